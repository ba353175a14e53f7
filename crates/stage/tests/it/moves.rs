//! Moves of an axis with each make of drive, in health and under faults of the line.

use std::{
    collections::BTreeMap,
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
    time::Duration,
};

use rig_link::{Clock, Port, StopSignal};
use rig_model::{
    Axis, AxisLimits, DriveMake, LineSettings, Mm, Parity, Position, Scale, Span, StopBits, Target,
};
use rig_stage::{BusError, BusHandle, BusSettings, LineFault, Stage, StageError};
use tokio::{
    io::DuplexStream,
    time::{Instant, sleep},
};

use crate::{
    drive::{AZ, Drive, IAI, LEADSHINE, MAKES, Make},
    peer::{FAULTS, Fault, faulty, hex, serve, with_crc},
};

pub(crate) fn axis() -> Axis<Mm> {
    let limits = AxisLimits {
        travel: Span::new(-60.0, 60.0),
        soft: Span::new(-55.0, 55.0),
        rest: Position::new(0.0),
        tolerance: 0.005,
        max_speed_per_s: 30.0,
    };
    Axis::new("linear stage", limits).unwrap()
}

pub(crate) fn target(mm: f64) -> Target<Mm> {
    axis().target(Position::new(mm)).unwrap()
}

pub(crate) fn scale(make: &Make) -> Scale<Mm> {
    // A count of IAI is a hundredth of a millimetre; the others are a stepper of 6 mm lead.
    let per_count = if make.map.simulated_as == Some(DriveMake::IaiRc) { 0.01 } else { 0.0006 };
    Scale {
        per_count,
        zero: Position::new(0.0),
        counts_per_revolution: 10_000.0,
        acceleration_per_s2: 600.0,
    }
}

pub(crate) fn counts(make: &Make, mm: f64) -> i32 {
    (mm / scale(make).per_count).round() as i32
}

pub(crate) fn stage_on(
    make: &Make,
    drive: &Drive,
    faults: impl IntoIterator<Item = (usize, Fault)>,
) -> Stage<Mm> {
    stage_of(make, scale(make), drive, faults)
}

fn stage_of(
    make: &Make,
    scale: Scale<Mm>,
    drive: &Drive,
    faults: impl IntoIterator<Item = (usize, Fault)>,
) -> Stage<Mm> {
    let (host, device) = tokio::io::duplex(4096);
    let faults: BTreeMap<_, _> = faults.into_iter().collect();
    let drive = drive.clone();
    tokio::spawn(serve(device, faulty(faults, move |request| drive.reply(request))));
    stage_at(make, scale, host)
}

/// An axis at the other end of a line.
pub(crate) fn stage_at(make: &Make, scale: Scale<Mm>, host: DuplexStream) -> Stage<Mm> {
    let line = LineSettings { baud: 115_200, parity: Parity::Even, stop_bits: StopBits::One };
    let port = Port::new("line 1", host, Some(line), Clock::start());
    let bus = BusHandle::open(port, BusSettings::rtu());
    Stage::new(bus, make.map, 1, scale, axis())
}

/// A drive in good order, and the axis on it, identified.
pub(crate) async fn ready(make: &'static Make) -> (Drive, Stage<Mm>) {
    let drive = Drive::new(make, 1);
    let mut stage = stage_on(make, &drive, []);
    stage.identify().await.unwrap();
    (drive, stage)
}

