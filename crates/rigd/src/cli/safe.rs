//! `rigd safe`: retracts the probe on its own, for the stop hook of a service manager.

use std::path::PathBuf;

use clap::Args;
use rig_engine::{Fault, Jump, Snapshot};
use rig_model::{Clearance, Position, Span};
use rig_store::Digest;
use rig_system::program::wait_for_the_replaced;
use serde::Serialize;

use super::{
    Failure,
    args::{OperatorArgs, OutputArgs, RigArgs},
    table::{concluded, note, print, print_json},
};
use crate::{
    hint,
    rig::{KnownRig, WayOut, make_safe},
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
    /// Directory of the journal, to record the retract; without it the default directory is read, and nothing is
    /// recorded
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    #[command(flatten)]
    operator: OperatorArgs,
    /// Why rigd has replaced itself by this command; the exit code is then 4
    #[arg(long, value_name = "TEXT", hide = true)]
    because: Option<String>,
    /// What the replaced program knew of its rig
    #[command(flatten)]
    known: KnownArgs,
    #[command(flatten)]
    output: OutputArgs,
}

/// What a replaced program knew of its rig; its disk may not answer.
#[derive(Debug, Default, Args)]
pub(super) struct KnownArgs {
    /// The rig was in service, with files of this digest
    #[arg(long, value_name = "SHA256", hide = true)]
    in_service_with: Option<String>,
    /// The linear stage was not between these positions, mm, where its last moves can have led it
    #[arg(long, value_names = ["MIN", "MAX"], num_args = 2, allow_hyphen_values = true, hide = true)]
    jump_mm: Option<Vec<f64>>,
    /// It was being homed since
    #[arg(long, requires = "jump_mm", hide = true)]
    homing: bool,
}

impl KnownArgs {
    /// The arguments that say it of a rig with files of this digest.
    pub(super) fn of(snapshot: &Snapshot, digest: Digest) -> Vec<String> {
        let mut args = Vec::new();
        if !matches!(snapshot.fault, Some(Fault::NotCommissioned { .. })) {
            args.extend(["--in-service-with".to_owned(), digest.to_string()]);
        }
        if let Some(Jump { last_moves, is_homing_open }) = snapshot.jump {
            let ends = [last_moves.min, last_moves.max].map(|end| end.value().to_string());
            args.extend(["--jump-mm".to_owned()].into_iter().chain(ends));
            args.extend(is_homing_open.then(|| "--homing".to_owned()));
        }
        args
    }

    /// What it knew of the rig whose files have this digest now. Another geometry has not been in service.
    fn known(&self, digest: Digest) -> KnownRig {
        let jump = self.jump_mm.as_deref().and_then(|ends| match ends {
            &[min, max] => {
                let last_moves = Span::new(min, max);
                Some(Jump { last_moves, is_homing_open: self.homing })
            }
            _ => None,
        });
        let was_in_service = self.in_service_with.as_ref() == Some(&digest.to_string());
        KnownRig { was_in_service, jump }
    }
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
    let rig = args.rig.load()?;
    let known = args.known.known(rig.digest());
    let out = make_safe(rig, args.data.as_deref(), known, operator.as_str())?;
    for fault in &out.faults {
        note(&fault.to_string());
    }
    if let Err(reason) = &out.recorded {
        note(&format!("the retract is not in the journal: {reason}"));
    }
    let printed = if args.output.json { print_json(&view(&out)) } else { print(&sentence(&out)) };
    concluded(printed, judged(&out, args.because.as_deref()))
}

/// Whether the probe is clear, and the program before it, if there was one, has ended by itself.
fn judged(out: &WayOut, because: Option<&str>) -> Result<(), Failure> {
    if out.clearance == Clearance::Clear {
        return match because {
            None => Ok(()),
            Some(because) => Err(Failure::Replaced { because: because.to_owned() }),
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

#[cfg(test)]
mod tests {
    use clap::Parser;
    use rig_engine::Engine;

    use super::*;

    #[derive(Debug, Parser)]
    struct Program {
        #[command(flatten)]
        known: KnownArgs,
    }

    #[test]
    fn what_a_replaced_program_knew_is_understood() {
        let file = include_str!("../../../../config/rigs/simulated.toml");
        let file = rig_files::rig_file::RigFile::read("rig.toml", file).unwrap();
        let engine = Engine::with_patience(file.limits, std::time::Duration::from_secs(60));
        let mut snapshot = engine.snapshot();
        for is_homing_open in [false, true] {
            let jump = Jump { last_moves: Span::new(-60.5, 12.25), is_homing_open };
            snapshot.jump = Some(jump);
            let args = KnownArgs::of(&snapshot, Digest::START).into_iter();
            let args = Program::parse_from(["rigd".to_owned()].into_iter().chain(args)).known;
            let known = args.known(Digest::START);
            assert_eq!((known.was_in_service, known.jump), (true, Some(jump)));
            // A file that was changed meanwhile.
            let known = args.known(Digest::from_bytes([1; 32]));
            assert_eq!((known.was_in_service, known.jump), (false, Some(jump)));
        }
        (snapshot.jump, snapshot.fault) =
            (None, Some(Fault::NotCommissioned { missing: String::new() }));
        assert!(KnownArgs::of(&snapshot, Digest::START).is_empty());
    }
}
