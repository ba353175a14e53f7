//! `rigd doctor`: checks a rig and advises on each problem.

use clap::Args;
use rig_model::{LineSettings, Parity, with_causes};
use serde::Serialize;

use super::{
    Failure,
    args::{DataArgs, OutputArgs, RigArgs},
    settings,
    table::{concluded, note, print, print_json},
};
use crate::{
    calibrations,
    doctor::{self, Finding, Level, commissioning, host::HostFacts},
    loaded_rig::LoadedRig,
    rig::{self, OpenError, Rung},
};

#[derive(Debug, Args)]
pub(super) struct DoctorArgs {
    #[command(flatten)]
    rig: RigArgs,
    #[command(flatten)]
    data: DataArgs,
    /// Print udev rules for serial adapters and USB instruments, and check nothing
    #[arg(long, conflicts_with_all = ["ladder", "json"])]
    udev_rules: bool,
    /// Try every speed and parity on the line of the drives, by reading alone, and check nothing else
    #[arg(long, conflicts_with = "json")]
    ladder: bool,
    #[command(flatten)]
    output: OutputArgs,
}

/// Rules that give adapters and instruments names and access, and keep other programs away.
const UDEV_RULES: &str = include_str!("../../../../config/service/99-rigd.rules");

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
    if args.udev_rules {
        return print(UDEV_RULES.trim_end());
    }
    let rig = args.rig.load()?;
    if args.ladder {
        return ladder(&rig);
    }
    let host = HostFacts::look(&rig.file);
    let (name, is_simulated) = (rig.file.name.clone(), rig.is_simulated());
    let shown = (!rig.is_put_together_as_described()).then(|| {
        let standing = calibrations::standing(&rig.basis(), &args.data.dir());
        commissioning::findings(&standing, &rig.unproven())
    });
    let (left, inspection) = ((name.as_str(), is_simulated), rig::inspect(rig)?);
    let mut findings = doctor::findings(&args.data.dir(), left, host.as_ref(), &inspection);
    findings.extend(shown.into_iter().flatten());
    match settings::hub() {
        Ok(Some(hub)) => findings.extend(doctor::hub::findings(&hub, &args.data.dir())),
        Ok(None) => {}
        Err(error) => findings.push(doctor::hub::unread(with_causes(&error))),
    }
    let count = |level| findings.iter().filter(|finding| finding.level == level).count();
    let (problems, warnings) = (count(Level::Problem), count(Level::Warning));
    let printed = if args.output.json {
        let findings = findings.into_iter().map(FindingView::from).collect();
        print_json(&DoctorView { rig: name, problems, warnings, findings })
    } else {
        print(&text(&findings))
    };
    concluded(printed, if problems > 0 { Err(Failure::Unfit { problems }) } else { Ok(()) })
}

/// Says at which speeds and parities the drives of a rig answer.
fn ladder(rig: &LoadedRig) -> Result<(), Failure> {
    let shown = |line: LineSettings| {
        let parity = match line.parity {
            Parity::None => "none",
            Parity::Even => "even",
            Parity::Odd => "odd",
        };
        format!("baud = {}, parity = \"{parity}\"", line.baud)
    };
    let report = |line, trouble: Option<&OpenError>| match trouble {
        None => note(&format!("reading at {}", shown(line))),
        Some(error) => note(&format!("not read: {}", with_causes(error))),
    };
    let found = rig::climb(rig, report)?;
    for Rung { line, linear, rotary } in &found {
        let who = match (linear, rotary) {
            (true, true) => "both drives answer",
            (true, false) => "the drive of the linear stage answers",
            (false, true) => "the drive of the rotary stage answers",
            (false, false) => continue,
        };
        print(&format!("{}: {who}", shown(*line)))?;
    }
    if found.is_empty() { Err(Failure::NoAnswer) } else { Ok(()) }
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