/// Frames of moves, laid out apart from this code. They must not change.
#[tokio::test(start_paused = true)]
async fn a_move_is_the_frame_that_the_manual_asks_for() {
    let rows = [
        // A user's driver for the AZ gives the words for -50 mm at 46667 steps a second.
        (
            &AZ,
            (-50.0, 28.0002, 600.0),
            "01 10 00 58 00 10 20 00 00 00 00 00 00 00 01 FF FE BA 7B 00 00 B6 4B \
             00 0F 42 40 00 0F 42 40 00 00 03 E8 00 00 00 01 48 03",
        ),
        // 12.34 mm at 5 mm/s and 0.3 G, laid out by hand after IAI's manual.
        (
            &IAI,
            (12.34, 5.0, 2942.0),
            "01 10 99 00 00 09 12 00 00 04 D2 00 00 00 02 00 00 01 F4 00 1E 00 00 00 00 06 1B",
        ),
        // 200000 pulses at 300 rpm, ramps of 100 ms for 1000 rpm.
        (
            &LEADSHINE,
            (120.0, 30.0, 1000.0),
            "01 10 62 00 00 08 10 00 01 00 03 0D 40 01 2C 00 64 00 64 00 00 00 10 E7 9E",
        ),
    ];
    for (make, (mm, speed, acceleration), golden) in rows {
        let drive = Drive::new(make, 1);
        let (host, device) = tokio::io::duplex(4096);
        let answering = drive.clone();
        let answer = faulty(BTreeMap::new(), move |request: &[u8]| answering.reply(request));
        tokio::spawn(serve(device, answer));
        let bus =
            BusHandle::open(Port::new("line 1", host, None, Clock::start()), BusSettings::rtu());
        let limits = AxisLimits {
            travel: Span::new(-200.0, 200.0),
            soft: Span::new(-200.0, 200.0),
            rest: Position::new(0.0),
            tolerance: 0.005,
            max_speed_per_s: 30.0,
        };
        let axis = Axis::new("linear stage", limits).unwrap();
        let scale = Scale { acceleration_per_s2: acceleration, ..scale(make) };
        let mut stage = Stage::new(bus, make.map, 1, scale, axis);
        stage.identify().await.unwrap();
        let target = axis.target(Position::new(mm)).unwrap();
        stage.move_to(target, speed, &StopSignal::new()).await.unwrap();
        let sent = drive.seen().into_iter().rfind(|frame| frame[1] == 0x10).unwrap();
        assert_eq!(sent, hex(golden), "{}", make.map.name);
    }
}

#[tokio::test(start_paused = true)]
async fn a_move_ends_at_its_target_after_the_time_it_takes() {
    for make in MAKES {
        let (drive, mut stage) = ready(make).await;
        let started = Instant::now();
        let at = stage.move_to(target(-50.0), 30.0, &StopSignal::new()).await.unwrap();
        assert_eq!(drive.position(), counts(make, -50.0));
        assert!((at.value() + 50.0).abs() < 0.005);
        // 50 mm at 30 mm/s, two ramps, and hardly any waiting beyond.
        let seconds = started.elapsed().as_secs_f64();
        assert!((1.71..1.78).contains(&seconds), "{}: {seconds}", make.map.name);
    }
}

#[tokio::test(start_paused = true)]
async fn a_move_costs_one_write_and_a_look_a_second() {
    for make in MAKES {
        let (drive, mut stage) = ready(make).await;
        let reads = make.map.status.len();
        for (mm, seconds) in [(1.0, 1), (0.98, 1), (40.0, 7), (-40.0, 14), (-39.5, 1)] {
            let before = drive.seen().len();
            stage.move_to(target(mm), 6.0, &StopSignal::new()).await.unwrap();
            let requests = drive.seen().len() - before;
            let expected = 1 + (1 + seconds) * reads;
            assert!(requests <= expected, "{} to {mm}: {requests}", make.map.name);
        }
    }
}

#[tokio::test(start_paused = true)]
async fn an_alarm_on_the_way_is_seen_within_a_second() {
    for make in MAKES {
        let (drive, mut stage) = ready(make).await;
        let alarmed = drive.clone();
        tokio::spawn(async move {
            sleep(Duration::from_millis(1500)).await;
            alarmed.raise_alarm(0x20);
        });
        let started = Instant::now();
        let error = stage.move_to(target(50.0), 6.0, &StopSignal::new()).await.unwrap_err();
        assert!(matches!(error, StageError::Alarmed { .. }), "{error:?}");
        assert!(started.elapsed() < Duration::from_millis(2600), "{:?}", started.elapsed());
    }
}

#[tokio::test(start_paused = true)]
async fn the_settings_are_put_into_the_drive_once() {
    for make in MAKES {
        let (drive, mut stage) = ready(make).await;
        let writes = |drive: &Drive| drive.seen().iter().filter(|frame| frame[1] == 0x10).count();
        assert_eq!(writes(&drive), 1);
        stage.identify().await.unwrap();
        assert_eq!(writes(&drive), 1);
    }
    let (az, _) = ready(&AZ).await;
    let limits = [1, counts(&AZ, 55.0), counts(&AZ, -55.0)];
    assert_eq!([az.long(0x386), az.long(0x388), az.long(0x38A)], limits);
    let (leadshine, _) = ready(&LEADSHINE).await;
    assert_eq!([leadshine.long(0x6006), leadshine.long(0x6008)], limits[1..]);
}

