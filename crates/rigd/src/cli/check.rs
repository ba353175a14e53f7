//! `rigd check`: whether a protocol can run on a rig, without moving anything, and whether its sweeps
//! look where the resonances will be.

use std::path::{Path, PathBuf};

use clap::Args;
use rig_files::FileKind;
use rig_model::{RigLimits, counted};
use rig_protocol::{Plan, Protocol, Step, Summary};
use serde::Serialize;

use super::{
    Failure,
    args::{DataArgs, OutputArgs, RigArgs},
    screen::words_in_lines,
    table::{COLUMNS, duration, print, print_json},
};
use crate::{
    aim,
    descents::Descents,
    describe,
    files::{FileError, read},
    loaded_rig::LoadedRig,
    predict::{
        EDGE_LINEWIDTHS, NotPredicted, Predicted, Predictions, SweepSection, Warning, WindowEdge,
        WindowPosition,
    },
    protocol_file::LoadedProtocol,
    rig::{RequestRefusal, check_space},
};

#[derive(Debug, Args)]
pub(super) struct CheckArgs {
    /// Protocol file
    protocol: PathBuf,
    /// List every step with its predicted resonance
    #[arg(long)]
    steps: bool,
    #[command(flatten)]
    rig: RigArgs,
    #[command(flatten)]
    data: DataArgs,
    #[command(flatten)]
    output: OutputArgs,
}

/// The warning of a protocol that leaves the check of slip out.
const NO_SLIP_CHECK: &str = "warning: slip_mm = 0: steps that the linear stage loses in a touch will not show, and each \
                             touch is marked as not checked for slip; for a tissue that stays indented, a slip_mm \
                             larger than what stays keeps the check.";

/// Steps that a warning names one by one.
const STEPS_NAMED: usize = 5;

/// The result of a check as JSON.
#[derive(Debug, Serialize)]
struct CheckView {
    protocol: String,
    rig: String,
    is_runnable: bool,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    faults: Vec<FaultView>,
    #[serde(flatten)]
    plan: Option<PlanView>,
}

/// A fault of a file.
#[derive(Debug, Serialize)]
pub(super) struct FaultView {
    file: String,
    line: usize,
    column: usize,
    message: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    suggestion: Option<String>,
}

#[derive(Debug, Serialize)]
struct PlanView {
    touches: usize,
    no_loads: usize,
    prompts: usize,
    duration_s: f64,
    /// Whether the surface is looked for again after each sweep.
    is_slip_checked: bool,
    /// How the surfaces are found by descents.
    #[serde(skip_serializing_if = "Option::is_none")]
    descents: Option<DescentsView>,
    /// Space that the journal and the files of the run may take, bytes.
    disk_bytes: u64,
    /// Why a run would be refused now for want of space.
    #[serde(skip_serializing_if = "Option::is_none")]
    no_space: Option<String>,
    /// What the protocol wants of its touches, and what is expected of them.
    #[serde(skip_serializing_if = "Option::is_none")]
    aim: Option<rig_store::Aim>,
    linear_mm: [f64; 2],
    rotary_deg: [f64; 2],
    /// The model of the predictions.
    model: &'static str,
    warnings: Vec<WarningView>,
    steps: Vec<StepView>,
}

/// The descents of a plan on this rig.
#[derive(Debug, Serialize)]
#[expect(clippy::struct_field_names, reason = "each field ends with its unit")]
struct DescentsView {
    planned_mm_per_s: f64,
    /// The speed of a run; `null` if it searches in steps.
    mm_per_s: Option<f64>,
    /// Longest time of a reading.
    reading_s: f64,
}

#[derive(Debug, Serialize)]
struct StepView {
    id: String,
    what: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    prediction: Option<PredictionView>,
}

