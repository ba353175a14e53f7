//! The journal after its program was killed.

use super::sample::{Directory, append, records, run_started};
use crate::{
    Axis, Clearance, Ending, Fault, HOMING, Intent, Jump, Move, MoveReason, Operator, PREPARE,
    ProbeWord, Reader, Record, RunFinished, RunKind, RunStatus, StateChanged, Store,
};

fn lowering(to: f64) -> Record {
    let (what, axis) = (MoveReason::Approach, Axis::LinearMm);
    Record::Intent(Intent { what, axis, from: Some(30.0), to, limit: Some(to) })
}

fn moved(axis: Axis, to: f64, is_clear: bool) -> Record {
    Record::Moved(Move { axis, target: to, read_back: to, is_clear })
}

fn lost() -> Record {
    let (cause, hint) = ("no answer".to_owned(), "look".to_owned());
    Record::Fault(Fault { step: None, cause, probe: Clearance::Unknown, hint, last_moves_mm: None })
}

fn state(state: &str) -> Record {
    Record::StateChanged(StateChanged { state: state.to_owned(), reason: None })
}

fn preparing() -> Record {
    state("preparing")
}

#[test]
fn a_position_that_was_said_to_be_wrong_stays_so_until_the_rig_was_in_service() {
    let directory = Directory::new();
    let session = |rig, said: &[Record]| {
        let store = Store::open(directory.path()).unwrap();
        let mut journal = store.begin(RunKind::Session, rig).unwrap();
        for record in said {
            append(&mut journal, 0, record);
        }
        journal.commit().unwrap();
    };
    let found = |rig| Reader::open(directory.path()).unwrap().jump(rig).unwrap();
    let jump = |is_homing_open| Some(Jump { last_moves_mm: [9.5, 24.5], is_homing_open });
    let Record::Fault(fault) = lost() else { unreachable!() };
    let jumped = Record::Fault(Fault { last_moves_mm: Some([9.5, 24.5]), ..fault });
    session("bench", &[state("idle"), jumped.clone(), state("latched"), lost()]);
    assert_eq!(found("bench"), jump(false));
    // Programs that end before they say anything, and another rig.
    session("bench", &[]);
    session("bench", &[preparing()]);
    session("another", &[state("idle")]);
    assert_eq!((found("bench"), found("another")), (jump(false), None));
    // A homing that fails, and each program after it says again what the first one had said.
    let (action, who) = (HOMING.to_owned(), "mo".to_owned());
    session("bench", &[Record::Operator(Operator { action, who }), preparing(), lost()]);
    assert_eq!(found("bench"), jump(true));
    session("bench", &[jumped.clone(), state("latched")]);
    assert_eq!(found("bench"), jump(true));
    // One without a jump before it that breaks off: its fault is the first to say where the last moves had led.
    let (action, who) = (HOMING.to_owned(), "mo".to_owned());
    let homing = Record::Operator(Operator { action, who });
    let broken_off = [state("latched"), homing, preparing(), jumped.clone(), state("latched")];
    session("third", &[&[state("idle"), lost()], &broken_off[..]].concat());
    assert_eq!(found("third"), jump(true));
    // It has ended with the move that follows a homing, though not that of another axis, or with service.
    session("bench", &[moved(Axis::RotaryDeg, 0.0, false)]);
    assert_eq!(found("bench"), jump(true));
    session("bench", &[moved(Axis::LinearMm, 24.5, true), lost()]);
    assert_eq!(found("bench"), None);
    session("bench", &[jumped]);
    assert_eq!(found("bench"), jump(false));
    session("bench", &[preparing(), state("idle"), lost()]);
    assert_eq!(found("bench"), None);
}

#[test]
fn a_fault_of_the_rotary_stage_stands_until_the_rig_is_in_service_again() {
    let directory = Directory::new();
    let found = |said: &[Record]| {
        let store = Store::open(directory.path()).unwrap();
        let mut journal = store.begin(RunKind::Session, "bench").unwrap();
        for record in said {
            append(&mut journal, 0, record);
        }
        journal.commit().unwrap();
        Reader::open(directory.path()).unwrap().is_rotary_faulted_since_service("bench").unwrap()
    };
    let fault = |cause: &str| {
        let (cause, hint) = (cause.to_owned(), "look".to_owned());
        let probe = Clearance::Unknown;
        Record::Fault(Fault { step: None, cause, probe, hint, last_moves_mm: None })
    };
    let of_rotary = || fault("rotary stage: came to rest at 30 °, and is at 35 °");
    let (action, who) = (PREPARE.to_owned(), "rigd".to_owned());
    let begins = || Record::Operator(Operator { action: action.clone(), who: who.clone() });
    let way_out = [of_rotary(), state("retracting"), state("latched")];
    assert!(!found(&[begins(), state("idle")]));
    // It says what the program before it said.
    assert!(!found(&way_out));
    assert!(!found(&[begins(), state("idle"), lost(), state("latched")]));
    assert!(found(&[begins(), state("idle"), of_rotary(), state("latched")]));
    // A start that finds it latched, a way out, and a preparation that does not end.
    assert!(found(&[lost(), state("latched")]) && found(&way_out) && found(&[preparing()]));
    assert!(!found(&[lost(), state("latched"), preparing(), state("idle")]));
    // A start that is not latched has no record of its state before the first fault.
    assert!(found(&[begins(), of_rotary(), state("latched")]));
    assert!(!found(&[begins(), state("idle")]));
    // What a salvage could not copy.
    assert!(found(&[lost()]));
}

