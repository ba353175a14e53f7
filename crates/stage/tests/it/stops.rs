//! Stops of an axis with each make of drive: when they leave, and what follows them.

use std::time::Duration;

use rig_link::StopSignal;
use rig_model::DriveMake;
use rig_stage::StageError;
use tokio::time::{Instant, sleep};

use crate::{
    drive::{Drive, MAKES},
    moves::{counts, ready, stage_on, target},
    peer::Fault,
};

/// How long the drive goes on moving.
async fn standstill(drive: &Drive) -> Duration {
    let started = Instant::now();
    while drive.is_moving() {
        sleep(Duration::from_millis(1)).await;
    }
    started.elapsed()
}

#[tokio::test(start_paused = true)]
async fn a_stop_ends_the_move_at_standstill_and_the_next_move_goes() {
    for make in MAKES {
        let (drive, mut stage) = ready(make).await;
        let stop = StopSignal::new();
        let raise = stop.clone();
        tokio::spawn(async move {
            sleep(Duration::from_millis(700)).await;
            raise.raise();
        });
        let error = stage.move_to(target(50.0), 20.0, &stop).await.unwrap_err();
        let StageError::Stopped { at, .. } = error else { panic!("{error}") };
        assert!(!drive.is_moving());
        assert_eq!(counts(make, at.value()), drive.position());
        assert!((10.0..18.0).contains(&at.value()), "{at}");
        // The stop is still requested, so nothing starts.
        let frames = drive.seen().len();
        let again = stage.move_to(target(50.0), 20.0, &stop).await;
        assert!(matches!(again, Err(StageError::Stopped { .. })), "{again:?}");
        assert_eq!(drive.seen().len(), frames);
        stop.lower();
        stage.move_to(target(50.0), 20.0, &stop).await.unwrap();
        assert_eq!(drive.position(), counts(make, 50.0));
    }
}

/// A drive that does not answer is stopped before any other attempt.
#[tokio::test(start_paused = true)]
async fn a_stop_does_not_wait_for_a_line_to_be_in_order() {
    for make in MAKES {
        let drive = Drive::new(make, 1);
        // Identified and sent off; from the look on, no answer comes back.
        let healthy = 2
            + make.map.settings.write.len()
            + make.map.prepare.len()
            + make.map.status.len()
            + make.map.start.len();
        let deaf = (healthy..healthy + 100).map(|frame| (frame, Fault::ReplyLost));
        let mut stage = stage_on(make, &drive, deaf);
        stage.identify().await.unwrap();
        let error = stage.move_to(target(50.0), 5.0, &StopSignal::new()).await.unwrap_err();
        assert!(matches!(error, StageError::Bus(_)), "{}: {error:?}", make.map.name);
        drive.run_away();
        assert!(drive.is_moving(), "{}", make.map.name);
        let (stopped, after) = tokio::join!(stage.stop(), standstill(&drive));
        assert!(stopped.is_err());
        assert!(after < Duration::from_millis(10), "{after:?}");
    }
}

/// Its answer is waited for, and then the stop is sent again before the line is put in order.
#[tokio::test(start_paused = true)]
async fn a_stop_that_is_lost_on_a_line_in_order_is_sent_again_at_once() {
    for make in MAKES {
        let drive = Drive::new(make, 1);
        let settings = make.map.settings.write.len();
        let identified = 3 + settings + make.map.prepare.len() + make.map.status.len();
        let mut stage = stage_on(make, &drive, [(identified, Fault::RequestLost)]);
        stage.identify().await.unwrap();
        assert_eq!(drive.seen().len(), identified, "{}", make.map.name);
        drive.run_away();
        let (stopped, after) = tokio::join!(stage.stop(), standstill(&drive));
        stopped.unwrap();
        assert!(after < Duration::from_millis(120), "{after:?}");
    }
}

/// The button of a homing is released, held and pressed; a stop in between keeps it from being pressed.
#[tokio::test(start_paused = true)]
async fn a_stop_between_the_requests_of_a_homing_lets_nothing_begin() {
    for make in MAKES {
        let stop = StopSignal::new();
        let (drive, mut stage) = ready(make).await;
        stage.move_to(target(2.0), 6.0, &stop).await.unwrap();
        let before = drive.position();
        let stops = async {
            sleep(Duration::from_millis(10)).await;
            stop.raise();
        };
        let (homed, ()) = tokio::join!(stage.home(&stop), stops);
        assert!(matches!(homed, Err(StageError::Stopped { .. })), "{}: {homed:?}", make.map.name);
        if make.map.simulated_as == Some(DriveMake::IaiRc) {
            assert_eq!(drive.position(), before);
        }
        stage.move_to(target(3.0), 6.0, &StopSignal::new()).await.unwrap();
    }
}
