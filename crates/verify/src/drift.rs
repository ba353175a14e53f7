//! How the free resonance drifts, learnt again from the references of a run: what a touch states of the drift since its
//! reference, and which reference is a jump.
//!
//! The resonance walks at random, and follows a rate that is forgotten in half an hour. The strengths of both are unknown:
//! each pair of strengths predicts every reference, and is weighted by how well it did.

/// Standard deviation of the walk in an hour, Hz, and its weight before the first reference, percent.
const WALKS: [(f64, f64); 13] = [
    (0.03, 8.0),
    (0.055, 11.0),
    (0.1, 13.0),
    (0.18, 13.0),
    (0.3, 13.0),
    (0.55, 11.0),
    (1.0, 9.0),
    (1.8, 7.0),
    (3.0, 5.0),
    (5.5, 4.0),
    (10.0, 3.0),
    (18.0, 2.0),
    (30.0, 1.0),
];
/// Standard deviation of the rate, Hz in an hour, and its weight before the first reference, percent.
const RATES: [(f64, f64); 3] = [(0.5, 70.0), (5.0, 25.0), (50.0, 5.0)];
const HOUR_S: f64 = 3600.0;
const FORGOTTEN_S: f64 = 1800.0;
/// A sensor that was turned may have another resonance by this, Hz.
const TURNED_HZ: f64 = 0.5;
/// A reference that is farther off than so many standard deviations is a jump, however probable.
pub(crate) const JUMP_SIGMAS: f64 = 5.0;
/// The weight of a pair at least.
const LEAST_WEIGHT: f64 = 1e-6;
/// An interval that holds 95 % of a normal distribution is this many standard deviations to each side.
const SIDE: f64 = 1.96;

/// A component of a mixture of normal distributions.
#[derive(Debug, Clone, Copy)]
struct Component {
    weight: f64,
    mean_hz: f64,
    sigma_hz: f64,
}

/// What one pair of strengths says of the resonance.
#[derive(Debug, Clone, Copy)]
struct Pair {
    prior: f64,
    weight: f64,
    /// Variance that the walk adds, Hz² in a second, and the variance of a rate of which nothing is known, Hz²/s².
    walk: f64,
    rate: f64,
    /// Resonance and rate: means, and covariance.
    mean: [f64; 2],
    covariance: [[f64; 2]; 2],
}

impl Pair {
    fn new((walk_hz, of_walk): (f64, f64), (rate_hz, of_rate): (f64, f64)) -> Self {
        let weight = of_walk * of_rate / 1e4;
        let rate = (rate_hz / HOUR_S).powi(2);
        let (walk, covariance) = (walk_hz.powi(2) / HOUR_S, [[0.0, 0.0], [0.0, rate]]);
        Self { prior: weight, weight, walk, rate, mean: [0.0; 2], covariance }
    }

    /// After some seconds, without a measurement.
    fn later(&self, seconds: f64) -> Self {
        let kept = (-seconds / FORGOTTEN_S).exp();
        let forgotten = 1.0 - kept;
        let gathered_s = FORGOTTEN_S * forgotten;
        // An Ornstein-Uhlenbeck rate from zero on, and its integral.
        let of_rate = self.rate * (1.0 - kept * kept);
        let of_both = self.rate * gathered_s * forgotten;
        let of_value =
            self.rate * FORGOTTEN_S * (2.0 * (seconds - gathered_s) - gathered_s * forgotten);
        let step = [[1.0, gathered_s], [0.0, kept]];
        let added = [[of_value.max(0.0) + self.walk * seconds, of_both], [of_both, of_rate]];
        let mut covariance = added;
        for (i, row) in covariance.iter_mut().enumerate() {
            for (j, sum) in row.iter_mut().enumerate() {
                for (k, of) in self.covariance.iter().enumerate() {
                    for (l, of) in of.iter().enumerate() {
                        *sum += step[i][k] * of * step[j][l];
                    }
                }
            }
        }
        let mean = step.map(|row| row[0] * self.mean[0] + row[1] * self.mean[1]);
        Self { mean, covariance, ..*self }
    }

    fn component(&self, sigma_hz: f64) -> Component {
        let sigma_hz = self.covariance[0][0].max(0.0).sqrt().hypot(sigma_hz);
        Component { weight: self.weight, mean_hz: self.mean[0], sigma_hz }
    }

