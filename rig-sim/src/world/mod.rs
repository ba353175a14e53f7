//! The physical bench: two stages, a sample, a sensor, and what befalls them.
//!
//! It is deterministic: the same seed and the same commands at the same times give the same bytes.
//! Time only ever comes in as an argument. Nothing here knows how it is commanded; that is the
//! devices' business.

mod motion;
mod nuisance;
mod place;
mod sensor;
mod stage;

use std::fmt;

use num_complex::Complex64;
use rig_contact::{Circuit, SensorError, TissueError};
use rig_model::{Orientation, RigTime};

pub use self::{
    motion::Profile,
    nuisance::{Drift, Nuisances},
    place::Place,
    sensor::SensorScene,
    stage::{Drivetrain, Stage},
};
use self::{
    nuisance::{DriftPath, Point},
    sensor::{SensorModel, Touched},
};
use crate::{
    clock::after,
    plant::{NotRinging, Plant},
    random::{Stream, normal_at},
};

/// Everything that a world is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// What it is called.
    pub name: String,
    /// Decides all that is left to chance.
    pub seed: u64,
    /// The sensor.
    pub sensor: SensorScene,
    /// What there is to touch.
    pub samples: Vec<Sample>,
    /// Where things are.
    pub place: Place,
    /// The stage that carries the sensor, in mm.
    pub linear: Mechanics,
    /// The stage that tilts the sample, in degrees.
    pub rotary: Mechanics,
    /// How the sensor is mounted at first.
    pub orientation: Orientation,
    /// What disturbs.
    pub nuisances: Nuisances,
}

/// What a stage is made of, in the unit of its axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mechanics {
    /// Where it stands at first.
    pub start: f64,
    /// Where its limit switches are: the lower and the upper one.
    pub travel: (f64, f64),
}

/// Which stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum AxisId {
    /// The vertical stage that carries the sensor.
    Linear,
    /// The stage that tilts the sample.
    Rotary,
}

impl fmt::Display for AxisId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Linear => "linear",
            Self::Rotary => "rotary",
        })
    }
}

/// One sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// The name on its label.
    pub name: String,
    /// Nominal elastic modulus, MPa.
    pub stiffness_mpa: f64,
    /// How deep it may be pressed before it tears, mm.
    pub max_indentation_mm: f64,
}

/// Something that must never happen on a bench.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Violation {
    /// When.
    pub at: RigTime,
    /// What.
    pub kind: ViolationKind,
}

/// What must never happen on a bench.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ViolationKind {
    /// The rotary stage moved while the probe was in the sample.
    RotatedInContact {
        /// Largest indentation meanwhile, mm.
        indentation_mm: f64,
    },
    /// A sample was put in place or taken away while the probe was in contact.
    SampleChangedInContact {
        /// Indentation at that moment, mm.
        indentation_mm: f64,
    },
    /// The sensor was turned by hand while the probe was in contact.
    SensorTurnedInContact {
        /// Indentation at that moment, mm.
        indentation_mm: f64,
    },
    /// The probe went deeper than the sample bears.
    PressedTooDeep {
        /// Indentation, mm.
        indentation_mm: f64,
        /// What the sample bears, mm.
        limit_mm: f64,
    },
}

/// How things really are, for tests.
#[derive(Debug, Clone, PartialEq)]
pub struct Truth {
    /// Name of the sample under the probe.
    pub sample: Option<String>,
    /// How the sensor is mounted.
    pub orientation: Orientation,
    /// Where the tip of the probe is on the linear axis, mm.
    pub tip_mm: f64,
    /// Where the rotary stage is, degrees.
    pub tilt_deg: f64,
    /// How deep the tip is below the undeformed surface along the probe, mm; negative while clear,
    /// minus infinity without a sample.
    pub indentation_mm: f64,
    /// The angle between the probe and the normal of the touched point, degrees, with its sign.
    pub contact_deg: f64,
    /// The modulus at the touched point, MPa.
    pub stiffness_mpa: Option<f64>,
    /// The resonance at this moment, Hz.
    pub resonance_hz: f64,
    /// What it would be without contact, Hz.
    pub no_load_hz: f64,
}

impl Truth {
    /// Whether the probe is in the sample.
    pub fn is_in_contact(&self) -> bool {
        self.indentation_mm > 0.0
    }
}

