//! Moves of an AZ axis, in health and under every fault of the line.

use std::{collections::BTreeMap, time::Duration};

use rig_link::{Clock, LineSettings, Port, StopSignal};
use rig_model::{Axis, AxisLimits, Mm, Position, Span};
use rig_stage::{BusHandle, BusSettings, Scale, Stage, StageError, maps};
use tokio::time::{Instant, sleep};

use crate::{
    az::Az,
    peer::{FAULTS, Fault, faulty, hex, serve},
};

const PER_COUNT_MM: f64 = 0.0006;

fn axis() -> Axis<Mm> {
    let limits = AxisLimits {
        travel: Span::new(-60.0, 60.0),
        soft: Span::new(-55.0, 55.0),
        rest: Position::new(0.0),
        tolerance: 0.002,
        max_speed_per_s: 30.0,
    };
    Axis::new("linear stage", limits).unwrap()
}

fn scale() -> Scale<Mm> {
    Scale {
        per_count: PER_COUNT_MM,
        zero: Position::new(0.0),
        counts_per_revolution: 10_000.0,
        acceleration_per_s2: 600.0,
    }
}

fn stage_on(az: &Az, faults: impl IntoIterator<Item = (usize, Fault)>) -> Stage<Mm> {
    let (host, device) = tokio::io::duplex(4096);
    let faults: BTreeMap<_, _> = faults.into_iter().collect();
    let drive = az.clone();
    tokio::spawn(serve(device, faulty(faults, move |request| drive.reply(request))));
    let line = LineSettings::eight_e_one(115_200);
    let port = Port::new("line 1", host, Some(line), Clock::start());
    let bus = BusHandle::open(port, BusSettings::rtu());
    Stage::new(bus, &maps::ORIENTAL_AZ, 1, scale(), axis())
}

fn counts(mm: f64) -> i32 {
    (mm / PER_COUNT_MM).round() as i32
}

#[tokio::test(start_paused = true)]
async fn a_move_is_the_frame_that_the_manual_gives_and_ends_at_its_target() {
    let az = Az::new(1);
    let mut stage = stage_on(&az, []);
    assert!(stage.identify().await.unwrap().is_homed);
    let target = axis().target(Position::new(-50.0)).unwrap();
    let started = Instant::now();
    let at = stage.move_to(target, 28.0, &StopSignal::new()).await.unwrap();
    let golden = "01 10 00 58 00 10 20 00 00 00 00 00 00 00 01 FF FE BA 7B 00 00 B6 4B \
                  00 0F 42 40 00 0F 42 40 00 00 03 E8 00 00 00 01 48 03";
    assert!(az.seen().contains(&hex(golden)));
    assert_eq!(az.position(), counts(-50.0));
    assert!((at.value() + 50.0).abs() < PER_COUNT_MM);
    // 50 mm at 28 mm/s, two ramps, and hardly any waiting beyond.
    let seconds = started.elapsed().as_secs_f64();
    assert!((1.83..1.90).contains(&seconds), "{seconds}");
}

#[tokio::test(start_paused = true)]
async fn a_move_costs_one_write_and_one_look() {
    let az = Az::new(1);
    let mut stage = stage_on(&az, []);
    stage.identify().await.unwrap();
    for (n, mm) in [1.0, 0.99, 40.0, -40.0, -39.5].into_iter().enumerate() {
        let before = az.seen().len();
        let target = axis().target(Position::new(mm)).unwrap();
        stage.move_to(target, 5.0, &StopSignal::new()).await.unwrap();
        assert!(az.seen().len() - before <= 5, "move {n}: {} requests", az.seen().len() - before);
    }
}

#[tokio::test(start_paused = true)]
async fn the_soft_limits_of_the_axis_are_put_into_the_drive_once() {
    let az = Az::new(1);
    let mut stage = stage_on(&az, []);
    stage.identify().await.unwrap();
    let long = |at| (i32::from(az.register(at)) << 16) | i32::from(az.register(at + 1));
    assert_eq!([long(0x386), long(0x388), long(0x38A)], [1, counts(55.0), counts(-55.0)]);
    let writes = |az: &Az| az.seen().iter().filter(|frame| frame[1] == 0x10).count();
    assert_eq!(writes(&az), 1);
    stage.identify().await.unwrap();
    assert_eq!(writes(&az), 1);
}

