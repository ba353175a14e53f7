//! Plays whole runs against an ideal bench, and again with every operation failing, every moment
//! aborted, every moment stopped. In every history, the sample turns only under a clear probe, the
//! probe is clear at the end or the rig is latched, and a run ends once.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

mod attempts;
mod descent;
mod drift;
mod drive;
mod hold_up;
mod level;
mod out_of_contact;
mod pauses;
mod refusals;
mod skips;
mod streams;
mod way_down;
mod world;

use rig_engine::{
    Command, Event, FailureKind, Input, LeftRig, Operation, Report, RigState, RunPhase, RunStatus,
    TouchOutcome,
};
use rig_model::{Clearance, Position, RigTime, SweepMethod, SweepRequest, Window};

use world::{FREE_HZ, LOADED_HZ, OF_ONE_OPERATION, REST_MM, Trouble, World, plan};

#[test]
fn an_undisturbed_run_finds_the_surface_and_the_shift_at_every_touch() {
    let mut world = World::new(None);
    world.play();
    assert_eq!(world.endings(), [RunStatus::Completed], "{:#?}", world.events);
    assert_eq!(world.engine.snapshot().clearance, Clearance::Clear);
    let mut touches = 0;
    for event in &world.events {
        if let Event::TouchFinished(result) = event {
            touches += 1;
            let TouchOutcome::Measured { contact, loaded, halfway: None, .. } = &result.outcome
            else {
                panic!("{result:?}")
            };
            let shift_hz = loaded.resonance_hz - result.no_load.resonance_hz;
            assert!((shift_hz - (LOADED_HZ - FREE_HZ)).abs() < 0.01, "{shift_hz}");
            assert!((contact.indentation_mm() - 0.5).abs() < 1e-9);
        }
    }
    assert_eq!(touches, 3);
}

/// The time constant of the sensor is 0.114 s: 3 of it before a self-test and before an early reading
/// after a contact, and 4 before the baseline.
#[test]
fn a_vibration_decays_before_each_reading_and_time_that_has_passed_is_not_waited_again() {
    let time_constant_s = 50.0 / (std::f64::consts::PI * FREE_HZ);
    let mut world = World::new(None);
    world.play();
    let (mut waited_s, mut tests) = (0.0, 0);
    for one in &world.listened {
        let needed = if one.is_clear && !one.is_test { 4.0 } else { 3.0 };
        assert!(needed * time_constant_s - 1e-3 < one.driven_s, "{one:?}");
        waited_s += one.asked_s;
        tests += usize::from(one.is_test);
    }
    // Of each touch, and of the clear probe after the last one.
    assert_eq!(tests, 4);
    // The shortest settling of each reading; the baselines of the touches and at the end; the self-tests; and
    // in each touch the beginning of the search, and the ways out of the sample in search and check. The
    // analyzer rounds its frequencies, which changes none of these.
    let readings = world.listened.len() as f64;
    let most_s =
        0.1 * readings + (3.0 * 4.0 + 5.0 + 4.0 * 3.0 + 3.0 * (5.0 + 3.0 + 3.0)) * time_constant_s;
    assert!(waited_s < most_s, "{waited_s} s of at most {most_s} s in {readings} readings");
}

/// Where a sample is easier to place.
#[test]
fn a_run_begins_with_the_probe_above_its_clear_position() {
    let mut world = World::new(None);
    world.command(Command::Prepare);
    while world.engine.snapshot().state != RigState::Idle {
        world.step();
    }
    world.command(Command::MoveLinear(Position::new(47.0)));
    while world.engine.snapshot().state != RigState::Idle {
        world.step();
    }
    world.command(Command::Run(Box::new(plan())));
    skips::finish(&mut world);
    assert_eq!(world.endings(), [RunStatus::Completed], "{:?}", world.engine.snapshot().fault);
}