#[test]
fn a_run_goes_on_as_long_as_its_program_lives() {
    let directory = Directory::new();
    let store = Store::open(directory.path()).unwrap();
    let mut journal = store.begin(RunKind::Run, "one touch").unwrap();
    append(&mut journal, 0, &run_started());
    journal.commit().unwrap();
    let (id, reader) = (journal.id(), Reader::open(directory.path()).unwrap());
    let run = reader.run(id).unwrap();
    assert_eq!((run.status, &run.finished_at, run.wall_s), (RunStatus::Running, &None, None));
    assert!(reader.has_writer() && reader.interruption(&run).unwrap().is_none());

    // The lock ends with the program.
    drop((journal, store));
    let run = reader.run(id).unwrap();
    assert!(!reader.has_writer() && run.status == RunStatus::Interrupted, "{run:?}");
    assert_eq!(reader.runs().unwrap(), std::slice::from_ref(&run));
    let left = reader.interruption(&run).unwrap().unwrap();
    assert!(left.at >= run.started_at && Some(&left.at) == run.finished_at.as_ref(), "{left:?}");
    assert!(matches!(reader.verify(id).unwrap(), crate::ChainCheck::Intact { records: 1, .. }));

    // The next opening of the journal leaves the run open and its end time unchanged.
    let store = Store::open(directory.path()).unwrap();
    assert_eq!(store.interrupted(), [id]);
    let still = reader.run(id).unwrap();
    assert_eq!(still, run);
    assert_eq!(reader.interruption(&still).unwrap().unwrap(), left);
}

#[test]
fn a_reader_does_not_stand_in_the_way_of_a_writer() {
    let directory = Directory::new();
    drop(Store::open(directory.path()).unwrap());
    std::thread::scope(|scope| {
        let asking = scope.spawn(|| {
            let reader = Reader::open(directory.path()).unwrap();
            (0..20_000).filter(|_| reader.has_writer()).count()
        });
        while !asking.is_finished() {
            drop(Store::open(directory.path()).unwrap());
        }
    });
}

#[track_caller]
fn check(kind: RunKind, said: &[Record], expected: ProbeWord) {
    let directory = Directory::new();
    let store = Store::open(directory.path()).unwrap();
    let mut journal = store.begin(kind, "simulated").unwrap();
    append(&mut journal, 0, &run_started());
    for record in said {
        append(&mut journal, 1, record);
    }
    journal.commit().unwrap();
    let id = journal.id();
    drop((journal, store));
    let reader = Reader::open(directory.path()).unwrap();
    let left = reader.interruption(&reader.run(id).unwrap()).unwrap().unwrap();
    assert_eq!(left.probe, expected, "{said:?}");
    assert!(!left.is_cleared_since);
}

#[test]
fn the_probe_counts_as_in_contact_unless_the_last_word_is_a_proven_clear() {
    let rest = moved(Axis::LinearMm, 30.0, true);
    let down = moved(Axis::LinearMm, 12.0, false);
    let turned = moved(Axis::RotaryDeg, 15.0, false);
    let may_touch = |at_mm, down_to_mm| ProbeWord::MayTouch { at_mm, down_to_mm };
    let run = |said: &[&Record], expected| {
        let said: Vec<Record> = said.iter().copied().cloned().collect();
        check(RunKind::Run, &said, expected);
    };
    run(&[], ProbeWord::Clear);
    run(&[&turned], ProbeWord::Clear);
    run(&[&lowering(9.0)], may_touch(None, Some(9.0)));
    run(&[&rest, &turned, &lowering(9.0)], may_touch(None, Some(9.0)));
    run(&[&lowering(9.0), &down], may_touch(Some(12.0), Some(9.0)));
    run(&[&lowering(9.0), &down, &rest], ProbeWord::Clear);
    run(&[&lowering(9.0), &down, &rest, &turned], ProbeWord::Clear);
    run(&[&lowering(9.0), &down, &rest, &lowering(8.0)], may_touch(None, Some(8.0)));
    run(&[&rest, &lost()], may_touch(None, None));
    run(&[&lost(), &rest], ProbeWord::Clear);
    // It goes on with the probe clear.
    let on = super::resume::resumed(1);
    run(&[&lowering(9.0), &on], ProbeWord::Clear);
    run(&[&lowering(9.0), &on, &lowering(8.0)], may_touch(None, Some(8.0)));
    run(&[&lowering(9.0), &on, &lost()], may_touch(None, None));
    check(RunKind::Session, &[], ProbeWord::Silent);
    check(RunKind::Session, std::slice::from_ref(&rest), ProbeWord::Clear);
    check(RunKind::Session, &[rest.clone(), preparing()], ProbeWord::Silent);
    check(RunKind::Session, &[rest, lost(), preparing()], may_touch(None, None));
}

