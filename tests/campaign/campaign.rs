//! Many seeds of the fault campaign, and their counts.

use std::{
    collections::{BTreeMap, HashMap},
    fmt,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{Arc, Mutex, OnceLock, PoisonError},
};

use serde::{Deserialize, Serialize};

use crate::{
    bench::{BENCHES, Bench, Draw},
    counts::Table,
    faults::{self, MENU, Trouble},
    judge::{self, BeyondNotice, Outcome, Touches},
    life::{self, Played},
};

/// A bench, and what its undisturbed run measures.
#[derive(Debug)]
struct Known {
    bench: Bench,
    undisturbed: Played,
}

/// The benches that were needed so far.
#[derive(Debug, Default)]
pub(crate) struct Campaign {
    known: Mutex<HashMap<u64, Arc<OnceLock<Known>>>>,
}

/// What became of a seed.
#[derive(Debug)]
pub(crate) struct Ended {
    pub(crate) failures: Vec<String>,
    /// Why a wrong shift was not noticed, if it is known that it cannot be.
    unnoticed: Option<BeyondNotice>,
    /// Bench and faults in words.
    pub(crate) story: String,
    pub(crate) played: Option<Played>,
    planned: usize,
}

/// The number of the bench and the faults that a seed draws.
pub(crate) fn drawn(seed: u64) -> (u64, Vec<Trouble>) {
    let draw = &mut Draw::new(seed, 0xfa17);
    (draw.below(BENCHES), faults::draw(draw))
}

impl Campaign {
    /// Plays a seed.
    pub(crate) fn play(&self, seed: u64, has_records: bool) -> Ended {
        let (number, troubles) = drawn(seed);
        let known = {
            let mut all = self.known.lock().unwrap_or_else(PoisonError::into_inner);
            Arc::clone(all.entry(number).or_default())
        };
        let played = catch_unwind(AssertUnwindSafe(|| {
            let known = known.get_or_init(|| {
                let bench = Bench::new(number);
                let undisturbed = life::play(&bench, &[], false);
                Known { bench, undisturbed }
            });
            (known, life::play(&known.bench, &troubles, has_records))
        }));
        let story = |makes| story(number, makes, &troubles);
        let Ok((known, played)) = played else {
            let failures = vec!["panicked".to_owned()];
            let story = story("?");
            return Ended { failures, unnoticed: None, story, played: None, planned: 0 };
        };
        let mut failures = played.violations.clone();
        for violation in &known.undisturbed.violations {
            failures.push(format!("undisturbed: {violation}"));
        }
        failures.extend(judge::refused(&known.undisturbed.touches));
        failures.append(&mut judge::wrong_marks(&known.bench, &played));
        let undisturbed: &Touches = &known.undisturbed.touches;
        let mut unnoticed = None;
        for judge::Difference { step, what } in
            judge::differences(&known.bench, &played, undisturbed)
        {
            match judge::is_beyond_notice(&played, &step) {
                None => failures.push(what),
                // Of several touches, one without a mark counts.
                Some(why) => {
                    let before: BeyondNotice = unnoticed.unwrap_or(why);
                    unnoticed = Some(if before.is_marked { why } else { before });
                }
            }
        }
        let (story, planned) = (story(known.bench.makes), undisturbed.len());
        Ended { failures, unnoticed, story, played: Some(played), planned }
    }
}

fn story(bench: u64, makes: &str, troubles: &[Trouble]) -> String {
    let one = |trouble: &Trouble| {
        let (name, phase) = (MENU[trouble.row].0, trouble.phase.name());
        format!(
            "{name} in {phase} (change {}, after {:.3} s, {})",
            trouble.nth_change, trouble.after_s, trouble.trigger
        )
    };
    let troubles: Vec<_> = troubles.iter().map(one).collect();
    format!("bench {bench}, {makes}: {}", troubles.join("; "))
}

