//! The stiffness of the samples from the touches of a run, with the contact angle compensated.
//!
//! The sensor is the one of the rig file. The run corrects its description in two ways: each shift
//! is scaled by the free resonance measured before it, and all stiffness by the samples of known
//! stiffness at the smallest angle. The labels of the blind touches take no part in it.

mod calibration;
mod site;
mod values;

use std::collections::BTreeMap;

use rig_analysis::stiffness::{self, Compensation, PosedTouch, Young};
use rig_contact::{
    Pose, SensorDescription,
    inverse::{InverseError, OneTouch, TiltInference},
};
use rig_files::{Faults, rig_file::RigFile};
use rig_protocol::{AngleKnowledge, Protocol};
use rig_record::{Direction, Phase, Sample, Touch};

pub(crate) use calibration::{Calibration, ScaleSource};
pub(crate) use site::Site;
pub(crate) use values::{SampleStiffness, TouchStiffness};

use crate::data::{PlannedTouch, RunData};
use calibration::ComparedAt;
use site::{RepeatedTouch, UnknownAngle};

/// The stiffness of the samples and of the blind touches.
#[derive(Debug)]
pub(crate) struct Stiffness {
    pub(crate) calibration: Calibration,
    /// Each sample from its main touches, calibrated, ordered by sample.
    pub(crate) samples: Vec<SampleStiffness>,
    /// Every main touch, in order; or every site, when the angle is unknown.
    pub(crate) main: Vec<TouchStiffness>,
    /// Every blind touch, in order.
    pub(crate) blind: Vec<TouchStiffness>,
    /// The sites of the main phase, when the angle is unknown.
    pub(crate) sites: Option<Vec<Site>>,
    /// By the address of its step, the stiffness of each touch or of its site, with the uncertainty
    /// of the calibration.
    by_step: BTreeMap<String, Result<Young, InverseError>>,
}

/// The touches or sites behind the stiffness of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct StiffnessBasis {
    /// Number of touches or sites with a stiffness.
    pub(crate) used: usize,
    /// Number of planned touches or sites.
    pub(crate) planned: usize,
    /// The counted thing: `touches` or `sites`.
    pub(crate) of: &'static str,
}

impl StiffnessBasis {
    /// `9 of 12 touches`; `None` when none is missing.
    pub(crate) fn shortfall(self) -> Option<String> {
        let Self { used, planned, of } = self;
        (used < planned).then(|| format!("{used} of {planned} {of}"))
    }
}

/// Reason why a run has no stiffness.
#[derive(Debug, thiserror::Error)]
pub(crate) enum NoStiffness {
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
        let sensor = rig.map_err(NoStiffness::RigFile)?.sensor;
        let compensation = Compensation::new(&sensor, surface_sigma_mm(data));
        let free_hz = compensation.no_load_hz();
        let (mut main, mut blind) = (Vec::new(), Vec::new());
        for touch in &data.touches {
            let Some(posed) = posed(touch, &sensor, data, free_hz) else { continue };
            match touch.touch.phase {
                Phase::Main => main.push((touch, posed)),
                Phase::Blind => blind.push((touch, posed)),
            }
        }
        let reader = Reader { compensation, sensor, data };
        let angle = Protocol::read(&started.protocol.name, &started.protocol.toml).angle();
        let Readings { main: read, blind: blind_read, sites, at } = match angle {
            AngleKnowledge::Known => reader.known(&main, &blind),
            AngleKnowledge::Unknown => reader.unknown(&main, &blind),
        };
        let mean_hz = main.iter().map(|(touch, _)| touch.no_load_hz).sum::<f64>();
        let resonance_ratio = mean_hz / main.len() as f64 / free_hz;
        let scale_rel = reader.sensor.uncertainty.scale_rel;
        let calibration = Calibration::of(&read, at, data.samples(), resonance_ratio, scale_rel);
        let samples = samples(&read, data.samples(), &calibration);
        if samples.is_empty() {
            return Err(NoStiffness::NoTouches);
        }
        let calibrated = |touches: Vec<TouchStiffness>| -> Vec<TouchStiffness> {
            touches.into_iter().map(|touch| calibration.touch(touch)).collect()
        };
        let (main_read, blind_read) = (calibrated(read), calibrated(blind_read));
        let mut by_step = BTreeMap::new();
        let mut note = |touch: &Touch, found: &TouchStiffness| {
            let young = found.young.map(|young| calibration.with_its_sigma(young));
            by_step.insert(touch.touch.step.clone(), young);
        };
        for (index, (touch, posed)) in main.iter().enumerate() {
            let index = match &sites {
                Some(sites) => sites.iter().position(|site| site.holds(touch, posed.sample)),
                None => Some(index),
            };
            if let Some(index) = index {
                note(touch, &main_read[index]);
            }
        }
        blind.iter().zip(&blind_read).for_each(|((touch, _), found)| note(touch, found));
        Ok(Self { calibration, samples, main: main_read, blind: blind_read, sites, by_step })
    }

    /// The stiffness of a sample, if it has one.
    pub(crate) fn of_sample(&self, sample: usize) -> Option<&SampleStiffness> {
        self.samples.iter().find(|found| found.sample == sample)
    }

    /// The used and the planned touches or sites of a sample.
    pub(crate) fn basis(&self, data: &RunData, sample: usize) -> StiffnessBasis {
        let is_of_sample = |planned: &&PlannedTouch| {
            planned.settings.phase == Phase::Main
                && data.sample(&planned.settings.sample) == Some(sample)
        };
        let mut planned: Vec<(f64, u32)> = (data.planned.iter().filter(is_of_sample))
            .map(|planned| (planned.settings.pose.angle_deg, planned.settings.repeat))
            .collect();
        if self.sites.is_some() {
            planned.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            planned.dedup();
        }
        let used = self.of_sample(sample).map_or(0, |found| found.touches);
        let of = if self.sites.is_some() { "sites" } else { "touches" };
        StiffnessBasis { used, planned: planned.len(), of }
    }

    /// The stiffness of the touch at this address, with the uncertainty of the calibration.
    pub(crate) fn of_touch(&self, step: &str) -> Option<Result<Young, InverseError>> {
        self.by_step.get(step).copied()
    }
}

