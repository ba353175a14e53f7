//! The stiffness of the samples from the touches of a run, with the contact angle compensated.
//!
//! The sensor is the one of the rig file. What its description gets wrong, the run corrects as far
//! as it can: each shift is scaled by the free resonance measured before it, and all stiffness by
//! what the samples of known stiffness say at the smallest angle. The labels of the blind touches
//! take no part in it.

mod section;

use rig_analysis::{
    scale::{self, Comparison},
    stiffness::{Compensation, PosedTouch},
};
use rig_contact::{Depth, Models, Pose, Tier, inverse::InverseError};
use rig_settings::Faults;
use rig_store::{Direction, Phase, Touch};

pub(super) use section::{recognitions, section};

use super::data::RunData;
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
    /// Every main touch, in order.
    pub(super) main: Vec<Reading>,
    /// Every blind touch, in order.
    pub(super) blind: Vec<Reading>,
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
        /// The contact angle at which they were compared, degrees.
        angle_deg: f64,
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
    /// Touches that gave a stiffness.
    pub(super) touches: usize,
    /// Touches that were refused one.
    pub(super) refused: usize,
}

/// What one touch says of the stiffness under it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Reading {
    /// Which sample it was; for a blind touch, only to be scored.
    pub(super) sample: usize,
    /// Its number among the repeats, or among the blind touches.
    pub(super) number: u32,
    /// The calibrated stiffness, or why there is none.
    pub(super) young: Result<Young, InverseError>,
}

/// A stiffness, MPa.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Young {
    /// Young's modulus.
    pub(super) mpa: f64,
    /// Its standard deviation, without that of the calibration, which all touches share.
    pub(super) sigma_mpa: f64,
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
        let rig = &data.started.as_ref().ok_or(NoStiffness::NoRigFile)?.rig;
        let rig = RigFile::read(&rig.name, &rig.toml).map_err(NoStiffness::RigFile)?;
        let compensation = compensation(&rig.sensor, data);
        let free_hz = compensation.models.no_load_hz(TIER);
        let posed = |phase: Phase| {
            let touches = data.touches.iter().filter(move |touch| touch.touch.phase == phase);
            touches.filter_map(|touch| Some((touch, posed(touch, &rig.sensor, data, free_hz)?)))
        };
        let main: Vec<(&Touch, PosedTouch)> = posed(Phase::Main).collect();
        let mean_hz = main.iter().map(|(touch, _)| touch.no_load_hz).sum::<f64>();
        let resonance_ratio = mean_hz / main.len() as f64 / free_hz;
        let described = rig.sensor.uncertainty.scale_rel;
        let calibration = Calibration::of(&compensation, data, &main, resonance_ratio, described);
        let reading = |(touch, posed): (&Touch, PosedTouch)| Reading {
            sample: posed.sample,
            number: touch.touch.repeat,
            young: compensation.of_touch(&posed).map(|one| Young {
                mpa: one.young_mpa / calibration.factor,
                sigma_mpa: one.sigma_mpa / calibration.factor,
            }),
        };
        let touches: Vec<PosedTouch> = main.iter().map(|&(_, posed)| posed).collect();
        let samples: Vec<SampleStiffness> = compensation
            .by_sample(&touches)
            .into_iter()
            .map(|found| calibration.sample(data, &found))
            .collect();
        if samples.is_empty() {
            return Err(NoStiffness::NoTouches);
        }
        let main = main.into_iter().map(reading).collect();
        Ok(Self { calibration, samples, main, blind: posed(Phase::Blind).map(reading).collect() })
    }
}

impl Calibration {
    /// Compares the touches at the smallest angle with what is known of their samples. There the
    /// angle hardly counts.
    fn of(
        compensation: &Compensation,
        data: &RunData,
        main: &[(&Touch, PosedTouch)],
        resonance_ratio: f64,
        described_rel: f64,
    ) -> Self {
        let angles = main.iter().map(|(touch, _)| touch.touch.pose.angle_deg);
        let angle_deg = angles.min_by(f64::total_cmp).unwrap_or_default();
        let compared = |(touch, posed): &(&Touch, PosedTouch)| {
            let known_mpa = data.samples()[posed.sample].stiffness_mpa?;
            let found = compensation.of_touch(posed).ok()?;
            (touch.touch.pose.angle_deg == angle_deg).then_some(Comparison {
                sample: posed.sample,
                young_mpa: found.young_mpa,
                sigma_mpa: found.sigma_mpa,
                known_mpa,
            })
        };
        let comparisons: Vec<Comparison> = main.iter().filter_map(compared).collect();
        match scale::scale(&comparisons) {
            Some(scale) => Self {
                resonance_ratio,
                factor: scale.factor,
                sigma_rel: scale.sigma_rel,
                source: ScaleSource::Known { samples: scale.samples, angle_deg },
            },
            // A resonance that is off by a stiffer beam instead of a lighter tip makes a shift of
            // the same contact smaller instead of larger.
            None => Self {
                resonance_ratio,
                factor: 1.0,
                sigma_rel: described_rel.hypot(2.0 * (resonance_ratio - 1.0)),
                source: ScaleSource::Described,
            },
        }
    }

    fn sample(
        &self,
        data: &RunData,
        found: &rig_analysis::stiffness::SampleStiffness,
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
            known_mpa: data.samples()[found.sample].stiffness_mpa,
            touches: found.touches,
            refused: found.refused,
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
    let sample = data.samples().iter().position(|sample| sample.name == settings.sample)?;
    let direction = match settings.pose.direction {
        Direction::Front => rig_contact::Direction::Front,
        Direction::Back => rig_contact::Direction::Back,
        Direction::Left => rig_contact::Direction::Left,
    };
    let along_probe_mm = touch.indentation_mm;
    let scale = free_hz / touch.no_load_hz;
    Some(PosedTouch {
        sample,
        pose: Pose::leaning(direction, settings.pose.angle_deg.to_radians()).ok()?,
        depth: if file.gives_way {
            Depth::Stage { along_probe_mm }
        } else {
            Depth::Indentation { along_probe_mm }
        },
        shift_hz: scale * touch.shift_hz,
        sigma_hz: scale * touch.shift_sigma_hz,
    })
}