/// The limits are in the drive, and the write that turns them on is lost.
#[tokio::test(start_paused = true)]
async fn settings_that_were_written_in_part_are_written_again() {
    let drive = Drive::new(&LEADSHINE, 1);
    let lost = (3..20).map(|frame| (frame, Fault::RequestLost));
    let mut stage = stage_on(&LEADSHINE, &drive, lost);
    assert!(stage.identify().await.is_err());
    let limit_max = counts(&LEADSHINE, 55.0);
    assert_eq!((drive.long(0x6006), drive.long(0x6000) >> 16), (limit_max, 0));
    let mut again = stage.identify().await;
    for _ in 0..20 {
        if again.is_ok() {
            break;
        }
        again = stage.identify().await;
    }
    again.unwrap();
    assert_eq!(drive.long(0x6000) >> 16, 2);

    // The program ended before the last write, and another one finds the limits there.
    let drive = Drive::new(&LEADSHINE, 1);
    let mut stage = stage_on(&LEADSHINE, &drive, (3..20).map(|frame| (frame, Fault::RequestLost)));
    assert!(stage.identify().await.is_err());
    assert_eq!((drive.long(0x6006), drive.long(0x6000) >> 16), (limit_max, 0));
    stage_on(&LEADSHINE, &drive, []).identify().await.unwrap();
    assert_eq!(drive.long(0x6000) >> 16, 2);
}

/// Its code may be that of its manual for none, or the register another one.
#[tokio::test(start_paused = true)]
async fn an_alarm_without_a_code_is_an_alarm() {
    let (drive, mut stage) = ready(&LEADSHINE).await;
    drive.raise_alarm(0);
    let error = stage.move_to(target(10.0), 6.0, &StopSignal::new()).await.unwrap_err();
    let StageError::Alarmed { alarm, .. } = &error else { panic!("{error:?}") };
    assert_eq!((alarm.code, alarm.name), (0, "see its manual"));
}

#[tokio::test(start_paused = true)]
async fn a_drive_that_does_not_move_as_told_is_found_out() {
    let stop = StopSignal::new();
    for make in MAKES {
        let (drive, mut stage) = ready(make).await;
        stage.move_to(target(2.0), 6.0, &stop).await.unwrap();
        drive.ignore_moves();
        let error = stage.move_to(target(10.0), 6.0, &stop).await.unwrap_err();
        assert!(matches!(error, StageError::Ignored { .. }), "{}: {error}", make.map.name);
        // It still says that it is homed.
        let error = stage.home(&stop).await.unwrap_err();
        assert!(matches!(error, StageError::HomingUnseen { .. }), "{}: {error}", make.map.name);
        // One that stands at its zero has nowhere to go.
        let (drive, mut stage) = ready(make).await;
        drive.ignore_moves();
        assert_eq!(stage.home(&stop).await.unwrap().value(), 0.0, "{}", make.map.name);

        let (drive, mut stage) = ready(make).await;
        drive.lose_counts(counts(make, 0.03));
        let error = stage.move_to(target(12.0), 6.0, &stop).await.unwrap_err();
        assert_eq!(error.to_string(), "is at 11.970 mm, 0.0300 mm from its target 12.000 mm");

        drive.lose_counts(0);
        drive.raise_alarm(0xE0);
        let error = stage.move_to(target(10.0), 6.0, &stop).await.unwrap_err();
        let StageError::Alarmed { alarm, at, .. } = error else { panic!("{error}") };
        assert_eq!((alarm.code, at.to_string()), (0xE0, "12.000 mm".to_owned()));
        assert_eq!(stage.reset_alarm().await.unwrap().alarm, None);
        stage.move_to(target(10.0), 6.0, &stop).await.unwrap();
    }
}

#[tokio::test(start_paused = true)]
async fn what_cannot_be_done_is_refused_before_it_is_sent() {
    let stop = StopSignal::new();
    let drive = Drive::new(&LEADSHINE, 1);
    let mut stage = stage_on(&LEADSHINE, &drive, []);
    let error = stage.move_to(target(10.0), 6.0, &stop).await.unwrap_err();
    assert_eq!(error.to_string(), "not identified yet");
    stage.identify().await.unwrap();
    let frames = drive.seen().len();
    let error = stage.move_to(target(10.0), 30.1, &stop).await.unwrap_err();
    assert_eq!(error.to_string(), "speed 30.1 mm/s is outside (0, 30]");
    // One revolution a minute is a tenth of a millimetre a second.
    let error = stage.move_to(target(10.0), 0.09, &stop).await.unwrap_err();
    assert_eq!(error.to_string(), "speed 0.09 mm/s is below the slowest of the drive, 0.1000");
    assert_eq!(drive.seen().len(), frames);
}

