//! The stiffness of the samples from the touches of a run, with the contact angle compensated.
//!
//! The sensor is the one of the rig file. What its description gets wrong, the run corrects as far
//! as it can: each shift is scaled by the free resonance measured before it, and all stiffness by
//! what the samples of known stiffness say at the smallest angle. The labels of the blind touches
//! take no part in it.

mod place;
mod section;

use std::collections::BTreeMap;

use rig_analysis::{
    calibration::{self, Comparison},
    stiffness::{self, Compensation, PosedTouch, Young},
};
use rig_contact::{
    Models, Pose, Tier,
    inverse::{InverseError, OneTouch, TiltInference},
};
use rig_protocol::{AngleKnowledge, Protocol};
use rig_record::{Direction, Phase, Touch};
use rig_settings::Faults;

pub(super) use place::Place;
pub(super) use section::{recognitions, section};

use place::{Probed, Unknown};

use super::data::{PlannedTouch, RunData};
use crate::rig_file::{RigFile, SensorFile};

/// Within 0.05 Hz of the reference at the cost of a closed form, whatever the depth means.
const TIER: Tier = Tier::E1s;

/// The stiffness of the samples and of the blind touches.
#[derive(Debug)]
pub(super) struct Stiffness {
    /// What all stiffness was divided by, and why.
    pub(super) calibration: Calibration,
    /// Each sample from its main touches, calibrated, ordered by sample.
    pub(super) samples: Vec<SampleStiffness>,
    /// Every main touch, in order; or every place, when the angle is unknown.
    pub(super) main: Vec<Reading>,
    /// Every blind touch, in order.
    pub(super) blind: Vec<Reading>,
    /// The places of the main phase, when the angle is unknown.
    pub(super) places: Option<Vec<Place>>,
    /// For each touch, by the address of its step, its stiffness or that of its place, with the
    /// uncertainty of the calibration; or why there is none.
    by_step: BTreeMap<String, Result<Young, InverseError>>,
}

/// How the sensor of the rig file was made that of the run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Calibration {
    /// Mean free resonance measured, over that of the sensor described.
    pub(super) resonance_ratio: f64,
    /// All stiffness was divided by this.
    pub(super) factor: f64,
    /// Its relative standard deviation.
    pub(super) sigma_rel: f64,
    /// Where the factor comes from.
    pub(super) source: ScaleSource,
}

/// Where the factor of a calibration comes from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum ScaleSource {
    /// From known samples.
    Known {
        /// How many.
        samples: usize,
        /// The contact angle at which they were compared, degrees; all when it is unknown.
        angle_deg: Option<f64>,
    },
    /// From the description of the sensor alone: the factor is one.
    Described,
}

/// The stiffness of a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SampleStiffness {
    /// Which sample.
    pub(super) sample: usize,
    /// Young's modulus, MPa.
    pub(super) young_mpa: f64,
    /// Its standard deviation, that of the calibration included, MPa.
    pub(super) sigma_mpa: f64,
    /// Standard deviation of the touches about it, MPa, when there are several.
    pub(super) spread_mpa: Option<f64>,
    /// What is known of it otherwise, MPa.
    pub(super) known_mpa: Option<f64>,
    /// Touches, or places, that gave a stiffness.
    pub(super) touches: usize,
}

/// On what the stiffness of a sample rests.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Support {
    /// Touches, or places, that gave a stiffness.
    pub(super) used: usize,
    /// Those that were planned.
    pub(super) planned: usize,
    /// What is counted: `touches` or `places`.
    pub(super) of: &'static str,
}

impl Support {
    /// `9 of 12 touches`, where some are missing.
    pub(super) fn shortfall(self) -> Option<String> {
        let Self { used, planned, of } = self;
        (used < planned).then(|| format!("{used} of {planned} {of}"))
    }
}

/// What one touch or place says of the stiffness under it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Reading {
    /// Which sample it was; for a blind touch, only to be scored.
    pub(super) sample: usize,
    /// Its number among the repeats, or among the blind touches.
    pub(super) number: u32,
    /// The calibrated stiffness, without the uncertainty of the calibration, which all share; or
    /// why there is none.
    pub(super) young: Result<Young, InverseError>,
}

