//! The physical bench: two stages, a sample, a sensor, and their disturbances.
//!
//! It is deterministic: the same seed and the same commands at the same times give the same bytes.
//! Time only ever comes in as an argument. Nothing here knows how it is commanded; that is the
//! devices' business.

mod hit;
mod motion;
mod nuisance;
mod reading;
mod scene;
mod sensor;
mod stage;
#[cfg(test)]
mod tests;
mod true_geometry;
mod truth;

use std::{f64::consts::TAU, iter, mem::Discriminant};

use rig_contact::Circuit;
use rig_model::{
    Orientation, RigTime,
    random::{Stream, normal_at},
};

pub use self::{
    motion::Profile,
    nuisance::{Drift, Nuisances},
    scene::{Assembly, AxisId, Mechanics, NoSuchSample, PersonScene, Sample, Scene, SceneError},
    sensor::{Relaxation, SensorScene},
    stage::{Drivetrain, Stage},
    true_geometry::TrueGeometry,
    truth::{Truth, Violation, ViolationKind},
};
use self::{
    nuisance::{DriftPath, Point},
    reading::OpenReading,
    sensor::{SensorModel, WorldContact},
};
use crate::plant::Plant;

/// A sample as it lies under the probe.
#[derive(Debug, Clone, Copy)]
struct MountedSample {
    sample: usize,
    /// Counts every placing of a sample.
    number: u64,
    raised_mm: f64,
}

/// A person who mounts a sample sees when it lies further off than this many standard deviations.
const MOST_SIGMAS: f64 = 2.5;

/// Why every circuit of a checked sensor rings.
const RINGS: &str = "loss factors of at most 1 leave a quality of at least 1";

/// The load of a stuck contact.
const STUCK: WorldContact = WorldContact {
    stiffness_mpa: 0.1,
    indentation_mm: 0.2,
    contact_deg: 0.0,
    orientation: Orientation::FrontBack,
    rested_s: 0.0,
    thickness_mm: f64::INFINITY,
};

/// Young's modulus of debris on the tip, MPa.
const DEBRIS_MPA: f64 = 0.1;

/// While the rotary stage turns, contact is checked this many times between two events.
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
    mounted: Option<MountedSample>,
    placings: u64,
    drift: DriftPath,
    plant: Plant,
    /// The level of the drive, V.
    level_v: f64,
    /// The time up to which the plant has been followed.
    plant_at: RigTime,
    /// Whether the plant has the circuit of a probe in the sample.
    is_plant_loaded: bool,
    /// The reading under way.
    reading: Option<OpenReading>,
    noise: Stream,
    encoder: Stream,
    drive_phase: Stream,
    /// The time up to which violations have been looked for.
    watched_until: RigTime,
    violations: Vec<Violation>,
    /// The kinds of violation since the probe was last clear.
    told: Vec<Discriminant<ViolationKind>>,
    /// The highest speed at which the probe has gone into a sample, mm/s.
    hit_mm_per_s: f64,
    contact_fault: Option<ContactFault>,
    is_stop_pressed: bool,
    /// Where the linear stage stands while its lower limit switch is held pressed.
    held_at_mm: Option<f64>,
    homings: u64,
}

/// A fault of the contact sense.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ContactFault {
    /// It feels none.
    Blind,
    /// It feels one that is not there.
    Stuck,
    /// The drive stays at its frequency.
    StuckFrequency,
}

/// Names of the streams of chance.
mod stream {
    pub(super) const NOISE: u64 = 1;
    pub(super) const ENCODER: u64 = 2;
    pub(super) const DRIFT: u64 = 3;
    pub(super) const LINEAR_SCREW: u64 = 4;
    pub(super) const ROTARY_SCREW: u64 = 5;
    pub(super) const MOUNTING: u64 = 6;
    pub(super) const DRIVE_PHASE: u64 = 7;
    pub(super) const HOMING: u64 = 8;
}

