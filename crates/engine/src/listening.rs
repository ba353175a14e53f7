//! When a reading at the no-load resonance is due: the vibration of the sensor must have followed the
//! last change of frequency and of contact. The time that has passed since then counts, whatever the rig
//! did in it.

use rig_model::{DriveLevel, RigTime, SweepPoint};
use rig_protocol::Plan;
use rig_resonance::Resonance;

use crate::{
    Operation,
    contact_sense::{TEST_LINEWIDTHS, response::ring_time_constant_s},
};

/// The reading of the self-test waits for this many, to e⁻³ = 5 % of the vibration at the
/// resonance, which is within what the self-test allows. The vibration there is three times what is read at the
/// frequency of the test, so that the quality factor of a loose sweep does not do: 10 % were left where it stated 51
/// instead of 66, and the test failed.
const TEST_TIME_CONSTANTS: f64 = 3.0;

/// After a change of frequency, or when the probe has left the sample, the vibration decays for this many
/// time constants, to e⁻⁵ = 0.7 % of the change.
const SETTLED_TIME_CONSTANTS: f64 = 5.0;

/// After the probe has left the sample, a reading after this many time constants has 5 % of the change left,
/// which makes a clear probe seem to touch rather than the other way round. If it shows a clear probe, the
/// rest of the decay need not be awaited.
const EARLY_TIME_CONSTANTS: f64 = 3.0;

/// The baseline waits for this many, to e⁻⁴ = 1.8 % of a contact: a fifth of the usual threshold, which moves a
/// surface by less than a micrometre.
const BASELINE_TIME_CONSTANTS: f64 = 4.0;

/// A reading integrates as many cycles as make the standard deviation of each of its parts this many times
/// smaller than the contact threshold. Baseline and reading then differ by more in one of 10⁷ cases without a
/// contact.
const NOISES_OF_THRESHOLD: f64 = 8.0;

/// No reading of the contact sense integrates more cycles, unless the protocol asks for more; a threshold that needs
/// more is too close to the noise.
pub(crate) const CYCLES_MAX: u32 = 200;

/// Cycles that a reading must integrate so that noise is no contact.
pub(crate) fn cycles_needed(no_load: &Resonance, contact_threshold: f64) -> f64 {
    10.0 * (NOISES_OF_THRESHOLD * no_load.noise_at_ten_cycles / contact_threshold).powi(2)
}

/// The decay of the vibration that a contact has left.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Decay {
    /// Most of it: enough to show that the probe is clear.
    Early,
    /// All of it.
    Whole,
}

/// What drives the sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Driven {
    /// The frequency as it was asked for, Hz. The analyzer rounds it, and a frequency that differs by the
    /// last digit begins at another phase.
    pub(crate) frequency_hz: f64,
    /// Since when.
    pub(crate) since: RigTime,
}

/// The readings of a touch at the no-load resonance.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Listening<'a> {
    pub(crate) now: RigTime,
    pub(crate) no_load: &'a Resonance,
    pub(crate) plan: &'a Plan,
    /// The drive of the sensor, if it is known.
    pub(crate) driven: Option<Driven>,
}

