//! A hub that is put back to a backup, behind what it had said that it has.

use std::{fs, path::Path, process::Command};

use tempfile::TempDir;

use crate::{
    bench::{Bench, Counts},
    support::{Hub, assert_same, contents_of, server},
};

/// The seed of the bench that has shipped, beyond those of the campaign.
const SEED: u64 = u64::MAX;

/// Stops PostgreSQL, puts its directory back to a copy, and lets the bench ship again.
pub(crate) async fn play(hub: &mut Hub, counts: &mut Counts) {
    let mut bench = Bench::new(SEED, hub).await;
    let data = bench.data.path().to_owned();
    bench.measure_in(&data, counts);
    // A run that goes on behind the backup.
    bench.kill_rig();
    hub.ship(&bench.role, &data).await.unwrap();
    let (directory, backup) = (server().data(), TempDir::new().unwrap());
    server().stop().unwrap();
    copy(&directory, &backup.path().join("data"));
    server().go_on().unwrap();
    hub.reconnect().await;
    bench.end_all(counts);
    hub.ship(&bench.role, &data).await.unwrap();
    server().stop().unwrap();
    fs::remove_dir_all(&directory).unwrap();
    copy(&backup.path().join("data"), &directory);
    server().go_on().unwrap();
    hub.reconnect().await;
    let held = hub.contents_of(&bench.role).await;
    assert!(held.len() < contents_of(&data).len(), "the backup has everything");
    hub.ship(&bench.role, &data).await.unwrap();
    assert_same(&hub.contents_of(&bench.role).await, &contents_of(&data));
    *counts.entry("hubs restored".to_owned()).or_default() += 1;
}

/// Copies a directory with its owners.
fn copy(from: &Path, to: &Path) {
    let status = Command::new("cp").arg("-a").args([from, to]).status().unwrap();
    assert!(status.success(), "{} cannot be copied", from.display());
}