/// A Modbus device that stores written values and is not a drive.
async fn identify_storage(make: &'static Make, value: u16) -> (String, usize) {
    let (host, device) = tokio::io::duplex(4096);
    let writes = Arc::new(AtomicUsize::new(0));
    let counted = writes.clone();
    let mut kept = BTreeMap::new();
    let answer = move |request: &[u8]| {
        let word = |at: usize| u16::from_be_bytes([request[at], request[at + 1]]);
        if request[1] == 3 {
            let mut reply = vec![request[0], 3, 2 * request[5]];
            for address in word(2)..word(2) + word(4) {
                reply.extend(kept.get(&address).copied().unwrap_or(value).to_be_bytes());
            }
            return with_crc(&reply);
        }
        counted.fetch_add(1, Ordering::Relaxed);
        if request[1] == 0x10 {
            for (address, bytes) in (word(2)..).zip(request[7..].chunks_exact(2)) {
                kept.insert(address, u16::from_be_bytes([bytes[0], bytes[1]]));
            }
        } else {
            kept.insert(word(2), word(4));
        }
        with_crc(&request[..6])
    };
    tokio::spawn(serve(device, faulty(BTreeMap::new(), answer)));
    let bus = BusHandle::open(Port::new("line 1", host, None, Clock::start()), BusSettings::rtu());
    let mut stage = Stage::new(bus, make.map, 1, scale(make), axis());
    let outcome = stage.identify().await;
    let said = outcome.map_or_else(|error| error.to_string(), |status| format!("{status:?}"));
    (said, writes.load(Ordering::Relaxed))
}

/// Another resolution than that of the rig file makes every position wrong, and is refused before anything
/// is written.
#[tokio::test(start_paused = true)]
async fn a_drive_that_counts_otherwise_is_refused() {
    for make in [&AZ, &LEADSHINE] {
        for steps in [1000, 9999, 20_000] {
            let drive = Drive::new(make, 1);
            drive.set_steps_per_revolution(steps);
            let error = stage_on(make, &drive, []).identify().await.unwrap_err();
            let said = format!(
                "the drive is set to {steps} steps for a revolution of its motor; the rig file says \
                 10000 (steps_per_revolution)"
            );
            assert_eq!(error.to_string(), said);
            let is_write = |frame: &Vec<u8>| frame[1] > 4;
            assert!(!drive.seen().iter().any(is_write), "something was written");
        }
    }
}

#[tokio::test(start_paused = true)]
async fn a_device_that_is_no_drive_is_not_taken_for_one() {
    for make in MAKES {
        let (said, writes) = identify_storage(make, 0).await;
        assert!(said.starts_with("not recognised: "), "{said}");
        assert!(said.contains(" reads 0, outside ["), "{said}");
        assert_eq!(writes, 0, "{}: something was written to it", make.map.name);
    }
    let (said, _) = identify_storage(&AZ, 0).await;
    assert_eq!(
        said,
        "not recognised: electronic gear A or B reads 0, outside [1, 65535] of Oriental Motor AZ series"
    );
    // A value in every register.
    for value in [1, 7, 100] {
        for make in [&AZ, &LEADSHINE] {
            let (said, writes) = identify_storage(make, value).await;
            assert!(said.contains("not recognised") && writes == 0, "{value}: {said}");
        }
    }
}