    /// Nothing that was measured before says where the resonance is now.
    fn begin(&mut self, hz: f64, sigma_hz: f64) {
        self.mean[0] = hz;
        let rate = self.covariance[1][1];
        self.covariance = [[sigma_hz * sigma_hz, 0.0], [0.0, rate]];
    }

    fn learn(&mut self, hz: f64, sigma_hz: f64) {
        let Component { mean_hz, sigma_hz: expected_hz, .. } = self.component(sigma_hz);
        let off = (hz - mean_hz) / expected_hz;
        self.weight *= (-0.5 * off * off).exp() / expected_hz;
        let with_value = self.covariance.map(|row| row[0] / expected_hz);
        for i in 0..2 {
            self.mean[i] += with_value[i] * off;
            for j in 0..2 {
                self.covariance[i][j] -= with_value[i] * with_value[j];
            }
        }
    }
}

/// How far a reference is from where it was expected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Unexpected {
    /// How probable a resonance is that is as far off.
    pub(crate) probability: f64,
    /// Off the mean, Hz, and its standard deviation, Hz.
    pub(crate) off_hz: f64,
    pub(crate) sigma_hz: f64,
}

impl Unexpected {
    /// Whether it is less probable than this, or farther off than so many standard deviations that touches state of the
    /// drift.
    pub(crate) fn is_jump(&self, probability: f64, sigmas: f64) -> bool {
        self.probability < probability || self.off_hz.abs() > sigmas * self.sigma_hz
    }
}

/// What the references so far say.
#[derive(Debug)]
pub(crate) struct Drift {
    pairs: Vec<Pair>,
    /// The moment of the last reference, s.
    at_s: Option<f64>,
}

impl Default for Drift {
    fn default() -> Self {
        let pair = |walk| RATES.map(|rate| Pair::new(walk, rate));
        Self { pairs: WALKS.into_iter().flat_map(pair).collect(), at_s: None }
    }
}

impl Drift {
    /// Takes in the resonance and the standard deviation, Hz, of a reference. It is a jump if it is less probable than
    /// `jump`. `None` for the first one.
    pub(crate) fn reference(
        &mut self,
        at_s: f64,
        (hz, sigma_hz): (f64, f64),
        jump: f64,
    ) -> Option<Unexpected> {
        let since_s = self.at_s.replace(at_s).map(|before_s| at_s - before_s);
        for pair in &mut self.pairs {
            *pair = pair.later(since_s.unwrap_or_default());
        }
        let mixture: Vec<Component> =
            self.pairs.iter().map(|pair| pair.component(sigma_hz)).collect();
        let unexpected = since_s.map(|_| {
            let mean_hz = mean(&mixture, |component| component.mean_hz);
            let (probability, sigma_hz) = (farther(&mixture, hz), side(&mixture, mean_hz) / SIDE);
            Unexpected { probability, off_hz: hz - mean_hz, sigma_hz }
        });
        let is_jump = unexpected.is_some_and(|of| of.probability < jump);
        for pair in &mut self.pairs {
            if is_jump || unexpected.is_none() {
                pair.begin(hz, sigma_hz);
            } else {
                pair.learn(hz, sigma_hz);
            }
        }
        let all: f64 = self.pairs.iter().map(|pair| pair.weight).sum();
        for pair in &mut self.pairs {
            pair.weight = (pair.weight / all).max(LEAST_WEIGHT);
            if is_jump {
                pair.weight = 0.5 * (pair.weight + pair.prior);
            }
        }
        unexpected
    }

    /// A person turned the sensor.
    pub(crate) fn turned(&mut self) {
        for pair in &mut self.pairs {
            pair.covariance[0][0] += TURNED_HZ * TURNED_HZ;
        }
    }

    /// The standard deviation of what the resonance has moved by since the last reference, Hz.
    pub(crate) fn sigma_hz(&self, now_s: f64) -> f64 {
        let Some(at_s) = self.at_s else { return 0.0 };
        let moved = |pair: &Pair| {
            let rate = pair.covariance[1][1];
            let now =
                Pair { mean: [0.0, pair.mean[1]], covariance: [[0.0, 0.0], [0.0, rate]], ..*pair };
            now.later(now_s - at_s).component(0.0)
        };
        side(&self.pairs.iter().map(moved).collect::<Vec<Component>>(), 0.0) / SIDE
    }
}

