//! `rig-study analyse`: the analysis of runs whose touches come from another program.

use std::{
    io::{self, BufRead, Write},
    path::Path,
};

use rig_analysis::{
    model::{ModelSource, Pattern},
    run::{RunTouches, RunYoung, at_known_angles},
    stiffness::{Compensation, Halfway, PosedTouch},
};
use rig_contact::{Depth, Pose, PoseError, SensorDescription};
use serde::{Deserialize, Serialize};

use crate::outcome::StudyError;

/// The analysis of a run of the daemon, for touches on standard input: one JSON object a line for each run, and one
/// a line out.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Take the model of the rig file instead of the one learnt from the main touches.
    #[arg(long)]
    described: bool,
    /// Standard deviation of the surface found, mm.
    #[arg(long, default_value_t = 0.002, value_parser = crate::contact_args::not_negative)]
    surface_sigma_mm: f64,
}

/// A run of the reference sensor.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Run {
    main: Vec<Touch>,
    blind: Vec<Touch>,
    /// Known Young's modulus of each sample, MPa.
    known_mpa: Vec<Option<f64>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Touch {
    /// Index of the sample.
    sample: usize,
    angle_deg: f64,
    /// From the front towards the left.
    azimuth_deg: f64,
    indentation_mm: f64,
    shift_hz: f64,
    sigma_hz: f64,
    /// The part of it that is due to the reference.
    reference_sigma_hz: f64,
    halfway: Option<TouchHalfway>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct TouchHalfway {
    indentation_mm: f64,
    shift_hz: f64,
    sigma_hz: f64,
}

#[derive(Debug, Serialize)]
struct Answer {
    /// `None` when the touches leave no degree of freedom.
    verdict: Option<&'static str>,
    pattern: Option<&'static str>,
    chi2_per_dof: Option<f64>,
    /// This and the next two: `None` unless the model holds.
    depth_exponent_noticed: Option<f64>,
    slip_noticed_below: Option<f64>,
    first_slip_noticed: Option<f64>,
    tangential_ratio: f64,
    arm_mm: f64,
    is_held_by_stage: bool,
    /// For each sample with a stiffness.
    samples: Vec<SampleAnswer>,
    /// For each blind touch; `None` for a refusal.
    blind: Vec<Option<YoungAnswer>>,
}

#[derive(Debug, Serialize)]
struct SampleAnswer {
    sample: usize,
    #[serde(flatten)]
    young: YoungAnswer,
}

#[derive(Debug, Serialize)]
struct YoungAnswer {
    stiffness_mpa: f64,
    sigma_mpa: f64,
}

/// A run that cannot be analysed.
#[derive(Debug, thiserror::Error)]
enum RunError {
    #[error("touch of sample {sample}: known_mpa has {samples} samples, from 0 on")]
    NoSample { sample: usize, samples: usize },
    #[error("touch of sample {sample}")]
    Pose { sample: usize, source: PoseError },
}

pub(crate) fn run(args: &Args, out: &mut impl Write) -> Result<(), StudyError> {
    let described = Compensation::new(&SensorDescription::reference(), args.surface_sigma_mm);
    let source = if args.described { ModelSource::Described } else { ModelSource::Learnt };
    for line in io::stdin().lock().lines() {
        let file = |source| StudyError::File { path: Path::new("standard input").into(), source };
        let run: Run = serde_json::from_str(&line.map_err(file)?).map_err(StudyError::arguments)?;
        let answer = analysed(&described, &run, source).map_err(StudyError::arguments)?;
        serde_json::to_writer(&mut *out, &answer)?;
        writeln!(out)?;
    }
    Ok(())
}

fn analysed(described: &Compensation, run: &Run, source: ModelSource) -> Result<Answer, RunError> {
    let samples = run.known_mpa.len();
    let posed = |touches: &[Touch]| -> Result<Vec<PosedTouch>, RunError> {
        touches.iter().map(|touch| touch.posed(samples)).collect()
    };
    let (main, blind) = (posed(&run.main)?, posed(&run.blind)?);
    let uncertainty = SensorDescription::reference().uncertainty;
    let touches = RunTouches {
        main: &main,
        blind: &blind,
        known_mpa: &run.known_mpa,
        sample_rel: uncertainty.sample_rel,
        depth_correlation: None,
        reference_hz2: None,
        resonance_ratio: 1.0,
        scale_rel: uncertainty.scale_rel,
    };
    let (found, model) = at_known_angles(described, &touches, source);
    let check = model.check();
    let slip = check.and_then(|check| check.slip_noticed);
    let young = |found: &Result<RunYoung, _>| {
        let whole = found.as_ref().ok()?.whole();
        Some(YoungAnswer { stiffness_mpa: whole.mpa, sigma_mpa: whole.sigma_mpa })
    };
    let samples = found.samples.iter().map(|one| SampleAnswer {
        sample: one.sample,
        young: YoungAnswer { stiffness_mpa: one.young_mpa, sigma_mpa: one.sigma_mpa },
    });
    Ok(Answer {
        verdict: check.map(|check| check.verdict.name()),
        pattern: check.and_then(|check| check.pattern).map(Pattern::name),
        chi2_per_dof: check.map(rig_analysis::model::ModelCheck::chi2_per_dof),
        depth_exponent_noticed: check.and_then(|check| check.exponent_noticed),
        slip_noticed_below: slip.and_then(|slip| slip.below),
        first_slip_noticed: slip.map(|slip| slip.share_of_first),
        tangential_ratio: model.terms().tangential_ratio,
        arm_mm: model.terms().arm_mm,
        is_held_by_stage: model.terms().deflects,
        samples: samples.collect(),
        blind: found.blind.iter().map(young).collect(),
    })
}

impl Touch {
    fn posed(&self, samples: usize) -> Result<PosedTouch, RunError> {
        let Self { sample, angle_deg, azimuth_deg, shift_hz, sigma_hz, .. } = *self;
        if sample >= samples {
            return Err(RunError::NoSample { sample, samples });
        }
        let pose = Pose::new(angle_deg.to_radians(), azimuth_deg.to_radians())
            .map_err(|source| RunError::Pose { sample, source })?;
        let halfway = self.halfway.as_ref().map(|one| Halfway {
            along_probe_mm: one.indentation_mm,
            shift_hz: one.shift_hz,
            sigma_hz: one.sigma_hz,
        });
        Ok(PosedTouch {
            sample,
            pose,
            depth: Depth::Indentation { along_probe_mm: self.indentation_mm },
            shift_hz,
            sigma_hz,
            reference_sigma_hz: self.reference_sigma_hz,
            halfway,
            stage_sigma_mm: None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_a_run_and_a_sample_that_is_not_there_is_refused() {
        let touch = |sample: usize, shift_hz: f64| {
            format!(
                r#"{{"sample":{sample},"angle_deg":0.0,"azimuth_deg":0.0,"indentation_mm":0.5,
                "shift_hz":{shift_hz},"sigma_hz":0.3,"reference_sigma_hz":0.2,"halfway":null}}"#
            )
        };
        let line = |sample| {
            let main = [touch(0, 8.0), touch(0, 8.1), touch(1, 17.8)].join(",");
            let blind = touch(sample, 17.8);
            format!(r#"{{"main":[{main}],"blind":[{blind}],"known_mpa":[0.045,null]}}"#)
        };
        let described = Compensation::new(&SensorDescription::reference(), 0.002);
        let of = |line: String| {
            analysed(&described, &serde_json::from_str(&line).unwrap(), ModelSource::Learnt)
        };
        let found = of(line(1)).unwrap();
        assert_eq!((found.samples.len(), found.blind.len()), (2, 1), "{found:?}");
        let young = found.blind[0].as_ref().unwrap();
        assert!((young.stiffness_mpa / 0.104 - 1.0).abs() < 0.03, "{young:?}");
        assert_eq!(
            of(line(2)).unwrap_err().to_string(),
            "touch of sample 2: known_mpa has 2 samples, from 0 on"
        );
    }
}
