use std::time::Duration;

use num_complex::Complex64;

use super::*;
use crate::scene::matched;

const FAST: Profile = Profile { speed: 50.0, acceleration: 1000.0, deceleration: 1000.0 };

fn at(seconds: f64) -> RigTime {
    RigTime::ZERO + Duration::from_secs_f64(seconds)
}

/// A bench without nuisances, with sample 3 in place.
fn quiet() -> World {
    let mut world = World::new(Scene { nuisances: Nuisances::NONE, ..matched() }, 1).unwrap();
    world.place_sample(RigTime::ZERO, "3").unwrap();
    world
}

/// The linear position at which the tip is `depth_mm` below the surface of a level sample.
fn below(world: &World, depth_mm: f64) -> f64 {
    world.scene().place.surface_mm - depth_mm
}

/// The resonance of a bench without other nuisances, with the tip this far below the level surface of sample 3.
fn resonance_hz(depth_mm: f64, debris_mm: f64, edge_mm: f64) -> f64 {
    let scene = matched();
    let nuisances = Nuisances { debris_mm, ..Nuisances::NONE };
    let place = TrueGeometry { edge_mm, ..scene.place };
    let mut world = World::new(Scene { place, nuisances, ..scene }, 1).unwrap();
    world.place_sample(RigTime::ZERO, "3").unwrap();
    let target = below(&world, depth_mm);
    world.drive(RigTime::ZERO, AxisId::Linear).start(RigTime::ZERO, target, &FAST);
    world.truth(at(5.0)).resonance_hz
}

/// A tissue relaxes from the end of the last way on, however it ended, and not from a command that moves nothing.
#[test]
fn a_tissue_relaxes_from_the_end_of_the_last_way() {
    let scene = crate::scene::paper();
    let mut world = World::new(Scene { nuisances: Nuisances::NONE, ..scene }, 1).unwrap();
    world.place_sample(RigTime::ZERO, "5").unwrap();
    let target = below(&world, 0.4);
    world.drive(RigTime::ZERO, AxisId::Linear).start(RigTime::ZERO, target, &FAST);
    let arrived_s = world.stage(AxisId::Linear).rests_from().as_seconds();
    let fresh_hz = world.truth(at(arrived_s)).resonance_hz;
    let crept_hz = world.truth(at(60.0)).resonance_hz;
    assert!(fresh_hz + 0.5 < crept_hz, "{fresh_hz} {crept_hz}");
    let idle: [fn(&mut Stage); 4] = [
        |stage| stage.start(at(60.0), stage.target(), &FAST),
        |stage| stage.stop(at(60.0), 100.0),
        |stage| stage.halt(at(60.0)),
        |stage| stage.set_jammed(at(60.0), true),
    ];
    for command in idle {
        command(world.drive(at(60.0), AxisId::Linear));
        let now_hz = world.truth(at(60.0)).resonance_hz;
        assert!((now_hz - crept_hz).abs() < 1e-6, "{now_hz} {crept_hz}");
    }
    // A way that a jam has ended leaves a tissue that has not relaxed yet.
    world.clear_faults(at(70.0));
    world.drive(at(70.0), AxisId::Linear).start(at(70.0), target - 0.05, &FAST);
    let halted = at(70.008);
    world.drive(halted, AxisId::Linear).set_jammed(halted, true);
    let fresh_hz = world.truth(halted).resonance_hz;
    let crept_hz = world.truth(at(130.0)).resonance_hz;
    assert!(fresh_hz + 0.5 < crept_hz, "{fresh_hz} {crept_hz}");
}

#[test]
fn debris_is_felt_above_the_sample_and_not_in_it() {
    let far = f64::INFINITY;
    let free_hz = resonance_hz(-1.0, 0.1, far);
    assert_eq!(resonance_hz(-0.11, 0.1, far), free_hz);
    assert!(resonance_hz(-0.05, 0.1, far) > free_hz + 1.0);
    assert_eq!(resonance_hz(-0.05, 0.0, far), free_hz);
    assert_eq!(resonance_hz(0.5, 0.1, far), resonance_hz(0.5, 0.0, far));
}

#[test]
fn a_contact_at_an_edge_is_softer_and_beside_it_there_is_none() {
    // The probe stands 0.32 mm beside the axis. In contact at 0.5 mm, the radius of the contact is 0.5 mm.
    let [far_hz, whole_hz, half_hz] =
        [f64::INFINITY, 0.9, 0.3201].map(|edge_mm| resonance_hz(0.5, 0.0, edge_mm));
    assert_eq!(whole_hz, far_hz);
    let free_hz = resonance_hz(0.5, 0.0, 0.3);
    assert_eq!(free_hz, resonance_hz(-1.0, 0.0, f64::INFINITY));
    let part = (half_hz - free_hz) / (far_hz - free_hz);
    assert!((0.4..0.7).contains(&part), "{part}");
}

