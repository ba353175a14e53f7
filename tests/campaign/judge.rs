//! What a seed of the fault campaign must have kept.

use std::collections::BTreeMap;

use rig_engine::RunPhase;
use rig_sim::world::ViolationKind;
use rig_store::{Confirmed, MemoryDisk, Reader, Record, RunId, StoreError, StoredRecord};
use rig_verify::{Check, Finding, JournalError, MemoryJournal, Verdict};

use crate::{
    bench::{Bench, PATIENCE_S},
    counts::Phase,
    faults::{Fault, Trouble},
    life::{Begun, Played},
};

/// The outcomes of the touches of a run, by step.
pub(crate) type Touches = BTreeMap<String, Outcome>;

/// The outcome of a touch.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Outcome {
    Measured {
        shift_hz: f64,
        /// Standard deviation of the sweeps, and of the depth, as a shift.
        sigma_hz: f64,
        /// Whether what was measured after it confirms it.
        is_confirmed: bool,
        /// Whether it is not marked as one in which lost steps would not have shown.
        is_slip_checked: bool,
    },
    Refused(String),
}

/// Measured shifts may differ by this many standard deviations.
const SIGMAS: f64 = 6.0;

/// Standard deviation of a depth: the positions of the stage, mm.
const STAGE_MM: f64 = 0.005;

/// Lost steps whose sum is less than this are none at the check of slip, mm.
const CANCELLED_MM: f64 = 0.025;

/// A sample that is placed again on an uneven bench has another stiffness and slope: 3 % and 1°.
const PLACED_AGAIN_REL: f64 = 0.06;

/// The records that say of a touch what became of it.
const KINDS: [&str; 8] = [
    "touch_result",
    "touch_refused",
    "surface_found",
    "sweep",
    "run_finished",
    "resumed",
    "given_up",
    "amended",
];

/// The outcomes of a run. The checker looks at its digests.
pub(crate) fn touches(reader: &Reader, run: RunId) -> Result<Touches, StoreError> {
    let (mut touches, mut confirmed) = (Touches::new(), Confirmed::default());
    for stored in reader.unchecked(run, &KINDS)? {
        let record = stored.record()?;
        confirmed.take(&record);
        match record {
            Record::TouchResult(touch) => {
                let depth_mm = touch.surface_sigma_mm.hypot(STAGE_MM);
                let by_depth_hz = touch.shift_hz * depth_mm / touch.indentation_mm;
                let sigma_hz = touch.shift_sigma_hz.hypot(by_depth_hz);
                let shift_hz = touch.shift_hz;
                let is_slip_checked = touch.is_slip_checked != Some(false);
                let measured =
                    Outcome::Measured { shift_hz, sigma_hz, is_confirmed: true, is_slip_checked };
                touches.insert(touch.touch.step, measured);
            }
            // What was measured next may contradict a touch.
            Record::TouchRefused(refused) => {
                touches.insert(refused.touch.step, Outcome::Refused(refused.reason));
            }
            _ => {}
        }
    }
    for (step, outcome) in &mut touches {
        if let Outcome::Measured { is_confirmed, .. } = outcome {
            *is_confirmed = confirmed.touch(step) == Some(true);
        }
    }
    Ok(touches)
}

/// All records of a journal, in the order in which they were written.
pub(crate) fn records(disk: &MemoryDisk) -> Vec<String> {
    let reader = Reader::open_in_memory(disk).expect("the journal can be read");
    let records = reader.events_after(0, u32::MAX).expect("the journal can be read");
    let line = |record: &rig_store::StoredRecord| {
        let seconds = record.rig_us as f64 / 1e6;
        let payload: String = record.payload.chars().take(4000).collect();
        format!("{:4} {} {seconds:10.3} {payload}", record.seq, record.epoch)
    };
    records.iter().map(line).collect()
}

/// What the checker finds in these journals.
pub(crate) fn findings(
    checker: &MemoryJournal,
    journals: &[RunId],
) -> Result<Vec<(String, Finding)>, JournalError> {
    let journals: Vec<String> = journals.iter().map(ToString::to_string).collect();
    let of = |verdict: Verdict| {
        let run = verdict.run;
        verdict.findings.into_iter().map(move |finding| (run.clone(), finding))
    };
    Ok(checker.verify(&journals)?.into_iter().flat_map(of).collect())
}

/// A difference from the undisturbed run of the same bench.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Difference {
    /// The touch.
    pub(crate) step: String,
    pub(crate) what: String,
}

