use tempfile::TempDir;

use super::*;

fn entry(protocol: &str) -> Entry {
    Entry {
        number: 0,
        protocol: protocol.to_owned(),
        toml: String::new(),
        note: String::new(),
        deadline_unix_ms: None,
        by: "ada".to_owned(),
        added_unix_ms: 7,
        is_missed: false,
    }
}

const IDLE: Seen<'static> =
    Seen { state: RigState::Idle, fault: None, journal_error: None, is_silent: false };

fn queue_of(protocols: &[&str]) -> Queue {
    let mut queue = Queue::default();
    for protocol in protocols {
        queue.add(entry(protocol)).unwrap();
    }
    queue
}

fn names(queue: &Queue) -> Vec<&str> {
    queue.entries().iter().map(|entry| entry.protocol.as_str()).collect()
}

#[test]
fn entries_are_moved_and_cancelled_by_numbers_that_are_not_used_again() {
    let mut queue = queue_of(&["a", "b", "c"]);
    queue.move_to(3, 1).unwrap();
    assert_eq!(names(&queue), ["c", "a", "b"]);
    queue.move_to(3, 3).unwrap();
    assert_eq!(names(&queue), ["a", "b", "c"]);
    assert_eq!(queue.move_to(1, 0), Err(QueueRefusal::NoPlace { place: 0, entries: 3 }));
    assert_eq!(queue.move_to(1, 4), Err(QueueRefusal::NoPlace { place: 4, entries: 3 }));
    assert_eq!(queue.take(3).unwrap().protocol, "c");
    assert_eq!(queue.take(3), Err(QueueRefusal::NoEntry(3)));
    assert_eq!(queue.add(entry("d")), Ok(4));
}

#[test]
fn a_queue_and_a_note_have_a_largest_size() {
    let mut queue = Queue::default();
    for number in 1..=ENTRIES_MAX {
        assert_eq!(queue.add(entry("a")), Ok(number as u64));
    }
    assert_eq!(queue.add(entry("a")), Err(QueueRefusal::Full));
    let mut queue = Queue::default();
    let noted = |length| Entry { note: "é".repeat(length), ..entry("a") };
    assert_eq!(queue.add(noted(NOTE_MAX + 1)), Err(QueueRefusal::LongNote));
    assert!(queue.add(noted(NOTE_MAX)).is_ok());
}

#[test]
fn only_a_released_queue_on_an_idle_rig_begins_its_first_entry() {
    let mut queue = queue_of(&["a", "b"]);
    let every = [
        RigState::Preparing,
        RigState::Idle,
        RigState::Running,
        RigState::WaitingForPerson,
        RigState::Paused,
        RigState::Retracting,
        RigState::Latched,
    ];
    for state in every {
        let seen = Seen { state, ..IDLE };
        let begins = matches!(queue.turn(seen), Turn::Begin(entry) if entry.number == 1);
        assert_eq!(begins, state == RigState::Idle, "{state:?}");
        let holds = matches!(queue.turn(seen), Turn::Hold(HoldKind::Fault, _));
        assert_eq!(holds, state == RigState::Latched, "{state:?}");
        assert_eq!(queue.turn(Seen { is_silent: true, ..seen }), Turn::Wait);
        let failed = Seen { journal_error: Some("disk"), ..seen };
        assert!(matches!(queue.turn(failed), Turn::Hold(HoldKind::Fault, _)));
    }
    queue.stop(HoldKind::Person, "held".to_owned(), 0);
    for state in every {
        assert_eq!(queue.turn(Seen { state, ..IDLE }), Turn::Wait);
    }
}

#[test]
fn an_entry_that_cannot_end_in_time_lets_the_next_one_begin() {
    let late = Entry { deadline_unix_ms: Some(10_000), ..entry("a") };
    assert!(late.is_in_time(4_000, 6.0) && !late.is_in_time(4_001, 6.0));
    assert!(!late.is_in_time(20_000, 0.0) && entry("b").is_in_time(u64::MAX, 1e9));
    let mut queue = queue_of(&["a", "b"]);
    queue.miss(1);
    assert!(matches!(queue.turn(IDLE), Turn::Begin(entry) if entry.number == 2));
    queue.take(2).unwrap();
    assert!(matches!(queue.turn(IDLE), Turn::Hold(HoldKind::Empty, _)));
    assert_eq!(queue.release(), Err(QueueRefusal::Empty));
    queue.move_to(1, 1).unwrap();
    assert!(matches!(queue.turn(IDLE), Turn::Begin(entry) if entry.number == 1));
}

#[test]
fn a_queue_is_held_after_a_start_unless_asked_otherwise() {
    let folder = TempDir::new().unwrap();
    let kind = |queue: &Queue| queue.hold().map(|hold| hold.kind);
    for (before, plain, released) in [
        (None, Some(HoldKind::Start), None),
        (Some(HoldKind::Start), Some(HoldKind::Start), None),
        (Some(HoldKind::Empty), Some(HoldKind::Start), None),
        (Some(HoldKind::Fault), Some(HoldKind::Fault), Some(HoldKind::Fault)),
        (Some(HoldKind::Person), Some(HoldKind::Person), Some(HoldKind::Person)),
    ] {
        let mut queue = queue_of(&["a"]);
        if let Some(before) = before {
            queue.stop(before, "before".to_owned(), 1);
        }
        queue.write(folder.path()).unwrap();
        let open = |is_released| Queue::open(folder.path(), is_released, 2).unwrap();
        assert_eq!(open(false).entries(), queue.entries());
        assert_eq!((kind(&open(false)), kind(&open(true))), (plain, released), "{before:?}");
    }
}

