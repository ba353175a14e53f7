//! Stops of an axis with each make of drive: when they leave, and what follows them.

use std::{
    collections::BTreeMap,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use rig_link::{Clock, Port, StopSignal};
use rig_model::{DriveMake, LineSettings, Parity, StopBits};
use rig_stage::{BusHandle, BusSettings, Stage, StageError};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt, DuplexStream, duplex},
    time::{Instant, sleep},
};

use crate::{
    drive::{Drive, MAKES},
    moves::{axis, counts, ready, scale, stage_at, stage_on, target},
    peer::{Fault, faulty, serve},
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

/// The answer to the reading of the way is lost in the moment in which the probe touches.
#[tokio::test(start_paused = true)]
async fn the_stop_of_a_descent_does_not_wait_for_a_line_to_be_in_order() {
    for make in MAKES {
        // Where the frames of the way begin.
        let (drive, mut stage) = ready(make).await;
        stage.move_to(target(40.0), 20.0, &StopSignal::new()).await.unwrap();
        let before = drive.seen().len();
        let stop = StopSignal::new();
        let is_seen = |drive: Drive, frames: usize| async move {
            while drive.seen().len() < frames {
                sleep(Duration::from_millis(1)).await;
            }
        };
        let raises = async {
            is_seen(drive.clone(), before + 20).await;
            stop.raise();
        };
        let (sound, ()) = tokio::join!(stage.descend_to(target(10.0), 1.0, &stop), raises);
        assert!(sound.unwrap().1.len() > 2, "{}", make.map.name);

        for lost in 1..4 {
            let drive = Drive::new(make, 1);
            let frames = (before + 20..before + 20 + lost).map(|frame| (frame, Fault::ReplyLost));
            let mut stage = stage_on(make, &drive, frames);
            stage.identify().await.unwrap();
            stage.move_to(target(40.0), 20.0, &StopSignal::new()).await.unwrap();
            let stop = StopSignal::new();
            let stopped = async {
                is_seen(drive.clone(), before + 21).await;
                sleep(Duration::from_millis(20)).await;
                stop.raise();
                standstill(&drive).await
            };
            let (ended, after) = tokio::join!(stage.descend_to(target(10.0), 1.0, &stop), stopped);
            assert!(after < Duration::from_millis(150), "{}, {lost}: {after:?}", make.map.name);
            let (at, _) = ended.unwrap();
            assert_eq!(counts(make, at.value()), drive.position());
        }
    }
}

/// Passes the bytes between a host and a drive, and a byte of noise every millisecond to the host as long as it is told to.
async fn noisy(mut host: DuplexStream, mut drive: DuplexStream, is_noisy: Arc<AtomicBool>) {
    let (mut sent, mut said) = (Vec::new(), Vec::new());
    loop {
        tokio::select! {
            read = host.read_buf(&mut sent) => {
                if read.unwrap_or(0) == 0 {
                    return;
                }
                _ = drive.write_all(&std::mem::take(&mut sent)).await;
            }
            read = drive.read_buf(&mut said) => {
                if read.unwrap_or(0) == 0 {
                    return;
                }
                _ = host.write_all(&std::mem::take(&mut said)).await;
            }
            () = sleep(Duration::from_millis(1)) => {
                if is_noisy.load(Ordering::Relaxed) {
                    _ = host.write_all(&[0x55]).await;
                }
            }
        }
    }
}

/// Another master, or a terminator that has come off.
#[tokio::test(start_paused = true)]
async fn a_stop_does_not_wait_for_a_line_to_fall_silent() {
    for make in MAKES {
        let drive = Drive::new(make, 1);
        let [(host, inner), (outer, device)] = [duplex(4096), duplex(4096)];
        let answers = drive.clone();
        tokio::spawn(serve(device, faulty(BTreeMap::new(), move |request| answers.reply(request))));
        let is_noisy = Arc::new(AtomicBool::new(false));
        tokio::spawn(noisy(inner, outer, is_noisy.clone()));
        let mut stage = stage_at(make, scale(make), host);
        stage.identify().await.unwrap();
        drive.run_away();
        is_noisy.store(true, Ordering::Relaxed);
        sleep(Duration::from_millis(10)).await;
        let (stopped, after) = tokio::join!(stage.stop(), standstill(&drive));
        assert!(stopped.is_err());
        assert!(after < Duration::from_millis(50), "{}: {after:?}", make.map.name);
        is_noisy.store(false, Ordering::Relaxed);
        stage.stop().await.unwrap();
    }
}

/// A drive on a slow line: it hears nothing while a frame of it, or to it, is on the wire.
async fn slow(mut io: DuplexStream, line: LineSettings, drive: Drive) {
    let mut buffer = Vec::new();
    while io.read_buf(&mut buffer).await.unwrap_or(0) > 0 {
        let request = std::mem::take(&mut buffer);
        let reply = drive.reply(&request);
        let on_wire = line.duration_of(request.len() + reply.len());
        let until = Instant::now() + on_wire + Duration::from_millis(3);
        let mut over = Vec::new();
        let is_hit = tokio::select! {
            () = tokio::time::sleep_until(until) => false,
            _ = io.read_buf(&mut over) => true,
        };
        if is_hit {
            // Two frames at once: neither is understood.
            tokio::time::sleep_until(until).await;
        } else {
            _ = io.write_all(&reply).await;
        }
    }
}

/// Every moment of exchanges that take up to forty milliseconds on the wire.
#[tokio::test(start_paused = true)]
async fn a_stop_is_not_sent_into_a_frame_on_a_slow_line() {
    let line = LineSettings { baud: 9600, parity: Parity::Even, stop_bits: StopBits::One };
    for (make, moment) in MAKES.into_iter().flat_map(|make| (0..60).map(move |ms| (make, ms))) {
        let drive = Drive::new(make, 1);
        let (host, device) = duplex(4096);
        tokio::spawn(slow(device, line, drive.clone()));
        let port = Port::new("line 1", host, Some(line), Clock::start());
        let bus = BusHandle::open(port, BusSettings::rtu());
        let mut stage = Stage::new(bus.clone(), make.map, 1, scale(make), axis());
        stage.identify().await.unwrap();
        drive.run_away();
        let frames = stage.halt_frames().unwrap();
        let stopped = async {
            sleep(Duration::from_millis(moment)).await;
            tokio::join!(bus.halt(frames), standstill(&drive)).1
        };
        let (_, after) = tokio::join!(stage.status(), stopped);
        assert!(after < Duration::from_millis(100), "{} at {moment} ms: {after:?}", make.map.name);
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
