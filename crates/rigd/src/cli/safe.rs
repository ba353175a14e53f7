//! `rigd safe`: retracts the probe on its own, for the stop hook of a service manager.

use std::path::PathBuf;

use clap::Args;
use rig_model::{Clearance, Position};
use rig_system::program::wait_for_the_replaced;
use serde::Serialize;

use super::{
    Failure,
    args::{OperatorArgs, OutputArgs, RigArgs},
    table::{note, print, print_json},
};
use crate::{
    hint,
    rig::{WayOut, make_safe},
};

/// Opens the port of the drives and nothing else, stops both axes, and retracts the probe until a
/// read-back shows it clear. It lowers nothing and turns nothing, and it ends: it tries for as long
/// as `patience_s` in the rig file. Exit code 0: the probe is clear. 4: it is not shown to be clear.
/// 1: nothing was sent, because another program has the port or the data directory, or the port
/// cannot be opened.
#[derive(Debug, Args)]
pub(super) struct SafeArgs {
    #[command(flatten)]
    rig: RigArgs,
    /// Directory of the journal, to record the retract; without it nothing is recorded
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    #[command(flatten)]
    operator: OperatorArgs,
    /// Why rigd has replaced itself by this command; the exit code is then 4
    #[arg(long, value_name = "TEXT", hide = true)]
    because: Option<String>,
    #[command(flatten)]
    output: OutputArgs,
}

/// The way out, for a program.
#[derive(Debug, Serialize)]
struct SafeView {
    /// `clear`, `in contact` or `unknown`.
    probe: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    from_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    linear_mm: Option<f64>,
    duration_s: f64,
    /// What failed on the way.
    faults: Vec<String>,
    /// The session in the journal.
    #[serde(skip_serializing_if = "Option::is_none")]
    session: Option<String>,
    /// Why the journal has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    not_recorded: Option<String>,
}

pub(super) fn safe(args: &SafeArgs) -> Result<(), Failure> {
    wait_for_the_replaced();
    let operator = args.operator.name();
    let out = make_safe(args.rig.load()?, args.data.as_deref(), operator.as_str())?;
    for fault in &out.faults {
        note(&fault.to_string());
    }
    if let Err(reason) = &out.recorded {
        note(&format!("the retract is not in the journal: {reason}"));
    }
    if args.output.json {
        print_json(&view(&out))?;
    } else {
        print(&sentence(&out))?;
    }
    if out.clearance == Clearance::Clear {
        return match &args.because {
            None => Ok(()),
            Some(because) => Err(Failure::Replaced { because: because.clone() }),
        };
    }
    let cause = out.faults.last();
    let hint = cause.map_or_else(String::new, |fault| {
        format!("; {}", hint::after(fault, out.clearance).at_a_terminal())
    });
    Err(Failure::NotClear { probe: out.clearance, hint })
}

/// All of it in one line.
fn sentence(out: &WayOut) -> String {
    let moved = match (out.from, out.linear) {
        (Some(from), Some(to)) => format!("linear stage: {from} → {to}; "),
        _ => "linear stage: no read-back; ".to_owned(),
    };
    let seconds = out.took.as_secs_f64();
    format!("{moved}the probe is {} after {seconds:.1} s", out.clearance.text())
}

fn view(out: &WayOut) -> SafeView {
    SafeView {
        probe: out.clearance.name(),
        from_mm: out.from.map(Position::value),
        linear_mm: out.linear.map(Position::value),
        duration_s: out.took.as_secs_f64(),
        faults: out.faults.iter().map(ToString::to_string).collect(),
        session: out.recorded.as_ref().ok().and_then(|id| id.map(|id| id.to_string())),
        not_recorded: out.recorded.as_ref().err().map(ToString::to_string),
    }
}