/// Under the same declared depth, with the same surface and reference.
#[test]
fn a_touch_is_measured_halfway_and_then_at_its_depth() {
    let mut both = plan();
    both.touch.halfway_mm = Some(0.25);
    let mut world = World::new(None);
    world.play_plan(&both);
    assert_eq!(world.endings(), [RunStatus::Completed], "{:#?}", world.events);
    assert_eq!(world.engine.snapshot().clearance, Clearance::Clear);
    let mut touches = 0;
    for event in &world.events {
        if let Event::TouchFinished(result) = event {
            touches += 1;
            let TouchOutcome::Measured { contact, halfway: Some(halfway), .. } = &result.outcome
            else {
                panic!("{result:?}")
            };
            assert!((contact.indentation_mm() - 0.5).abs() < 1e-9, "{contact:?}");
            assert!((halfway.contact.indentation_mm() - 0.25).abs() < 1e-9, "{halfway:?}");
            assert_eq!(halfway.contact.surface, contact.surface);
            let shift_hz = halfway.loaded.resonance_hz - result.no_load.resonance_hz;
            assert!((shift_hz - (LOADED_HZ - FREE_HZ)).abs() < 0.01, "{shift_hz}");
        }
    }
    assert_eq!(touches, 3);
}

#[test]
fn a_refused_touch_is_finished_with_its_reason_and_the_run_says_so_at_its_end() {
    let mut narrow = plan();
    // The resonance in contact lies below it.
    narrow.contact_sweep = SweepRequest {
        window: Window { min_hz: 165.0, max_hz: 190.0 },
        method: SweepMethod::Uniform { points: 21 },
        ..narrow.contact_sweep
    };
    let mut world = World::new(None);
    world.play_plan(&narrow);
    assert_eq!(world.endings(), [RunStatus::CompletedWithRefusals], "{:#?}", world.events);
    assert_eq!(world.engine.snapshot().clearance, Clearance::Clear);
    let mut refused = 0;
    for event in &world.events {
        if let Event::TouchFinished(result) = event {
            refused += 1;
            let TouchOutcome::Refused { contact, .. } = result.outcome else {
                panic!("{result:?}")
            };
            assert!((contact.unwrap().indentation_mm() - 0.5).abs() < 1e-9);
        }
    }
    assert_eq!(refused, 3);
}

#[test]
fn whatever_goes_wrong_wherever_it_ends_clear_or_latched() {
    let mut undisturbed = World::new(None);
    undisturbed.play();
    let count = undisturbed.operations;
    assert!(count > 60, "a run of {count} operations shows little");
    let mut endings = [0_u32; 4];
    for at in 0..count {
        for trouble in OF_ONE_OPERATION {
            let mut world = World::new(Some((at, trouble)));
            world.play();
            let end = world.engine.snapshot();
            let context = format!("{trouble:?} at operation {at}: {end:?}");
            assert!(world.endings().len() <= 1, "{context}");
            for ending in world.endings() {
                endings[ending as usize] += 1;
            }
            if end.state == RigState::Idle {
                assert!((world.linear_mm - REST_MM).abs() < 0.011, "{context}");
                assert_eq!(end.clearance, Clearance::Clear, "{context}");
            } else {
                assert!(end.fault.is_some(), "{context}");
            }
            if trouble == Trouble::FlagsOnce {
                assert_eq!(world.endings(), [RunStatus::Completed], "{context}");
            }
            if trouble == Trouble::Flags {
                let refused = world.refused();
                let expected = if refused.is_empty() {
                    RunStatus::Completed
                } else {
                    RunStatus::CompletedWithRefusals
                };
                assert_eq!(world.endings(), [expected], "{context}");
                for reason in refused {
                    let (hz, what) = ("the analyzer flagged overload at ", "in 3 of 3 tries");
                    assert!(reason.starts_with(hz) && reason.ends_with(what), "{reason}");
                }
            }
            if trouble == Trouble::Stop {
                assert_eq!(end.state, RigState::Latched, "{context}");
                assert_eq!(end.clearance, Clearance::Clear, "{context}");
            }
        }
    }
    assert!(endings.iter().all(|&count| count >= 25), "one-sided endings: {endings:?}");
}

