//! Silent rig loops.

use std::sync::mpsc;

use rig_engine::{Command, RigState};
use rig_model::Clearance;
use tempfile::TempDir;

use super::*;
use crate::rig::{self, Request, RequestRefusal, way_out};

#[track_caller]
fn check(is_virtual_time: bool, doing: Doing, is_silent: bool) {
    let pulse = Pulse::default();
    let mut look = Look::default();
    let mut again = || look.again(&pulse, is_virtual_time);
    pulse.beat(doing);
    for _ in 0..SILENT_AFTER {
        assert_eq!(again(), None);
    }
    assert_eq!(
        again().map(|silence| (silence.doing, silence.is_given_up)),
        is_silent.then_some((doing, false))
    );
    for _ in SILENT_AFTER..GIVEN_UP_AFTER {
        again();
    }
    assert_eq!(again().is_some_and(|silence| silence.is_given_up), is_silent);
    pulse.beat(doing);
    assert_eq!(again(), None);
}

#[test]
fn a_loop_without_a_sign_of_life_is_silent_and_then_given_up() {
    check(false, Doing::Recording, true);
    check(false, Doing::Deciding, true);
    // In real time it wakes ten times a second.
    check(false, Doing::Waiting, true);
    check(true, Doing::Recording, true);
    check(true, Doing::Waiting, false);
}

#[test]
fn a_stop_gives_up_a_silent_loop_at_once_and_no_other() {
    let pulse = Pulse::default();
    let mut look = Look::default();
    pulse.give_up();
    for _ in 0..SILENT_AFTER {
        assert_eq!(look.again(&pulse, false), None);
    }
    assert!(look.again(&pulse, false).is_some_and(|silence| silence.is_given_up));
    // The stop was carried out: the next silence has its own patience.
    pulse.beat(Doing::Recording);
    for _ in 0..=SILENT_AFTER {
        assert!(look.again(&pulse, false).is_none_or(|silence| !silence.is_given_up));
    }
}

#[test]
fn the_message_has_the_time_and_the_activity() {
    let since = SystemTime::UNIX_EPOCH + Duration::from_secs(86_400 * 3 + 3600 * 14 + 62);
    let silence = Silence { since, doing: Doing::Recording, is_given_up: false };
    let said = "the rig loop has not answered since 14:01:02 UTC, when it used the data directory";
    assert_eq!(silence.to_string(), said);
}

/// What a loop that stands still means for those who ask it, until it goes on.
#[tokio::test]
async fn a_blocked_loop_is_published_refuses_requests_and_is_given_up_by_a_stop() {
    let data = TempDir::new().unwrap();
    let (handle, thread) = rig::open(way_out::tests::load(), data.path().to_owned()).unwrap();
    let mut status = handle.status();
    status.wait_for(|status| status.snapshot.state == RigState::Idle).await.unwrap();
    let (release, released) = mpsc::channel();
    handle.requests.send(Request::Block(released)).await.unwrap();
    let silence = |status: &Status| status.silence;
    let seen = silence(&status.wait_for(|status| status.silence.is_some()).await.unwrap());
    assert_eq!(seen.map(|silence| silence.doing), Some(Doing::Deciding));
    let refused = handle.command(Command::Prepare, None, "Ada").await.unwrap_err();
    assert!(matches!(refused, RequestRefusal::Silent(_)), "{refused}");
    assert!(!silence(&status.borrow()).unwrap().is_given_up);
    let refused = handle.command(Command::Stop, None, "Ada").await.unwrap_err();
    assert!(refused.to_string().contains("when it decided about"), "{refused}");
    let given_up = |status: &Status| status.silence.is_some_and(|silence| silence.is_given_up);
    status.wait_for(given_up).await.unwrap();
    drop(release);
    status.wait_for(|status| status.silence.is_none()).await.unwrap();
    handle.close().await;
    assert_eq!(status.borrow().snapshot.clearance, Clearance::Clear);
    thread.join();
}