#[test]
fn a_run_that_was_under_way_when_the_daemon_ended_holds_the_queue() {
    let folder = TempDir::new().unwrap();
    let mut queue = queue_of(&["a", "b"]);
    let first = queue.entries()[0].clone();
    queue.begin(&first, "run".to_owned());
    assert_eq!((names(&queue), queue.run()), (vec!["b"], Some("run")));
    queue.write(folder.path()).unwrap();
    let mut opened = Queue::open(folder.path(), true, 0).unwrap();
    assert_eq!(opened.hold().map(|hold| hold.kind), Some(HoldKind::Fault));
    opened.release().unwrap();
    assert!(opened.run().is_none() && matches!(opened.turn(IDLE), Turn::Begin(_)));
    assert_eq!(queue.end(0), None);
    queue.write(folder.path()).unwrap();
    assert_eq!(Queue::open(folder.path(), true, 0).unwrap().hold(), None);
}

#[test]
fn a_file_of_another_version_is_not_read() {
    let folder = TempDir::new().unwrap();
    let other = Queue { format: FORMAT + 1, ..queue_of(&["a"]) };
    other.write(folder.path()).unwrap();
    let error = Queue::open(folder.path(), false, 0).unwrap_err().to_string();
    assert_eq!(error, "its format is 4, and this rigd reads 1 to 3");
    fs::write(folder.path().join(FILE), "{").unwrap();
    assert!(Queue::open(folder.path(), false, 0).is_err());
}

#[test]
fn a_file_without_keys_is_read() {
    let folder = TempDir::new().unwrap();
    queue_of(&["a"]).write(folder.path()).unwrap();
    let path = folder.path().join(FILE);
    let mut file: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
    file["format"] = 1.into();
    file.as_object_mut().unwrap().remove("keys").unwrap();
    fs::write(&path, file.to_string()).unwrap();
    assert_eq!(names(&Queue::open(folder.path(), false, 0).unwrap()), ["a"]);
}

#[test]
fn a_request_with_a_known_key_adds_nothing_also_after_its_entry_has_begun() {
    let mut queue = queue_of(&["a"]);
    let asked = entry("a");
    assert_eq!(queue.keyed("k", &asked), Ok(None));
    queue.remember("k".to_owned(), asked.digest(), 1);
    let first = queue.entries()[0].clone();
    queue.begin(&first, "run".to_owned());
    assert_eq!(queue.keyed("k", &Entry { added_unix_ms: 99, ..asked.clone() }), Ok(Some(1)));
    for other in [
        Entry { note: "b".to_owned(), ..asked.clone() },
        Entry { toml: "b".to_owned(), ..asked.clone() },
        Entry { deadline_unix_ms: Some(1), ..asked.clone() },
    ] {
        let refusal = QueueRefusal::OtherRequest { key: "k".to_owned(), number: 1 };
        assert_eq!(queue.keyed("k", &other), Err(refusal));
    }
    for number in 0..KEYS_MAX {
        queue.remember(format!("n{number}"), asked.digest(), 2);
    }
    assert_eq!(queue.keyed("k", &asked), Ok(None), "it is the oldest of too many");
    assert_eq!(queue.keyed("n0", &asked), Ok(Some(2)));
}

#[test]
fn a_run_that_ends_after_its_deadline_is_kept_as_late() {
    let folder = TempDir::new().unwrap();
    let mut queue = Queue::default();
    for number in 0..=LATE_MAX as u64 + 1 {
        queue.add(Entry { deadline_unix_ms: Some(5_000), ..entry("a") }).unwrap();
        let first = queue.entries()[0].clone();
        queue.begin(&first, format!("run {number}"));
        queue.write(folder.path()).unwrap();
        // The first one ends just in time.
        let sentence = queue.end(5_000 + number * 1_500).map(LateRun::sentence);
        let late_s = number as f64 * 1.5;
        let expected = format!(
            "run run {number} of entry {}, a, ended {late_s:.1} s after its deadline",
            number + 1
        );
        assert_eq!(sentence, (number > 0).then_some(expected));
    }
    assert_eq!((queue.late().len(), queue.late()[0].number), (LATE_MAX, LATE_MAX as u64 + 2));
    assert_eq!(queue.late()[LATE_MAX - 1].run, "run 2", "the oldest is left out");
    queue.write(folder.path()).unwrap();
    assert_eq!(Queue::open(folder.path(), true, 0).unwrap().late(), queue.late());
    // Without a deadline no run is late, also behind one that had one.
    queue.add(entry("b")).unwrap();
    let first = queue.entries()[0].clone();
    queue.begin(&first, "another".to_owned());
    assert_eq!(queue.end(u64::MAX), None);
}
