//! The screen of a terminal of a given width, through a pseudo-terminal.

// Pseudo-terminals are those of Linux.
#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

#[path = "support/terminal.rs"]
mod support;

use std::path::Path;

use rig_model::Orientation;
use rustix::process::Signal;
use support::{Bench, PROTOCOL, Terminal, narrow};
use tempfile::TempDir;

const TURN: &str =
    "Turn the sensor a quarter to the left about its own axis. Press Enter when that is done.";
const FIRST: &str = "Put sample 1 under the probe. Press Enter when that is done.";
const SECOND: &str = "Put sample 2 under the probe. Press Enter when that is done.";
const ADVICE: &str = "retracting the probe; interrupt again to stop everything";

/// A person at a terminal who changes its width while rigd waits for the second sample, and
/// interrupts the run at last.
fn check(bench: &Bench, folder: &Path, columns: u16, changed: u16) {
    let mut terminal = Terminal::start(bench, folder, columns);
    terminal.wait_for_text(FIRST);
    bench.person.place_sample("1").unwrap();
    terminal.press_enter();
    terminal.wait_for_text(TURN);
    bench.person.turn_sensor(Orientation::Left);
    terminal.press_enter();
    terminal.wait_for_text("sample 1 of 2");
    // An Enter before the prompt is no answer.
    terminal.press_enter();
    terminal.press_enter();
    terminal.wait_for_text(SECOND);
    let all = terminal.text();
    assert!(all.contains(TURN) && all.contains(FIRST), "{columns}: {all}");

    terminal.resize(changed);
    let count = |all: &str| all.matches("Press Enter when that is done.").count();
    let before = count(&terminal.text());
    terminal.wait_for("the prompt again", |all| all.ends_with(SECOND) && count(all) > before);
    bench.person.place_sample("2").unwrap();
    terminal.press_enter();
    terminal.wait_for_text("sample 2 of 2");
    terminal.signal(Signal::INT);
    terminal.wait_for_text(ADVICE);
    assert_eq!(terminal.end(), Some(5), "{}", terminal.text());
    let all = terminal.text();
    assert!(all.contains(SECOND) && all.contains(ADVICE), "{columns} to {changed}: {all}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_prompt_is_not_lost_whatever_the_width_of_the_terminal() {
    let widths = [40, 60, 80, 90, 120, 300];
    let folders = widths.map(|_| TempDir::new().unwrap());
    let mut people = Vec::new();
    for ((folder, columns), changed) in folders.iter().zip(widths).zip(widths.into_iter().rev()) {
        let (bench, path) = (Bench::start(folder.path(), PROTOCOL).await, folder.path().to_owned());
        people.push(tokio::task::spawn_blocking(move || check(&bench, &path, columns, changed)));
    }
    for person in people {
        person.await.unwrap();
    }
}

/// A person decides at the terminal about a refused touch: a wrong letter changes nothing, `w` measures
/// the first sample, `s` leaves the second one refused.
fn decide(bench: &Bench, folder: &Path) {
    let mut terminal = Terminal::start(bench, folder, 80);
    terminal.wait_for_text(FIRST);
    bench.person.place_sample("1").unwrap();
    terminal.press_enter();
    terminal.wait_for_text(TURN);
    bench.person.turn_sensor(Orientation::Left);
    // An umlaut of a terminal that does not send UTF-8 is an answer like any other line, and no end of the input.
    terminal.enter_bytes(b"\xfc");
    let question = "Touch main/1/left/0/1 was refused:";
    terminal.wait_for_text(question);
    terminal.enter("x");
    terminal.wait_for("the question again", |all| all.matches(question).count() == 2);
    terminal.enter("w");
    terminal.wait_for_text("\u{2713} main/1/left/0/1");
    terminal.wait_for_text(SECOND);
    bench.person.place_sample("2").unwrap();
    terminal.press_enter();
    terminal.wait_for_text("Touch main/2/left/0/1 was refused:");
    terminal.enter("S");
    terminal.wait_for_text("\u{2715} main/2/left/0/1");
    assert_eq!(terminal.end(), Some(6), "{}", terminal.text());
    let all = terminal.text();
    assert!(all.contains("1 of 2 touches measured"), "{all}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_refused_touch_is_decided_about_in_the_terminal() {
    let folder = TempDir::new().unwrap();
    let bench = Bench::start(folder.path(), &narrow()).await;
    tokio::task::spawn_blocking(move || decide(&bench, folder.path())).await.unwrap();
}

#[test]
fn a_terminal_that_is_closed_ends_the_daemon_in_it() {
    let folder = TempDir::new().unwrap();
    let rig = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/rigs/simulated.toml");
    let data = folder.path().join("data");
    let args = ["serve", "--listen", "127.0.0.1:0"].map(Path::new);
    let files = ["--rig".as_ref(), &*rig, "--data".as_ref(), &data];
    let mut terminal = Terminal::open(&[&args[..], &files].concat(), 80);
    terminal.wait_for_text("listening on");
    terminal.signal(Signal::HUP);
    terminal.wait_for_text("ending what is under way and closing");
    terminal.wait_for_text("rigd: the probe is clear");
    assert_eq!(terminal.end(), Some(0), "{}", terminal.text());
}