#[test]
fn the_speed_into_a_sample_and_the_depth_at_which_a_motor_turns_round_are_seen() {
    let mut world = quiet();
    let target = below(&world, 0.1);
    world.drive(RigTime::ZERO, AxisId::Linear).start(RigTime::ZERO, target, &FAST);
    // The last tenth of a millimetre of a deceleration of 1000 mm/s².
    let found = world.fastest_hit_mm_per_s(at(5.0));
    assert!((13.0..15.0).contains(&found), "{found}");

    let mut world = quiet();
    let (target, above) = (below(&world, 5.0), below(&world, -0.1));
    world.drive(RigTime::ZERO, AxisId::Linear).start(RigTime::ZERO, target, &FAST);
    let mut now = RigTime::ZERO;
    while world.stage(AxisId::Linear).motor(now) > above {
        now = now + Duration::from_millis(1);
    }
    // It brakes for 1.25 mm, and goes up again before anybody looks.
    let up = below(&world, -5.0);
    world.drive(now, AxisId::Linear).start(now, up, &FAST);
    assert!(world.fastest_hit_mm_per_s(at(5.0)) > 40.0);
    let [Violation { kind: ViolationKind::PressedTooDeep { indentation_mm, .. }, .. }] =
        world.violations(at(5.0))
    else {
        panic!("{:?}", world.violations(at(5.0)))
    };
    assert!((1.05..1.25).contains(indentation_mm), "{indentation_mm}");
}

/// The depth of the probe, the action, and the expected violation.
type Row = (f64, fn(&mut World), fn(&ViolationKind) -> bool);

#[test]
fn what_must_never_happen_is_kept_once_for_each_contact() {
    use ViolationKind::{
        PressedTooDeep, RotatedInContact, SampleChangedInContact, SankTooDeep,
        SensorTurnedInContact,
    };
    let rows: [Row; 8] = [
        (
            0.5,
            |w| w.drive(at(5.0), AxisId::Rotary).start(at(5.0), 5.0, &FAST),
            |k| matches!(k, RotatedInContact { .. }),
        ),
        // The sample rises into the probe while it is tilted.
        (
            -0.05,
            |w| w.drive(at(5.0), AxisId::Rotary).start(at(5.0), -10.0, &FAST),
            |k| matches!(k, RotatedInContact { .. }),
        ),
        (0.5, |w| w.take_sample_away(at(5.0)), |k| matches!(k, SampleChangedInContact { .. })),
        (
            0.5,
            |w| w.place_sample(at(5.0), "1").unwrap(),
            |k| matches!(k, SampleChangedInContact { .. }),
        ),
        (
            0.5,
            |w| w.turn_sensor(at(5.0), Orientation::Left),
            |k| matches!(k, SensorTurnedInContact { .. }),
        ),
        (1.1, |_| {}, |k| matches!(k, PressedTooDeep { .. })),
        (
            0.5,
            |w| {
                w.drive(at(5.0), AxisId::Linear).lose_steps(-0.6);
                let clear = below(w, -1.0);
                w.drive(at(6.0), AxisId::Linear).start(at(6.0), clear, &FAST);
            },
            |k| matches!(k, SankTooDeep { .. }),
        ),
        // A probe that has sunk is sent lower.
        (
            0.5,
            |w| {
                w.drive(at(5.0), AxisId::Linear).lose_steps(-0.6);
                let lower = below(w, 0.55);
                w.drive(at(6.0), AxisId::Linear).start(at(6.0), lower, &FAST);
            },
            |k| matches!(k, PressedTooDeep { .. }),
        ),
    ];
    for (depth_mm, act, is_expected) in rows {
        let mut world = quiet();
        let place = below(&world, depth_mm);
        world.drive(at(0.0), AxisId::Linear).start(at(0.0), place, &FAST);
        act(&mut world);
        let kinds: Vec<_> = world.violations(at(10.0)).iter().map(|one| one.kind).collect();
        assert!(kinds.len() == 1 && is_expected(&kinds[0]), "{depth_mm}: {kinds:?}");
        // Asking again does not add any.
        assert_eq!(world.violations(at(20.0)).len(), 1);
    }
}

#[test]
fn a_touch_as_it_should_be_violates_nothing_and_a_second_crash_counts_again() {
    let mut world = quiet();
    for round in 0..2 {
        let start = 20.0 * f64::from(round);
        for (second, depth_mm) in [(0.0, 0.5), (5.0, -20.0)] {
            let now = at(start + second);
            let place = below(&world, depth_mm);
            world.drive(now, AxisId::Linear).start(now, place, &FAST);
        }
        let now = at(start + 10.0);
        world.drive(now, AxisId::Rotary).start(now, 15.0, &FAST);
    }
    assert_eq!(world.violations(at(50.0)), []);
    let mut world = quiet();
    for (second, depth_mm) in [(0.0, 1.1), (5.0, -20.0), (10.0, 1.1)] {
        let place = below(&world, depth_mm);
        world.drive(at(second), AxisId::Linear).start(at(second), place, &FAST);
    }
    assert_eq!(world.violations(at(50.0)).len(), 2);
}

