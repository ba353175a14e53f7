//! Where the next surface lies, learnt from the surfaces found so far in a run.
//!
//! A surface is found away from where the rig file expects it, because the file is slightly wrong, no two
//! mountings of a sample are alike, and the screw of the stage is not even. For a tilt t the difference is
//! `s + (d + m)/cos t − p tan t + τ (D sin t − x)/cos² t`: errors of the heights s of the level surface
//! and d above the pivot, of the distance p from it, and of the zero τ of the rotary stage, and the excess
//! height m of this mounting. A Kalman filter learns them; the spread of mountings and that of touches of
//! one mounting are learnt with them.

use rig_model::{Deg, Geometry, Position};
use rig_protocol::Prompt;

/// Number of unknowns: s, d, p, τ, m.
const N: usize = 5;
const MOUNTING: usize = 4;
/// The surface tolerance of the rig file counts as this many standard deviations of a length of the bench.
const TOLERANCE_SIGMAS: f64 = 3.0;
/// Standard deviation of the zero of the rotary stage, °.
const ZERO_DEG: f64 = 0.5;
/// Standard deviation of one touch before any is known, as a part of the tolerance.
const TOUCH_PART: f64 = 0.05;
/// The least standard deviation of one touch, mm: a few steps of a drive.
const LEAST_TOUCH_MM: f64 = 0.003;
/// A spread that is assumed counts as this many observations.
const ASSUMED_COUNT: f64 = 2.0;
/// Drift of the bench from touch to touch, mm.
const DRIFT_MM: f64 = 0.002;

/// What a person has changed since the last surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Change {
    /// A sample was placed.
    Placed,
    /// The sensor was turned.
    Turned,
}

impl Change {
    /// What a person does who follows this prompt.
    pub(crate) const fn of(prompt: Prompt) -> Self {
        match prompt {
            Prompt::PlaceSample { .. } => Self::Placed,
            Prompt::TurnSensor { .. } => Self::Turned,
        }
    }
}

/// A variance, learnt from its expected squares.
#[derive(Debug, Clone, Copy)]
struct Spread {
    squares: f64,
    count: f64,
}

impl Spread {
    const fn assumed(variance: f64) -> Self {
        Self { squares: ASSUMED_COUNT * variance, count: ASSUMED_COUNT }
    }

    fn variance(self) -> f64 {
        self.squares / self.count
    }

    /// Takes one of several independent errors whose sum is `error`, of variance `total`: this one counts
    /// in it with the factor `slope`.
    fn learn(&mut self, error: f64, slope: f64, total: f64) {
        let variance = self.variance();
        let gain = variance * slope / total;
        self.squares += (gain * error).powi(2) + variance * (1.0 - gain * slope);
        self.count += 1.0;
    }
}

/// Where a surface is expected from what was learnt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Prediction {
    /// Height above where the rig file expects it, mm.
    pub(crate) above_mm: f64,
    /// Standard deviation, mm.
    pub(crate) sigma_mm: f64,
}

/// What the surfaces of a run say about the next one.
#[derive(Debug, Clone)]
pub(crate) struct Heights {
    mean: [f64; N],
    covariance: [[f64; N]; N],
    placed: Spread,
    turned: Spread,
    touch: Spread,
    change: Option<Change>,
    is_any_found: bool,
}

impl Heights {
    /// Before the first surface. The tolerance is that of the height of a surface, mm.
    pub(crate) fn new(tolerance_mm: f64) -> Self {
        let length = (tolerance_mm / TOLERANCE_SIGMAS).powi(2);
        let touch = (TOUCH_PART * tolerance_mm).max(LEAST_TOUCH_MM).powi(2);
        let variances = [length, length, length, ZERO_DEG.to_radians().powi(2), length];
        let mut covariance = [[0.0; N]; N];
        for (index, variance) in variances.into_iter().enumerate() {
            covariance[index][index] = variance;
        }
        Self {
            mean: [0.0; N],
            covariance,
            placed: Spread::assumed(length),
            turned: Spread::assumed(length),
            touch: Spread::assumed(touch),
            change: Some(Change::Placed),
            is_any_found: false,
        }
    }

