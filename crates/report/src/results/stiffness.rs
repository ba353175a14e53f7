//! The stiffness of the samples from the touches of a run, with the contact angle compensated.
//!
//! The sensor is the one of the rig file. The run corrects its description in two ways: each shift
//! is scaled by the free resonance measured before it, and all stiffness by the samples of known
//! stiffness at the smallest angle. The main touches judge the model and may change it. The labels of the
//! blind touches take no part in any of this.

mod depth;
mod shared;
mod site;
mod values;

use std::collections::BTreeMap;

use rig_analysis::{
    model::{ModelCheck, ModelReading, ModelSource, RunModel, Verdict},
    run::{
        self, ComparedAt, Reading, RunCalibration, RunSample, RunStiffness, RunTouches, RunYoung,
        SharedReferences,
    },
    screw::NoScrewMap,
    stiffness::{Compensation, Halfway, PosedTouch, Young},
};
use rig_contact::{
    Pose, SensorDescription,
    inverse::{InverseError, TiltInference},
};
use rig_files::{Faults, rig_file::RigFile};
use rig_protocol::{AngleKnowledge, ModelOrigin, Protocol};
use rig_record::{Direction, Phase, Touch};

pub(crate) use depth::MappedDepths;
pub(crate) use site::Site;
pub(crate) use values::TouchStiffness;

use crate::data::{Part, PlannedTouch, RunData};
use depth::Depths;
use shared::Together;
use site::{RepeatedTouch, UnknownAngle};

/// The stiffness of the samples and of the blind touches.
#[derive(Debug)]
pub(crate) struct Stiffness {
    pub(crate) calibration: RunCalibration,
    /// The model, learnt and judged.
    pub(crate) model: RunModel,
    /// The address of each main touch, with its index or that of its site in the residuals of the model.
    residual_of: BTreeMap<String, usize>,
    /// Each sample from its main touches, calibrated, ordered by sample.
    pub(crate) samples: Vec<RunSample>,
    /// Every main touch, in order; or every site, when the angle is unknown.
    pub(crate) main: Vec<TouchStiffness>,
    /// Every blind touch, in order.
    pub(crate) blind: Vec<TouchStiffness>,
    /// The sites of the main phase, when the angle is unknown.
    pub(crate) sites: Option<Vec<Site>>,
    /// What the map of the screw does to the depths, if the run cites one.
    pub(crate) depths: Option<MappedDepths>,
    /// By the address of its step, the stiffness of each touch or of its site, with the uncertainty
    /// of calibration and model.
    by_step: BTreeMap<String, Result<RunYoung, InverseError>>,
    /// For each part of the run, whether its rig file describes the sensor of the model.
    is_described: Vec<bool>,
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

/// In place of the stiffness of a sample whose touches alone give the factor of the run.
pub(crate) const SETS_SCALE: &str = "used for the scale";

/// Reason why a run has no stiffness.
#[derive(Debug, thiserror::Error)]
pub(crate) enum NoStiffness {
    #[error("the rig file in the journal, which describes the sensor, is not there")]
    NoRigFile,
    #[error("the rig file in the journal, which describes the sensor, cannot be read: {0}")]
    RigFile(Faults),
    #[error(transparent)]
    Screw(#[from] NoScrewMap),
    #[error("no touch of the main phase gave a stiffness")]
    NoTouches,
}

impl Stiffness {
    pub(super) fn of(data: &RunData) -> Result<Self, NoStiffness> {
        let started = data.started.as_ref().ok_or(NoStiffness::NoRigFile)?;
        let rig = RigFile::read(&started.rig.name, &started.rig.toml);
        let sensor = rig.map_err(NoStiffness::RigFile)?.sensor;
        let surface_mm = surface_sigma_mm(data);
        let compensation = Compensation::new(&sensor, surface_mm);
        let depths = Depths::of(data)?;
        let is_described = described(data, &sensor);
        let free_hz = compensation.no_load_hz();
        let (main, blind) = touched(data, &sensor, (&is_described, &depths), free_hz);
        let known_mpa: Vec<Option<f64>> =
            data.samples().iter().map(|sample| sample.stiffness_mpa).collect();
        let mean_hz = main.iter().map(|(touch, _)| touch.no_load_hz).sum::<f64>();
        let (main_touches, blind_touches) = (posed_of(&main), posed_of(&blind));
        let of_main: Vec<&Touch> = main.iter().map(|(touch, _)| *touch).collect();
        let correlation = depths.correlation(&of_main, surface_mm);
        let reference_hz2 = shared::by_references(data, free_hz, main.iter().chain(&blind));
        let touches = RunTouches {
            main: &main_touches,
            blind: &blind_touches,
            known_mpa: &known_mpa,
            sample_rel: sensor.uncertainty.sample_rel,
            depth_correlation: correlation.as_deref(),
            reference_hz2: reference_hz2.as_deref(),
            resonance_ratio: mean_hz / main.len() as f64 / free_hz,
            scale_rel: sensor.uncertainty.scale_rel,
        };
        let protocol = Protocol::read(&started.protocol.name, &started.protocol.toml);
        let (found, model, sites) = match protocol.angle() {
            AngleKnowledge::Known => {
                let (found, model) =
                    run::at_known_angles(&compensation, &touches, source(&protocol));
                (found, model, None)
            }
            AngleKnowledge::Unknown => {
                let compensation = compensation.at_depths_of(&main_touches);
                let reader = Reader { compensation, sensor, data };
                let (found, model, sites) = reader.unknown(&main, &blind, &touches);
                (found, model, Some(sites))
            }
        };
        let RunStiffness { calibration, samples, main: main_found, blind: blind_found } = found;
        if samples.is_empty() {
            return Err(NoStiffness::NoTouches);
        }
        let (by_step, residual_of) =
            by_address([&main, &blind], sites.as_deref(), [&main_found, &blind_found]);
        let stiffness = |sample: usize, number: u32, found: &Result<RunYoung, InverseError>| {
            TouchStiffness { sample, number, young: found.map(|found| found.own) }
        };
        let of_touch = |((touch, posed), found): (&Touched<'_>, &_)| {
            stiffness(posed.sample, touch.touch.repeat, found)
        };
        let of_site = |(site, found): (&Site, &_)| stiffness(site.sample, site.repeat, found);
        Ok(Self {
            calibration,
            samples,
            residual_of,
            main: match &sites {
                None => main.iter().zip(&main_found).map(of_touch).collect(),
                Some(sites) => sites.iter().zip(&main_found).map(of_site).collect(),
            },
            blind: blind.iter().zip(&blind_found).map(of_touch).collect(),
            depths: depths.summary(&data.touches),
            model,
            sites,
            by_step,
            is_described,
        })
    }

