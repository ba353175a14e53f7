//! The page about a campaign.

use std::fmt::{self, Display};

use crate::{
    campaign::Counts,
    ledger::{Earlier, Ledger, Piece},
};

/// A page about the pieces of a ledger.
#[derive(Debug)]
pub(crate) struct Page<'a>(pub(crate) &'a Ledger);

impl Display for Page<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let counts = self.0.counts();
        let Counts { runs, failed, touches, measured, refused, unnoticed, .. } = &counts;
        let Counts { kills, resumptions, latches, lifts, refuted, sunk, marked, .. } = &counts;
        writeln!(
            f,
            "# Touches under faults\n\n\
             `cargo run -p rig-tests --release --bin campaign -- --first-seed K --seeds N --jobs 2 --page \
             docs/studies/campaign.md` plays N seeds, adds them as a piece to the ledger beside this page, \
             `campaign.json`, and writes the page of all pieces again; with `--seeds 0` it only writes the \
             page. No seed is in two pieces. The same seeds give the same counts and the same digest with \
             the same program. The digest of the menu says what seeds draw; seeds of another menu are others, \
             and with `--begin-anew` only the sums of another menu are kept. `--first-seed K --seeds 1 --records` plays one of them and prints its \
             records.\n\n\
             Each seed draws a bench (five analyzers, three makes of drives, serial lines and networks, \
             one of five samples), a protocol of one touch or two, and one to four faults, each in a \
             phase of a touch. The whole daemon below HTTP runs it through the drivers and the wire in \
             virtual time. After the faults a person acknowledges, and the run must be completed.\n\n\
             ## Counts\n\n\
             | what | number |\n| --- | ---: |\n\
             | runs | {runs} |\n\
             | faults | {} |\n\
             | planned touches | {touches} |\n\
             | measured, as in the undisturbed run | {} |\n\
             | refused | {refused} |\n\
             | latches | {latches} |\n\
             | kills of the daemon | {kills} |\n\
             | resumptions | {resumptions} |\n\
             | lifted by hand, because the drive had forgotten its position | {lifts} |\n\
             | runs with sweeps during which steps were lost or the contact sense failed, or of an analyzer that stays at its frequency, refuted by the checker | {refuted} |\n\
             | runs in which lost steps took the probe deeper than the sample bears: without a command, on the way in, or with a contact sense that failed too | {sunk} |\n\
             | runs that failed | {failed} |\n\
             | runs with a shift that is wrong, and marked in every result as not confirmed or not checked for slip | {marked} |\n\
             | runs with a shift that is wrong in a known way, without a mark | {unnoticed} |\n\
             | digest of all runs | {:016x} |\n\
             | digest of the menu | {} |\n",
            counts.table.total(),
            measured - unnoticed - marked,
            counts.digest,
            self.0.menu,
        )?;
        writeln!(
            f,
            "A run fails if, by the truth of the simulated bench, the sample turned with the probe in \
             it, the probe was sent deeper than the sample bears, the rig said clear while in contact, or \
             the probe was left in contact though a retract was possible; if the checker finds \
             something in a journal; if the run cannot be completed after the faults; or if a shift \
             differs from that of the undisturbed run by more than six standard deviations and the \
             touch is not refused. Decision \
             [41](../decisions/0041-a-campaign-of-faults-in-one-process.md) names the known ways in \
             which a shift can be wrong without notice, and decision \
             [112](../decisions/0112-a-touch-without-a-check-of-slip-is-marked.md) those that are marked. Programs of \
             before 2026-11-25 marked no touch whose protocol has no check of slip.\n"
        )?;
        self.pieces(f)?;
        self.earlier(f)?;
        writeln!(f, "## Reasons\n\n| reason | number |\n| --- | ---: |")?;
        for (reason, count) in &counts.reasons {
            writeln!(f, "| {} | {count} |", reason.replace('|', "/"))?;
        }
        writeln!(
            f,
            "\n## Faults in each phase\n\nHow often each fault began in each phase. A fault of a frame acts \
             at a frame from there on.\n\n{}",
            counts.table
        )?;
        let empty = counts.table.empty();
        let list = if empty.is_empty() { "none".to_owned() } else { empty.join(", ") };
        writeln!(f, "Empty cells: {list}.")
    }
}