/// After the last touch the analyzer gives up on so many measurements, the first of which is the impedance of the clear probe.
#[test]
fn a_last_touch_is_confirmed_by_readings_and_not_by_flags() {
    for (flagged, ending, sweeps) in [
        (0, RunStatus::Completed, 0),
        (1, RunStatus::Completed, 1),
        (2, RunStatus::Completed, 2),
        (usize::MAX, RunStatus::Faulted, 2),
    ] {
        let mut world = World::new(None);
        world.play_until(|world| {
            let progress = world.engine.snapshot().progress;
            progress.is_some_and(|progress| progress.phase == RunPhase::Confirmation)
        });
        let (first, before) = (world.operations, world.events.len());
        while world.endings().is_empty() {
            if world.operations - first < flagged {
                world.trouble = Some((world.operations, Trouble::Flags));
            }
            world.step();
        }
        let after = &world.events[before..];
        let swept = after.iter().filter(|event| matches!(event, Event::SweepFinished(_))).count();
        let doubted = after.iter().any(|event| matches!(event, Event::TouchDoubted(_)));
        assert_eq!((world.endings(), swept), (vec![ending], sweeps), "{flagged}");
        assert_eq!(doubted, ending == RunStatus::Faulted, "{flagged}");
        assert_eq!(world.engine.snapshot().clearance, Clearance::Clear, "{flagged}");
    }
}

/// A person has changed something since, and the touch behind it is left out.
#[test]
fn flags_contradict_the_last_touch_before_a_change_as_well() {
    let last = world::plan().steps.last().unwrap().id.clone();
    let mut world = World::new(None);
    world.play_until(|world| {
        let touches = world.events.iter().filter(|event| matches!(event, Event::TouchFinished(_)));
        touches.count() == 2 && world.engine.snapshot().state == RigState::WaitingForPerson
    });
    world.command(Command::Skip(last));
    world.answer();
    while world.endings().is_empty() {
        world.trouble = Some((world.operations, Trouble::Flags));
        world.step();
    }
    assert_eq!(world.endings(), [RunStatus::Faulted]);
    let doubted = world.events.iter().filter(|event| matches!(event, Event::TouchDoubted(_)));
    assert_eq!(doubted.count(), 1);
}

#[test]
fn a_linear_stage_that_is_lost_on_the_way_out_is_not_moved_again() {
    for trouble in [Trouble::Fails, Trouble::Abort, Trouble::Stop] {
        let mut world = World::new(Some((30, trouble)));
        world.command(Command::Prepare);
        while world.engine.snapshot().state != RigState::Retracting {
            match world.engine.snapshot().state {
                RigState::Idle => world.command(Command::Run(Box::new(plan()))),
                RigState::WaitingForPerson => world.answer(),
                _ => world.step(),
            }
        }
        while !matches!(world.in_flight, Some((_, Operation::MoveLinear { .. }))) {
            world.step();
        }
        world.trouble = Some((world.operations, Trouble::Loses));
        while world.in_flight.is_some() {
            world.step();
        }
        let end = world.engine.snapshot();
        assert!(world.is_lost && end.clearance == Clearance::Unknown, "{trouble:?}: {end:?}");
        assert_eq!(end.state, RigState::Latched, "{trouble:?}");
    }
}

#[test]
fn a_latched_rig_takes_no_command_but_an_acknowledgement() {
    let mut world = World::new(None);
    world.command(Command::Stop);
    while world.in_flight.is_some() {
        world.step();
    }
    let denied = world.engine.admit(Command::Run(Box::new(plan()))).unwrap_err();
    assert_eq!(denied.to_string(), "cannot run while the rig is latched");
    assert!(world.engine.admit(Command::Sweep(plan().no_load_sweep)).is_err());
    world.command(Command::Acknowledge);
    while world.in_flight.is_some() {
        world.step();
    }
    assert_eq!(world.engine.snapshot().state, RigState::Idle);
}

