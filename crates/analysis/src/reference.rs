//! What the shifts of touches have in common by their references.
//!
//! ```text
//!   error of a reference = (1 − a) e₁ + a e₂ + a W(T) − W(t)
//! ```
//!
//! e₁ and e₂ are the errors of the sweeps before and after the touch, a the weight of the second one, and W the random walk of
//! the free resonance since the first one: until the touch at t, and until the second sweep at T. Most touches have one sweep
//! alone, and a is zero. Touches with a sweep in common share its error, and those of one walk share it up to the earlier one.

/// The reference of a touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reference {
    /// Number of the sweep before the touch.
    pub sweep: u64,
    /// Standard deviation of its resonance, Hz.
    pub sigma_hz: f64,
    /// Standard deviation of the drift since this sweep, Hz.
    pub drift_sigma_hz: f64,
    /// The sweep after the touch, if the reference lies between both.
    pub next: Option<NextSweep>,
}

/// The sweep after a touch whose reference lies between two.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NextSweep {
    /// Its number.
    pub sweep: u64,
    /// Standard deviation of its resonance, Hz.
    pub sigma_hz: f64,
    /// Its weight in the reference, 0 to 1.
    pub weight: f64,
    /// Time from the sweep before to the touch, s.
    pub since_s: f64,
    /// Time from the touch to this sweep, s.
    pub until_s: f64,
}

impl Reference {
    /// The covariance of the shifts of two touches by their references, Hz².
    pub fn covariance_hz2(&self, other: &Self) -> f64 {
        let parts = |one: &Self| {
            let next = one.next.map_or((one.sweep, 0.0), |next| (next.sweep, next.weight));
            let of_next_hz = next.1 * one.next.map_or(0.0, |next| next.sigma_hz);
            [(one.sweep, (1.0 - next.1) * one.sigma_hz), (next.0, of_next_hz)]
        };
        let mut covariance_hz2 = self.drift_covariance_hz2(other);
        for (sweep, sigma_hz) in parts(self) {
            for (other_sweep, other_sigma_hz) in parts(other) {
                covariance_hz2 +=
                    if sweep == other_sweep { sigma_hz * other_sigma_hz } else { 0.0 };
            }
        }
        covariance_hz2
    }

    /// The part of the drift. Walks between different sweeps have nothing in common.
    fn drift_covariance_hz2(&self, other: &Self) -> f64 {
        if self.sweep != other.sweep {
            return 0.0;
        }
        match (self.next, other.next) {
            (None, None) => self.drift_sigma_hz.min(other.drift_sigma_hz).powi(2),
            (Some(next), Some(other_next)) if next.sweep == other_next.sweep => {
                let root_per_s =
                    |one: &Self, next: &NextSweep| one.drift_sigma_hz / next.since_s.sqrt();
                let whole_s = next.since_s + next.until_s;
                let (a, b) = (next.weight, other_next.weight);
                let walked_s = next.since_s.min(other_next.since_s)
                    - a * other_next.since_s
                    - b * next.since_s
                    + a * b * whole_s;
                root_per_s(self, &next) * root_per_s(other, &other_next) * walked_s
            }
            _ => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    fn after(sweep: u64, drift_sigma_hz: f64) -> Reference {
        Reference { sweep, sigma_hz: 0.1, drift_sigma_hz, next: None }
    }

    #[test]
    fn touches_share_the_sweep_and_the_walk_up_to_the_earlier_one() {
        let covariance = after(1, 0.2).covariance_hz2(&after(1, 0.3));
        assert!((covariance - (0.01 + 0.04)).abs() < 1e-15, "{covariance}");
        assert_eq!(after(1, 0.2).covariance_hz2(&after(2, 0.2)), 0.0);
    }

    /// 20,000 walks with their sweeps: the second reference is between two, of which the third touch has the later one alone.
    #[test]
    fn the_covariance_is_that_of_drawn_walks() {
        const DRAWS: u32 = 20_000;
        let (per_s, sigmas_hz, whole_s) = (0.04_f64, [0.3, 0.2], 8.0);
        // The time of each touch and the weight of the second sweep in its reference.
        let between = [(2.0, 0.4), (5.0, 0.7)];
        let reference = |(since_s, weight): (f64, f64)| Reference {
            sweep: 1,
            sigma_hz: sigmas_hz[0],
            drift_sigma_hz: (per_s * since_s).sqrt(),
            next: Some(NextSweep {
                sweep: 2,
                sigma_hz: sigmas_hz[1],
                weight,
                since_s,
                until_s: whole_s - since_s,
            }),
        };
        let last = Reference {
            sweep: 2,
            sigma_hz: sigmas_hz[1],
            drift_sigma_hz: (per_s * 3.0).sqrt(),
            next: None,
        };
        let all = [reference(between[0]), reference(between[1]), last];
        let mut random = Pcg64Mcg::seed_from_u64(170);
        // Box and Muller; the first is never zero.
        let mut normal = || {
            let [a, b] = [0, 1].map(|_| (random.next_u64() as f64 + 1.0) / 2.0_f64.powi(64));
            (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
        };
        let mut sums = [[0.0; 3]; 3];
        for _ in 0..DRAWS {
            let mut step = |seconds: f64| (per_s * seconds).sqrt() * normal();
            let steps = [step(2.0), step(3.0), step(3.0), step(3.0)];
            let whole: f64 = steps[..3].iter().sum();
            let errors = sigmas_hz.map(|sigma_hz| sigma_hz * normal());
            let walked = [steps[0], steps[0] + steps[1]];
            let of = |index: usize| {
                let weight = between[index].1;
                (1.0 - weight) * errors[0] + weight * (errors[1] + whole) - walked[index]
            };
            let found = [of(0), of(1), errors[1] - steps[3]];
            for (row, a) in sums.iter_mut().zip(found) {
                row.iter_mut().zip(found).for_each(|(sum, b)| *sum += a * b);
            }
        }
        for (a, row) in all.iter().zip(sums) {
            for (b, sum) in all.iter().zip(row) {
                let (drawn, stated) = (sum / f64::from(DRAWS), a.covariance_hz2(b));
                assert!((drawn - stated).abs() < 0.006, "{drawn}, stated {stated}");
            }
        }
    }
}