#[test]
fn the_sensor_rings_after_a_move_and_settles_to_the_circuit_of_the_contact() {
    let mut world = quiet();
    world.set_frequency(at(0.0), 150.0);
    let place = below(&world, 0.3);
    world.drive(at(5.0), AxisId::Linear).start(at(5.0), place, &FAST);
    let arrival = world.stage(AxisId::Linear).rests_from();
    let early = world.measure(arrival, 1).0;
    let late = world.measure(at(20.0), 1).0;
    let truth = world.truth(at(20.0));
    let expected = world.circuit(at(20.0)).impedance_ohm(150.0);
    assert!((late - expected).norm() < 1e-9 * expected.norm(), "{late} {expected}");
    assert!((early - expected).norm() > 0.02 * expected.norm(), "{early} {expected}");
    assert!((truth.indentation_mm - 0.3).abs() < 1e-9 && truth.resonance_hz > 150.0, "{truth:?}");
}

/// A retract of half a second leaves the sample at its beginning: when it ends, the free sensor has settled.
#[test]
fn the_sensor_rings_from_the_moment_at_which_the_probe_leaves_the_sample() {
    const SLOW: Profile = Profile { speed: 20.0, acceleration: 200.0, deceleration: 200.0 };
    let mut world = quiet();
    let depth = below(&world, 0.5);
    world.drive(at(1.0), AxisId::Linear).start(at(1.0), depth, &FAST);
    world.set_frequency(at(2.0), 140.4);
    world.drive(at(4.0), AxisId::Linear).start(at(4.0), depth + 30.0, &SLOW);
    let (reading, _) = world.measure(at(5.6), 2);
    let (settled, _) = world.measure(at(20.0), 2);
    let change = (reading - settled).norm() / settled.norm();
    assert!(change < 1e-3, "{change} ten time constants after the contact");
}

#[test]
fn noise_has_the_size_that_the_scene_says_for_every_integration() {
    let nuisances = Nuisances { impedance_rel: 0.005, ..Nuisances::NONE };
    let mut world = World::new(Scene { nuisances, ..matched() }, 1).unwrap();
    world.set_frequency(at(0.0), 140.0);
    let mut now = at(10.0);
    let exact = quiet_free_impedance();
    for cycles in [1, 10, 160] {
        let (mut re, mut im, n) = (0.0, 0.0, 2000);
        for _ in 0..n {
            let (measured, done) = world.measure(now, cycles);
            let error = measured / exact - 1.0;
            (re, im) = (re + error.re * error.re, im + error.im * error.im);
            now = done;
        }
        let expected = 0.005 * (10.0 / f64::from(cycles)).sqrt();
        for square in [re, im] {
            let sigma = (square / f64::from(n)).sqrt();
            assert!((sigma / expected - 1.0).abs() < 0.08, "{cycles}: {sigma} {expected}");
        }
    }
}

fn quiet_free_impedance() -> Complex64 {
    let mut world = quiet();
    world.set_frequency(at(0.0), 140.0);
    world.measure(at(10.0), 1).0
}

#[test]
fn the_same_seed_gives_the_same_world_and_looking_at_it_changes_nothing() {
    let play = |seed: u64, looks: bool| {
        let mut world = World::new(matched(), seed).unwrap();
        let mut told = Vec::new();
        for (round, name) in ["1", "2", "3", "4", "5"].repeat(4).into_iter().enumerate() {
            let start = 100.0 * round as f64;
            world.place_sample(at(start), name).unwrap();
            let place = below(&world, 0.4);
            world.drive(at(start), AxisId::Linear).start(at(start), place, &FAST);
            for look in 0..if looks { 50 } else { 0 } {
                _ = world.truth(at(start + 0.1 * f64::from(look)));
            }
            world.set_frequency(at(start + 5.0), 160.0);
            told.push(world.measure(at(start + 6.0), 10).0);
            world.drive(at(start + 10.0), AxisId::Linear).start(at(start + 10.0), 40.0, &FAST);
        }
        assert_eq!(world.violations(at(5000.0)), []);
        told
    };
    assert_eq!(play(1, false), play(1, true));
    assert_ne!(play(1, false), play(2, false));
}

#[test]
fn no_two_mountings_are_alike_and_none_is_far_off() {
    let mut world = World::new(matched(), 1).unwrap();
    let (mut heights, sigma_mm) = (Vec::new(), world.scene().nuisances.mounting_mm);
    for _ in 0..300 {
        world.place_sample(at(0.0), "3").unwrap();
        heights.push(world.mounted.unwrap().raised_mm);
    }
    let spread = (heights.iter().map(|mm| mm * mm).sum::<f64>() / 300.0).sqrt();
    assert!((0.8..1.2).contains(&(spread / sigma_mm)), "{spread}");
    assert!(heights.iter().all(|mm| mm.abs() <= 2.5 * sigma_mm));
    heights.dedup();
    assert_eq!(heights.len(), 300);
}

#[test]
fn a_scene_that_cannot_be_is_refused() {
    let mut scene = matched();
    scene.linear.start = 51.0;
    let refused = World::new(scene, 1).unwrap_err().to_string();
    assert_eq!(refused, "linear stage: start 51 is outside its travel [0, 50]");
    let mut scene = matched();
    scene.samples[1].stiffness_mpa = -1.0;
    assert!(matches!(World::new(scene, 1), Err(SceneError::Sample { name, .. }) if name == "2"));
}