    /// A person has changed the bench.
    pub(crate) fn changed(&mut self, change: Change) {
        let own = match change {
            Change::Placed => {
                self.mean[MOUNTING] = 0.0;
                for other in 0..N {
                    self.covariance[MOUNTING][other] = 0.0;
                    self.covariance[other][MOUNTING] = 0.0;
                }
                self.placed.variance()
            }
            // A sample that was placed since the last surface may lie anywhere, however the sensor stands.
            Change::Turned if self.change.is_some() => return,
            Change::Turned => self.turned.variance(),
        };
        self.covariance[MOUNTING][MOUNTING] += own;
        self.change = Some(change);
    }

    /// Where the surface lies at a tilt; `None` before the first one is found.
    pub(crate) fn predict(&self, geometry: &Geometry, tilt: Position<Deg>) -> Option<Prediction> {
        let (above_mm, variance) = self.expected(&row(geometry, tilt));
        self.is_any_found.then(|| Prediction { above_mm, sigma_mm: variance.sqrt() })
    }

    /// A surface was found this much above where the rig file expects it, mm.
    pub(crate) fn found(&mut self, geometry: &Geometry, tilt: Position<Deg>, above_mm: f64) {
        let row = row(geometry, tilt);
        let (expected_mm, variance) = self.expected(&row);
        let error = above_mm - expected_mm;
        match self.change.take() {
            Some(Change::Placed) => self.placed.learn(error, row[MOUNTING], variance),
            Some(Change::Turned) => self.turned.learn(error, row[MOUNTING], variance),
            None => self.touch.learn(error, 1.0, variance),
        }
        let along = self.along(&row);
        for one in 0..N {
            self.mean[one] += along[one] / variance * error;
            for other in 0..N {
                self.covariance[one][other] -= along[one] * along[other] / variance;
            }
        }
        self.covariance[MOUNTING][MOUNTING] += DRIFT_MM.powi(2);
        self.is_any_found = true;
    }

    /// The expected height of a row and the variance of a surface found there.
    fn expected(&self, row: &[f64; N]) -> (f64, f64) {
        let touch = self.touch.variance().max(LEAST_TOUCH_MM.powi(2));
        (dot(row, &self.mean), dot(row, &self.along(row)).max(0.0) + touch)
    }

    fn along(&self, row: &[f64; N]) -> [f64; N] {
        self.covariance.map(|line| dot(&line, row))
    }
}

fn dot(one: &[f64; N], other: &[f64; N]) -> f64 {
    one.iter().zip(other).map(|(one, other)| one * other).sum()
}

/// How much each unknown raises the surface at a tilt.
fn row(geometry: &Geometry, tilt: Position<Deg>) -> [f64; N] {
    let (sin, cos) = tilt.value().to_radians().sin_cos();
    let centre_mm = geometry.surface_above_pivot_mm + geometry.probe_radius_mm;
    let zero = (centre_mm * sin - geometry.probe_beside_pivot_mm) / cos.powi(2);
    [1.0, 1.0 / cos, -sin / cos, zero, 1.0 / cos]
}

#[cfg(test)]
mod tests {
    use rig_model::random::Stream;

    use super::*;

    fn geometry() -> Geometry {
        Geometry {
            surface: Position::new(10.0),
            surface_above_pivot_mm: 4.0,
            probe_beside_pivot_mm: 0.3,
            probe_radius_mm: 0.5,
            sample_half_width_mm: 20.0,
            surface_tolerance_mm: 0.5,
            pin_radius_mm: None,
        }
    }

    /// The bench of a run: geometry wrong by up to the third of the tolerance, mountings and touches that
    /// scatter, and a bench that drifts.
    struct Bench {
        truth: [f64; N],
        mounting_mm: f64,
        touch_mm: f64,
        drift_mm: f64,
    }