/// The prediction for a step, or the reason for its absence.
#[derive(Debug, Serialize)]
#[serde(untagged)]
enum PredictionView {
    Known { resonance_hz: f64, linewidth_hz: f64, window_hz: [f64; 2], placing: &'static str },
    Unknown { unknown: String },
}

/// An edge of a window that should be moved.
#[derive(Debug, Serialize)]
struct WarningView {
    sweep: &'static str,
    key: &'static str,
    window_hz: [f64; 2],
    wanted_hz: f64,
    steps: Vec<String>,
    message: String,
}

pub(super) fn check(args: &CheckArgs) -> Result<(), Failure> {
    let path = args.rig.path();
    match load(args, &path) {
        Ok((rig, protocol)) => {
            let predictions = Predictions::of(&protocol.plan, &rig);
            let disk_bytes = protocol.summary.disk_bytes;
            let no_space = check_space(existing(&args.data.dir()), disk_bytes).err();
            let checked = CheckedProtocol {
                rig: &rig,
                protocol: &protocol,
                predictions: &predictions,
                no_space,
            };
            if !args.output.json {
                if args.steps {
                    print(&(checked.steps() + "\n"))?;
                }
                return print(&checked.text());
            }
            print_json(&CheckView {
                protocol: protocol.plan.name.clone(),
                rig: rig.file.name.clone(),
                is_runnable: true,
                faults: Vec::new(),
                plan: Some(checked.view()),
            })
        }
        Err(error) => {
            if let (FileError::Faults(faults), true) = (&error, args.output.json) {
                print_json(&CheckView {
                    protocol: args.protocol.display().to_string(),
                    rig: path.display().to_string(),
                    is_runnable: false,
                    faults: faults.iter().map(FaultView::of).collect(),
                    plan: None,
                })?;
            }
            Err(error.into())
        }
    }
}

/// The directory, or the first one above it that is there.
fn existing(directory: &Path) -> Option<&Path> {
    let mut above = directory.ancestors();
    above.find(|above| above.is_dir()).or_else(|| directory.is_relative().then_some(Path::new(".")))
}

/// Reads both files. When the rig file has faults, those that the protocol has on any rig are said
/// too.
fn load(args: &CheckArgs, rig: &Path) -> Result<(LoadedRig, LoadedProtocol), FileError> {
    match LoadedRig::load(rig) {
        Ok(rig) => {
            let facts = rig.facts().with_data(&args.data.dir());
            let protocol = LoadedProtocol::load(&args.protocol, &facts)?;
            Ok((rig, protocol))
        }
        Err(FileError::Faults(mut faults)) => {
            faults.append(match read(&args.protocol, FileKind::Protocol) {
                Ok((name, text)) => Protocol::read(&name, &text).faults().clone(),
                Err(FileError::Faults(others)) => others,
                Err(error) => return Err(error),
            });
            Err(FileError::Faults(faults))
        }
        Err(error) => Err(error),
    }
}

impl FaultView {
    pub(super) fn of(fault: &rig_files::Fault) -> Self {
        Self {
            file: fault.file.clone(),
            line: fault.location.line,
            column: fault.location.column,
            message: fault.message.clone(),
            suggestion: fault.suggestion.clone(),
        }
    }
}

/// A protocol that can run, with where its resonances will be.
struct CheckedProtocol<'a> {
    rig: &'a LoadedRig,
    protocol: &'a LoadedProtocol,
    predictions: &'a Predictions,
    /// Why the disk has no room for a run now.
    no_space: Option<RequestRefusal>,
}