#[test]
fn each_session_is_asked_for_its_own_epoch() {
    let directory = Directory::new();
    let rest = moved(Axis::LinearMm, 30.0, true);
    let said = [vec![rest.clone()], vec![], vec![lowering(9.0)], vec![], vec![rest]];
    let mut ids = Vec::new();
    for (records, number) in said.iter().zip(0..) {
        let store = Store::open(directory.path()).unwrap();
        let mut session = store.begin(RunKind::Session, "simulated").unwrap();
        append(&mut session, 0, &run_started());
        for record in records {
            append(&mut session, 1, record);
        }
        if number == 1 {
            // A session without a record gets its first one, its end, when the journal is opened again.
            store.begin(RunKind::Session, "other").unwrap();
        }
        session.commit().unwrap();
        ids.push(session.id());
    }
    let reader = Reader::open(directory.path()).unwrap();
    let sessions: Vec<_> = ids.iter().map(|id| reader.run(*id).unwrap()).collect();
    let words: Vec<_> =
        sessions.iter().map(|session| reader.probe_word(session).unwrap()).collect();
    let lowered = ProbeWord::MayTouch { at_mm: None, down_to_mm: Some(9.0) };
    let (clear, silent) = (ProbeWord::Clear, ProbeWord::Silent);
    assert_eq!(words, [clear, silent, lowered, silent, clear]);
    let left = |session| reader.interruption(session).unwrap().unwrap();
    let cleared: Vec<_> = sessions.iter().map(|session| left(session).is_cleared_since).collect();
    assert_eq!(cleared, [true, true, true, true, false]);
}

#[test]
fn every_cut_of_a_run_says_where_it_was_left() {
    let all = records();
    let is_intent = |record: &Record| matches!(record, Record::Intent(_));
    let lowered = all.iter().position(is_intent).unwrap();
    for cut in 1..all.len() {
        let directory = Directory::new();
        let store = Store::open(directory.path()).unwrap();
        let mut session = store.begin(RunKind::Session, "simulated").unwrap();
        append(&mut session, 0, &moved(Axis::LinearMm, 30.0, true));
        let mut journal = store.begin(RunKind::Run, "one touch").unwrap();
        for record in &all[..cut] {
            append(&mut journal, 1, record);
        }
        journal.commit().unwrap();
        let (run, session_id) = (journal.id(), session.id());
        drop((journal, session, store));
        let reader = Reader::open(directory.path()).unwrap();
        let left = |id| reader.interruption(&reader.run(id).unwrap()).unwrap().unwrap();
        let is_clear = cut <= lowered;
        assert_eq!(left(run).probe == ProbeWord::Clear, is_clear, "cut at {cut}");
        // The session ended with the run.
        assert_eq!(left(session_id).probe == ProbeWord::Clear, is_clear, "cut at {cut}");
        assert_eq!(left(run).step.is_some(), cut > 1);
        assert_eq!(reader.latest_session("simulated").unwrap().unwrap().id, session_id);
        assert!(reader.latest_session("bench").unwrap().is_none());

        // Only the same rig can show that its probe is clear.
        for (rig, is_cleared) in [("bench", false), ("simulated", true)] {
            let store = Store::open(directory.path()).unwrap();
            let mut session = store.begin(RunKind::Session, rig).unwrap();
            append(&mut session, 0, &moved(Axis::LinearMm, 30.0, true));
            append(
                &mut session,
                0,
                &Record::RunFinished(RunFinished { status: Ending::Completed }),
            );
            session.commit().unwrap();
            assert_eq!(left(run).is_cleared_since, is_cleared, "{rig}");
            assert_eq!(left(run).probe == ProbeWord::Clear, is_clear);
        }
    }
}

#[test]
fn the_run_that_belongs_to_a_key_is_found_again() {
    let directory = Directory::new();
    let mut ids = Vec::new();
    for key in [None, Some("monday"), Some("tuesday"), Some("it's \"noon\"")] {
        let store = Store::open(directory.path()).unwrap();
        let mut journal = store.begin(RunKind::Run, "one touch").unwrap();
        let Record::RunStarted(mut started) = run_started() else { unreachable!() };
        started.idempotency_key = key.map(str::to_owned);
        append(&mut journal, 0, &Record::RunStarted(started));
        journal.commit().unwrap();
        ids.push(journal.id());
    }
    let reader = Reader::open(directory.path()).unwrap();
    let found = |key| reader.keyed_run(key).unwrap().map(|record| record.run);
    assert_eq!((found("monday"), found("tuesday")), (Some(ids[1]), Some(ids[2])));
    assert_eq!(found("it's \"noon\""), Some(ids[3]));
    assert_eq!((found(""), found("' OR 1")), (None, None));
}