    /// Whether the rig file of this part of the run describes the sensor of the model.
    pub(super) fn describes(&self, part: usize) -> bool {
        self.is_described.get(part).is_some_and(|is_described| *is_described)
    }

    /// The stiffness of a sample, if it has one.
    pub(crate) fn of_sample(&self, sample: usize) -> Option<&RunSample> {
        self.samples.iter().find(|found| found.sample == sample)
    }

    /// The samples whose stiffness is a measurement: those that do not set the scale alone.
    pub(crate) fn measured(&self) -> impl Iterator<Item = &RunSample> {
        self.samples.iter().filter(|found| !found.sets_scale)
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

    /// The judgement on the model by the main touches.
    pub(crate) fn check(&self) -> Option<&ModelCheck> {
        self.model.check()
    }

    /// Whether the model holds; `None` when the touches cannot say.
    pub(crate) fn verdict(&self) -> Option<Verdict> {
        Some(self.check()?.verdict)
    }

    /// The residual of the main touch at this address or of its site, in standard deviations.
    pub(crate) fn residual(&self, step: &str) -> Option<f64> {
        let check = self.check()?;
        let index = self.residual_of.get(step)?;
        let residual = check.residuals.iter().find(|residual| residual.touch == *index)?;
        Some(residual.sigmas)
    }

    /// The stiffness of the touch at this address, with the uncertainty of calibration and model.
    pub(crate) fn of_touch(&self, step: &str) -> Option<Result<RunYoung, InverseError>> {
        self.by_step.get(step).copied()
    }
}

/// Turns touches at an unknown angle into stiffness.
struct Reader<'a> {
    compensation: Compensation,
    sensor: SensorDescription,
    data: &'a RunData,
}

type Touched<'a> = (&'a Touch, PosedTouch);

/// By the address of its step, the stiffness of each touch, and the index of a main touch or of its site.
type ByAddress = (BTreeMap<String, Result<RunYoung, InverseError>>, BTreeMap<String, usize>);

fn by_address(
    [main, blind]: [&[Touched<'_>]; 2],
    sites: Option<&[Site]>,
    [main_found, blind_found]: [&[Result<RunYoung, InverseError>]; 2],
) -> ByAddress {
    let mut by_step = BTreeMap::new();
    let mut note = |touch: &Touch, found: Option<&Result<RunYoung, InverseError>>| {
        let Some(found) = found else { return };
        by_step.insert(touch.touch.step.clone(), *found);
    };
    let mut residual_of = BTreeMap::new();
    for (index, (touch, posed)) in main.iter().enumerate() {
        let index = match sites {
            Some(sites) => sites.iter().position(|site| site.holds(touch, posed.sample)),
            None => Some(index),
        };
        residual_of.extend(index.map(|index| (touch.touch.step.clone(), index)));
        note(touch, index.and_then(|index| main_found.get(index)));
    }
    blind.iter().zip(blind_found).for_each(|((touch, _), found)| note(touch, Some(found)));
    (by_step, residual_of)
}

/// The touches with a known sample, of the main and of the blind phase.
fn touched<'a>(
    data: &'a RunData,
    sensor: &SensorDescription,
    (is_described, depths): (&[bool], &Depths<'_>),
    free_hz: f64,
) -> (Vec<Touched<'a>>, Vec<Touched<'a>>) {
    let touched = |touch: &'a Touch| {
        is_described.get(data.part_of(touch)).filter(|is_described| **is_described)?;
        let posed = posed(touch, sensor, data, free_hz)?;
        Some((touch, depths.correct(touch, posed)))
    };
    let is_main = |(touch, _): &Touched<'_>| touch.touch.phase == Phase::Main;
    data.touches.iter().filter_map(touched).partition(is_main)
}

/// For each part of a run, whether its rig file describes this sensor. One model holds for one sensor.
fn described(data: &RunData, sensor: &SensorDescription) -> Vec<bool> {
    let is_same = |part: &Part| {
        let rig = part.rig.as_ref().map(|rig| RigFile::read(&rig.name, &rig.toml));
        matches!(rig, Some(Ok(rig)) if rig.sensor == *sensor)
    };
    data.parts.iter().map(is_same).collect()
}

const fn source(protocol: &Protocol) -> ModelSource {
    match protocol.model() {
        ModelOrigin::Learnt => ModelSource::Learnt,
        ModelOrigin::Described => ModelSource::Described,
    }
}

fn posed_of(touched: &[Touched<'_>]) -> Vec<PosedTouch> {
    touched.iter().map(|(_, posed)| *posed).collect()
}

impl Reader<'_> {
    /// Main touches by site, each blind touch alone, at any angle up to the largest of the run.
    fn unknown(
        &self,
        main: &[Touched<'_>],
        blind: &[Touched<'_>],
        touches: &RunTouches<'_>,
    ) -> (RunStiffness, RunModel, Vec<Site>) {
        let angles = self.data.touches.iter().map(|touch| touch.touch.pose.angle_deg);
        let unknown = UnknownAngle {
            compensation: &self.compensation,
            sample_rel: self.sensor.uncertainty.sample_rel,
            max_angle_rad: angles.fold(0.0, f64::max).to_radians(),
        };
        let reading = |sample: usize, found: Result<TiltInference, InverseError>| Reading {
            sample,
            found: found.map(|found| ModelReading::of_site(&self.compensation, &found)),
        };
        let repeated = |&(touch, posed): &Touched<'_>| RepeatedTouch {
            touch: posed,
            angle_deg: touch.touch.pose.angle_deg,
            repeat: touch.touch.repeat,
        };
        let sites = unknown.sites(main.iter().map(repeated).collect());
        let mut of_sites: Vec<Reading> =
            sites.iter().map(|site| reading(site.sample, site.found)).collect();
        let mut of_blind: Vec<Reading> =
            blind.iter().map(|(_, posed)| reading(posed.sample, unknown.infer([posed]))).collect();
        let at = ComparedAt { angle_deg: None, is_there: vec![true; sites.len()] };
        let touches_of = |site: &Site| {
            let is_here =
                |(_, (touch, posed)): &(usize, &Touched<'_>)| site.holds(touch, posed.sample);
            main.iter().enumerate().filter(is_here).map(|(index, _)| index).collect()
        };
        let shared = touches.reference_hz2.map_or_else(SharedReferences::default, |hz2| {
            let groups = sites.iter().zip(&mut of_sites);
            let groups: Vec<Together> = groups
                .map(|(site, reading)| Together::new(reading, touches_of(site), hz2))
                .collect();
            let alone = of_blind.iter_mut().enumerate();
            let alone: Vec<Together> = alone
                .map(|(index, reading)| Together::new(reading, vec![main.len() + index], hz2))
                .collect();
            shared::of_groups(&groups, &alone, hz2)
        });
        // A site without a stiffness has no residual.
        let found = |(index, reading): (usize, &Reading)| {
            Some((index, (reading.sample, reading.found.as_ref().ok()?.young)))
        };
        let (indices, found): (Vec<usize>, Vec<(usize, Young)>) =
            of_sites.iter().enumerate().filter_map(found).unzip();
        let between =
            indices.iter().map(|&i| indices.iter().map(|&j| shared.between(i, j)).collect());
        let between: Vec<Vec<f64>> = between.collect();
        let model = RunModel::of_sites(&self.compensation, &found, &between).with_touches(&indices);
        (run::calibrated(touches, [&of_sites, &of_blind], &shared, &at, &model), model, sites)
    }
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
        reference_sigma_hz: scale * touch.no_load_sigma_hz.hypot(touch.drift_sigma_hz),
        halfway: touch.halfway.map(|halfway| Halfway {
            along_probe_mm: halfway.indentation_mm,
            shift_hz: scale * (halfway.resonance_hz - touch.no_load_hz),
            sigma_hz: scale * halfway.sigma_hz,
        }),
        stage_sigma_mm: None,
    })
}
