//! The drivers against the simulated drives, which share no line with them.

use std::time::Duration;

use rig_link::{Clock, Port, StopSignal};
use rig_model::{
    Axis, AxisLimits, Deg, DriveMake, LineSettings, Mm, Parity, Position, Scale, Span, StopBits,
    Unit,
};
use rig_sim::{
    AxisWiring, LineTransport, PortId, SimRig, Wiring,
    faults::{DeviceFault, Fault, FaultKind, FaultTrigger, RequestFault},
    scene::matched,
};
use rig_stage::{
    BusError, BusHandle, BusSettings, HaltFrames, LineFault, RegisterMap, Stage, StageError,
};
use tokio::time::sleep;

/// A simulated make and the map for it. A count of IAI is a hundredth of a millimetre.
const MAKES: [(DriveMake, f64); 3] =
    [(DriveMake::OrientalAz, 0.001), (DriveMake::IaiRc, 0.01), (DriveMake::LeadshinePr, 0.0005)];

fn axis<U: Unit>(name: &'static str, range: Span<U>, rest: f64, tolerance: f64) -> Axis<U> {
    let rest = Position::new(rest);
    let limits = AxisLimits { travel: range, soft: range, rest, tolerance, max_speed_per_s: 20.0 };
    Axis::new(name, limits).unwrap()
}

fn scale<U: Unit>(per_count: f64) -> Scale<U> {
    Scale {
        per_count,
        zero: Position::new(0.0),
        counts_per_revolution: 1000.0,
        acceleration_per_s2: 200.0,
    }
}

struct Bench {
    rig: SimRig,
    bus: BusHandle,
    linear: Stage<Mm>,
    rotary: Stage<Deg>,
}

/// Both axes on one line, identified and homed.
async fn bench(make: DriveMake, per_count: f64) -> Bench {
    let wiring = Wiring {
        linear: AxisWiring::new(make, 1, per_count),
        rotary: AxisWiring::new(make, 2, per_count),
        ..Wiring::paper(LineTransport::Serial { baud: 115_200 })
    };
    let mut rig = SimRig::start(matched(), &wiring, 1).unwrap();
    let line = LineSettings { baud: 115_200, parity: Parity::Even, stop_bits: StopBits::One };
    let port = Port::new("bus", rig.bus_port(), Some(line), Clock::start());
    let bus = BusHandle::open(port, BusSettings::rtu());
    let linear = axis("linear stage", Span::new(0.0, 49.0), 40.0, 0.02);
    let rotary = axis("rotary stage", Span::new(-50.0, 50.0), 0.0, 0.05);
    let mut linear = Stage::new(bus.clone(), RegisterMap::of(make), 1, scale(per_count), linear);
    let mut rotary = Stage::new(bus.clone(), RegisterMap::of(make), 2, scale(per_count), rotary);
    let stop = StopSignal::new();
    for _ in 0..2 {
        if !linear.identify().await.unwrap().is_homed {
            linear.home(&stop).await.unwrap();
        }
        if !rotary.identify().await.unwrap().is_homed {
            rotary.home(&stop).await.unwrap();
        }
    }
    Bench { rig, bus, linear, rotary }
}

/// Changes the drive of the linear stage.
fn apply_fault(rig: &SimRig, fault: DeviceFault) {
    rig.handle().with(|now, rig| rig.apply_fault(now, PortId::Bus, Some(1), fault));
}

async fn move_to<U: Unit>(stage: &mut Stage<U>, wanted: f64) -> Result<f64, StageError<U>> {
    let target = stage.axis().target(Position::new(wanted)).unwrap();
    stage.move_to(target, 10.0, &StopSignal::new()).await.map(Position::value)
}

#[tokio::test(start_paused = true)]
async fn both_axes_go_where_they_are_sent() {
    for (make, per_count) in MAKES {
        let Bench { rig, mut linear, mut rotary, .. } = bench(make, per_count).await;
        for (mm, degrees) in [(40.0, 30.0), (39.9, -45.0), (12.5, 0.0)] {
            let at_mm = move_to(&mut linear, mm).await.unwrap();
            let at_degrees = move_to(&mut rotary, degrees).await.unwrap();
            let truth = rig.truth();
            assert!((at_mm - mm).abs() <= 0.02 && (truth.tip_mm - mm).abs() < 0.03, "{truth:?}");
            assert!((at_degrees - degrees).abs() <= 0.05, "{make}: {at_degrees}");
            assert!((truth.tilt_deg - degrees).abs() < 0.08, "{make}: {truth:?}");
        }
    }
}

