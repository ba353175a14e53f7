//! The page about a campaign.

use std::fmt::{self, Display};

use crate::{campaign::Counts, counts::PHASES};

/// A campaign that has ended.
#[derive(Debug)]
pub(crate) struct Page<'a> {
    pub(crate) counts: &'a Counts,
    pub(crate) first_seed: u64,
    pub(crate) seeds: u64,
    pub(crate) jobs: usize,
    pub(crate) seconds: f64,
}

impl Display for Page<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { counts, first_seed, seeds, jobs, seconds } = self;
        let Counts { runs, failed, touches, measured, refused, unnoticed, .. } = counts;
        let Counts { kills, resumptions, latches, lifts, refuted, sunk, .. } = counts;
        writeln!(
            f,
            "# Touches under faults\n\n\
             This page is written by `cargo run -p rig-tests --release --bin campaign -- --first-seed \
             {first_seed} --seeds {seeds} --jobs {jobs} --page docs/studies/campaign.md`, here in {:.0} \
             minutes on a computer that did other work too. The same seeds give the same counts and the \
             same digest. `--first-seed K --seeds 1 --records` plays one of them and prints its records.\n\n\
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
             | sweeps during which steps were lost, refuted by the checker | {refuted} |\n\
             | runs in which lost steps alone, without a command, took the probe deeper than the sample bears | {sunk} |\n\
             | runs that failed | {failed} |\n\
             | runs with a shift that is wrong in a known way | {unnoticed} |\n\
             | runs a second | {:.0} |\n\
             | digest of all runs | {:016x} |\n",
            seconds / 60.0,
            counts.table.total(),
            measured - unnoticed,
            *runs as f64 / seconds,
            counts.digest,
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
             which a shift can be wrong without notice.\n\n\
             ## Reasons\n\n| reason | number |\n| --- | ---: |"
        )?;
        for (reason, count) in &counts.reasons {
            writeln!(f, "| {} | {count} |", reason.replace('|', "/"))?;
        }
        self.table(f)
    }
}

impl Page<'_> {
    /// Every fault in every phase.
    fn table(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let counts = self.counts;
        writeln!(
            f,
            "\n## Faults in each phase\n\nHow often each fault began in each phase. A fault of a frame acts \
             at a frame from there on.\n"
        )?;
        let names: Vec<&str> = PHASES.iter().map(|phase| phase.name()).collect();
        writeln!(f, "| fault | {} |", names.join(" | "))?;
        writeln!(f, "| --- |{}", " ---: |".repeat(PHASES.len()))?;
        for (name, cells) in counts.table.rows() {
            let is_of_prompts = name.starts_with("person");
            let cell = |count: &u64| match count {
                0 if is_of_prompts => String::new(),
                count => count.to_string(),
            };
            let cells: Vec<String> = cells.iter().map(cell).collect();
            writeln!(f, "| {name} | {} |", cells.join(" | "))?;
        }
        let empty = counts.table.empty();
        let list = if empty.is_empty() { "none".to_owned() } else { empty.join(", ") };
        writeln!(f, "\nEmpty cells: {list}.")
    }
}