impl World {
    /// A bench with no sample in place.
    ///
    /// # Errors
    /// [`SceneError`] with the first thing that cannot be.
    pub fn new(scene: Scene, seed: u64) -> Result<Self, SceneError> {
        let (mut stiffest_mpa, mut deepest_mm) = (0.0, 0.0);
        for sample in &scene.samples {
            let Sample { name, stiffness_mpa, max_indentation_mm, thickness_mm } = sample;
            let tissue = scene.sensor.tissue(*stiffness_mpa);
            tissue.map_err(|source| SceneError::Sample { name: name.clone(), source })?;
            let specimen = scene.sensor.specimen(*thickness_mm);
            let specimen =
                specimen.map_err(|source| SceneError::Specimen { name: name.clone(), source })?;
            let radius_mm = scene.sensor.design.probe_radius_mm;
            let felt_mpa = stiffness_mpa * specimen.stiffening(radius_mm, *max_indentation_mm);
            stiffest_mpa = f64::max(stiffest_mpa, felt_mpa);
            deepest_mm = f64::max(deepest_mm, *max_indentation_mm);
        }
        let mut sensor = SensorModel::new(scene.sensor, stiffest_mpa, deepest_mm)?;
        for (axis, mechanics) in [(AxisId::Linear, scene.linear), (AxisId::Rotary, scene.rotary)] {
            let Mechanics { start, travel: (min, max), .. } = mechanics;
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
            level_v: 1.0,
            plant_at: RigTime::ZERO,
            is_plant_loaded: false,
            reading: None,
            noise: Stream::new(seed, stream::NOISE),
            encoder: Stream::new(seed, stream::ENCODER),
            drive_phase: Stream::new(seed, stream::DRIVE_PHASE),
            watched_until: RigTime::ZERO,
            violations: Vec::new(),
            told: Vec::new(),
            hit_mm_per_s: 0.0,
            contact_fault: None,
            is_stop_pressed: false,
            held_at_mm: None,
            homings: 0,
            scene,
            seed,
        })
    }

    /// The scene that it was made from.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The true state of a stage. The load of the linear stage is the height of the tip in mm, that
    /// of the rotary stage the tilt in degrees.
    pub fn stage(&self, axis: AxisId) -> &Stage {
        match axis {
            AxisId::Linear => &self.linear,
            AxisId::Rotary => &self.rotary,
        }
    }

    /// A stage for the commands of its drive. Its motion up to now is checked for violations.
    pub fn drive(&mut self, now: RigTime, axis: AxisId) -> &mut Stage {
        self.glide(now);
        self.watch(now);
        match axis {
            AxisId::Linear => &mut self.linear,
            AxisId::Rotary => &mut self.rotary,
        }
    }

    /// Positions of the limit switches of a stage. One that is held pressed is where the stage is.
    pub fn travel(&self, axis: AxisId) -> (f64, f64) {
        match axis {
            AxisId::Linear => {
                let (low, high) = self.scene.linear.travel;
                (self.held_at_mm.unwrap_or(low), high)
            }
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
        self.mounted = Some(MountedSample { sample, number: self.placings, raised_mm });
        self.follow_plant(now);
        Ok(())
    }

    /// A person takes the sample away.
    pub(crate) fn take_sample_away(&mut self, now: RigTime) {
        self.refuse_contact(now, |indentation_mm| ViolationKind::SampleChangedInContact {
            indentation_mm,
        });
        self.mounted = None;
        self.follow_plant(now);
    }

    /// A person lifts the linear stage to the upper end of its travel by hand, slowly.
    pub(crate) fn lift_probe(&mut self, now: RigTime) {
        const BY_HAND: Profile = Profile { speed: 20.0, acceleration: 50.0, deceleration: 50.0 };
        let (_, top) = self.travel(AxisId::Linear);
        self.drive(now, AxisId::Linear).start(now, top, &BY_HAND);
    }

    /// A person presses the emergency stop, which takes the power from both motors, or releases it.
    pub(crate) fn press_stop(&mut self, now: RigTime, is_pressed: bool) {
        self.is_stop_pressed = is_pressed;
        for axis in [AxisId::Linear, AxisId::Rotary] {
            self.drive(now, axis).set_jammed(now, is_pressed);
        }
    }

    /// A person holds the lower limit switch of the linear stage pressed, or lets go of it.
    pub(crate) fn hold_lower_switch(&mut self, now: RigTime, is_held: bool) {
        self.held_at_mm = is_held.then(|| self.linear.motor(now));
    }

    /// How far from its place a drive finds its zero this time.
    pub(crate) fn homing_error(&mut self, axis: AxisId) -> f64 {
        self.homings += 1;
        let sigma = match axis {
            AxisId::Linear => self.scene.nuisances.homing_mm,
            AxisId::Rotary => self.scene.nuisances.homing_deg,
        };
        sigma * normal_at(self.seed, [stream::HOMING, self.homings, 0])
    }

    /// Whether the emergency stop is pressed.
    pub(crate) const fn is_stop_pressed(&self) -> bool {
        self.is_stop_pressed
    }

    /// A person turns the sensor about its own axis.
    pub fn turn_sensor(&mut self, now: RigTime, orientation: Orientation) {
        self.refuse_contact(now, |indentation_mm| ViolationKind::SensorTurnedInContact {
            indentation_mm,
        });
        self.orientation = orientation;
        self.follow_plant(now);
    }

    /// Sets the frequency of the drive now, in Hz. A synthesizer that is set again starts at any phase:
    /// no make of analyzer promises another.
    pub fn set_frequency(&mut self, now: RigTime, frequency_hz: f64) {
        self.follow_plant(now);
        let is_stuck = self.contact_fault == Some(ContactFault::StuckFrequency);
        if frequency_hz != self.plant.frequency_hz() && !is_stuck {
            self.plant.set_frequency(frequency_hz);
            self.plant.turn_drive(TAU * self.drive_phase.uniform());
        }
    }

    /// Sets the level of the drive now, V, without a jump of its phase.
    pub(crate) fn set_level(&mut self, now: RigTime, level_v: f64) {
        self.follow_plant(now);
        self.switch_on_level(level_v);
        if self.scene.nuisances.level_hz_per_v2 != 0.0 {
            self.follow_plant(now);
        }
    }

    /// The level, V, of an analyzer that is switched on with the bench.
    pub(crate) fn switch_on_level(&mut self, level_v: f64) {
        self.plant.scale_drive(level_v / self.level_v);
        self.level_v = level_v;
    }

    /// Sets or clears a fault of the contact sense.
    pub(crate) fn set_contact_fault(&mut self, now: RigTime, fault: Option<ContactFault>) {
        self.follow_plant(now);
        self.contact_fault = fault;
        self.follow_plant(now);
    }

    /// The free resonance jumps by this, Hz.
    pub(crate) fn knock(&mut self, now: RigTime, by_hz: f64) {
        self.follow_plant(now);
        self.drift.knock(by_hz);
        self.follow_plant(now);
    }

    /// Mends what faults have broken.
    pub(crate) fn clear_faults(&mut self, now: RigTime) {
        self.is_stop_pressed = false;
        for axis in [AxisId::Linear, AxisId::Rotary] {
            if self.stage(axis).is_jammed() {
                self.drive(now, axis).set_jammed(now, false);
            }
        }
        self.set_contact_fault(now, None);
    }

    /// A normal draw for the jitter of an encoder, in steps of its drive.
    pub fn encoder_jitter(&mut self) -> f64 {
        self.scene.nuisances.encoder_steps * self.encoder.normal()
    }

    /// The time at which a position was true that a drive reports now.
    pub fn position_seen_at(&self, now: RigTime) -> RigTime {
        let age = std::time::Duration::from_secs_f64(self.scene.nuisances.position_age_s);
        RigTime::ZERO + now.since(RigTime::ZERO + age)
    }

    /// The safety violations up to `now`.
    pub fn violations(&mut self, now: RigTime) -> &[Violation] {
        self.watch(now);
        &self.violations
    }

    /// Whether the probe is in the sample.
    pub fn is_in_contact(&self, now: RigTime) -> bool {
        self.indentation_mm(now) > 0.0
    }

    /// How deep the probe is in the sample, mm; negative above it, and infinitely so without one or beside it.
    pub fn indentation_mm(&self, now: RigTime) -> f64 {
        let Some(mounted) = self.mounted.filter(|_| self.edge_distance_mm(now) > 0.0) else {
            return f64::NEG_INFINITY;
        };
        let (tip_mm, tilt_deg) = (self.linear.load(now), self.rotary.load(now));
        let radius_mm = self.scene.sensor.design.probe_radius_mm;
        self.scene.place.indentation_mm(tip_mm, tilt_deg, radius_mm, mounted.raised_mm)
    }

    /// How far it is from the probe to the edge of the sample, mm; negative beyond it.
    fn edge_distance_mm(&self, now: RigTime) -> f64 {
        let (tip_mm, tilt_deg) = (self.linear.load(now), self.rotary.load(now));
        self.scene.place.edge_distance_mm(
            tip_mm,
            tilt_deg,
            self.scene.sensor.design.probe_radius_mm,
        )
    }

    /// Whether the probe feels a contact: of the sample, or of debris on the tip.
    fn is_felt(&self, now: RigTime) -> bool {
        self.indentation_mm(now) + self.scene.nuisances.debris_mm > 0.0
    }

    /// The true state.
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
        // A reading of a moving probe is ahead of what is watched, and has felt the sample itself.
        let is_behind = self.plant_at <= now;
        if is_behind && self.is_felt(now) != self.is_plant_loaded {
            self.advance_plant(self.crossing(since, now));
        }
        // A lowering probe is deepest where it turns round, or at the end of its way; a tilting sample may rise in between.
        let looks = if is_turning { LOOKS_PER_TURN } else { 1 };
        let span = now.as_micros() - since.as_micros();
        let limit_mm = self.limit_mm();
        let turn = self.linear.turns().filter(|turn| !is_turning && (since..now).contains(turn));
        let even = |look| RigTime::from_micros(since.as_micros() + span * look / looks);
        let mut before = None;
        for at in iter::once(since).chain(turn).chain((1..=looks).map(even)) {
            let indentation_mm = self.indentation_mm(at);
            let clear_at = before.replace((at, indentation_mm <= 0.0));
            if indentation_mm <= 0.0 {
                self.told.clear();
                continue;
            }
            if let Some((clear_at, true)) = clear_at {
                self.hit(clear_at, at);
            }
            if self.rotary.is_moving(at) {
                self.record(at, ViolationKind::RotatedInContact { indentation_mm });
            }
            if indentation_mm - self.linear.sunk() > limit_mm {
                self.record(at, ViolationKind::PressedTooDeep { indentation_mm, limit_mm });
            } else if indentation_mm > limit_mm {
                self.record(at, ViolationKind::SankTooDeep { indentation_mm, limit_mm });
            }
        }
    }

    /// Records a violation, once for each time that the probe goes into a sample.
    fn record(&mut self, at: RigTime, kind: ViolationKind) {
        let sort = std::mem::discriminant(&kind);
        if !self.told.contains(&sort) {
            self.told.push(sort);
            self.violations.push(Violation { at, kind });
        } else if let Some(told) =
            self.violations.iter_mut().rfind(|told| std::mem::discriminant(&told.kind) == sort)
            && told.kind.indentation_mm() < kind.indentation_mm()
        {
            told.kind = kind;
        }
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

    /// When the probe went into the sample or out of it, between these times.
    fn crossing(&self, since: RigTime, now: RigTime) -> RigTime {
        const CLOSE_US: u64 = 100;
        let (mut before, mut after) = (since.as_micros(), now.as_micros());
        while CLOSE_US < after - before {
            let middle = before.midpoint(after);
            let is_loaded = self.is_felt(RigTime::from_micros(middle));
            if is_loaded == self.is_plant_loaded { before = middle } else { after = middle }
        }
        RigTime::from_micros(after)
    }

    /// Lets the plant live up to `now`. The sensor feels that a move takes it into the sample or out of it,
    /// and the depth when the move ends.
    fn follow_plant(&mut self, now: RigTime) {
        self.glide(now);
        self.watch(now);
        let moved = self.linear.rests_from().max(self.rotary.rests_from());
        if self.plant_at < moved && moved < now {
            self.advance_plant(moved);
        }
        self.advance_plant(now);
    }

    fn advance_plant(&mut self, until: RigTime) {
        self.plant.advance(until.since(self.plant_at).as_secs_f64());
        self.plant_at = self.plant_at.max(until);
        self.is_plant_loaded = self.is_felt(until);
        let circuit = self.circuit(until);
        self.plant.set_circuit(circuit).expect(RINGS);
    }

    fn circuit(&mut self, now: RigTime) -> Circuit {
        let touched = match self.contact_fault {
            None | Some(ContactFault::StuckFrequency) => self.touched(now),
            Some(ContactFault::Blind) => None,
            Some(ContactFault::Stuck) => Some(STUCK),
        };
        let by_level_hz = self.scene.nuisances.level_hz_per_v2 * self.plant.drive().norm_sqr();
        let shift_hz = self.drift.shift_hz(now) + by_level_hz;
        self.sensor.circuit(touched, shift_hz)
    }

    fn point(&self, now: RigTime, mounted: MountedSample) -> Point {
        let turn = match self.orientation {
            Orientation::FrontBack => 0,
            Orientation::Left => 1,
        };
        let tilt_deg = self.rotary.load(now);
        Point::of(&self.scene.nuisances, self.seed, mounted.number, tilt_deg, turn)
    }

    fn contact_deg(&self, now: RigTime) -> f64 {
        let slope_deg = self.mounted.map_or(0.0, |mounted| self.point(now, mounted).slope_deg);
        let tilt_deg = self.rotary.load(now);
        let radius_mm = self.scene.sensor.design.probe_radius_mm;
        tilt_deg + self.scene.place.slope_deg(tilt_deg, radius_mm) + slope_deg
    }

    fn stiffness_mpa(&self, now: RigTime, mounted: MountedSample) -> f64 {
        let nominal_mpa = self.scene.samples[mounted.sample].stiffness_mpa;
        nominal_mpa * self.point(now, mounted).stiffness_factor
    }

    fn touched(&self, now: RigTime) -> Option<WorldContact> {
        let mounted = self.mounted?;
        let (stiffness_mpa, indentation_mm) = self.felt(now, mounted)?;
        Some(WorldContact {
            stiffness_mpa,
            indentation_mm,
            contact_deg: self.contact_deg(now),
            orientation: self.orientation,
            rested_s: now.since(self.linear.arrived().min(now)).as_secs_f64(),
            thickness_mm: self.scene.samples[mounted.sample].thickness_mm,
        })
    }

    /// The modulus, MPa, and the indentation, mm, that the probe feels. Of sample and debris it is the one that is stiffer
    /// at its depth. At an edge of the sample, the part of the contact that lies on it carries.
    fn felt(&self, now: RigTime, mounted: MountedSample) -> Option<(f64, f64)> {
        let height_mm = self.scene.nuisances.debris_mm;
        let depth_mm = self.indentation_mm(now);
        let felt_mm = (depth_mm + height_mm).min(height_mm);
        let debris = (felt_mm > 0.0).then_some((DEBRIS_MPA, felt_mm));
        let contact_mm = (self.scene.sensor.design.probe_radius_mm * depth_mm.max(0.0)).sqrt();
        let on_sample = (0.5 + 0.5 * self.edge_distance_mm(now) / contact_mm).min(1.0);
        let sample =
            (depth_mm > 0.0).then(|| (on_sample * self.stiffness_mpa(now, mounted), depth_mm));
        let stiffness = |(mpa, mm): &(f64, f64)| mpa * mm.sqrt();
        sample
            .into_iter()
            .chain(debris)
            .max_by(|one, other| stiffness(one).total_cmp(&stiffness(other)))
    }
}