#[tokio::test(start_paused = true)]
async fn a_stop_holds_the_axis_where_it_says() {
    for (make, per_count) in MAKES {
        let Bench { rig, mut linear, .. } = bench(make, per_count).await;
        move_to(&mut linear, 40.0).await.unwrap();
        let stop = StopSignal::new();
        let raise = stop.clone();
        tokio::spawn(async move {
            sleep(Duration::from_secs(1)).await;
            raise.raise();
        });
        let target = linear.axis().target(Position::new(10.0)).unwrap();
        let error = linear.move_to(target, 10.0, &stop).await.unwrap_err();
        let StageError::Stopped { at, .. } = error else { panic!("{make}: {error:?}") };
        assert!((25.0..33.0).contains(&at.value()), "{make}: {at}");
        sleep(Duration::from_secs(5)).await;
        assert!((rig.truth().tip_mm - at.value()).abs() < 0.03, "{}: {:?}", make, rig.truth());
        move_to(&mut linear, 40.0).await.unwrap();
    }
}

#[tokio::test(start_paused = true)]
async fn what_befalls_a_drive_is_told() {
    for (make, per_count) in MAKES {
        // An alarm, at once and for the next move, until it is reset.
        let Bench { rig, mut linear, .. } = bench(make, per_count).await;
        move_to(&mut linear, 40.0).await.unwrap();
        apply_fault(&rig, DeviceFault::Alarm(0x20));
        let error = move_to(&mut linear, 30.0).await.unwrap_err();
        let StageError::Alarmed { alarm, .. } = error else { panic!("{make}: {error:?}") };
        assert_eq!(alarm.code, 0x20);
        linear.reset_alarm().await.unwrap();
        move_to(&mut linear, 30.0).await.unwrap();

        // A motor that does not move.
        apply_fault(&rig, DeviceFault::Jam);
        let error = move_to(&mut linear, 35.0).await.unwrap_err();
        let is_told = matches!(
            error,
            StageError::Ignored { .. }
                | StageError::NotThere { .. }
                | StageError::Alarmed { .. }
                | StageError::Overdue { .. }
        );
        assert!(is_told, "{make}: {error:?}");
        assert!((rig.truth().tip_mm - 30.0).abs() < 0.1);
    }
}

#[tokio::test(start_paused = true)]
async fn a_drive_that_restarts_has_to_be_identified_again() {
    for (make, per_count) in MAKES {
        let Bench { rig, mut linear, .. } = bench(make, per_count).await;
        move_to(&mut linear, 40.0).await.unwrap();
        apply_fault(&rig, DeviceFault::Reboot);
        // It is silent at first, so that it has to be recognised when it answers again.
        let error = move_to(&mut linear, 30.0).await.unwrap_err();
        let is_told = matches!(
            error,
            StageError::Bus(BusError::Failed(
                LineFault::Changed { .. } | LineFault::NoAnswer { .. },
            )) | StageError::Ignored { .. }
                | StageError::Alarmed { .. }
        );
        assert!(is_told, "{make}: {error:?}");
        sleep(Duration::from_secs(3)).await;
        // A look sees that it lost what it was given, and leaves it so.
        for _ in 0..2 {
            let is_told = match linear.look_again().await {
                Ok(look) => !look.has_settings,
                Err(StageError::Bus(BusError::Failed(LineFault::Changed { .. }))) => true,
                Err(_) => false,
            };
            assert!(is_told, "{make}");
        }
        let status = linear.identify().await.unwrap();
        let look = linear.look_again().await.unwrap();
        assert!(look.has_settings, "{make}");
        // The soft limits that it was given are read back; a controller of this make has none.
        let soft = linear.axis().soft();
        assert_eq!(look.soft.is_none(), make == DriveMake::IaiRc, "{make}");
        assert!(look.soft.is_none_or(|found| (found.min.value() - soft.min.value()).abs() < 0.011));
        assert!(look.soft.is_none_or(|found| (found.max.value() - soft.max.value()).abs() < 0.011));
        if status.alarm.is_some() {
            linear.reset_alarm().await.unwrap();
        }
        if !status.is_homed {
            linear.home(&StopSignal::new()).await.unwrap();
        }
        let at = move_to(&mut linear, 30.0).await.unwrap();
        assert!((at - 30.0).abs() <= 0.02, "{make}: {at}");
    }
}