impl CheckedProtocol<'_> {
    fn view(&self) -> PlanView {
        let (plan, summary) = (&self.protocol.plan, &self.protocol.summary);
        let steps = plan.steps.iter().zip(&self.predictions.steps).enumerate();
        PlanView {
            touches: summary.touches,
            no_loads: summary.no_loads,
            prompts: summary.prompts,
            duration_s: summary.duration_s,
            is_slip_checked: plan.touch.approach.has_slip_check(),
            descents: Descents::of(plan, self.rig).map(|of| DescentsView {
                planned_mm_per_s: of.planned_mm_per_s,
                mm_per_s: of.mm_per_s,
                reading_s: of.reading_s,
            }),
            disk_bytes: summary.disk_bytes,
            no_space: self.no_space.as_ref().map(ToString::to_string),
            aim: plan.aim.as_ref().map(aim::recorded),
            linear_mm: [summary.linear.min.value(), summary.linear.max.value()],
            rotary_deg: [summary.rotary.min.value(), summary.rotary.max.value()],
            model: self.predictions.tier.name(),
            warnings: self
                .predictions
                .warnings()
                .iter()
                .map(|warning| self.warning(warning))
                .collect(),
            steps: steps
                .map(|(index, (step, predicted))| StepView {
                    id: step.id.to_string(),
                    what: describe::step(plan, index),
                    prediction: predicted.as_ref().map(PredictionView::of),
                })
                .collect(),
        }
    }

    fn warning(&self, warning: &Warning) -> WarningView {
        WarningView {
            sweep: warning.section.name(),
            key: warning.edge.key(),
            window_hz: [warning.window.min_hz, warning.window.max_hz],
            wanted_hz: warning.wanted_hz,
            steps: warning.steps.iter().map(|index| self.id(*index)).collect(),
            message: self.message(warning),
        }
    }

    fn id(&self, step: usize) -> String {
        self.protocol.plan.steps[step].id.to_string()
    }

    /// The fault of a window edge and the value to write instead.
    fn message(&self, warning: &Warning) -> String {
        let Warning { section, edge, window, .. } = warning;
        let (edge_hz, beyond, this_side) = match edge {
            WindowEdge::Min => (window.min_hz, "below", "above"),
            WindowEdge::Max => (window.max_hz, "above", "below"),
        };
        let (section, key) = (section.name(), edge.key());
        let advice = advice(warning, &self.rig.file.limits);
        format!(
            "[{section}] {key} = {edge_hz} Hz: predicted resonances lie {beyond} it, or less than \
             {EDGE_LINEWIDTHS} linewidth {this_side} it; {advice}"
        )
    }

    /// The worst steps of a warning, a line each.
    fn worst(&self, warning: &Warning) -> Vec<String> {
        let mut lines = Vec::new();
        for &step in warning.steps.iter().take(STEPS_NAMED) {
            if let Some(Ok(predicted)) = &self.predictions.steps[step] {
                let Predicted { resonance_hz, linewidth_hz, .. } = predicted;
                let (id, placing) = (self.id(step), predicted.placing());
                lines.push(format!(
                    "  {id}: {resonance_hz:.1} Hz, {linewidth_hz:.1} Hz wide, {placing}"
                ));
            }
        }
        if warning.steps.len() > STEPS_NAMED {
            let more = warning.steps.len() - STEPS_NAMED;
            lines.push(format!("  and {more} more; --json lists them"));
        }
        lines
    }

    /// Three lines, and what is wrong.
    fn text(&self) -> String {
        let (name, rig) = (&self.protocol.plan.name, &self.rig.file.name);
        let Summary { touches, no_loads, prompts, linear, rotary, halfway_s, .. } =
            &self.protocol.summary;
        let halfway = duration(*halfway_s);
        let duration = duration(self.protocol.summary.duration_s);
        let disk_mb = self.protocol.summary.disk_bytes.div_ceil(1_000_000);
        let predicted = || self.predictions.steps.iter().flatten().flatten();
        let (all, outside) = (
            predicted().count(),
            predicted().filter(|it| it.placing() == WindowPosition::Outside).count(),
        );
        let verdict = match outside {
            0 => format!("{name} can run on {rig}: {duration} without its prompts."),
            _ if outside == all => format!(
                "{name} keeps the limits of {rig}, but no predicted resonance lies in its window: {duration} \
                 without its prompts."
            ),
            _ => format!(
                "{name} can run on {rig}: {duration} without its prompts, with {outside} of {all} predicted \
                 resonances outside their windows."
            ),
        };
        let mut lines = vec![
            verdict,
            format!(
                "{}, {}, {}; up to {disk_mb} MB on the disk.",
                counted(*touches, "touch"),
                counted(*no_loads, "no-load reference"),
                counted(*prompts, "prompt"),
            ),
            format!("linear stage {linear}, rotary stage {rotary}."),
        ];
        lines.extend(self.no_space.as_ref().map(|refusal| format!("warning: {refusal}.")));
        if *halfway_s > 0.0 {
            lines.push(format!("{halfway} of it measure the touches halfway to their depth."));
        }
        if !self.protocol.plan.touch.approach.has_slip_check() {
            lines.push(NO_SLIP_CHECK.to_owned());
        }
        let descents = Descents::of(&self.protocol.plan, self.rig);
        let slower = descents.filter(|descents| !descents.are_as_planned());
        lines.extend(slower.map(|descents| format!("warning: {descents}.")));
        lines.extend(self.by_mounting());
        lines.extend(self.not_predicted(&self.protocol.plan));
        for warning in self.predictions.warnings() {
            lines.push(format!("warning: {}", self.message(&warning)));
            lines.extend(self.worst(&warning));
        }
        let screw_file = self.protocol.screw_file.as_deref();
        let aim = self.protocol.plan.aim.as_ref().map(|aim| aim::lines(aim, screw_file));
        let aim = aim.unwrap_or_default();
        let wrapped = lines.iter().map(|line| {
            let indent = line.len() - line.trim_start().len();
            let lines = words_in_lines(line, COLUMNS - indent);
            lines.iter().map(|line| format!("{:indent$}{line}", "")).collect::<Vec<_>>().join("\n")
        });
        wrapped.chain(aim).collect::<Vec<_>>().join("\n")
    }

    /// What the blind touches by mounting would save, if that is half of the prompts or more.
    fn by_mounting(&self) -> Option<String> {
        let now = &self.protocol.summary;
        let then = self.protocol.plan.by_mounting().summary(&self.rig.file.limits);
        let saved = duration((now.duration_s - then.duration_s).max(0.0));
        (2 * then.prompts <= now.prompts).then(|| {
            format!(
                "order = \"by-mounting\" in [blind] makes the same touches with {} prompts, in {saved} less \
                 without them.",
                then.prompts
            )
        })
    }

    /// Every step with its predicted resonance.
    fn steps(&self) -> String {
        let plan = &self.protocol.plan;
        let rows = || plan.steps.iter().zip(&self.predictions.steps).enumerate();
        let width = |of: &dyn Fn(usize) -> usize| {
            let predicted = rows().filter(|(_, (_, predicted))| predicted.is_some());
            predicted.map(|(index, _)| of(index)).max().unwrap_or(0)
        };
        let addresses = width(&|index| plan.steps[index].id.to_string().chars().count());
        let whats = width(&|index| describe::step(plan, index).chars().count());
        let line = |(index, (step, predicted)): (usize, (&Step, &Option<_>))| {
            let hz = match predicted {
                Some(Ok(Predicted { resonance_hz, .. })) => format!("{resonance_hz:8.1} Hz"),
                Some(Err(_)) => "not predicted".into(),
                // A prompt, which has no column of its own.
                None => {
                    let text = format!("{}  {}", step.id, describe::step(plan, index));
                    return words_in_lines(&text, COLUMNS - 2).join("\n  ");
                }
            };
            let (id, what) = (step.id.to_string(), describe::step(plan, index));
            format!("{id:<addresses$}  {what:<whats$}  {hz}").trim_end().to_owned()
        };
        rows().map(line).collect::<Vec<_>>().join("\n")
    }

    /// The touches without a prediction, and the reason.
    fn not_predicted(&self, plan: &Plan) -> Vec<String> {
        let mut lines = Vec::new();
        let unknown = self.predictions.unknown_samples();
        if !unknown.is_empty() {
            let names = unknown.join(", ");
            lines.push(format!(
                "There is no prediction for touches of {names}: their stiffness is not in \
                 [[samples]] of {}.",
                self.rig.source.name,
            ));
        }
        let refused =
            plan.steps.iter().zip(&self.predictions.steps).find_map(|(step, predicted)| {
                match predicted {
                    Some(Err(NotPredicted::UnknownSample { .. }) | Ok(_)) | None => None,
                    Some(Err(error)) => Some((&step.id, error)),
                }
            });
        if let Some((step, error)) = refused {
            lines.push(format!("There is no prediction for {step} and touches like it: {error}."));
        }
        lines
    }
}