/// Why a run has no stiffness.
#[derive(Debug, thiserror::Error)]
pub(super) enum NoStiffness {
    #[error("the rig file in the journal, which describes the sensor, is not there")]
    NoRigFile,
    #[error("the rig file in the journal, which describes the sensor, cannot be read: {0}")]
    RigFile(Faults),
    #[error("no touch of the main phase gave a stiffness")]
    NoTouches,
}

impl Stiffness {
    pub(super) fn of(data: &RunData) -> Result<Self, NoStiffness> {
        let started = data.started.as_ref().ok_or(NoStiffness::NoRigFile)?;
        let rig = RigFile::read(&started.rig.name, &started.rig.toml);
        let file = rig.map_err(NoStiffness::RigFile)?.sensor;
        let compensation = compensation(&file, data);
        let free_hz = compensation.models.no_load_hz(TIER);
        let (mut main, mut blind) = (Vec::new(), Vec::new());
        for touch in &data.touches {
            let Some(posed) = posed(touch, &file, data, free_hz) else { continue };
            match touch.touch.phase {
                Phase::Main => main.push((touch, posed)),
                Phase::Blind => blind.push((touch, posed)),
            }
        }
        let reader = Reader { compensation, file, data };
        let angle = Protocol::read(&started.protocol.name, &started.protocol.toml).angle();
        let Readings { main: read, blind: blind_read, places, at } = match angle {
            AngleKnowledge::Known => reader.known(&main, &blind),
            AngleKnowledge::Unknown => reader.unknown(&main, &blind),
        };
        let mean_hz = main.iter().map(|(touch, _)| touch.no_load_hz).sum::<f64>();
        let resonance_ratio = mean_hz / main.len() as f64 / free_hz;
        let calibration = reader.calibration(&read, at, resonance_ratio);
        let samples = reader.samples(&read, &calibration);
        if samples.is_empty() {
            return Err(NoStiffness::NoTouches);
        }
        let calibrated = |readings: Vec<Reading>| -> Vec<Reading> {
            readings.into_iter().map(|reading| calibration.reading(reading)).collect()
        };
        let (main_read, blind_read) = (calibrated(read), calibrated(blind_read));
        let mut by_step = BTreeMap::new();
        let mut note = |touch: &Touch, reading: &Reading| {
            let young = reading.young.map(|young| calibration.with_its_sigma(young));
            by_step.insert(touch.touch.step.clone(), young);
        };
        for (index, (touch, posed)) in main.iter().enumerate() {
            let place = match &places {
                Some(places) => places.iter().position(|place| place.holds(touch, posed.sample)),
                None => Some(index),
            };
            if let Some(place) = place {
                note(touch, &main_read[place]);
            }
        }
        blind.iter().zip(&blind_read).for_each(|((touch, _), reading)| note(touch, reading));
        Ok(Self { calibration, samples, main: main_read, blind: blind_read, places, by_step })
    }

    /// The stiffness of a sample, where there is one.
    pub(super) fn of_sample(&self, sample: usize) -> Option<&SampleStiffness> {
        self.samples.iter().find(|found| found.sample == sample)
    }

    /// On how many of the planned touches, or places, the stiffness of a sample rests.
    pub(super) fn support(&self, data: &RunData, sample: usize) -> Support {
        let is_of_sample = |planned: &&PlannedTouch| {
            planned.settings.phase == Phase::Main
                && data.sample(&planned.settings.sample) == Some(sample)
        };
        let mut planned: Vec<(f64, u32)> = (data.planned.iter().filter(is_of_sample))
            .map(|planned| (planned.settings.pose.angle_deg, planned.settings.repeat))
            .collect();
        if self.places.is_some() {
            planned.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            planned.dedup();
        }
        let used = self.of_sample(sample).map_or(0, |found| found.touches);
        let of = if self.places.is_some() { "places" } else { "touches" };
        Support { used, planned: planned.len(), of }
    }