/// The counts of all seeds.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Counts {
    pub(crate) runs: u64,
    pub(crate) failed: u64,
    pub(crate) touches: u64,
    pub(crate) measured: u64,
    pub(crate) refused: u64,
    pub(crate) kills: u64,
    pub(crate) resumptions: u64,
    pub(crate) latches: u64,
    pub(crate) lifts: u64,
    pub(crate) refuted: u64,
    pub(crate) sunk: u64,
    /// Runs with a shift that is wrong in a known way, and not marked.
    pub(crate) unnoticed: u64,
    /// Runs with one that is marked as not confirmed or as not checked for slip.
    #[serde(default)]
    pub(crate) marked: u64,
    pub(crate) table: Table,
    /// Why touches were refused, and what failed, without the numbers.
    pub(crate) reasons: BTreeMap<String, u64>,
    /// The seeds that failed, in ascending order.
    pub(crate) failed_seeds: Vec<u64>,
    pub(crate) digest: u64,
}

impl Counts {
    pub(crate) fn add(&mut self, seed: u64, ended: &Ended) {
        self.runs += 1;
        if !ended.failures.is_empty() {
            self.failed += 1;
            self.failed_seeds.push(seed);
            self.failed_seeds.sort_unstable();
        }
        for failure in &ended.failures {
            *self.reasons.entry(format!("failed: {}", plain(failure))).or_default() += 1;
        }
        if let Some(BeyondNotice { why, is_marked }) = ended.unnoticed {
            *(if is_marked { &mut self.marked } else { &mut self.unnoticed }) += 1;
            let how = if is_marked { "marked" } else { "not noticed" };
            *self.reasons.entry(format!("wrong, {how}: {why}")).or_default() += 1;
        }
        let Some(played) = &ended.played else { return };
        self.touches += ended.planned as u64;
        for outcome in played.touches.values() {
            match outcome {
                Outcome::Measured { .. } => self.measured += 1,
                Outcome::Refused(reason) => {
                    self.refused += 1;
                    *self.reasons.entry(format!("refused: {}", plain(reason))).or_default() += 1;
                }
            }
        }
        self.kills += played.kills;
        self.resumptions += played.resumptions;
        self.latches += played.latches;
        self.lifts += played.lifts;
        self.refuted += u64::from(played.refuted > 0);
        self.sunk += u64::from(played.sunk > 0);
        for begun in &played.begun {
            self.table.add(begun.row, begun.phase);
        }
        // The order of the seeds has no influence.
        self.digest = self.digest.wrapping_add(played.digest);
    }

    /// Adds the counts of other seeds.
    pub(crate) fn merge(&mut self, other: &Self) {
        let Self { runs, failed, touches, measured, refused, .. } = other;
        let Self { kills, resumptions, latches, lifts, refuted, sunk, unnoticed, marked, .. } =
            other;
        self.runs += runs;
        self.failed += failed;
        self.touches += touches;
        self.measured += measured;
        self.refused += refused;
        self.kills += kills;
        self.resumptions += resumptions;
        self.latches += latches;
        self.lifts += lifts;
        self.refuted += refuted;
        self.sunk += sunk;
        self.unnoticed += unnoticed;
        self.marked += marked;
        self.table.merge(&other.table);
        for (reason, count) in &other.reasons {
            *self.reasons.entry(reason.clone()).or_default() += count;
        }
        self.failed_seeds.extend(&other.failed_seeds);
        self.failed_seeds.sort_unstable();
        self.digest = self.digest.wrapping_add(other.digest);
    }
}

/// A message without its numbers.
fn plain(message: &str) -> String {
    let is_number = |word: &str| word.contains(|c: char| c.is_ascii_digit());
    let words = message.split(' ').map(|word| if is_number(word) { "…" } else { word });
    words.collect::<Vec<_>>().join(" ")
}

impl fmt::Display for Counts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { runs, failed, touches, measured, refused, unnoticed, marked, .. } = self;
        let Self { kills, resumptions, latches, lifts, .. } = self;
        write!(
            f,
            "{runs} runs with {} faults, {failed} failed; {touches} touches: {measured} measured, \
             {refused} refused, {marked} wrong and marked, {unnoticed} wrong in known ways without a mark; {latches} latched, {kills} killed, {resumptions} resumed, {lifts} \
             lifted by hand; digest \
             {:016x}",
            self.table.total(),
            self.digest,
        )
    }
}
