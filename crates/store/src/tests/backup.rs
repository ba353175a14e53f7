//! A copy of a journal that is being written.

use std::{
    fs,
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
    thread,
};

use super::sample::{Directory, append, names, records};
use crate::{Reader, RunKind, Store, StoreError, back_up, salvage};

#[test]
fn a_copy_made_while_the_journal_is_written_is_sound_and_can_be_written_on() {
    let (data, copies) = (Directory::new(), Directory::new());
    let store = Store::open(data.path()).unwrap();
    let ended = AtomicBool::new(false);
    let copied = thread::scope(|scope| {
        let writing = scope.spawn(|| {
            let mut written = 0;
            while !ended.load(Ordering::Acquire) {
                let mut run = store.begin(RunKind::Run, "test").unwrap();
                for record in records() {
                    append(&mut run, 1, &record);
                    run.commit().unwrap();
                    written += 1;
                }
            }
            written
        });
        let copied: Vec<_> = (0..10)
            .map(|copy| {
                let to = copies.path().join(copy.to_string());
                (back_up(data.path(), &to, &[]).unwrap(), to)
            })
            .collect();
        ended.store(true, Ordering::Release);
        assert!(writing.join().unwrap() > 0);
        copied
    });
    let mut runs = 0;
    for (copied, to) in copied {
        assert!(copied.iter().all(|run| run.flaw.is_none()), "{copied:?}");
        assert!(copied.len() >= runs, "a later copy has less");
        runs = copied.len();
        // Restored: it is a data directory as any other.
        let restored = Store::open(&to).unwrap();
        let mut run = restored.begin(RunKind::Run, "after").unwrap();
        append(&mut run, 0, &records()[0]);
        run.commit().unwrap();
        assert_eq!(Reader::open(&to).unwrap().runs().unwrap().len(), runs + 1);
        assert!(!to.join("rigd.db.part").exists());
    }
    assert!(runs > 0);
}

/// A directory with a journal has everything, unless a salvage cannot read it.
#[cfg(target_os = "linux")]
#[test]
fn a_copy_gets_its_name_after_what_is_beside_it() {
    let data = Directory::new();
    drop(Store::open(data.path()).unwrap().begin(RunKind::Run, "test").unwrap());
    let notes = data.path().join("notes.json");
    fs::write(&notes, "").unwrap();
    let check = |copy: &dyn Fn(&Path) -> Result<(), StoreError>, is_salvage: bool| {
        let to = Directory::new();
        // A file that cannot be read.
        fs::remove_file(&notes).unwrap();
        std::os::unix::fs::symlink("/proc/self/mem", &notes).unwrap();
        let failed = copy(to.path()).unwrap_err();
        assert!(matches!(failed, StoreError::Path { .. }), "{failed}");
        assert_eq!(to.path().join("rigd.db").exists(), is_salvage);
        fs::remove_file(&notes).unwrap();
        fs::write(&notes, "{}").unwrap();
        let to = if is_salvage { Directory::new() } else { to };
        copy(to.path()).unwrap();
        assert_eq!(names(to.path()), ["notes.json", "rigd.db", "rigd.lock"]);
        assert_eq!(fs::read_to_string(to.path().join("notes.json")).unwrap(), "{}");
    };
    check(&|to| back_up(data.path(), to, &["notes.json"]).map(drop), false);
    check(&|to| salvage(data.path(), to, &["notes.json"]).map(drop), true);
}

#[test]
fn a_copy_overwrites_nothing_and_says_where_the_original_is_damaged() {
    let (data, to) = (Directory::new(), Directory::new());
    assert!(matches!(back_up(data.path(), to.path(), &[]), Err(StoreError::NoJournal)));
    let store = Store::open(data.path()).unwrap();
    let mut run = store.begin(RunKind::Run, "test").unwrap();
    append(&mut run, 0, &records()[0]);
    run.commit().unwrap();
    // A copy that was broken off is made again.
    fs::write(to.path().join("rigd.db.part"), "half").unwrap();
    assert_eq!(back_up(data.path(), to.path(), &[]).unwrap().len(), 1);
    assert!(matches!(back_up(data.path(), to.path(), &[]), Err(StoreError::NotEmpty)));
    let database = rusqlite::Connection::open(data.path().join("rigd.db")).unwrap();
    database.execute("UPDATE records SET payload = replace(payload, '{', '{ ')", []).unwrap();
    let again = Directory::new();
    assert!(back_up(data.path(), again.path(), &[]).unwrap()[0].flaw.is_some());
}
