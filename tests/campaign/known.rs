//! Cases that a long campaign has found, by their faults: a seed draws others when the menu changes.

use rig_engine::RunPhase;
use rig_sim::world::ViolationKind;

use crate::{
    bench::Bench,
    counts::Phase,
    faults::{MENU, Trouble},
    judge::{self, Outcome},
    life::{self, Begun, Played},
};

/// A fault at the first change of a phase, and a wait after it, s.
fn trouble(name: &str, phase: Phase, after_s: f64, trigger: &str) -> Trouble {
    let row = MENU.iter().position(|(known, _)| *known == name).expect("a fault of the menu");
    Trouble { row, phase, nth_change: 1, after_s, trigger: trigger.to_owned(), nth: 1 }
}

/// A device at once.
fn device(name: &str, phase: RunPhase, after_s: f64) -> Trouble {
    trouble(name, Phase::Run(phase), after_s, "nth=1")
}

/// What the sweep of the only touch says.
fn outcome(played: &Played) -> &Outcome {
    assert_eq!((&*played.violations, played.touches.len()), (&[][..], 1));
    played.touches.values().next().expect("a touch")
}

/// Why a wrong shift of the only touch is known not to be noticed.
fn is_beyond_notice(played: &Played) -> Option<judge::BeyondNotice> {
    let (step, _) = played.touches.first_key_value().expect("a touch");
    judge::is_beyond_notice(played, step)
}

/// The kinds of all records.
fn kinds(played: &Played) -> Vec<&str> {
    let kind = |record: &'_ String| record.find("\"kind\":\"").map(|at| at + 8);
    let kind = |record| kind(record).map(|at| record[at..].split('"').next().unwrap_or_default());
    played.records.iter().filter_map(kind).collect()
}

const UPWARDS: &str = "linear drive: loses 0.3 mm upwards";
const DOWNWARDS: &str = "linear drive: loses 0.3 mm downwards";

/// Seed 32965 of the first menu. Each loss alone is noticed. Both together leave a sound record of a softer
/// sample: nothing that the rig reads differs but the resonance, which nothing else predicts.
#[test]
fn steps_that_are_lost_and_gained_again_are_beyond_notice_and_each_loss_alone_is_not() {
    let bench = Bench::new(39);
    let up = device(UPWARDS, RunPhase::Indentation, 0.0);
    let down = device(DOWNWARDS, RunPhase::SlipCheck, 0.012);
    let undisturbed = life::play(&bench, &[], true);
    assert!(matches!(outcome(&undisturbed), Outcome::Measured { .. }));
    for one in [&up, &down] {
        let played = life::play(&bench, std::slice::from_ref(one), false);
        assert!(matches!(outcome(&played), Outcome::Refused(_)), "{:?}", played.touches);
        assert_eq!(is_beyond_notice(&played), None);
    }
    let both = life::play(&bench, &[up, down], true);
    assert!(matches!(outcome(&both), Outcome::Measured { .. }), "{:?}", both.touches);
    assert_eq!(judge::differences(&bench, &both, &undisturbed.touches).len(), 1);
    assert_eq!(kinds(&both), kinds(&undisturbed));
    let why = is_beyond_notice(&both).map(|beyond| beyond.why);
    assert_eq!(why, Some("steps lost in a touch and gained again before its check of slip"));
}

/// Seed 301146 of the first menu: the first alarm is that of a stall, the second another one.
#[test]
fn a_second_alarm_with_another_code_on_the_way_out_leaves_no_probe_in_the_sample() {
    let bench = Bench::new(812);
    let troubles = [
        device("linear drive: stalls", RunPhase::SlipCheck, 0.0),
        device("linear drive: alarm", RunPhase::SlipCheck, 0.418),
    ];
    let played = life::play(&bench, &troubles, true);
    let alarms = played.records.iter().filter(|record| record.contains("linear stage: alarm"));
    assert!(alarms.count() >= 2, "{:#?}", played.records);
    outcome(&played);
}

/// Seed 4183 of the second menu, with the softest sample: where the impedance of the clear probe was read
/// again, the probe still touched, and by so little that it seemed to have drifted.
#[test]
fn steps_lost_downwards_are_not_taken_for_drift() {
    let bench = Bench::new(685);
    assert!(bench.has_slip_check);
    let undisturbed = life::play(&bench, &[], false);
    assert!(matches!(outcome(&undisturbed), Outcome::Measured { .. }));
    let played = life::play(&bench, &[device(DOWNWARDS, RunPhase::Dwell, 0.0)], false);
    assert!(matches!(outcome(&played), Outcome::Refused(_)), "{:?}", played.touches);
}