#[tokio::test(start_paused = true)]
async fn nothing_moves_from_where_the_axis_cannot_be() {
    let stop = StopSignal::new();
    for make in MAKES {
        let (drive, mut stage) = ready(make).await;
        stage.move_to(target(12.0), 6.0, &stop).await.unwrap();
        // The rig file has the step ten times too long, and then with the wrong sign as well.
        for factor in [10.0, -10.0] {
            let wrong = Scale { per_count: factor * scale(make).per_count, ..scale(make) };
            let mut stage = stage_of(make, wrong, &drive, []);
            stage.identify().await.unwrap();
            let frames = drive.seen().len();
            let error = stage.move_to(target(0.0), 6.0, &stop).await.unwrap_err();
            assert_eq!(
                error.to_string(),
                format!(
                    "is at {:.3} mm, outside its travel [-60.000 mm, 60.000 mm]",
                    12.0 * factor
                )
            );
            assert_eq!(stage.trusted_position().unwrap_err().to_string(), error.to_string());
            assert_eq!(drive.seen().len(), frames, "{}", make.map.name);
        }
        drive.forget_home();
        stage.status().await.unwrap();
        let frames = drive.seen().len();
        let error = stage.move_to(target(0.0), 6.0, &stop).await.unwrap_err();
        assert_eq!(
            error.to_string(),
            "not homed: the position 12.000 mm that it reports means nothing"
        );
        assert_eq!(drive.seen().len(), frames, "{}", make.map.name);
        stage.home(&stop).await.unwrap();
        stage.move_to(target(5.0), 6.0, &stop).await.unwrap();
    }
}

#[tokio::test(start_paused = true)]
async fn homing_ends_when_the_drive_knows_where_it_is() {
    for make in MAKES {
        let drive = Drive::new(make, 1);
        drive.forget_home();
        let mut stage = stage_on(make, &drive, []);
        assert!(!stage.identify().await.unwrap().is_homed);
        let at = stage.home(&StopSignal::new()).await.unwrap();
        assert_eq!((at.value(), drive.position()), (0.0, 0));
        assert!(stage.status().await.unwrap().is_homed);
    }
}

#[tokio::test(start_paused = true)]
async fn a_drive_that_was_switched_off_is_not_trusted_before_it_is_identified_again() {
    let stop = StopSignal::new();
    for make in MAKES {
        let (drive, mut stage) = ready(make).await;
        drive.restart();
        drive.swallow_an_answer();
        let error = stage.move_to(target(3.0), 6.0, &stop).await.unwrap_err();
        if make.map.simulated_as == Some(DriveMake::IaiRc) {
            // Its settings come with each move, so that it is known only by its servo being off.
            assert!(matches!(error, StageError::Ignored { .. }), "{error:?}");
        } else {
            let StageError::Bus(BusError::Failed(fault)) = error else {
                panic!("{}: {error:?}", make.map.name)
            };
            assert!(matches!(fault, LineFault::Changed { .. }), "{fault:?}");
            let again = stage.status().await;
            assert!(again.is_err(), "{again:?}");
        }
        stage.identify().await.unwrap();
        stage.move_to(target(3.0), 6.0, &stop).await.unwrap();
        assert_eq!(drive.position(), counts(make, 3.0));
    }
}

/// It lost no frame by that, so that nothing on the line tells of it. A reading in between, as before a turn or for a look at the
/// devices, does not make where it is now the place where it was left.
#[tokio::test(start_paused = true)]
async fn a_drive_that_was_switched_off_while_nothing_was_asked_is_not_moved_from_where_it_was() {
    let stop = StopSignal::new();
    for make in MAKES {
        for (is_descent, is_read) in [(false, false), (true, false), (false, true), (true, true)] {
            for is_homed in [false, true] {
                let (drive, mut stage) = ready(make).await;
                stage.move_to(target(2.0), 6.0, &stop).await.unwrap();
                let before = drive.position();
                if is_homed {
                    // Its count begins elsewhere, and it does not say so.
                    drive.lose_counts(counts(make, 1.0));
                } else {
                    drive.forget_home();
                }
                tokio::time::sleep(Duration::from_millis(300)).await;
                if is_read {
                    stage.look_again().await.unwrap();
                    let error = stage.trusted_position().unwrap_err();
                    let is_moved = matches!(error, StageError::Moved { .. });
                    assert_eq!(is_moved, is_homed, "{}: {error:?}", make.map.name);
                }
                let error = if is_descent {
                    stage.descend_to(target(1.0), 1.0, &stop).await.unwrap_err()
                } else {
                    stage.move_to(target(3.0), 6.0, &stop).await.unwrap_err()
                };
                let is_expected = if is_homed {
                    matches!(error, StageError::Moved { .. })
                } else {
                    matches!(error, StageError::Unhomed { .. })
                };
                assert!(is_expected, "{}: {error:?}", make.map.name);
                assert_eq!(drive.position(), before, "{}", make.map.name);
            }
        }
    }
}