fn listed(seeds: &[u64]) -> String {
    let seeds: Vec<String> = seeds.iter().map(u64::to_string).collect();
    if seeds.is_empty() { "none".to_owned() } else { seeds.join(", ") }
}

impl Page<'_> {
    /// What was counted with other menus, if anything.
    fn earlier(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.earlier.is_empty() {
            return Ok(());
        }
        writeln!(
            f,
            "## Earlier menus\n\nWhen benches, protocols or faults change, the seeds draw others, and are counted again. The \
             counts above are without these.\n\n\
             | menu | runs | touches | faults | failed | software |\n| --- | ---: | ---: | ---: | --- | --- |"
        )?;
        for earlier in &self.0.earlier {
            let Earlier { menu, runs, touches, faults, failed_seeds, software } = earlier;
            let (failed, software) = (listed(failed_seeds), software.join(", "));
            writeln!(f, "| `{menu}` | {runs} | {touches} | {faults} | {failed} | {software} |")?;
        }
        writeln!(f)
    }

    /// Every piece with the program that played it.
    fn pieces(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "## Pieces\n\nThe digest of a program is the beginning of the SHA-256 of its file. The computer \
             did other work too. Seeds 260001 to 270000 of this menu were played twice. In the first piece, of the program \
             `190a3e60a636dceb`, seed 267229 failed: the checker held the repetition of a flagged reading for one at \
             another frequency. That piece was taken out of the ledger, the checker was changed, and all of its seeds \
             were played again. Of seeds 510001 to 560000, first played by the program `d8f2609654feb9e2`, seed 537422 \
             failed: the checker expected a loss tangent below zero, which is stated as zero. That piece was taken out too, the \
             checker was changed, and its seeds were played again. Of seeds 550001 to 560000, seed 550121 \
             did not finish: a stage whose homing upwards was not answered was taken for one in a wrong place, for good. That piece \
             was taken out, the engine was changed (decision 184), and its seeds were played again. In the piece of 620001 to 630000 seed 624360 was \
             left in contact: the drive stalled in two retracts within a second, each time with the alarm of a position deviation. \
             An alarm that comes back is not reset again; the rig was latched, and 20 s later the simulated person acknowledged, and it \
             retracted. That is the rule of the way out (decision 34), and the judge knows it now; the piece was played again. Two more seeds of the program \
             `c659773d68c9f766` were left in contact. Seed 781872: the line failed in the reset of an alarm, which used up the only one; the engine \
             was changed (decision 185). Seed 856468: the bus was away for 30 s, and then six connections broke, until the patience of 60 s \
             was over; the judge counts both together now. Their pieces were played again. \
             Seeds up to 410000 were judged before 2026-11-27 22:00 UTC, by a judge that excused \
             more (decision 41).\n\n\
             | seeds | runs | touches | faults | failed | jobs | runs a second | software | program | digest |\n\
             | --- | ---: | ---: | ---: | --- | ---: | ---: | --- | --- | --- |"
        )?;
        for piece in &self.0.pieces {
            let Piece { first_seed, jobs, seconds, software, program, counts, .. } = piece;
            let failed = listed(&counts.failed_seeds);
            writeln!(
                f,
                "| {first_seed} to {} | {} | {} | {} | {failed} | {jobs} | {:.0} | {software} | \
                 `{program}` | {:016x} |",
                piece.range().end.saturating_sub(1),
                counts.runs,
                counts.touches,
                counts.table.total(),
                counts.runs as f64 / seconds,
                counts.digest,
            )?;
        }
        writeln!(f)
    }
}