/// Differences from the undisturbed run of the same bench.
pub(crate) fn differences(
    bench: &Bench,
    played: &Played,
    undisturbed: &Touches,
) -> Vec<Difference> {
    let mut differences = Vec::new();
    let mut differs =
        |step: &String, what| differences.push(Difference { step: step.clone(), what });
    for (step, expected) in undisturbed {
        let Outcome::Measured { shift_hz: true_hz, sigma_hz: true_sigma_hz, .. } = expected else {
            continue;
        };
        match played.touches.get(step) {
            None => differs(step, format!("touch {step} is missing")),
            Some(Outcome::Refused(_)) => {}
            Some(Outcome::Measured { shift_hz, sigma_hz, .. }) => {
                let is_other = bench.is_uneven && played.is_placed_again;
                let scatter_hz = if is_other { PLACED_AGAIN_REL * true_hz } else { 0.0 };
                let allowed_hz = SIGMAS * sigma_hz.hypot(*true_sigma_hz).hypot(scatter_hz);
                if (shift_hz - true_hz).abs() > allowed_hz {
                    let what = format!(
                        "touch {step}: shift {shift_hz:.2} Hz, undisturbed {true_hz:.2} Hz, and \
                         {allowed_hz:.2} Hz are allowed"
                    );
                    differs(step, what);
                }
            }
        }
    }
    differences
}

/// Touches that an undisturbed run refuses: nothing could be compared with them.
pub(crate) fn refused(undisturbed: &Touches) -> Vec<String> {
    let word = |(step, outcome): (&String, &Outcome)| match outcome {
        Outcome::Measured { .. } => None,
        Outcome::Refused(reason) => Some(format!("undisturbed: touch {step} is refused: {reason}")),
    };
    undisturbed.iter().filter_map(word).collect()
}

/// Whether the probe went into a sample faster than the rig file allows for that, but for rounding. A rig cannot know of steps
/// that were lost downwards.
pub(crate) fn is_hit_fast(
    fastest_mm_per_s: f64,
    limit_mm_per_s: f64,
    played: &Played,
) -> Option<String> {
    const ROUNDING: f64 = 1.02;
    let has_sunk = played.begun.iter().any(|one| one.fault().lost_mm().is_some_and(|mm| mm < 0.0));
    (fastest_mm_per_s > ROUNDING * limit_mm_per_s && !has_sunk).then(|| {
        format!(
            "the probe went into a sample at {fastest_mm_per_s:.2} mm/s; {limit_mm_per_s} are allowed"
        )
    })
}

/// Measured touches that do not say as they should whether they were checked for slip.
pub(crate) fn wrong_marks(bench: &Bench, played: &Played) -> Vec<String> {
    let is_wrong = |outcome: &Outcome| match outcome {
        Outcome::Measured { is_slip_checked, .. } => *is_slip_checked != bench.has_slip_check,
        Outcome::Refused(_) => false,
    };
    let wrong = played.touches.iter().filter(|(_, outcome)| is_wrong(outcome));
    wrong
        .map(|(step, _)| format!("touch {step} is wrongly marked as to its check of slip"))
        .collect()
}

/// A search presses by a coarse step, and by what the screw and the fit of a surface are wrong, mm.
const SEARCH_MM: f64 = 0.13;

/// With faults of a drive, of the bus or of the analyzer, it goes down to where it gives up, below a sample as high as
/// the rig file allows on a tilted stage, mm.
const FAULTED_SEARCH_MM: f64 = 0.4 + 0.3 + 0.05;

/// Whether the search for a surface went deeper than a search may, apart from the steps that were lost.
pub(crate) fn is_search_deep(played: &Played) -> Option<String> {
    let begun = || played.begun.iter().map(Begun::fault);
    let sunk_mm: f64 = begun().filter_map(Fault::lost_mm).map(|mm| (-mm).max(0.0)).sum();
    let is_of_device =
        |fault| matches!(fault, Fault::Frame(_) | Fault::Device(_) | Fault::Drives(_));
    let may_be_deep = begun().any(is_of_device);
    let limit_mm = if may_be_deep { FAULTED_SEARCH_MM + sunk_mm } else { SEARCH_MM };
    let deep_mm = played.searched_mm;
    (limit_mm < deep_mm).then(|| {
        format!("the search went {deep_mm:.3} mm into the sample; {limit_mm:.3} mm are allowed")
    })
}

/// No contact is felt, or one always.
const CONTACT_SENSES: [&str; 2] = ["analyzer blind-contact", "analyzer stuck-contact"];

/// Whether a fault is one of the contact sense.
fn is_of_sense(fault: Fault) -> bool {
    CONTACT_SENSES.into_iter().any(|words| fault == Fault::Device(words))
}

/// Why a wrong shift is known not to be noticed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct BeyondNotice {
    pub(crate) why: &'static str,
    /// Whether every result says of this touch that what would show it was not measured.
    pub(crate) is_marked: bool,
}