impl Listening<'_> {
    /// Reads the impedance of the clear probe at the no-load resonance, and goes on to the frequency of
    /// the self-test, which the vibration follows while the sample turns.
    pub(crate) fn baseline(&self) -> Operation {
        let settle_s = self.due_s(BASELINE_TIME_CONSTANTS, self.driven_since(0.0));
        self.measure(vec![self.point(0.0, settle_s), self.change_to(TEST_LINEWIDTHS)])
    }

    /// Reads the impedance of the clear probe at the frequency of the self-test, and goes back to the
    /// no-load resonance, which the vibration follows on the way down.
    pub(crate) fn test(&self) -> Operation {
        self.measure(vec![self.point(TEST_LINEWIDTHS, self.test_due_s()), self.change_to(0.0)])
    }

    /// Reads the self-test and then the baseline, in one operation.
    pub(crate) fn both(&self) -> Operation {
        let test_s = self.test_due_s();
        let baseline_s = self.due_s(SETTLED_TIME_CONSTANTS, None);
        self.measure(vec![self.point(TEST_LINEWIDTHS, test_s), self.point(0.0, baseline_s)])
    }

    /// Drives the sensor at the no-load resonance, which the vibration follows from now on.
    pub(crate) fn drive(&self) -> Operation {
        self.measure(vec![self.change_to(0.0)])
    }

    /// Reads the impedance at the no-load resonance, where a contact changes it most. `left` is when the
    /// probe left the sample, if it did before this reading.
    pub(crate) fn contact(&self, left: Option<RigTime>, decay: Decay) -> Operation {
        let time_constants = match decay {
            Decay::Early => EARLY_TIME_CONSTANTS,
            Decay::Whole => SETTLED_TIME_CONSTANTS,
        };
        let driven_s = self.due_s(time_constants, self.driven_since(0.0));
        let decay_s = left.map_or(0.0, |left| self.due_s(time_constants, Some(left)));
        let settle_s = self.plan.touch.approach.settle_s.max(driven_s).max(decay_s);
        self.measure(vec![self.point(0.0, settle_s)])
    }

    /// One reading at the no-load resonance in a stream of them, and the level.
    pub(crate) fn stream(&self) -> (SweepPoint, DriveLevel) {
        (self.point(0.0, 0.0), self.plan.contact_sweep.level)
    }

    /// The rest of the ring-down before a stream of readings, s.
    pub(crate) fn stream_due_s(&self) -> f64 {
        self.due_s(BASELINE_TIME_CONSTANTS, self.driven_since(0.0))
    }

    /// Since when the sensor has been driven this many linewidths below the no-load resonance.
    fn driven_since(&self, linewidths: f64) -> Option<RigTime> {
        let frequency_hz = self.frequency_hz(linewidths);
        self.driven.filter(|driven| driven.frequency_hz == frequency_hz).map(|driven| driven.since)
    }

    /// The rest of this many time constants of the ring-down since then, s.
    fn due_s(&self, time_constants: f64, since: Option<RigTime>) -> f64 {
        let time_constant_s = self.no_load.q / (std::f64::consts::PI * self.no_load.resonance_hz);
        self.rest_s(time_constants * time_constant_s, since)
    }

    /// The rest of the ring-down before the reading of the self-test, s.
    fn test_due_s(&self) -> f64 {
        let ring_s = TEST_TIME_CONSTANTS * ring_time_constant_s(self.no_load);
        self.rest_s(ring_s, self.driven_since(TEST_LINEWIDTHS))
    }

    /// The rest of a time that began then, or begins now, s.
    fn rest_s(&self, time_s: f64, since: Option<RigTime>) -> f64 {
        let passed_s = since.map_or(0.0, |since| self.now.since(since).as_secs_f64());
        (time_s - passed_s).max(0.0)
    }

    /// A frequency this many linewidths below the no-load resonance, or the end of the no-load window, Hz.
    fn frequency_hz(&self, linewidths: f64) -> f64 {
        let frequency_hz = self.no_load.resonance_hz * (1.0 - linewidths / self.no_load.q);
        frequency_hz.max(self.plan.no_load_sweep.window.min_hz)
    }

    fn point(&self, linewidths: f64, settle_s: f64) -> SweepPoint {
        let frequency_hz = self.frequency_hz(linewidths);
        let approach = &self.plan.touch.approach;
        let needed = cycles_needed(self.no_load, approach.contact_threshold);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "of 0 to 200")]
        let needed = needed.clamp(0.0, CYCLES_MAX.into()).ceil() as u32;
        let cycles = needed.max(approach.cycles);
        SweepPoint { frequency_hz, settle_s, cycles }
    }

    /// The shortest reading at a frequency, which only sets it.
    fn change_to(&self, linewidths: f64) -> SweepPoint {
        SweepPoint { cycles: 1, ..self.point(linewidths, 0.0) }
    }

    fn measure(&self, points: Vec<SweepPoint>) -> Operation {
        Operation::Measure { points, level: self.plan.contact_sweep.level }
    }
}