#[test]
fn a_move_by_hand_obeys_what_a_run_obeys() {
    let mut world = World::new(None);
    world.command(Command::Prepare);
    while world.in_flight.is_some() {
        world.step();
    }
    let denial = |world: &World, command: Command| {
        world.engine.admit(command).expect_err("it must be denied").to_string()
    };
    let linear = |mm| Command::MoveLinear(Position::new(mm));
    let rotary = |degrees| Command::MoveRotary(Position::new(degrees));
    assert_eq!(
        denial(&world, linear(0.5)),
        "linear stage: target 0.500 mm is outside the soft limits [1.000 mm, 49.000 mm]"
    );
    // The surface is expected at 10 mm, may lie 0.5 mm lower, and is indented by 0.6 mm at most.
    assert_eq!(
        denial(&world, linear(8.89)),
        "linear stage: target 8.890 mm is below 8.900 mm, the deepest that a touch may go here"
    );
    assert!(denial(&world, rotary(51.0)).contains("outside the soft limits"));
    world.command(rotary(30.0));
    world.step();
    world.command(linear(20.0));
    world.step();
    assert_eq!(world.engine.snapshot().clearance, Clearance::InContact);
    assert_eq!(
        denial(&world, rotary(0.0)),
        "cannot move the rotary stage while the probe is lowered, and may be in contact"
    );
    assert_eq!(
        denial(&world, Command::Run(Box::new(plan()))),
        "cannot run while the probe is lowered, and may be in contact"
    );
    world.command(linear(REST_MM));
    world.step();
    assert_eq!(world.engine.snapshot().clearance, Clearance::Clear);
    world.command(rotary(0.0));
}

/// The sample stands somewhere between both ends of the turn, and the floor depends on where.
#[test]
fn a_move_down_by_hand_waits_until_the_tilt_after_an_aborted_turn_is_known() {
    for kind in [FailureKind::Interrupted, FailureKind::Line] {
        let mut world = World::new(None);
        world.command(Command::Prepare);
        while world.in_flight.is_some() {
            world.step();
        }
        let linear = |mm| Command::MoveLinear(Position::new(mm));
        world.command(Command::MoveRotary(Position::new(30.0)));
        world.command(Command::Abort);
        let (id, _) = world.in_flight.take().unwrap();
        world.rotary_deg = 17.0;
        world.fail(id, kind);
        while world.in_flight.is_some() {
            world.step();
        }
        if kind == FailureKind::Interrupted {
            assert_eq!(world.engine.snapshot().state, RigState::Idle);
            for mm in [9.4, 20.0, REST_MM - 0.5] {
                assert_eq!(
                    world.engine.admit(linear(mm)).expect_err("the tilt is not known").to_string(),
                    format!(
                        "linear stage: target {mm:.3} mm is below {REST_MM:.3} mm, and the tilt is not known: \
                         the last turn was not completed"
                    )
                );
            }
            world.command(linear(45.0));
            world.step();
            world.command(Command::MoveRotary(Position::new(0.0)));
            world.step();
        } else {
            // It is prepared again, and so read back.
            world.command(Command::Acknowledge);
            while world.in_flight.is_some() {
                world.step();
            }
        }
        world.command(linear(20.0));
        world.step();
        assert_eq!(world.engine.snapshot().linear, Some(Position::new(20.0)), "{kind:?}");
    }
}

