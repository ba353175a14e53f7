//! `rigd doctor`: checks a rig and advises on each problem.

use clap::Args;
use serde::Serialize;

use super::{
    Failure,
    args::{DataArgs, OutputArgs, RigArgs},
    table::{print, print_json},
};
use crate::{
    doctor::{self, Finding, Level},
    rig,
};

#[derive(Debug, Args)]
pub(super) struct DoctorArgs {
    #[command(flatten)]
    rig: RigArgs,
    #[command(flatten)]
    data: DataArgs,
    #[command(flatten)]
    output: OutputArgs,
}

/// The findings as JSON.
#[derive(Debug, Serialize)]
struct DoctorView {
    rig: String,
    problems: usize,
    warnings: usize,
    findings: Vec<FindingView>,
}

#[derive(Debug, Serialize)]
struct FindingView {
    part: &'static str,
    check: &'static str,
    level: &'static str,
    text: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    advice: Option<&'static str>,
}

pub(super) fn doctor(args: &DoctorArgs) -> Result<(), Failure> {
    let rig = args.rig.load()?;
    let name = rig.file.name.clone();
    let findings = doctor::findings(&args.data.dir(), &name, &rig::inspect(rig)?);
    let count = |level| findings.iter().filter(|finding| finding.level == level).count();
    let (problems, warnings) = (count(Level::Problem), count(Level::Warning));
    if args.output.json {
        let findings = findings.into_iter().map(FindingView::from).collect();
        print_json(&DoctorView { rig: name, problems, warnings, findings })?;
    } else {
        print(&text(&findings))?;
    }
    if problems > 0 { Err(Failure::Unfit { problems }) } else { Ok(()) }
}

/// One line for each finding, with its advice below.
fn text(findings: &[Finding]) -> String {
    let mut lines = Vec::new();
    for Finding { part, check, level, text, advice } in findings {
        lines.push(format!("{:<7}  {part}, {check}: {text}", level.name()));
        lines.extend(advice.map(|advice| format!("{:7}  → {advice}", "")));
    }
    lines.join("\n")
}

impl From<Finding> for FindingView {
    fn from(Finding { part, check, level, text, advice }: Finding) -> Self {
        Self { part, check, level: level.name(), text, advice }
    }
}