/// Seed 3628 of the second menu: the person took the sample away from under a probe that could not be
/// lifted.
#[test]
fn a_blocked_stage_is_freed_before_the_probe_is_lifted_by_hand() {
    let troubles = [
        device("emergency stop: takes the power off the drives", RunPhase::Dwell, 0.4),
        device("emergency stop: blocks the drives", RunPhase::Sweep, 0.0),
    ];
    let bench = Bench::new(46);
    assert!(bench.forgets_position);
    let played = life::play(&bench, &troubles, false);
    assert_eq!(played.lifts, 1);
    outcome(&played);
}

/// The journal of a session said that a descent by hand began where the probe was before the last run.
#[test]
fn a_move_by_hand_after_a_run_begins_where_the_run_has_left_the_probe() {
    let name = "by hand: lowers the probe and turns the sample";
    let troubles = [device(name, RunPhase::Sweep, 0.0)];
    let bench = Bench::new(626);
    let played = life::play(&bench, &troubles, true);
    outcome(&played);
    let is_intent = |record: &&String| record.contains(r#""what":"by_hand""#);
    let intent = played.records.iter().find(is_intent).expect("a move by hand");
    let from = intent.split(r#""from":"#).nth(1).and_then(|rest| rest.split(',').next());
    let from_mm: f64 = from.and_then(|from| from.parse().ok()).expect("a height");
    assert!((from_mm - bench.rest().value()).abs() < 0.01, "{intent}");
}

/// Seed 15173 of the menu 30cc4ed8a2037c43: the contact is no longer felt just before the first reading of a sweep on a
/// grid, which still rings. The fit takes that for a second mode, which the checker fits too; the touch is
/// refused.
#[test]
fn a_touch_whose_contact_sense_fails_in_its_sweep_is_refused() {
    let bench = Bench::new(998);
    let played =
        life::play(&bench, &[device("analyzer: feels no contact", RunPhase::Sweep, 0.84)], false);
    assert!(matches!(outcome(&played), Outcome::Refused(_)), "{:?}", played.touches);
    assert_eq!(played.refuted, 0);
}

/// Seed 55698 of the menu 30cc4ed8a2037c43: as if in contact in the sweep, and as if free when the clear probe
/// is confirmed. Nothing that the rig reads differs from a touch on a stiffer sample.
#[test]
fn contact_senses_that_fail_both_ways_are_beyond_notice_and_each_alone_is_not() {
    let bench = Bench::new(93);
    let stuck = device("analyzer: feels a contact always", RunPhase::Indentation, 0.777);
    let blind = device("analyzer: feels no contact", RunPhase::Confirmation, 0.0);
    let undisturbed = life::play(&bench, &[], true);
    for one in [&stuck, &blind] {
        let played = life::play(&bench, std::slice::from_ref(one), false);
        assert_eq!(judge::differences(&bench, &played, &undisturbed.touches), Vec::new());
    }
    let both = life::play(&bench, &[stuck, blind], false);
    assert_eq!(judge::differences(&bench, &both, &undisturbed.touches).len(), 1);
    let beyond = is_beyond_notice(&both).unwrap();
    assert!(beyond.why.contains("other way round") && beyond.is_marked, "{beyond:?}");
}

/// A stuck contact sense makes the touch one of the free probe's resonance, or of another; after the abort nothing
/// more is measured that would show it.
#[test]
fn a_touch_after_which_the_run_is_aborted_is_marked_as_not_confirmed() {
    let bench = Bench::new(93);
    let is_confirmed = |played: &Played| match outcome(played) {
        Outcome::Measured { is_confirmed, .. } => *is_confirmed,
        Outcome::Refused(reason) => panic!("{reason}"),
    };
    let undisturbed = life::play(&bench, &[], true);
    assert!(is_confirmed(&undisturbed));
    let stuck = device("analyzer: feels a contact always", RunPhase::Indentation, 0.777);
    for order in ["client: abort", "client: stop"] {
        let end = device(order, RunPhase::Confirmation, 0.0);
        let played = life::play(&bench, std::slice::from_ref(&end), false);
        assert!(!is_confirmed(&played), "{order}");
        let played = life::play(&bench, &[stuck.clone(), end], false);
        assert!(!is_confirmed(&played), "{order}");
        let beyond = is_beyond_notice(&played);
        assert!(beyond.is_some_and(|beyond| beyond.is_marked), "{order}: {beyond:?}");
    }
}

/// Seed 40448 of the menu 30cc4ed8a2037c43: after a cut reply the analyzer was set up again, and the first
/// reading was of a sensor that rang, which looked like a contact.
#[test]
fn steps_lost_before_a_check_of_slip_are_noticed_whichever_reply_of_the_check_is_cut() {
    let bench = Bench::new(352);
    let lost = device(UPWARDS, RunPhase::Indentation, 0.0);
    for nth in 1..12 {
        let cut = Trouble { nth, ..device("analyzer: reply cut", RunPhase::SlipCheck, 0.146) };
        let played = life::play(&bench, &[lost.clone(), cut], false);
        let context = format!("reply {nth}: {:?}", played.touches);
        assert!(matches!(outcome(&played), Outcome::Refused(_)), "{context}");
    }
}

/// Seeds 163953 and 164779 of the menu 30cc4ed8a2037c43: a wrong bit in the eighth digit of the frequency of a
/// flagged reading, and a stop in the last moment of a retract to a clear height.
#[test]
fn a_rounded_frequency_and_a_stop_at_the_end_of_a_retract_are_sound() {
    let bit = Trouble {
        trigger: "next=5".to_owned(),
        ..device("analyzer: reply with a wrong bit", RunPhase::Indentation, 0.018)
    };
    let stop = device("two clients: pause and stop", RunPhase::Retract, 0.626);
    for (bench, trouble) in [(746, bit), (273, stop)] {
        let played = life::play(&Bench::new(bench), &[trouble], false);
        assert_eq!(played.violations, Vec::<String>::new());
    }
}

/// Seed 168463 of the menu 30cc4ed8a2037c43: late answers stretched the times of the points of a trace, and its free
/// decay seemed to be of another frequency.
#[test]
fn late_answers_of_an_analyzer_that_measures_traces_shift_no_resonance() {
    let bench = Bench::new(546);
    let undisturbed = life::play(&bench, &[], false);
    for name in ["analyzer: reply 0.3 s late", "analyzer: reply 3 s late"] {
        for phase in [RunPhase::Indentation, RunPhase::Dwell, RunPhase::Sweep] {
            let late = Trouble { trigger: "rate=1".to_owned(), ..device(name, phase, 0.0) };
            let played = life::play(&bench, &[late], false);
            let differences = judge::differences(&bench, &played, &undisturbed.touches);
            assert_eq!(
                (&*played.violations, &*differences),
                (&[][..], &[][..]),
                "{name} {phase:?}"
            );
        }
    }
}

/// Seed 13932 of the menu 30cc4ed8a2037c43: the disk was full before the first record of a session was on it, and rigd
/// had told the id of that session.
#[test]
fn whatever_has_an_id_is_on_the_disk() {
    let bench = Bench::new(613);
    for nth in 1..40 {
        let disk = Trouble { nth, ..device("disk: full", RunPhase::Sweep, 0.632) };
        let kill = device("daemon: killed", RunPhase::Sweep, 0.64);
        let played = life::play(&bench, &[disk, kill], false);
        assert_eq!(played.violations, Vec::<String>::new(), "call {nth}");
    }
}

/// The driver cannot notice it: the analyzer repeats the frequency that it was told. A no-load sweep is
/// refused, the contact sense contradicts the touch, or no contact is felt.
#[test]
fn an_analyzer_that_stays_at_its_frequency_is_noticed_in_each_phase_of_a_touch() {
    use RunPhase::{Dwell, Indentation, NoLoadSweep, Retract, Search, SlipCheck, Sweep};
    for number in 0..6 {
        let bench = Bench::new(number);
        let undisturbed = life::play(&bench, &[], false);
        for phase in [NoLoadSweep, Search, Indentation, Dwell, Sweep, SlipCheck, Retract] {
            let stuck = device("analyzer: stays at its frequency", phase, 0.1);
            let played = life::play(&bench, &[stuck], false);
            let differences = judge::differences(&bench, &played, &undisturbed.touches);
            let context = format!("bench {number}, {phase:?}: {:?}", played.touches);
            assert_eq!((&*played.violations, &*differences), (&[][..], &[][..]), "{context}");
            let has_begun = phase != SlipCheck || bench.has_slip_check;
            assert_eq!(played.begun.len(), usize::from(has_begun), "{context}");
            let is_refused = |outcome: &Outcome| matches!(outcome, Outcome::Refused(_));
            let is_noticed =
                played.latches > undisturbed.latches || played.touches.values().any(is_refused);
            assert_eq!(is_noticed, has_begun, "{context}");
        }
    }
}

/// Seed 332689 of the menu 6c11055b454a65d6: after the search the contact sense felt nothing. Two good sweeps of the
/// free sensor differed by eight standard deviations of their drift, and that was taken for a shift.
#[test]
fn a_drift_is_no_shift() {
    let blind =
        Trouble { nth: 6, ..device("analyzer: feels no contact", RunPhase::Indentation, 0.719) };
    for number in [241, 395, 613] {
        let bench = Bench::new(number);
        let undisturbed = life::play(&bench, &[], false);
        let played = life::play(&bench, std::slice::from_ref(&blind), false);
        let differences = judge::differences(&bench, &played, &undisturbed.touches);
        assert_eq!((&*played.violations, &*differences), (&[][..], &[][..]), "{number}");
        let is_refused = |outcome: &Outcome| matches!(outcome, Outcome::Refused(_));
        assert!(played.touches.values().any(is_refused), "{number}: {:?}", played.touches);
    }
}

/// Seeds 382625 and 488939 of the menu 6c11055b454a65d6: steps were lost twice, and then the contact sense felt
/// nothing, so that the next search went down to its lowest position; steps were lost twice on the way into the sample.
#[test]
fn a_position_lost_on_the_way_in_or_under_a_failed_sense_is_beyond_knowledge() {
    use RunPhase::{Baseline, Indentation};
    let sent = ViolationKind::PressedTooDeep { indentation_mm: 1.022, limit_mm: 1.0 };
    let is_beyond = |faults: &[(&str, RunPhase)]| {
        let begun = |(name, phase): &(&str, RunPhase)| {
            let row = MENU.iter().position(|(known, _)| known == name).unwrap();
            Begun { row, phase: Phase::Run(*phase), event: 0 }
        };
        let begun = faults.iter().map(begun).collect();
        judge::is_beyond_knowledge(&sent, &Played { begun, ..Played::default() })
    };
    let blind = ("analyzer: feels no contact", Baseline);
    let (before, on_the_way) = ((DOWNWARDS, Baseline), (DOWNWARDS, Indentation));
    assert!(is_beyond(&[before, blind]));
    assert!(is_beyond(&[on_the_way]));
    let stuck = ("analyzer: feels a contact always", Baseline);
    let upwards = (UPWARDS, Indentation);
    for some in [&[before, before][..], &[before, stuck], &[blind], &[upwards, blind], &[]] {
        assert!(!is_beyond(some), "{some:?}");
    }
}

/// A protocol without a check of slip, as a tissue that stays indented may need it: what would show the loss is
/// not measured, and the touch says so.
#[test]
fn steps_lost_in_a_touch_without_a_check_of_slip_leave_a_mark() {
    let bench = (0..64).map(Bench::new).find(|bench| !bench.has_slip_check).expect("one in four");
    let undisturbed = life::play(&bench, &[], false);
    let is_marked = |played: &Played| {
        let is_marked =
            |outcome: &Outcome| matches!(outcome, Outcome::Measured { is_slip_checked: false, .. });
        played.touches.values().all(is_marked)
    };
    assert!(is_marked(&undisturbed), "{:?}", undisturbed.touches);
    assert_eq!(is_beyond_notice(&undisturbed), None);
    let played = life::play(&bench, &[device(UPWARDS, RunPhase::Indentation, 0.0)], false);
    assert_eq!(judge::differences(&bench, &played, &undisturbed.touches).len(), 1);
    assert!(is_marked(&played), "{:?}", played.touches);
    assert!(is_beyond_notice(&played).is_some_and(|beyond| beyond.is_marked));
    // A shift that is wrong without a mark is no known way.
    let mut unmarked = played;
    for outcome in unmarked.touches.values_mut() {
        if let Outcome::Measured { is_slip_checked, .. } = outcome {
            *is_slip_checked = true;
        }
    }
    assert_eq!(is_beyond_notice(&unmarked), None);
}

/// Seed 488939 of the menu 6c11055b454a65d6: steps were lost twice on the way into the sample. Nothing that the rig
/// reads before the sweep differs; the check of slip after it does, and without one the touch is marked.
#[test]
fn steps_lost_on_the_way_in_show_in_nothing_before_the_sweep_and_the_touch_is_refused_or_marked() {
    let lost =
        [0.05, 0.15].map(|after_s| device(DOWNWARDS, RunPhase::Indentation, after_s)).to_vec();
    for has_slip_check in [true, false] {
        let is_such = |bench: &Bench| bench.has_slip_check == has_slip_check && !bench.is_uneven;
        let bench = (0..64).map(Bench::new).find(is_such).expect("such a bench");
        let [undisturbed, played] = [&[][..], &lost].map(|lost| life::play(&bench, lost, true));
        assert_eq!((played.begun.len(), played.sunk), (2, 1), "{:?}", played.violations);
        let before_sweep = |played: &Played| -> Vec<String> {
            let is_before = |record: &&String| !record.contains(r#""purpose":"touch""#);
            played.records.iter().take_while(is_before).cloned().collect()
        };
        let before = before_sweep(&played);
        assert!(kinds(&played).len() > before.len() && 10 < before.len());
        assert_eq!(before, before_sweep(&undisturbed));
        let is_told = played.touches.values().all(|outcome| match outcome {
            Outcome::Refused(_) => true,
            Outcome::Measured { is_slip_checked, .. } => !has_slip_check && !is_slip_checked,
        });
        assert!(is_told, "{:?}", played.touches);
    }
}