    /// What the touch at this address says of the stiffness, with the uncertainty of the
    /// calibration.
    pub(super) fn of_touch(&self, step: &str) -> Option<Result<Young, InverseError>> {
        self.by_step.get(step).copied()
    }
}

/// What is needed to read touches.
struct Reader<'a> {
    compensation: Compensation,
    file: SensorFile,
    data: &'a RunData,
}

/// The touches of a run as the model reads them, not yet calibrated.
struct Readings {
    main: Vec<Reading>,
    blind: Vec<Reading>,
    places: Option<Vec<Place>>,
    /// Where known samples are compared.
    at: ComparedAt,
}

/// At which contact angle known samples are compared.
struct ComparedAt {
    /// The angle, degrees; all when there is none.
    angle_deg: Option<f64>,
    /// For each main reading, whether it is one of these.
    is_there: Vec<bool>,
}

type Touched<'a> = (&'a Touch, PosedTouch);

impl Reader<'_> {
    /// Each touch by itself, at the angle that was set.
    fn known(&self, main: &[Touched<'_>], blind: &[Touched<'_>]) -> Readings {
        let young = |one: OneTouch| Young { mpa: one.young_mpa, sigma_mpa: one.sigma_mpa };
        let reading = |(touch, posed): &Touched<'_>| Reading {
            sample: posed.sample,
            number: touch.touch.repeat,
            young: self.compensation.of_touch(posed).map(young),
        };
        // There the angle hardly counts.
        let angle = |touched: &Touched<'_>| touched.0.touch.pose.angle_deg;
        let angle_deg = main.iter().map(angle).min_by(f64::total_cmp);
        let is_there = main.iter().map(|touched| Some(angle(touched)) == angle_deg).collect();
        Readings {
            main: main.iter().map(reading).collect(),
            blind: blind.iter().map(reading).collect(),
            places: None,
            at: ComparedAt { angle_deg, is_there },
        }
    }

    /// Main touches by places, each blind touch by itself, at any angle that the run has.
    fn unknown(&self, main: &[Touched<'_>], blind: &[Touched<'_>]) -> Readings {
        let angles = self.data.touches.iter().map(|touch| touch.touch.pose.angle_deg);
        let unknown = Unknown {
            compensation: &self.compensation,
            sample_rel: self.file.uncertainty.sample_rel,
            max_angle_rad: angles.fold(0.0, f64::max).to_radians(),
        };
        let young = |found: TiltInference| Young {
            mpa: found.young_mpa.value,
            sigma_mpa: found.young_mpa.sigma,
        };
        let probed = |&(touch, posed): &Touched<'_>| Probed {
            touch: posed,
            angle_deg: touch.touch.pose.angle_deg,
            repeat: touch.touch.repeat,
        };
        let places = unknown.places(main.iter().map(probed).collect());
        let of_place = |place: &Place| Reading {
            sample: place.sample,
            number: place.repeat,
            young: place.found.map(young),
        };
        let of_touch = |(touch, posed): &Touched<'_>| Reading {
            sample: posed.sample,
            number: touch.touch.repeat,
            young: unknown.infer([posed]).map(young),
        };
        Readings {
            main: places.iter().map(of_place).collect(),
            blind: blind.iter().map(of_touch).collect(),
            at: ComparedAt { angle_deg: None, is_there: vec![true; places.len()] },
            places: Some(places),
        }
    }

    /// Compares readings with what is known of their samples.
    fn calibration(&self, main: &[Reading], at: ComparedAt, resonance_ratio: f64) -> Calibration {
        let there = main.iter().zip(at.is_there).filter(|(_, is_there)| *is_there);
        let compared = |(reading, _): (&Reading, bool)| {
            let young = reading.young.ok()?;
            Some(Comparison {
                sample: reading.sample,
                young_mpa: young.mpa,
                sigma_mpa: young.sigma_mpa,
                known_mpa: self.data.samples()[reading.sample].stiffness_mpa?,
            })
        };
        let comparisons: Vec<Comparison> = there.filter_map(compared).collect();
        match calibration::calibrate(&comparisons) {
            Some(scale) => Calibration {
                resonance_ratio,
                factor: scale.factor,
                sigma_rel: scale.sigma_rel,
                source: ScaleSource::Known { samples: scale.samples, angle_deg: at.angle_deg },
            },
            // A resonance that is off by a stiffer beam instead of a lighter tip makes a shift of
            // the same contact smaller instead of larger.
            None => Calibration {
                resonance_ratio,
                factor: 1.0,
                sigma_rel: self.file.uncertainty.scale_rel.hypot(2.0 * (resonance_ratio - 1.0)),
                source: ScaleSource::Described,
            },
        }
    }

    fn samples(&self, main: &[Reading], calibration: &Calibration) -> Vec<SampleStiffness> {
        let sample = |(index, sample): (usize, &rig_record::Sample)| {
            let of_sample = || main.iter().filter(|reading| reading.sample == index);
            let found: Vec<Young> = of_sample().filter_map(|reading| reading.young.ok()).collect();
            let refused = of_sample().count() - found.len();
            let mean = stiffness::SampleStiffness::mean(index, &found, refused)?;
            Some(calibration.sample(&mean, sample.stiffness_mpa))
        };
        self.data.samples().iter().enumerate().filter_map(sample).collect()
    }
}