    /// The errors of the predictions of a run in standard deviations, and these, mm.
    fn play(bench: &Bench, seed: u64) -> Vec<(f64, f64)> {
        let mut stream = Stream::of_seed(seed);
        let (mut heights, mut truth) = (Heights::new(0.5), bench.truth);
        let mut predictions = Vec::new();
        for touch in 0..110 {
            if touch >= 60 || touch % 4 == 0 {
                let is_placed = touch % 8 == 0 || touch >= 60;
                heights.changed(if is_placed { Change::Placed } else { Change::Turned });
                if is_placed {
                    truth[MOUNTING] = bench.mounting_mm * stream.normal().clamp(-2.5, 2.5);
                }
            }
            truth[0] += bench.drift_mm;
            let tilt = Position::new(90.0 * stream.uniform() - 45.0);
            let scatter = bench.touch_mm * stream.normal();
            let found = dot(&row(&geometry(), tilt), &truth) + scatter;
            if let Some(Prediction { above_mm, sigma_mm }) = heights.predict(&geometry(), tilt) {
                predictions.push(((found - above_mm) / sigma_mm, sigma_mm));
            }
            heights.found(&geometry(), tilt, found);
        }
        predictions
    }

    #[test]
    fn a_surface_lies_within_four_standard_deviations_and_a_margin_of_where_it_was_predicted() {
        let benches = [
            ([0.03, 0.02, 0.02, 0.0005, 0.0], 0.06, 0.014, 0.0),
            ([0.15, -0.15, 0.15, 0.008, 0.0], 0.06, 0.014, 0.0),
            ([0.03, 0.02, 0.02, 0.0005, 0.0], 0.06, 0.014, 0.001),
            ([0.03, 0.02, 0.02, 0.0005, 0.0], 0.15, 0.03, -0.001),
            ([0.0; N], 0.0, 0.002, 0.0),
        ];
        for (truth, mounting_mm, touch_mm, drift_mm) in benches {
            let bench = Bench { truth, mounting_mm, touch_mm, drift_mm };
            let all: Vec<(f64, f64)> = (0..30).flat_map(|seed| play(&bench, seed)).collect();
            let early = all.iter().filter(|(sigmas, sigma)| 4.0 * sigma + 0.02 < sigmas * sigma);
            assert_eq!(early.count(), 0, "{truth:?}, {mounting_mm} mm");
            let square = all.iter().map(|(sigmas, _)| sigmas.powi(2)).sum::<f64>();
            let rms = (square / all.len() as f64).sqrt();
            assert!((0.05..1.1).contains(&rms), "{truth:?}, {mounting_mm} mm: {rms}");
        }
    }

    #[test]
    fn a_touch_of_a_known_mounting_is_predicted_as_well_as_touches_repeat() {
        let truth = [0.03, 0.02, 0.02, 0.0005, 0.0];
        let bench = Bench { truth, mounting_mm: 0.06, touch_mm: 0.014, drift_mm: 0.0 };
        let runs: Vec<Vec<(f64, f64)>> = (0..30).map(|seed| play(&bench, seed)).collect();
        // The last touches before the blind ones, whose mounting is known.
        let known = runs.iter().flat_map(|run| &run[56..59]).map(|(_, sigma_mm)| sigma_mm);
        let mean_mm = known.sum::<f64>() / 90.0;
        assert!((0.014..0.026).contains(&mean_mm), "{mean_mm}");
    }

    #[test]
    fn nothing_is_predicted_before_a_surface_is_found_and_little_after_one() {
        let mut heights = Heights::new(0.5);
        let tilt = Position::new(0.0);
        assert_eq!(heights.predict(&geometry(), tilt), None);
        heights.found(&geometry(), tilt, 0.1);
        let there = heights.predict(&geometry(), tilt).unwrap();
        let tilted = heights.predict(&geometry(), Position::new(45.0)).unwrap();
        assert!(there.sigma_mm < 0.05 && 0.1 < tilted.sigma_mm, "{there:?}, {tilted:?}");
        heights.changed(Change::Placed);
        assert!(heights.predict(&geometry(), tilt).unwrap().sigma_mm > 0.15);
    }
}
