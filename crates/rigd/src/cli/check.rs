//! `rigd check`: whether a protocol can run on a rig, without moving anything.

use rig_protocol::Protocol;
use serde::Serialize;

use super::{
    CheckArgs, Failure,
    table::{columns, duration, print, print_json},
};
use crate::{
    describe,
    loaded_rig::{FileError, LoadedRig, RigFacts, read},
    protocol_file::LoadedProtocol,
};

/// What a program is told.
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
    linear_mm: [f64; 2],
    rotary_deg: [f64; 2],
    steps: Vec<StepView>,
}

#[derive(Debug, Serialize)]
struct StepView {
    id: String,
    what: String,
}

pub(super) fn check(args: &CheckArgs) -> Result<(), Failure> {
    match load(args) {
        Ok((facts, protocol)) if args.output.json => print_json(&CheckView {
            protocol: protocol.plan.name.clone(),
            rig: facts.name,
            is_runnable: true,
            faults: Vec::new(),
            plan: Some(view(&protocol)),
        }),
        Ok((facts, protocol)) => print(&text(&protocol, &facts.name)),
        Err(error) => {
            if let (FileError::Faults(faults), true) = (&error, args.output.json) {
                print_json(&CheckView {
                    protocol: args.protocol.display().to_string(),
                    rig: args.rig.rig.display().to_string(),
                    is_runnable: false,
                    faults: faults.iter().map(FaultView::of).collect(),
                    plan: None,
                })?;
            }
            Err(error.into())
        }
    }
}

/// Reads both files. When the rig file has faults, those that the protocol has on any rig are said
/// too.
fn load(args: &CheckArgs) -> Result<(RigFacts, LoadedProtocol), FileError> {
    match LoadedRig::load(&args.rig.rig) {
        Ok(rig) => {
            let facts = rig.facts();
            let protocol = LoadedProtocol::load(&args.protocol, &facts)?;
            Ok((facts, protocol))
        }
        Err(FileError::Faults(mut faults)) => {
            let (name, text) = read(&args.protocol)?;
            faults.append(Protocol::read(&name, &text).faults().clone());
            Err(FileError::Faults(faults))
        }
        Err(error) => Err(error),
    }
}

impl FaultView {
    pub(super) fn of(fault: &rig_settings::Fault) -> Self {
        Self {
            file: fault.file.clone(),
            line: fault.place.line,
            column: fault.place.column,
            message: fault.message.clone(),
            suggestion: fault.suggestion.clone(),
        }
    }
}

fn view(protocol: &LoadedProtocol) -> PlanView {
    let (plan, summary) = (&protocol.plan, &protocol.summary);
    let step = |(index, step): (usize, &rig_protocol::Step)| StepView {
        id: step.id.to_string(),
        what: describe::step(plan, index),
    };
    PlanView {
        touches: summary.touches,
        no_loads: summary.no_loads,
        prompts: summary.prompts,
        duration_s: summary.duration_s,
        linear_mm: [summary.linear.min.value(), summary.linear.max.value()],
        rotary_deg: [summary.rotary.min.value(), summary.rotary.max.value()],
        steps: plan.steps.iter().enumerate().map(step).collect(),
    }
}

fn text(protocol: &LoadedProtocol, rig: &str) -> String {
    let (plan, summary) = (&protocol.plan, &protocol.summary);
    let mut rows = Vec::new();
    for (index, step) in plan.steps.iter().enumerate() {
        rows.push(vec![step.id.to_string(), describe::step(plan, index)]);
    }
    let steps = columns(&["step", ""], &rows);
    format!(
        "{steps}\n\n{name} can run on {rig}: {touches} touches, {no_loads} no-load references, \
         {prompts} prompts.\nlinear stage {linear}, rotary stage {rotary}.\nexpected duration \
         {duration}, without the time that a person takes.",
        name = plan.name,
        touches = summary.touches,
        no_loads = summary.no_loads,
        prompts = summary.prompts,
        linear = summary.linear,
        rotary = summary.rotary,
        duration = duration(summary.duration_s),
    )
}