#[tokio::test(start_paused = true)]
async fn a_stop_ends_the_move_at_standstill_and_the_next_move_goes() {
    let az = Az::new(1);
    let mut stage = stage_on(&az, []);
    stage.identify().await.unwrap();
    let stop = StopSignal::new();
    let raise = stop.clone();
    tokio::spawn(async move {
        sleep(Duration::from_millis(700)).await;
        raise.raise();
    });
    let target = axis().target(Position::new(50.0)).unwrap();
    let error = stage.move_to(target, 20.0, &stop).await.unwrap_err();
    let StageError::Stopped { at, .. } = error else { panic!("{error}") };
    assert!(!az.is_moving());
    assert_eq!(counts(at.value()), az.position());
    assert!((10.0..18.0).contains(&at.value()), "{at}");
    // The wish still stands, so nothing starts.
    let frames = az.seen().len();
    assert!(matches!(stage.move_to(target, 20.0, &stop).await, Err(StageError::Stopped { .. })));
    assert_eq!(az.seen().len(), frames);
    stop.lower();
    stage.move_to(target, 20.0, &stop).await.unwrap();
    assert_eq!(az.position(), counts(50.0));
}

#[tokio::test(start_paused = true)]
async fn a_drive_that_does_not_move_as_told_is_found_out() {
    let target = axis().target(Position::new(10.0)).unwrap();
    let stop = StopSignal::new();

    let az = Az::new(1);
    let mut stage = stage_on(&az, []);
    assert!(matches!(
        stage.move_to(target, 5.0, &stop).await,
        Err(StageError::NotIdentified { .. })
    ));
    stage.identify().await.unwrap();
    az.ignore_moves();
    let error = stage.move_to(target, 5.0, &stop).await.unwrap_err();
    assert!(matches!(error, StageError::Ignored { .. }), "{error}");

    let az = Az::new(1);
    let mut stage = stage_on(&az, []);
    stage.identify().await.unwrap();
    az.lose_steps(5);
    let error = stage.move_to(target, 5.0, &stop).await.unwrap_err();
    assert_eq!(
        error.to_string(),
        "linear stage: stands at 9.997 mm, 0.0028 mm from its target 10.000 mm"
    );

    az.lose_steps(0);
    az.raise_alarm(0x66);
    let error = stage.move_to(target, 5.0, &stop).await.unwrap_err();
    assert_eq!(error.to_string(), "linear stage: alarm 0x66 (hardware overtravel), at 10.000 mm");
    assert_eq!(stage.reset_alarm().await.unwrap().alarm, None);
    stage.move_to(axis().rest_target(), 5.0, &stop).await.unwrap();

    let error = stage.move_to(target, 30.1, &stop).await.unwrap_err();
    assert_eq!(error.to_string(), "linear stage: speed 30.1 mm/s is outside (0, 30]");
}

#[tokio::test(start_paused = true)]
async fn homing_ends_when_the_drive_knows_where_it_is() {
    let az = Az::new(1);
    az.forget_home();
    let mut stage = stage_on(&az, []);
    assert!(!stage.identify().await.unwrap().is_homed);
    let at = stage.home(&StopSignal::new()).await.unwrap();
    assert_eq!((at.value(), az.position()), (0.0, 0));
    assert!(stage.status().await.unwrap().is_homed);
}

/// Whatever happens to whatever frame: a move that reports success is true, and one that is
/// possible at all succeeds.
#[tokio::test(start_paused = true)]
async fn no_single_fault_makes_a_move_lie() {
    let mut succeeded = 0;
    for fault in FAULTS {
        for frame in 0..10 {
            let az = Az::new(1);
            let mut stage = stage_on(&az, [(frame, fault)]);
            let outcome = async {
                stage.identify().await?;
                let stop = StopSignal::new();
                let mut at = Position::new(0.0);
                for mm in [3.0, 2.9] {
                    let target = axis().target(Position::new(mm)).unwrap();
                    at = stage.move_to(target, 5.0, &stop).await?;
                }
                Ok::<_, StageError<Mm>>(at)
            };
            match outcome.await {
                Ok(at) => {
                    succeeded += 1;
                    assert_eq!(counts(at.value()), counts(2.9), "{fault:?} at frame {frame}");
                    assert_eq!(az.position(), counts(2.9), "{fault:?} at frame {frame}");
                }
                // That the device failed is for a person to judge; all else is overcome.
                Err(error) => assert_eq!(fault, Fault::Exception(4), "frame {frame}: {error:?}"),
            }
        }
    }
    assert_eq!(succeeded, (FAULTS.len() - 1) * 10);
}