/// A stop and an identification take the place where it is now for that of its rest.
#[tokio::test(start_paused = true)]
async fn a_drive_that_was_elsewhere_than_it_came_to_rest_has_jumped_until_it_is_homed() {
    let stop = StopSignal::new();
    for make in MAKES {
        let (drive, mut stage) = ready(make).await;
        stage.move_to(target(2.0), 6.0, &stop).await.unwrap();
        stage.stop().await.unwrap();
        stage.identify().await.unwrap();
        assert!(!stage.has_jumped(), "{}", make.map.name);
        drive.lose_counts(counts(make, 1.0));
        stage.stop().await.unwrap();
        stage.identify().await.unwrap();
        assert!(stage.has_jumped() && stage.trusted_position().is_ok(), "{}", make.map.name);
        drive.lose_counts(0);
        stage.home(&stop).await.unwrap();
        assert!(!stage.has_jumped(), "{}", make.map.name);
    }
}

#[tokio::test(start_paused = true)]
async fn a_move_ends_when_the_drive_loses_its_position() {
    let stop = StopSignal::new();
    for make in MAKES {
        for is_descent in [false, true] {
            let (drive, mut stage) = ready(make).await;
            stage.move_to(target(6.0), 6.0, &stop).await.unwrap();
            let moves = async {
                if is_descent {
                    stage.descend_to(target(0.0), 1.0, &stop).await.map(|_| ())
                } else {
                    stage.move_to(target(0.0), 1.0, &stop).await.map(|_| ())
                }
            };
            let forgets = async {
                sleep(Duration::from_secs(2)).await;
                drive.forget_home();
            };
            let (ended, ()) = tokio::join!(moves, forgets);
            let context = (&make.map.name, is_descent);
            assert!(matches!(ended, Err(StageError::Unhomed { .. })), "{context:?}: {ended:?}");
            let at = drive.position();
            assert!(counts(make, 1.0) < at, "{context:?}: {at}");
            sleep(Duration::from_secs(1)).await;
            assert_eq!(drive.position(), at, "{context:?}");
        }
    }
}

/// Any fault in any frame: a move that reports success is at its target, and a possible move
/// succeeds.
#[tokio::test(start_paused = true)]
async fn no_single_fault_makes_a_move_lie() {
    for make in MAKES {
        for fault in FAULTS {
            for frame in 0..18 {
                let drive = Drive::new(make, 1);
                let mut stage = stage_on(make, &drive, [(frame, fault)]);
                let context = (&make.map.name, fault, frame);
                match two_moves(&mut stage).await {
                    Ok(at) => {
                        assert_eq!(counts(make, at.value()), counts(make, 2.9), "{context:?}");
                        assert_eq!(drive.position(), counts(make, 2.9), "{context:?}");
                    }
                    // That a device fails is for a person to judge; all else is overcome.
                    Err(error) => assert_eq!(fault, Fault::Exception(4), "{context:?}: {error:?}"),
                }
            }
        }
    }
}

/// Two faults may be too many for a move, but do not make it lie either.
#[tokio::test(start_paused = true)]
async fn no_pair_of_faults_makes_a_move_lie() {
    let (mut succeeded, mut failed) = (0, 0);
    for make in MAKES {
        for (n, first) in FAULTS.into_iter().enumerate() {
            for (m, second) in FAULTS.into_iter().enumerate() {
                // Not all of them: another place for each pair.
                let frame = (7 * n + 3 * m) % 14;
                let faults = [(frame, first), (frame + 1 + m % 4, second)];
                let drive = Drive::new(make, 1);
                let mut stage = stage_on(make, &drive, faults);
                if let Ok(at) = two_moves(&mut stage).await {
                    succeeded += 1;
                    let context = (&make.map.name, faults);
                    assert_eq!(counts(make, at.value()), counts(make, 2.9), "{context:?}");
                    assert_eq!(drive.position(), counts(make, 2.9), "{context:?}");
                } else {
                    failed += 1;
                }
            }
        }
    }
    assert!(failed < succeeded, "{failed} failed, {succeeded} succeeded");
}

async fn two_moves(stage: &mut Stage<Mm>) -> Result<Position<Mm>, StageError<Mm>> {
    stage.identify().await?;
    let stop = StopSignal::new();
    stage.move_to(target(3.0), 6.0, &stop).await?;
    stage.move_to(target(2.9), 6.0, &stop).await
}