/// The readings say that no time has passed, and the clock that a minute has.
#[test]
fn the_time_between_the_readings_of_a_sweep_counts_against_its_limit() {
    let mut world = World::new(None);
    world.command(Command::Prepare);
    while world.engine.snapshot().state != RigState::Idle {
        world.step();
    }
    let mut request = plan().no_load_sweep;
    (request.method, request.time_limit_s) = (SweepMethod::Adaptive, 60.0);
    world.command(Command::Sweep(request));
    for passed_s in [1, 1, 58] {
        assert_eq!(world.engine.snapshot().state, RigState::Running);
        let (id, operation) = world.in_flight.take().unwrap();
        let Report::Measured(mut readings) = world.perform(&operation) else { panic!() };
        for reading in &mut readings {
            reading.started = RigTime::ZERO;
        }
        world.now = world.now + std::time::Duration::from_secs(passed_s);
        world.handle(Input::Done(id, Ok(Report::Measured(readings))));
    }
    assert_eq!(world.engine.snapshot().state, RigState::Idle);
    let refusal = world.events.iter().find_map(|event| match event {
        Event::SweepFinished(sweep) => Some(format!("{:?}", sweep.outcome)),
        _ => None,
    });
    assert!(refusal.as_ref().is_some_and(|refusal| refusal.contains("Time {")), "{refusal:?}");
}

/// As after a stop in the middle of a sweep that began at the same frequency.
#[test]
fn the_time_for_which_the_analyzer_was_at_a_frequency_before_its_sweep_does_not_count() {
    let mut world = World::new(None);
    world.command(Command::Prepare);
    while world.engine.snapshot().state != RigState::Idle {
        world.step();
    }
    world.now = world.now + std::time::Duration::from_secs(50);
    let mut request = plan().no_load_sweep;
    (request.method, request.time_limit_s) = (SweepMethod::Adaptive, 30.0);
    world.command(Command::Sweep(request));
    let (id, operation) = world.in_flight.take().unwrap();
    let Report::Measured(mut readings) = world.perform(&operation) else { panic!() };
    for reading in &mut readings {
        (reading.started, reading.settle_s) = (RigTime::ZERO, world.now.as_seconds());
    }
    world.handle(Input::Done(id, Ok(Report::Measured(readings))));
    assert_eq!(world.engine.snapshot().state, RigState::Running, "{:?}", world.events.last());
}

#[test]
fn a_rig_that_was_left_by_a_crash_waits_for_a_person_and_then_retracts_first() {
    for may_touch in [true, false] {
        let mut world = World::new(None);
        let mut effects = Vec::new();
        let left = |message: &str, may_touch| LeftRig {
            message: message.to_owned(),
            may_touch,
            was_lowered: may_touch,
            jump: None,
        };
        world.engine.latch_interrupted(left("smoke-1 was interrupted", may_touch), &mut effects);
        let snapshot = world.engine.snapshot();
        let expected = if may_touch { Clearance::InContact } else { Clearance::Unknown };
        assert_eq!((snapshot.state, snapshot.clearance), (RigState::Latched, expected));
        assert_eq!(snapshot.fault.unwrap().to_string(), "smoke-1 was interrupted");
        let is_motion = |effect: &rig_engine::Effect| matches!(effect, rig_engine::Effect::Do(..));
        assert!(!effects.iter().any(is_motion), "{effects:?}");
        for command in [Command::Prepare, Command::Run(Box::new(plan()))] {
            world.engine.admit(command).unwrap_err();
        }
        world.engine.admit(Command::Acknowledge).unwrap();
        // Once the rig is in service, a late call changes nothing.
        let mut world = World::new(None);
        world.play();
        effects.clear();
        world.engine.latch_interrupted(left("late", true), &mut effects);
        assert_eq!((world.engine.snapshot().state, effects.len()), (RigState::Idle, 0));
    }
}

/// The touches whose shift stands at the end, with the shift.
fn shifts(world: &World) -> Vec<(String, f64)> {
    let mut shifts: Vec<(String, f64)> = Vec::new();
    for event in &world.events {
        let (Event::TouchFinished(result) | Event::TouchDoubted(result)) = event else {
            continue;
        };
        shifts.retain(|(step, _)| *step != result.step.0);
        if let TouchOutcome::Measured { loaded, .. } = &result.outcome {
            let shift_hz = loaded.resonance_hz - result.no_load.resonance_hz;
            shifts.push((result.step.0.clone(), shift_hz));
        }
    }
    shifts
}