/// Why a scene cannot be played.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// The sensor cannot be built.
    #[error(transparent)]
    Sensor(#[from] SensorError),
    /// The sensor's losses leave no resonance.
    #[error(transparent)]
    NotRinging(#[from] NotRinging),
    /// A sample cannot be made.
    #[error("sample {name:?}")]
    Sample {
        /// The name of the sample.
        name: String,
        /// What is wrong with it.
        source: TissueError,
    },
    /// A stage does not stand between its limit switches.
    #[error("{axis} stage: start {start} is outside its travel [{min}, {max}]")]
    Start {
        /// Which stage.
        axis: AxisId,
        /// Where it was to stand.
        start: f64,
        /// The lower limit switch.
        min: f64,
        /// The upper limit switch.
        max: f64,
    },
}

/// There is no sample of this name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("there is no sample named {name:?}")]
pub struct NoSuchSample {
    /// The name asked for.
    pub name: String,
}

/// A sample as it lies under the probe.
#[derive(Debug, Clone, Copy)]
struct Mounted {
    sample: usize,
    /// Counts every placing of a sample.
    number: u64,
    raised_mm: f64,
}

/// A person who mounts a sample sees when it lies further off than this many standard deviations.
const MOST_SIGMAS: f64 = 2.5;

/// Why every circuit of a checked sensor rings.
const RINGS: &str = "loss factors of at most 1 leave a quality of at least 1";

/// While the rotary stage turns, contact is looked for this many times between two looks.
const LOOKS_PER_TURN: u64 = 64;

/// The bench and everything on it.
#[derive(Debug)]
pub struct World {
    scene: Scene,
    sensor: SensorModel,
    seed: u64,
    linear: Stage,
    rotary: Stage,
    orientation: Orientation,
    mounted: Option<Mounted>,
    placings: u64,
    drift: DriftPath,
    plant: Plant,
    /// The time up to which the plant has been followed.
    plant_at: RigTime,
    noise: Stream,
    encoder: Stream,
    /// The time up to which violations have been looked for.
    watched_until: RigTime,
    violations: Vec<Violation>,
}

/// Names of the streams of chance.
mod stream {
    pub(super) const NOISE: u64 = 1;
    pub(super) const ENCODER: u64 = 2;
    pub(super) const DRIFT: u64 = 3;
    pub(super) const LINEAR_SCREW: u64 = 4;
    pub(super) const ROTARY_SCREW: u64 = 5;
    pub(super) const MOUNTING: u64 = 6;
}

impl World {
    /// A bench with no sample in place.
    ///
    /// # Errors
    /// [`SceneError`] with the first thing that cannot be.
    pub fn new(scene: Scene, seed: u64) -> Result<Self, SceneError> {
        let sensor = SensorModel::new(scene.sensor)?;
        for sample in &scene.samples {
            sensor
                .tissue(sample.stiffness_mpa)
                .map_err(|source| SceneError::Sample { name: sample.name.clone(), source })?;
        }
        for (axis, mechanics) in [(AxisId::Linear, scene.linear), (AxisId::Rotary, scene.rotary)] {
            let Mechanics { start, travel: (min, max) } = mechanics;
            if !(min..=max).contains(&start) {
                return Err(SceneError::Start { axis, start, min, max });
            }
        }
        let n = &scene.nuisances;
        let linear = Drivetrain {
            backlash: n.linear_backlash_mm,
            screw_error: n.screw_mm,
            screw_length: n.screw_length_mm,
        };
        let rotary =
            Drivetrain { backlash: n.rotary_backlash_deg, screw_error: 0.0, screw_length: 1.0 };
        let mut drift = DriftPath::new(n.drift, Stream::new(seed, stream::DRIFT));
        let shift_hz = drift.shift_hz(RigTime::ZERO);
        // The frequency that an analyzer drives with when it is switched on.
        let circuit = sensor.circuit(None, shift_hz);
        let plant = Plant::at_rest(circuit, 1000.0)?;
        Ok(Self {
            sensor,
            linear: Stage::new(linear, (seed, stream::LINEAR_SCREW), scene.linear.start),
            rotary: Stage::new(rotary, (seed, stream::ROTARY_SCREW), scene.rotary.start),
            orientation: scene.orientation,
            mounted: None,
            placings: 0,
            drift,
            plant,
            plant_at: RigTime::ZERO,
            noise: Stream::new(seed, stream::NOISE),
            encoder: Stream::new(seed, stream::ENCODER),
            watched_until: RigTime::ZERO,
            violations: Vec::new(),
            scene,
            seed,
        })
    }

    /// The scene that it was made from.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// A stage as it is. The load of the linear stage is the height of the tip in mm, that of the
    /// rotary stage the tilt in degrees.
    pub fn stage(&self, axis: AxisId) -> &Stage {
        match axis {
            AxisId::Linear => &self.linear,
            AxisId::Rotary => &self.rotary,
        }
    }

    /// A stage for its drive to command. What it did until now has been watched.
    pub fn drive(&mut self, now: RigTime, axis: AxisId) -> &mut Stage {
        self.watch(now);
        match axis {
            AxisId::Linear => &mut self.linear,
            AxisId::Rotary => &mut self.rotary,
        }
    }

    /// Where the limit switches of a stage are.
    pub fn travel(&self, axis: AxisId) -> (f64, f64) {
        match axis {
            AxisId::Linear => self.scene.linear.travel,
            AxisId::Rotary => self.scene.rotary.travel,
        }
    }

    /// A person puts a sample under the probe, in place of the one that is there.
    ///
    /// # Errors
    /// [`NoSuchSample`].
    pub fn place_sample(&mut self, now: RigTime, name: &str) -> Result<(), NoSuchSample> {
        let sample = self
            .scene
            .samples
            .iter()
            .position(|sample| sample.name == name)
            .ok_or_else(|| NoSuchSample { name: name.to_owned() })?;
        self.take_sample_away(now);
        self.placings += 1;
        let key = [stream::MOUNTING, self.placings, 0];
        let draw = normal_at(self.seed, key).clamp(-MOST_SIGMAS, MOST_SIGMAS);
        let raised_mm = self.scene.nuisances.mounting_mm * draw;
        self.mounted = Some(Mounted { sample, number: self.placings, raised_mm });
        self.follow_plant(now);
        Ok(())
    }

    /// A person takes the sample away.
    pub fn take_sample_away(&mut self, now: RigTime) {
        self.refuse_contact(now, |indentation_mm| ViolationKind::SampleChangedInContact {
            indentation_mm,
        });
        self.mounted = None;
        self.follow_plant(now);
    }

    /// A person turns the sensor about its own axis.
    pub fn turn_sensor(&mut self, now: RigTime, orientation: Orientation) {
        self.refuse_contact(now, |indentation_mm| ViolationKind::SensorTurnedInContact {
            indentation_mm,
        });
        self.orientation = orientation;
        self.follow_plant(now);
    }

    /// Sets the frequency of the drive now, in Hz.
    pub fn set_frequency(&mut self, now: RigTime, frequency_hz: f64) {
        self.follow_plant(now);
        self.plant.set_frequency(frequency_hz);
    }

    /// Changes the amplitude of the drive by a factor now.
    pub fn scale_drive(&mut self, now: RigTime, factor: f64) {
        self.follow_plant(now);
        self.plant.scale_drive(factor);
    }

    /// What an ideal lock-in with the noise of the scene measures over `cycles` cycles from now on,
    /// in ohm, and when it is done.
    pub fn measure(&mut self, now: RigTime, cycles: u32) -> (Complex64, RigTime) {
        self.follow_plant(now);
        let duration_s = f64::from(cycles) / self.plant.frequency_hz();
        let impedance_ohm = self.plant.measure(cycles);
        // The plant has moved on by exactly its cycles; the clock rounds them up.
        let done = after(now, duration_s);
        self.plant.advance((done.since(now).as_secs_f64() - duration_s).max(0.0));
        self.plant_at = done;
        let sigma = self.scene.nuisances.impedance_rel * (10.0 / f64::from(cycles)).sqrt();
        let noise = Complex64::new(self.noise.normal(), self.noise.normal());
        (impedance_ohm * (1.0 + sigma * noise), done)
    }

    /// A normal draw for the jitter of an encoder, in steps of its drive.
    pub fn encoder_jitter(&mut self) -> f64 {
        self.scene.nuisances.encoder_steps * self.encoder.normal()
    }

    /// What must never happen and did, up to `now`.
    pub fn violations(&mut self, now: RigTime) -> &[Violation] {
        self.watch(now);
        &self.violations
    }

    /// How things really are.
    pub fn truth(&mut self, now: RigTime) -> Truth {
        let touched = self.touched(now);
        let shift_hz = self.drift.shift_hz(now);
        Truth {
            sample: self.mounted.map(|mounted| self.scene.samples[mounted.sample].name.clone()),
            orientation: self.orientation,
            tip_mm: self.linear.load(now),
            tilt_deg: self.rotary.load(now),
            indentation_mm: self.indentation_mm(now),
            contact_deg: self.contact_deg(now),
            stiffness_mpa: self.mounted.map(|mounted| self.stiffness_mpa(now, mounted)),
            resonance_hz: self.sensor.circuit(touched, shift_hz).series_resonance_hz,
            no_load_hz: self.sensor.circuit(None, shift_hz).series_resonance_hz,
        }
    }

    /// Looks for violations up to `now`.
    fn watch(&mut self, now: RigTime) {
        let since = self.watched_until;
        if now <= since {
            return;
        }
        self.watched_until = now;
        let is_turning = since < self.rotary.rests_from();
        let is_moving = since < self.linear.rests_from();
        if !(is_turning || is_moving) || self.mounted.is_none() {
            return;
        }
        // A lowering probe is deepest at the end of its way; a tilting sample may rise in between.
        let looks = if is_turning { LOOKS_PER_TURN } else { 1 };
        let span = now.as_micros() - since.as_micros();
        let (mut deepest_mm, mut deepest_turning_mm) = (0.0_f64, 0.0_f64);
        for look in 0..=looks {
            let at = RigTime::from_micros(since.as_micros() + span * look / looks);
            let indentation_mm = self.indentation_mm(at);
            deepest_mm = deepest_mm.max(indentation_mm);
            if self.rotary.is_moving(at) {
                deepest_turning_mm = deepest_turning_mm.max(indentation_mm);
            }
        }
        if deepest_turning_mm > 0.0 {
            let indentation_mm = deepest_turning_mm;
            self.record(now, ViolationKind::RotatedInContact { indentation_mm });
        }
        let limit_mm = self.limit_mm();
        if deepest_mm > limit_mm {
            let kind = ViolationKind::PressedTooDeep { indentation_mm: deepest_mm, limit_mm };
            self.record(now, kind);
        }
    }

    fn record(&mut self, at: RigTime, kind: ViolationKind) {
        self.violations.push(Violation { at, kind });
    }

    fn refuse_contact(&mut self, now: RigTime, kind: impl Fn(f64) -> ViolationKind) {
        self.watch(now);
        self.follow_plant(now);
        let indentation_mm = self.indentation_mm(now);
        if indentation_mm > 0.0 {
            self.record(now, kind(indentation_mm));
        }
    }

    fn limit_mm(&self) -> f64 {
        self.mounted
            .map_or(f64::INFINITY, |mounted| self.scene.samples[mounted.sample].max_indentation_mm)
    }

    /// Lets the plant live up to `now`. The sensor feels a move when it ends.
    fn follow_plant(&mut self, now: RigTime) {
        let moved = self.linear.rests_from().max(self.rotary.rests_from());
        if self.plant_at < moved && moved < now {
            self.advance_plant(moved);
        }
        self.advance_plant(now);
    }

    fn advance_plant(&mut self, until: RigTime) {
        self.plant.advance(until.since(self.plant_at).as_secs_f64());
        self.plant_at = self.plant_at.max(until);
        let circuit = self.circuit(until);
        self.plant.set_circuit(circuit).expect(RINGS);
    }

    fn circuit(&mut self, now: RigTime) -> Circuit {
        let touched = self.touched(now);
        let shift_hz = self.drift.shift_hz(now);
        self.sensor.circuit(touched, shift_hz)
    }

    fn indentation_mm(&self, now: RigTime) -> f64 {
        self.mounted.map_or(f64::NEG_INFINITY, |mounted| {
            let (tip_mm, tilt_deg) = (self.linear.load(now), self.rotary.load(now));
            let radius_mm = self.scene.sensor.design.probe_radius_mm;
            self.scene.place.indentation_mm(tip_mm, tilt_deg, radius_mm, mounted.raised_mm)
        })
    }

    fn point(&self, now: RigTime, mounted: Mounted) -> Point {
        let turn = match self.orientation {
            Orientation::FrontBack => 0,
            Orientation::Left => 1,
        };
        let tilt_deg = self.rotary.load(now);
        Point::of(&self.scene.nuisances, self.seed, mounted.number, tilt_deg, turn)
    }

    fn contact_deg(&self, now: RigTime) -> f64 {
        let slope_deg = self.mounted.map_or(0.0, |mounted| self.point(now, mounted).slope_deg);
        self.rotary.load(now) + slope_deg
    }

    fn stiffness_mpa(&self, now: RigTime, mounted: Mounted) -> f64 {
        let nominal_mpa = self.scene.samples[mounted.sample].stiffness_mpa;
        nominal_mpa * self.point(now, mounted).stiffness_factor
    }

    fn touched(&self, now: RigTime) -> Option<Touched> {
        let mounted = self.mounted?;
        let indentation_mm = self.indentation_mm(now);
        (indentation_mm > 0.0).then(|| Touched {
            stiffness_mpa: self.stiffness_mpa(now, mounted),
            indentation_mm,
            contact_deg: self.contact_deg(now),
            orientation: self.orientation,
        })
    }
}