/// Why the wrong shift of a touch is known not to be noticed: what would show it is measured after the touch, or not at
/// all. A touch that is missing is not excused, and neither is one by the mark of another.
pub(crate) fn is_beyond_notice(played: &Played, step: &str) -> Option<BeyondNotice> {
    let Some(&Outcome::Measured { is_confirmed, is_slip_checked, .. }) = played.touches.get(step)
    else {
        return None;
    };
    let in_touch = played.begun.iter().filter(|one| one.phase.is_in_touch()).map(Begun::fault);
    if !is_confirmed && in_touch.clone().any(is_of_sense) {
        let why = "a contact sense that fails in a touch, which is marked as not confirmed";
        return Some(BeyondNotice { why, is_marked: true });
    }
    // A confirmation follows the touch at once.
    let during = |words| played.begun.iter().any(|one| one.fault() == Fault::Device(words));
    let is_unchecked = !is_slip_checked;
    if in_touch.clone().any(is_of_sense) && CONTACT_SENSES.into_iter().all(during) {
        let why = if is_unchecked {
            "a contact sense that fails in a touch and the other way round before it is confirmed; the touch \
             is marked as not checked for slip"
        } else {
            "a contact sense that fails in a touch and the other way round before it is confirmed"
        };
        return Some(BeyondNotice { why, is_marked: is_unchecked });
    }
    let lost_mm: Vec<f64> = in_touch.filter_map(Fault::lost_mm).collect();
    if is_unchecked && !lost_mm.is_empty() {
        let why = "steps lost in a touch, which is marked as not checked for slip";
        return Some(BeyondNotice { why, is_marked: true });
    }
    let is_cancelled = lost_mm.len() > 1 && lost_mm.iter().sum::<f64>().abs() < CANCELLED_MM;
    let why = "steps lost in a touch and gained again before its check of slip";
    is_cancelled.then_some(BeyondNotice { why, is_marked: false })
}

/// Whether the rig could not know that it sent the probe too deep: it stands deeper than its drive says, by steps
/// that were lost on the way down into the sample, or before, while the contact sense feels nothing.
pub(crate) fn is_beyond_knowledge(violation: &ViolationKind, played: &Played) -> bool {
    let &ViolationKind::PressedTooDeep { indentation_mm, limit_mm } = violation else {
        return false;
    };
    let begun = || played.begun.iter().map(|one| (one.fault(), one.phase));
    let is_blind = begun().any(|(fault, _)| fault == Fault::Device(CONTACT_SENSES[0]));
    let is_unknown = |phase| is_blind || phase == Phase::Run(RunPhase::Indentation);
    let lost_mm: f64 = begun()
        .filter_map(|(fault, phase)| fault.lost_mm().filter(|mm| *mm < 0.0 && is_unknown(phase)))
        .sum();
    indentation_mm + lost_mm <= limit_mm
}

/// Whether the checker rightly refutes a sweep of these: one during which steps were lost or the contact sense failed,
/// so that its readings are of two states of the probe; or one of an analyzer that stays at another frequency than it
/// says, so that its readings take another time.
pub(crate) fn is_refuted(finding: &Finding, played: &Played, sweeps: &[StoredRecord]) -> bool {
    let is_of_sweep = matches!(finding.check, Check::Resonance | Check::Sigma);
    let is_of_time = finding.check == Check::ReadingTime;
    played.begun.iter().any(|begun| {
        let is_in_contact = matches!(
            begun.phase,
            Phase::Run(RunPhase::Indentation | RunPhase::Dwell | RunPhase::Sweep)
        );
        let next = sweeps.iter().find(|sweep| begun.event < sweep.event);
        let is_next = next.is_some_and(|sweep| sweep.seq == finding.record);
        let fault = begun.fault();
        let is_of_two_states = fault.lost_mm().is_some() || is_of_sense(fault);
        // The frequency may stay also in a search.
        (is_of_sweep || is_of_time) && is_next && is_in_contact && is_of_two_states
            || is_of_time && fault == Fault::Device("analyzer stuck-frequency")
    })
}

/// A drive on a line that is back is found, homed and retracted within this time, s.
const REACHED_S: f64 = 15.0;

/// Whether the faults that have begun leave no way out of contact while they last: the linear drive is blocked or cannot
/// be reached, or it has forgotten its position and may home downwards only, or it has an alarm that came back.
pub(crate) fn has_no_way_out(troubles: &[Trouble], played: &Played, bench: &Bench) -> bool {
    let has_begun = |trouble: &&Trouble| played.begun.iter().any(|one| one.row == trouble.row);
    let troubles: Vec<&Trouble> = troubles.iter().filter(has_begun).collect();
    let unplugged_s: f64 = troubles.iter().map(|trouble| trouble.unplugs_bus_s()).sum();
    unplugged_s + REACHED_S > PATIENCE_S
        || troubles.iter().any(|trouble| match trouble.fault() {
            Fault::Frame(words) => {
                words.starts_with("bus") && !words.ends_with("unit=2") && trouble.is_lasting()
            }
            Fault::Device("bus jam unit=1") | Fault::Drives(["bus jam unit=1", _]) => true,
            Fault::Device("bus reboot unit=1") | Fault::Drives(["bus reboot unit=1", _]) => {
                bench.forgets_position
            }
            _ => false,
        })
        || has_alarm_again(played, bench)
}

/// Whether the linear drive had the same alarm twice, the second time on the way out: an alarm that comes back is not
/// reset again (decision 34).
fn has_alarm_again(played: &Played, bench: &Bench) -> bool {
    ["bus alarm code=48 unit=1", "bus stall unit=1"].into_iter().any(|words| {
        let is_alarm = words.starts_with("bus alarm") || bench.has_alarm_at_stall();
        let mut begun = played.begun.iter().filter(|one| one.fault() == Fault::Device(words));
        is_alarm && begun.next().is_some() && begun.any(|one| one.phase == Phase::Recovery)
    })
}
