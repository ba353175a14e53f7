//! `rigd rehearse`: what the faults of a bench would do to a protocol.

use std::path::PathBuf;

use clap::Args;
use rig_model::counted;
use serde::Serialize;

use super::{
    Failure,
    args::{OutputArgs, RigArgs},
    screen::{self, words_in_lines},
    table::{duration, print, print_json},
};
use crate::{
    loaded_rig::LoadedScene,
    protocol_file::LoadedProtocol,
    rehearse::{Rehearsal, RehearsedFault, rehearse},
};

/// Runs the protocol on a copy of the rig with simulated devices, in virtual time: once without a fault,
/// and once with each fault of a menu at a drawn moment. No port is opened and no journal is kept. The
/// numbers of the faults are those of `rigd faults`.
#[derive(Debug, Args)]
pub(super) struct RehearseArgs {
    /// Protocol file
    protocol: PathBuf,
    #[command(flatten)]
    rig: RigArgs,
    /// Scene file with the bench [default: that of the rig file, or a bench as the rig file describes it]
    #[arg(long, value_name = "SCENE")]
    scene: Option<PathBuf>,
    /// Decides the moments of the faults
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    output: OutputArgs,
}

/// A rehearsal, for a program.
#[derive(Debug, Serialize)]
struct RehearsalView {
    touches: usize,
    undisturbed_s: f64,
    faults: Vec<FaultView>,
}

#[derive(Debug, Serialize)]
struct FaultView {
    number: u8,
    fault: &'static str,
    phase: &'static str,
    /// Each message that latched the rig, with its advice.
    seen: Vec<String>,
    touches_refused: usize,
    touches_repeated: usize,
    /// Accepted touches whose shift differs from that without the fault.
    touches_different: usize,
    /// Number of times that a person had to start rigd again.
    restarted: u32,
    /// Number of prompts that a person had to answer again.
    answered_again: usize,
    /// Number of times that a person had to acknowledge and resume.
    resumed: u32,
    is_complete: bool,
    is_clear: bool,
    additional_s: f64,
}

/// The width of the table.
const COLUMNS: usize = 80;

pub(super) fn rehearse_protocol(args: &RehearseArgs) -> Result<(), Failure> {
    let mut rig = args.rig.load()?;
    if let Some(path) = &args.scene {
        rig.scene = Some(LoadedScene::load(path)?);
    }
    let protocol = LoadedProtocol::load(&args.protocol, &rig.facts())?;
    let progress = |run: usize, runs: usize| {
        screen::show_progress(&format!("rehearsing: run {} of {}", run + 1, runs + 1));
    };
    let rehearsed = rehearse(&rig, &protocol, args.seed, progress);
    screen::show_progress("");
    let rehearsal = rehearsed?;
    if args.output.json { print_json(&view(&rehearsal)) } else { print(&table(&rehearsal)) }
}

fn table(rehearsal: &Rehearsal) -> String {
    let Rehearsal { touches, undisturbed_s, rows } = rehearsal;
    let mut lines = vec![
        format!("{}, {} without a fault", counted(*touches, "touch"), duration(*undisturbed_s)),
        String::new(),
        row(["#", "fault", "phase", "refused", "repeated", "resumed", "rig time"]),
    ];
    for fault in rows {
        let sign = if fault.additional_s < 0.0 { "-" } else { "+" };
        lines.push(row([
            &fault.number.to_string(),
            fault.what,
            fault.phase,
            &fault.refused.to_string(),
            &fault.repeated.to_string(),
            &fault.resumed.to_string(),
            &format!("{sign}{}", duration(fault.additional_s.abs())),
        ]));
        for text in said(fault) {
            let text = words_in_lines(&text, COLUMNS - INDENT);
            lines.extend(text.iter().map(|line| format!("{:INDENT$}{line}", "")));
        }
    }
    lines.join("\n")
}

/// Columns before a message.
const INDENT: usize = 4;

fn row([number, fault, phase, refused, repeated, resumed, time]: [&str; 7]) -> String {
    let row = format!(
        "{number:>2} {fault:<26}{phase:<14}{refused:>7}{repeated:>9}{resumed:>8}{time:>13}"
    );
    row.trim_end().to_owned()
}

/// What a person would have seen, and had to do beyond the advice.
fn said(fault: &RehearsedFault) -> Vec<String> {
    let mut said = fault.seen.clone();
    let of = |count: usize, one: &str, many: &str| match count {
        0 => None,
        1 => Some(one.to_owned()),
        _ => Some(format!("{count} {many}")),
    };
    said.extend(of(fault.restarted as usize, "start rigd again", "starts of rigd again"));
    said.extend(of(fault.answered_again, "1 prompt answered again", "prompts answered again"));
    said.extend(of(
        fault.different,
        "1 accepted shift differs from that without the fault, without a message",
        "accepted shifts differ from those without the fault, without a message",
    ));
    match (fault.is_complete, fault.is_clear) {
        (true, _) if said.is_empty() => said.push("nothing".to_owned()),
        (true, _) => {}
        (false, true) => said.push("the run did not come to its end".to_owned()),
        (false, false) => said.push(
            "the run did not come to its end, and the probe was not shown to be clear".to_owned(),
        ),
    }
    said
}

fn view(rehearsal: &Rehearsal) -> RehearsalView {
    let fault = |fault: &RehearsedFault| FaultView {
        number: fault.number,
        fault: fault.what,
        phase: fault.phase,
        seen: fault.seen.clone(),
        touches_refused: fault.refused,
        touches_repeated: fault.repeated,
        touches_different: fault.different,
        restarted: fault.restarted,
        answered_again: fault.answered_again,
        resumed: fault.resumed,
        is_complete: fault.is_complete,
        is_clear: fault.is_clear,
        additional_s: fault.additional_s,
    };
    RehearsalView {
        touches: rehearsal.touches,
        undisturbed_s: rehearsal.undisturbed_s,
        faults: rehearsal.rows.iter().map(fault).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_cells_of_a_row_stay_apart_within_the_width_of_the_table() {
        let fault = "the longest fault in a row";
        for time in ["+59 min 59 s", "+12 h 00 min"] {
            let row = row(["29", &fault[..25], "before the run", "110", "110", "10", time]);
            assert!(row.ends_with(&format!(" {time}")) && row.starts_with("29 the"), "{row}");
            assert!(row.chars().count() <= COLUMNS, "{row}");
        }
    }
}
