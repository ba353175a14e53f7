//! `rigd move` and `rigd home`: one axis by hand, within the limits of the interlock.

use clap::{Args, ValueEnum};
use rig_engine::{Command, CommandRefusal};
use rig_model::{Clearance, Deg, Mm, Position, RigLimits};
use serde::Serialize;

use super::{
    Failure,
    args::{BenchArgs, OutputArgs},
    session::{LeftInContact, Session, with_rig},
    table::{facts, note, print, print_json},
};
use crate::rig::{RequestRefusal, Status};

#[derive(Debug, Args)]
pub(super) struct MoveArgs {
    /// Axis to move
    #[arg(value_enum)]
    axis: MoveAxis,
    /// Target: the height of the probe in mm, or the tilt of the sample in degrees
    #[arg(value_name = "MM|DEG", allow_negative_numbers = true)]
    to: f64,
    #[command(flatten)]
    bench: BenchArgs,
    #[command(flatten)]
    output: OutputArgs,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum MoveAxis {
    /// The vertical stage that carries the probe
    Linear,
    /// The stage that tilts the sample
    Rotary,
}

#[derive(Debug, Args)]
pub(super) struct HomeArgs {
    /// States that you have seen with your own eyes that nothing is below the probe, down to the end of
    /// its travel: a linear stage that has lost its position is homed, even downwards. The journal
    /// keeps it with your name
    #[arg(long)]
    nothing_below_probe: bool,
    #[command(flatten)]
    bench: BenchArgs,
    #[command(flatten)]
    output: OutputArgs,
}

/// Read-back positions of the axes.
#[derive(Debug, Serialize)]
struct PositionsView {
    #[serde(skip_serializing_if = "Option::is_none")]
    linear_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    rotary_deg: Option<f64>,
    probe: &'static str,
}

pub(super) fn to(args: &MoveArgs) -> Result<(), Failure> {
    let rig = args.bench.rig.load()?;
    let command = match args.axis {
        MoveAxis::Linear => Command::MoveLinear(linear_target(&rig.file.limits, args.to)?),
        MoveAxis::Rotary => Command::MoveRotary(rotary_target(&rig.file.limits, args.to)?),
    };
    let moved = async |session: &mut Session| session.carry_out(command).await;
    show(
        &with_rig(
            rig,
            &args.bench.data.dir(),
            &args.bench.operator.name(),
            LeftInContact::Refuse,
            moved,
        )?,
        &args.output,
    )
}

/// Opening a rig is what homes it.
pub(super) fn home(args: &HomeArgs) -> Result<(), Failure> {
    let homed = async |session: &mut Session| session.finished().await;
    let (rig, operator) = (args.bench.rig.load()?, args.bench.operator.name());
    let left = if args.nothing_below_probe {
        LeftInContact::HomeWithNothingBelow
    } else {
        LeftInContact::Retract
    };
    show(&with_rig(rig, &args.bench.data.dir(), &operator, left, homed)?, &args.output)
}

/// A height within the soft limits. It is checked before the rig is opened, so that a mistyped
/// number moves nothing; the engine checks it again with the state of the probe.
pub(super) fn linear_target(limits: &RigLimits, mm: f64) -> Result<Position<Mm>, Failure> {
    let target = limits.linear.target(Position::new(mm));
    Ok(target
        .map_err(|error| RequestRefusal::from(CommandRefusal::LinearTarget(error)))?
        .position())
}

/// The target of a tilt.
pub(super) fn rotary_target(limits: &RigLimits, deg: f64) -> Result<Position<Deg>, Failure> {
    let target = limits.rotary.target(Position::new(deg));
    Ok(target
        .map_err(|error| RequestRefusal::from(CommandRefusal::RotaryTarget(error)))?
        .position())
}

/// The positions of the axes as text.
pub(super) fn positions(status: &Status) -> Vec<(&'static str, String)> {
    let (linear, rotary) = (status.snapshot.linear, status.snapshot.rotary);
    let linear = linear.map(|at| ("linear stage", at.to_string()));
    let rotary = rotary.map(|at| ("rotary stage", at.to_string()));
    linear.into_iter().chain(rotary).collect()
}

fn show(status: &Status, output: &OutputArgs) -> Result<(), Failure> {
    let snapshot = &status.snapshot;
    if output.json {
        return print_json(&PositionsView {
            linear_mm: snapshot.linear.map(Position::value),
            rotary_deg: snapshot.rotary.map(Position::value),
            probe: snapshot.clearance.name(),
        });
    }
    let mut rows = positions(status);
    rows.push(("probe", snapshot.clearance.text().to_owned()));
    print(&facts(&rows))?;
    if snapshot.clearance != Clearance::Clear {
        note(
            "the probe stays there, and counts as in contact until a read-back shows it clear; \
             the next command that opens the rig retracts it first",
        );
    }
    Ok(())
}
