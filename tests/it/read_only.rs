//! A journal with a log on a medium that cannot be written to.

use std::fs;

use rig_tests::{TestRig, text};
use tempfile::TempDir;

#[tokio::test]
async fn a_journal_with_a_log_is_checked_where_nothing_can_be_written() {
    let rig = TestRig::open().await;
    let (run, _) = rig.run(rig.protocol(&text("config/protocols/smoke.toml"))).await;
    let sound = rig_verify::verify(rig.data(), &run.to_string()).expect("a journal");
    assert!(sound.is_sound, "{:?}", sound.findings);
    let copy = TempDir::new().expect("a directory");
    // The program still has the journal open, so that its records are in the log.
    for name in ["rigd.db", "rigd.db-wal"] {
        fs::copy(rig.data().join(name), copy.path().join(name)).expect("a copy");
    }
    // SQLite cannot make its index of the log, as on a medium that cannot be written to.
    fs::create_dir(copy.path().join("rigd.db-shm")).expect("a directory");
    let verdict = rig_verify::verify(copy.path(), &run.to_string()).expect("a journal");
    assert_eq!(verdict, sound);
    rig.close().await;
}