impl Calibration {
    /// A calibrated stiffness with the uncertainty that all share.
    fn with_its_sigma(&self, young: Young) -> Young {
        Young { sigma_mpa: young.sigma_mpa.hypot(self.sigma_rel * young.mpa), ..young }
    }

    fn reading(&self, reading: Reading) -> Reading {
        let young = |young: Young| Young {
            mpa: young.mpa / self.factor,
            sigma_mpa: young.sigma_mpa / self.factor,
        };
        Reading { young: reading.young.map(young), ..reading }
    }

    fn sample(
        &self,
        found: &stiffness::SampleStiffness,
        known_mpa: Option<f64>,
    ) -> SampleStiffness {
        let young_mpa = found.young_mpa / self.factor;
        // The scatter sees that a sample is not alike everywhere; of a few touches it may be small
        // by chance.
        let scatter = |spread: f64| spread / (found.touches as f64).sqrt();
        let own_mpa = found.sigma_mpa.max(found.spread_mpa.map_or(0.0, scatter)) / self.factor;
        SampleStiffness {
            sample: found.sample,
            young_mpa,
            sigma_mpa: own_mpa.hypot(self.sigma_rel * young_mpa),
            spread_mpa: found.spread_mpa.map(|spread| spread / self.factor),
            known_mpa,
            touches: found.touches,
        }
    }
}

fn compensation(file: &SensorFile, data: &RunData) -> Compensation {
    let squares = data.touches.iter().map(|touch| touch.surface_sigma_mm.powi(2)).sum::<f64>();
    let surface_mm = (squares / data.touches.len().max(1) as f64).sqrt();
    Compensation {
        models: Models::new(&file.sensor, file.law),
        tier: TIER,
        law: file.law,
        friction: file.friction,
        kind: file.kind,
        // The surface is found anew for every touch.
        shared_depth_sigma_mm: 0.0,
        depth_sigma_mm: file.uncertainty.depth_mm.hypot(surface_mm),
        angle_sigma_rad: file.uncertainty.angle_deg.to_radians(),
    }
}

/// A touch as the model takes it, its shift scaled to the free resonance of the sensor described.
fn posed(touch: &Touch, file: &SensorFile, data: &RunData, free_hz: f64) -> Option<PosedTouch> {
    let settings = &touch.touch;
    let sample = data.sample(&settings.sample)?;
    let direction = match settings.pose.direction {
        Direction::Front => rig_contact::Direction::Front,
        Direction::Back => rig_contact::Direction::Back,
        Direction::Left => rig_contact::Direction::Left,
    };
    let scale = free_hz / touch.no_load_hz;
    Some(PosedTouch {
        sample,
        pose: Pose::leaning(direction, settings.pose.angle_deg.to_radians()).ok()?,
        depth: file.depth(touch.indentation_mm),
        shift_hz: scale * touch.shift_hz,
        sigma_hz: scale * touch.shift_sigma_hz,
    })
}
