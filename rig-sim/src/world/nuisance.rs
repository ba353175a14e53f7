//! Disturbances of a measurement on the bench, unknown to every estimator.

use rig_model::RigTime;

use rig_model::random::{Stream, normal_at};

/// The sizes of all nuisances of a scene. Zero switches one off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nuisances {
    /// Standard deviation of the height of the surface from one mounting to the next, mm.
    pub mounting_mm: f64,
    /// Standard deviation of the slope of the surface from one touched point to the next, degrees.
    pub slope_deg: f64,
    /// Relative standard deviation of the stiffness from one touched point to the next.
    pub stiffness_rel: f64,
    /// Standard deviation of the repeatable error of the linear screw, mm.
    pub screw_mm: f64,
    /// Distance over which the error of the screw changes, mm.
    pub screw_length_mm: f64,
    /// Play of the linear stage, mm.
    pub linear_backlash_mm: f64,
    /// Play of the rotary stage, degrees.
    pub rotary_backlash_deg: f64,
    /// Standard deviation of the place at which a drive that homes finds its zero, of the linear stage, mm.
    pub homing_mm: f64,
    /// The same of the rotary stage, degrees.
    pub homing_deg: f64,
    /// Standard deviation of the position that an encoder reports, in steps of its drive.
    pub encoder_steps: f64,
    /// Age of a position that a drive reports, s.
    pub position_age_s: f64,
    /// The drift of the free resonance.
    pub drift: Drift,
    /// By how much the free resonance is higher for a square volt of the drive, Hz/V²; negative for a sensor that softens.
    pub level_hz_per_v2: f64,
    /// Relative standard deviation of each part of an impedance integrated over ten cycles.
    pub impedance_rel: f64,
    /// Phase error of the analyzer, degrees.
    pub analyzer_phase_deg: f64,
    /// Change of the static capacitance for each factor e of the frequency, as a part of it: a dielectric of constant phase
    /// has -2/π of its loss angle. Beside 140 Hz it follows this power of the frequency.
    pub capacitance_slope: f64,
    /// Time of the analyzer for each command, s: a client that times its drive does not know it.
    pub analyzer_command_s: f64,
    /// How far soft debris, as dried gel, hangs below the tip of the probe, mm. The probe feels it before the sample, until
    /// it is pressed flat.
    pub debris_mm: f64,
}

impl Nuisances {
    /// A bench without nuisances.
    pub const NONE: Self = Self {
        mounting_mm: 0.0,
        slope_deg: 0.0,
        stiffness_rel: 0.0,
        screw_mm: 0.0,
        screw_length_mm: 1.0,
        linear_backlash_mm: 0.0,
        rotary_backlash_deg: 0.0,
        homing_mm: 0.0,
        homing_deg: 0.0,
        encoder_steps: 0.0,
        position_age_s: 0.0,
        drift: Drift { warm_up_hz: 0.0, warm_up_s: 1.0, walk_hz_per_sqrt_hour: 0.0 },
        level_hz_per_v2: 0.0,
        impedance_rel: 0.0,
        analyzer_phase_deg: 0.0,
        capacitance_slope: 0.0,
        analyzer_command_s: 0.0,
        debris_mm: 0.0,
    };
}

/// Drift of the free resonance: a decaying warm-up and a random walk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drift {
    /// Shift of the resonance at the end of the warm-up, Hz.
    pub warm_up_hz: f64,
    /// Time constant of the warm-up, s.
    pub warm_up_s: f64,
    /// Standard deviation of the walk after one hour, Hz.
    pub walk_hz_per_sqrt_hour: f64,
}

/// The walk moves on a grid of this many seconds, straight in between.
const WALK_STEP_S: f64 = 10.0;

/// The drift as it happens in one run.
#[derive(Debug, Clone)]
pub(super) struct DriftPath {
    drift: Drift,
    stream: Stream,
    /// The walk so far, one value a step.
    walk_hz: Vec<f64>,
    /// The sum of all knocks at the sensor, Hz.
    knocked_hz: f64,
}

impl DriftPath {
    pub(super) fn new(drift: Drift, stream: Stream) -> Self {
        Self { drift, stream, walk_hz: vec![0.0], knocked_hz: 0.0 }
    }

    /// The resonance jumps by this, Hz.
    pub(super) fn knock(&mut self, by_hz: f64) {
        self.knocked_hz += by_hz;
    }