/// Turns the touches of a run into stiffness.
struct Reader<'a> {
    compensation: Compensation,
    sensor: SensorDescription,
    data: &'a RunData,
}

/// The stiffness of the touches of a run, not yet calibrated.
struct Readings {
    main: Vec<TouchStiffness>,
    blind: Vec<TouchStiffness>,
    sites: Option<Vec<Site>>,
    at: ComparedAt,
}

type Touched<'a> = (&'a Touch, PosedTouch);

impl Reader<'_> {
    /// Each touch alone, at its planned angle.
    fn known(&self, main: &[Touched<'_>], blind: &[Touched<'_>]) -> Readings {
        let young = |one: OneTouch| Young { mpa: one.young_mpa, sigma_mpa: one.sigma_mpa };
        let found = |(touch, posed): &Touched<'_>| TouchStiffness {
            sample: posed.sample,
            number: touch.touch.repeat,
            young: self.compensation.of_touch(posed).map(young),
        };
        // At the smallest angle, an error of the angle changes the stiffness least.
        let angle = |touched: &Touched<'_>| touched.0.touch.pose.angle_deg;
        let angle_deg = main.iter().map(angle).min_by(f64::total_cmp);
        let is_there = main.iter().map(|touched| Some(angle(touched)) == angle_deg).collect();
        Readings {
            main: main.iter().map(found).collect(),
            blind: blind.iter().map(found).collect(),
            sites: None,
            at: ComparedAt { angle_deg, is_there },
        }
    }

    /// Main touches by site, each blind touch alone, at any angle up to the largest of the run.
    fn unknown(&self, main: &[Touched<'_>], blind: &[Touched<'_>]) -> Readings {
        let angles = self.data.touches.iter().map(|touch| touch.touch.pose.angle_deg);
        let unknown = UnknownAngle {
            compensation: &self.compensation,
            sample_rel: self.sensor.uncertainty.sample_rel,
            max_angle_rad: angles.fold(0.0, f64::max).to_radians(),
        };
        let young = |found: TiltInference| Young {
            mpa: found.young_mpa.value,
            sigma_mpa: found.young_mpa.sigma,
        };
        let repeated = |&(touch, posed): &Touched<'_>| RepeatedTouch {
            touch: posed,
            angle_deg: touch.touch.pose.angle_deg,
            repeat: touch.touch.repeat,
        };
        let sites = unknown.sites(main.iter().map(repeated).collect());
        let of_site = |site: &Site| TouchStiffness {
            sample: site.sample,
            number: site.repeat,
            young: site.found.map(young),
        };
        let of_touch = |(touch, posed): &Touched<'_>| TouchStiffness {
            sample: posed.sample,
            number: touch.touch.repeat,
            young: unknown.infer([posed]).map(young),
        };
        Readings {
            main: sites.iter().map(of_site).collect(),
            blind: blind.iter().map(of_touch).collect(),
            at: ComparedAt { angle_deg: None, is_there: vec![true; sites.len()] },
            sites: Some(sites),
        }
    }
}

fn samples(
    main: &[TouchStiffness],
    samples: &[Sample],
    calibration: &Calibration,
) -> Vec<SampleStiffness> {
    let sample = |(index, sample): (usize, &Sample)| {
        let of_sample = || main.iter().filter(|touch| touch.sample == index);
        let found: Vec<Young> = of_sample().filter_map(|touch| touch.young.ok()).collect();
        let refused = of_sample().count() - found.len();
        let mean = stiffness::SampleStiffness::mean(index, &found, refused)?;
        Some(calibration.sample(&mean, sample.stiffness_mpa))
    };
    samples.iter().enumerate().filter_map(sample).collect()
}

/// The root mean square of the standard deviations of the surfaces found, mm.
fn surface_sigma_mm(data: &RunData) -> f64 {
    let squares = data.touches.iter().map(|touch| touch.surface_sigma_mm.powi(2)).sum::<f64>();
    (squares / data.touches.len().max(1) as f64).sqrt()
}

/// A touch for the model, its shift scaled to the free resonance of the sensor described.
fn posed(
    touch: &Touch,
    sensor: &SensorDescription,
    data: &RunData,
    free_hz: f64,
) -> Option<PosedTouch> {
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
        depth: sensor.depth(touch.indentation_mm),
        shift_hz: scale * touch.shift_hz,
        sigma_hz: scale * touch.shift_sigma_hz,
    })
}
