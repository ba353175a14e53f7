//! A spring that softens with the amplitude, by harmonic balance.

use num_complex::Complex64;

/// A resonator with the response D(u) = 1 + κa² − u² + ju/Q, where a is its amplitude over the
/// linear peak. A negative κ softens.
#[derive(Debug, Clone)]
pub(super) struct Spring {
    q: f64,
    kappa: f64,
    /// Squared amplitude of the last response. Of several solutions, the nearest one continues.
    squared: f64,
}

/// Number of squared amplitudes tried between zero and the highest one.
const SAMPLES: u32 = 400;
const BISECTIONS: u32 = 60;

impl Spring {
    /// A resonator with a quality factor, whose stiffness falls by this share at the linear peak.
    pub(super) const fn new(q: f64, softer_by: f64) -> Self {
        Self { q, kappa: -softer_by, squared: 0.0 }
    }

    /// The response of a linear resonator.
    pub(super) fn linear(q: f64, u: f64) -> Complex64 {
        Complex64::new(1.0 - u * u, u / q)
    }

    /// The stiffness at a frequency relative to the resonance, over that of a small amplitude, starting
    /// from the last response.
    pub(super) fn stiffness(&mut self, u: f64) -> f64 {
        self.response(u);
        1.0 + self.kappa * self.squared
    }

    /// The response at a frequency relative to the resonance, starting from the last response.
    pub(super) fn response(&mut self, u: f64) -> Complex64 {
        let linear = Self::linear(self.q, u);
        if self.kappa == 0.0 {
            return linear;
        }
        let peak = 1.0 / self.q;
        let excess = |s: f64| {
            let stiffness = linear.re + self.kappa * s;
            s * (stiffness * stiffness + linear.im * linear.im) - peak * peak
        };
        // Damping alone limits the amplitude, to 1/u of the linear peak.
        let highest = (1.0 / (u * u)).max(1.0) * 1.001;
        let at = |sample: u32| highest * f64::from(sample) / f64::from(SAMPLES);
        let last = self.squared;
        let crossings =
            (0..SAMPLES).filter(|&sample| excess(at(sample)) * excess(at(sample + 1)) <= 0.0);
        let nearest = crossings
            .map(|sample| bisect(excess, at(sample), at(sample + 1)))
            .min_by(|a, b| (a - last).abs().total_cmp(&(b - last).abs()));
        self.squared = nearest.unwrap_or(last);
        linear + self.kappa * self.squared
    }
}

/// The zero of a function between two arguments with opposite signs.
fn bisect(of: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    let sign = of(low).signum();
    for _ in 0..BISECTIONS {
        let middle = f64::midpoint(low, high);
        if of(middle).signum() == sign {
            low = middle;
        } else {
            high = middle;
        }
    }
    f64::midpoint(low, high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_amplitude_is_what_its_own_stiffness_gives() {
        for softening in [0.05, 0.5, 2.0] {
            let mut spring = Spring::new(30.0, softening / 30.0);
            for step in 0..400 {
                let u = 0.9 + 0.0005 * f64::from(step);
                let response = spring.response(u);
                let squared = (1.0 / response.norm() / 30.0).powi(2);
                assert!((squared - spring.squared).abs() < 1e-6, "{softening} {u}: {squared}");
            }
        }
    }

    /// A weakly softening spring is single-valued; a strongly softening one jumps at another
    /// frequency on the way back.
    #[test]
    fn only_a_strong_spring_has_a_memory() {
        for (softening, has_memory) in [(0.5, false), (3.0, true)] {
            let peak = |falling: bool| {
                let mut spring = Spring::new(30.0, softening / 30.0);
                let point = |step: u32| 0.85 + 0.0005 * f64::from(step);
                let mut points: Vec<f64> = (0..500).map(point).collect();
                if falling {
                    points.reverse();
                }
                let sizes = points.iter().map(|&u| (u, 1.0 / spring.response(u).norm()));
                sizes.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap().0
            };
            let differing = (peak(false) - peak(true)).abs();
            assert_eq!(differing > 0.002, has_memory, "{softening}: {differing}");
        }
    }
}