/// The suggestion within the range of the analyzer.
fn advice(warning: &Warning, limits: &RigLimits) -> String {
    let Warning { section, edge, wanted_hz, .. } = *warning;
    let (lowest_hz, highest_hz) = limits.analyzer.frequency_hz;
    let (is_possible, verb, limit_hz) = match edge {
        WindowEdge::Min => (lowest_hz <= wanted_hz, "at most", lowest_hz),
        WindowEdge::Max => (wanted_hz <= highest_hz, "at least", highest_hz),
    };
    if is_possible {
        return format!("set it to {verb} {wanted_hz} Hz");
    }
    let cure = match section {
        SweepSection::NoLoad => "look whether [sensor] of the rig file describes this sensor",
        SweepSection::Contact => "touch softer samples, or less deep",
    };
    format!(
        "it would have to be {wanted_hz} Hz, and this rig's analyzer ends at {limit_hz} Hz: {cure}"
    )
}

impl PredictionView {
    fn of(predicted: &Result<Predicted, NotPredicted>) -> Self {
        match predicted {
            Ok(predicted) => Self::Known {
                resonance_hz: predicted.resonance_hz,
                linewidth_hz: predicted.linewidth_hz,
                window_hz: [predicted.window.min_hz, predicted.window.max_hz],
                placing: predicted.placing().name(),
            },
            Err(error) => Self::Unknown { unknown: error.to_string() },
        }
    }
}