/// Plays the run with a trouble at each operation; no shift may be wrong. Returns how often the run
/// noticed it.
fn notices(trouble: Trouble) -> u32 {
    let mut undisturbed = World::new(None);
    undisturbed.play();
    let mut noticed = 0;
    for at in 4..undisturbed.operations {
        let mut world = World::new(Some((at, trouble)));
        world.play();
        let shifts = shifts(&world);
        let are_true = shifts.iter().all(|(_, hz)| (hz - (LOADED_HZ - FREE_HZ)).abs() < 0.5);
        assert!(are_true, "{trouble:?} at operation {at}: {shifts:?}");
        noticed += u32::from(world.endings() != [RunStatus::Completed]);
    }
    noticed
}

#[test]
fn an_analyzer_that_repeats_its_last_reading_leaves_no_wrong_shift() {
    let noticed = notices(Trouble::Freezes);
    assert!(noticed > 50, "noticed {noticed} times");
}

#[test]
fn an_analyzer_that_keeps_its_frequency_is_noticed_before_the_approach() {
    let noticed = notices(Trouble::StaysAtFrequency);
    assert!(noticed > 50, "noticed {noticed} times");
    // From the self-test on. A sensor of weak coupling changes little from one frequency to the other.
    for (ratio, said) in
        [(0.05, "the impedance of the clear probe is"), (0.004, "changes otherwise")]
    {
        let mut world = World::new(None);
        world.ratio = ratio;
        world.play_until(|world| {
            matches!(&world.in_flight, Some((_, Operation::Measure { points, .. })) if points.len() == 2)
        });
        world.measured_hz = (FREE_HZ, true);
        while world.engine.snapshot().state != RigState::Latched {
            world.step();
        }
        let cause = world.engine.snapshot().fault.unwrap().to_string();
        assert!(cause.starts_with("contact sense: ") && cause.contains(said), "{ratio}: {cause}");
        let is_lowered = |event: &Event| matches!(event, Event::Intent { .. });
        assert!(!world.events.iter().any(is_lowered), "{ratio}: {:?}", world.events);
    }
}

#[test]
fn steps_lost_anywhere_leave_no_touch_at_a_wrong_depth() {
    let mut undisturbed = World::new(None);
    undisturbed.play();
    let mut told = 0;
    for slip_mm in [0.04, -0.04, 0.1, -0.1, 0.4, -0.4] {
        for at in 4..undisturbed.operations {
            let mut world = World::new(Some((at, Trouble::Slips(slip_mm))));
            world.play();
            for (step, _) in shifts(&world) {
                let depth_mm = world.depths_mm[&step];
                // What may go unnoticed, and half of a fine step.
                let is_right = (depth_mm - 0.5).abs() <= 0.025 + 0.0025 + 1e-9;
                assert!(is_right, "{slip_mm} mm at operation {at}: {step} at {depth_mm} mm");
            }
            let is_slip = |why: &String| why.starts_with("after the sweep the probe");
            told += world.refused().iter().filter(|why| is_slip(why)).count();
        }
    }
    assert!(told > 50, "told {told} times");
}

#[test]
fn a_free_resonance_that_drifts_during_a_touch_is_no_slip() {
    let mut world = World::new(None);
    // 0.3 Hz, a tenth of the linewidth, from the baseline to the check of the surface.
    world.drift_hz_per_s = 0.05;
    let mut plan = plan();
    plan.touch.dwell_s = 4.0;
    world.play_plan(&plan);
    assert_eq!(world.endings(), [RunStatus::Completed], "{:?}", world.refused());
    let read_anew = |event: &&Event| match event {
        Event::SurfaceChecked { trail } => trail.len() == 4,
        _ => false,
    };
    assert!(world.events.iter().any(|event| read_anew(&event)), "the drift was not seen");
}