fn mean(mixture: &[Component], of: impl Fn(&Component) -> f64) -> f64 {
    let all: f64 = mixture.iter().map(|component| component.weight).sum();
    mixture.iter().map(|component| component.weight * of(component)).sum::<f64>() / all
}

/// How probable a value is that is as far from the mean of its component, or farther.
fn farther(mixture: &[Component], hz: f64) -> f64 {
    mean(mixture, |component| 2.0 * above(((hz - component.mean_hz) / component.sigma_hz).abs()))
}

/// Half of the interval around a value that holds 95 %.
fn side(mixture: &[Component], hz: f64) -> f64 {
    let outside = |half_hz: f64| {
        mean(mixture, |component| {
            let off_hz = component.mean_hz - hz;
            above((half_hz - off_hz) / component.sigma_hz)
                + above((half_hz + off_hz) / component.sigma_hz)
        })
    };
    let widest = |component: &Component| (component.mean_hz - hz).abs() + 4.0 * component.sigma_hz;
    let mut within = 0.0..mixture.iter().map(widest).fold(0.0, f64::max);
    for _ in 0..40 {
        let middle = 0.5 * (within.start + within.end);
        if outside(middle) > 0.05 {
            within.start = middle;
        } else {
            within.end = middle;
        }
    }
    within.end
}

/// The part of a standard normal distribution above `x`: its series, or its continued fraction far from the middle.
fn above(x: f64) -> f64 {
    let density = (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
    if x.abs() > 4.0 {
        let fraction = || (1..40).rev().fold(x.abs(), |rest, n| x.abs() + f64::from(n) / rest);
        let far = if density > 0.0 { density / fraction() } else { 0.0 };
        return if x > 0.0 { far } else { 1.0 - far };
    }
    let (mut term, mut sum) = (x, x);
    for n in 1..60 {
        term *= x * x / f64::from(2 * n + 1);
        let before = sum;
        sum += term;
        // From the eighth on, each term is smaller than the one before.
        if n > 8 && sum == before {
            break;
        }
    }
    0.5 - density * sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_normal_distribution_is_that_of_the_tables() {
        for (x, expected) in
            [(0.0, 0.5), (1.0, 0.158_655_254), (1.96, 0.024_997_895), (-2.0, 0.977_249_868)]
        {
            assert!((above(x) - expected).abs() < 1e-9, "{x}");
        }
        for (x, expected) in [(3.999, 3.180_5e-5), (4.001, 3.153_8e-5), (6.0, 9.865_9e-10)] {
            assert!((above(x) / expected - 1.0).abs() < 1e-4, "{x}: {}", above(x));
        }
    }

    #[test]
    fn two_short_steps_are_one_long_step() {
        let mut pair = Pair::new(WALKS[5], RATES[1]);
        pair.begin(140.0, 0.02);
        pair.learn(140.1, 0.03);
        let (once, twice) = (pair.later(900.0), pair.later(350.0).later(550.0));
        for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let (one, two) = (once.covariance[i][j], twice.covariance[i][j]);
            assert!((one / two - 1.0).abs() < 1e-9, "{one} {two}");
        }
        assert!((once.mean[0] - twice.mean[0]).abs() < 1e-12);
    }

    #[test]
    fn a_leap_is_a_jump_and_a_walk_is_none() {
        const JUMP: f64 = 1e-4;
        let mut drift = Drift::default();
        assert_eq!(drift.reference(0.0, (140.0, 0.02), JUMP), None);
        for n in 1..20 {
            let hz = 140.0 + 0.01 * f64::from(n % 3);
            let of =
                drift.reference(60.0 * f64::from(n), (hz, 0.02), JUMP).expect("an expectation");
            assert!(of.probability > 0.1, "{n}: {of:?}");
        }
        let before = drift.sigma_hz(1200.0);
        assert!((0.005..0.1).contains(&before), "{before}");
        let of = drift.reference(1200.0, (141.0, 0.02), JUMP).expect("an expectation");
        assert!(of.probability < JUMP, "{of:?}");
        assert!((of.off_hz - 0.99).abs() < 0.02 && (0.01..0.1).contains(&of.sigma_hz), "{of:?}");
        assert!(drift.sigma_hz(1260.0) > before);
        drift.turned();
        let of = drift.reference(1260.0, (141.9, 0.02), JUMP).expect("an expectation");
        assert!(of.probability > JUMP, "{of:?}");
    }
}