/// Number of writes to a unit on the bus from the n-th message on.
fn writes(rig: &SimRig, unit: u8, from: usize) -> usize {
    let is_write = |heard: &&rig_sim::Overheard| {
        heard.bytes[0] == unit && matches!(heard.bytes[1], 5 | 6 | 16)
    };
    rig.handle().with(|_, rig| rig.overheard()[from..].iter().filter(is_write).count())
}

#[tokio::test(start_paused = true)]
async fn a_stop_reaches_both_drives_whatever_the_line_is_busy_with_and_no_write_follows_it() {
    let silent = |unit| Fault {
        port: PortId::Bus,
        unit: Some(unit),
        kind: FaultKind::Request(RequestFault::Drop),
        trigger: FaultTrigger::Rate(1.0),
    };
    let mut ended = 0;
    for (make, per_count) in MAKES {
        for is_silent in [[false, false], [false, true], [true, false], [true, true]] {
            for moment in 0..25 {
                let Bench { rig, bus, linear, mut rotary } = bench(make, per_count).await;
                let frames = [linear.halt_frames().unwrap(), rotary.halt_frames().unwrap()];
                for unit in [1, 2].into_iter().filter(|unit| is_silent[usize::from(unit - 1)]) {
                    rig.handle().with(|_, rig| rig.add_fault(silent(unit)));
                }
                rig.handle().with(|_, rig| rig.listen_in());
                let target = rotary.axis().target(Position::new(30.0)).unwrap();
                let stop = StopSignal::new();
                let moving = tokio::spawn({
                    let stop = stop.clone();
                    async move { rotary.move_to(target, 10.0, &stop).await }
                });
                sleep(Duration::from_micros(2_000 + 83_137 * moment)).await;
                let before = rig.handle().with(|_, rig| rig.overheard().len());
                let asked = tokio::time::Instant::now();
                bus.halt(HaltFrames::of(frames)).await;
                let took = asked.elapsed();
                let context = format!("{make} {is_silent:?} at {moment}: {took:?}");
                assert!(took < Duration::from_millis(100), "{context}");
                for unit in [1, 2] {
                    assert_eq!(writes(&rig, unit, before), 1, "{context}: unit {unit}");
                }
                let after = rig.handle().with(|_, rig| rig.overheard().len());
                sleep(Duration::from_secs(10)).await;
                // The move itself did not see the stop. Otherwise the write to a silent drive is
                // repeated.
                assert_eq!(writes(&rig, 2, after), 0, "{context}");
                let halted = StageError::Bus(BusError::Failed(LineFault::Closed));
                let end = moving.await.unwrap().err().unwrap_or(halted);
                ended += u32::from(matches!(
                    end,
                    StageError::Bus(BusError::Failed(LineFault::Halted { .. }))
                ));
            }
        }
    }
    // A silent drive is often asked where it is at that moment, and gets no write yet.
    assert!(ended > 0, "no write was under way in any case");
}

/// Where the drive says it: an IAI by a flag, an AZ by an alarm. A Leadshine only does not move.
#[tokio::test(start_paused = true)]
async fn an_emergency_stop_is_told_and_its_release_moves_nothing() {
    for (make, per_count) in MAKES {
        let mut bench = bench(make, per_count).await;
        move_to(&mut bench.linear, 20.0).await.unwrap();
        apply_fault(&bench.rig, DeviceFault::EmergencyStop);
        let error = move_to(&mut bench.linear, 30.0).await.unwrap_err();
        let is_told = matches!(error, StageError::EmergencyStopped { .. });
        assert_eq!(is_told, make != DriveMake::LeadshinePr, "{make}: {error}");
        let pressed = bench.linear.status().await.unwrap();
        assert_eq!(pressed.is_emergency_stopped, is_told, "{make}");

        let clear = |now, rig: &mut rig_sim::Rig| rig_sim::control::execute(now, rig, "clear");
        bench.rig.handle().with(clear).unwrap();
        sleep(Duration::from_secs(60)).await;
        let mut released = bench.linear.identify().await.unwrap();
        assert!((released.position.value() - 20.0).abs() < 0.02, "{make}: {released:?}");
        if released.alarm.is_some() {
            released = bench.linear.reset_alarm().await.unwrap();
        }
        assert!(!released.is_emergency_stopped, "{make}");
        move_to(&mut bench.linear, 30.0).await.unwrap();
    }
}