    /// Drift of the free resonance until `now`, Hz.
    pub(super) fn shift_hz(&mut self, now: RigTime) -> f64 {
        let elapsed_s = now.as_seconds();
        let Drift { warm_up_hz, warm_up_s, walk_hz_per_sqrt_hour } = self.drift;
        let warm_up = warm_up_hz * (1.0 - (-elapsed_s / warm_up_s).exp()) + self.knocked_hz;
        if walk_hz_per_sqrt_hour == 0.0 {
            return warm_up;
        }
        let cell = (elapsed_s / WALK_STEP_S).floor();
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "time is positive"
        )]
        let index = cell as usize;
        let sigma = walk_hz_per_sqrt_hour * (WALK_STEP_S / 3600.0).sqrt();
        while self.walk_hz.len() < index + 2 {
            let last = self.walk_hz[self.walk_hz.len() - 1];
            self.walk_hz.push(last + sigma * self.stream.normal());
        }
        let part = elapsed_s / WALK_STEP_S - cell;
        warm_up + (1.0 - part) * self.walk_hz[index] + part * self.walk_hz[index + 1]
    }
}

/// A point of a sample under the probe: the mounting, and the pose in steps of this many degrees.
const POINT_DEG: f64 = 2.0;

/// The deviations of one touched point from the sample's nominal properties.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Point {
    pub(super) stiffness_factor: f64,
    pub(super) slope_deg: f64,
}

impl Point {
    /// The point under the probe. Turning the sample by a few degrees brings another point there.
    pub(super) fn of(
        nuisances: &Nuisances,
        seed: u64,
        mounting: u64,
        tilt_deg: f64,
        turn: u64,
    ) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "a tilt is a few degrees")]
        let tilt = (tilt_deg / POINT_DEG).round() as i64;
        let pose = tilt.cast_unsigned() ^ (turn << 32);
        let draw = |what| normal_at(seed, [what, mounting, pose]);
        Self {
            // A sample is never softer than a third of its nominal value, however the dice fall.
            stiffness_factor: (1.0 + nuisances.stiffness_rel * draw(1)).max(1.0 / 3.0),
            slope_deg: nuisances.slope_deg * draw(2),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(seconds: f64) -> RigTime {
        RigTime::ZERO + std::time::Duration::from_secs_f64(seconds)
    }

    #[test]
    fn the_drift_is_the_same_however_often_it_is_looked_at() {
        let drift = Drift { warm_up_hz: 0.3, warm_up_s: 3600.0, walk_hz_per_sqrt_hour: 0.1 };
        let mut once = DriftPath::new(drift, Stream::new(5, 6));
        let mut often = once.clone();
        for second in 0..3600 {
            often.shift_hz(at(f64::from(second)));
        }
        assert_eq!(once.shift_hz(at(7213.7)), often.shift_hz(at(7213.7)));
    }

    #[test]
    fn the_walk_spreads_as_its_number_says_and_the_warm_up_ends() {
        let drift = Drift { warm_up_hz: 0.0, warm_up_s: 1.0, walk_hz_per_sqrt_hour: 0.2 };
        let n = 400;
        let square: f64 = (0..n)
            .map(|seed| DriftPath::new(drift, Stream::new(seed, 0)).shift_hz(at(4.0 * 3600.0)))
            .map(|shift| shift * shift)
            .sum();
        let sigma = (square / n as f64).sqrt();
        assert!((sigma - 0.4).abs() < 4.0 * 0.4 / (2.0 * n as f64).sqrt(), "{sigma}");
        let warm = Drift { warm_up_hz: 0.3, warm_up_s: 600.0, walk_hz_per_sqrt_hour: 0.0 };
        let mut path = DriftPath::new(warm, Stream::new(0, 0));
        assert_eq!(path.shift_hz(RigTime::ZERO), 0.0);
        assert!((path.shift_hz(at(600.0)) - 0.3 * (1.0 - (-1.0_f64).exp())).abs() < 1e-12);
        assert!((path.shift_hz(at(1e5)) - 0.3).abs() < 1e-9);
    }

    #[test]
    fn a_point_is_found_again_and_another_mounting_or_tilt_is_another_point() {
        let nuisances = Nuisances { stiffness_rel: 0.03, slope_deg: 1.0, ..Nuisances::NONE };
        let point = |mounting, tilt| Point::of(&nuisances, 1, mounting, tilt, 0);
        assert_eq!(point(1, 30.0), point(1, 30.3));
        assert_ne!(point(1, 30.0), point(2, 30.0));
        assert_ne!(point(1, 30.0), point(1, -30.0));
        assert_ne!(point(1, 30.0), Point::of(&nuisances, 1, 1, 30.0, 1));
    }
}
