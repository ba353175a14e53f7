use rig_model::random::Stream;

use super::*;
use crate::SensorDesign;

/// The paper's contacts up to this stiffness and angle.
fn required(young_mpa: f64, deepest: Depth, tilt_deg: f64, needs_impedance: bool) -> Requirements {
    Requirements {
        sensor: Sensor::reference(),
        stiffest: Tissue::soft(young_mpa).unwrap(),
        deepest,
        law: ContactLaw::Sneddon,
        friction: Friction::Sticking,
        tilt_max_rad: f64::to_radians(tilt_deg),
        needs_impedance,
    }
}

const SUNK: Depth = Depth::Indentation { along_probe_mm: 0.5 };
const MOVED: Depth = Depth::Stage { along_probe_mm: 0.5 };

#[track_caller]
fn check(required: &Requirements, tolerance_hz: f64, expected: Tier) {
    let choice = Tier::cheapest_for(required, tolerance_hz).unwrap();
    assert_eq!(choice.tier, expected, "{choice}");
    assert!(choice.difference_hz <= tolerance_hz, "{choice}");
}

#[test]
fn a_scene_gets_the_cheapest_tier_that_is_good_enough() {
    check(&required(0.649, SUNK, 0.0, false), 10.0, Tier::T0);
    check(&required(0.649, SUNK, 0.0, false), 1.0, Tier::T1);
    check(&required(0.649, SUNK, 45.0, false), 1.2, Tier::T2);
    check(&required(0.649, SUNK, 45.0, false), 0.3, Tier::E1);
    check(&required(0.649, MOVED, 45.0, false), 1.2, Tier::T2s);
    check(&required(0.649, MOVED, 45.0, true), 1.0, Tier::E1s);
    check(&required(0.649, MOVED, 45.0, true), 0.02, Tier::Reference);
    check(&required(0.649, MOVED, 45.0, false), 0.0, Tier::Reference);
}

/// At a loss of 1 the tiers without losses are 1.5 Hz off, and a contact without friction leaves T2
/// 2.6 Hz off: the numbers of a common tissue do not hold there.
#[test]
fn the_tissue_and_the_friction_of_the_scene_are_those_measured() {
    let lossy = Requirements {
        stiffest: Tissue::new(1.0, 0.5, 1.0).unwrap(),
        ..required(1.0, SUNK, 0.0, false)
    };
    let difference = lossy.difference_hz(Tier::Exact).unwrap();
    assert!((1.3..1.8).contains(&difference), "{difference}");
    check(&lossy, 1.0, Tier::Reference);
    let sliding =
        Requirements { friction: Friction::Frictionless, ..required(0.649, SUNK, 45.0, false) };
    let [sliding, sticking] = [sliding, required(0.649, SUNK, 45.0, false)]
        .map(|required| required.difference_hz(Tier::T2).unwrap());
    assert!(sliding > 1.5 * sticking && sliding > 2.0, "{sliding} {sticking}");
}

#[test]
fn contacts_that_the_reference_refuses_have_no_choice() {
    let deep = required(0.1, Depth::Indentation { along_probe_mm: 1.001 }, 0.0, false);
    assert!(matches!(Tier::cheapest_for(&deep, 1.0), Err(Refusal::Law(_))));
    let bent = required(8.0, SUNK, 0.0, false);
    assert!(matches!(Tier::cheapest_for(&bent, 1.0), Err(Refusal::Turned { .. })));
    let flat = required(0.1, SUNK, 90.0, false);
    assert!(matches!(Tier::cheapest_for(&flat, 1.0), Err(Refusal::Pose(_))));
}

/// A random scene: sensor, tissue, law, friction, depth and tilt.
fn scene(random: &mut Stream) -> Requirements {
    let between = |low: f64, high: f64, random: &mut Stream| low + (high - low) * random.uniform();
    let design = SensorDesign {
        length_mm: between(25.0, 45.0, random),
        width_mm: between(4.0, 8.0, random),
        arm_mm: between(0.0, 10.0, random),
        probe_radius_mm: between(0.4, 1.0, random),
        ..SensorDesign::reference()
    };
    let along_probe_mm = between(0.2, 0.4, random);
    let tissue = Tissue::new(
        0.03 * 30.0_f64.powf(random.uniform()),
        between(0.4, 0.5, random),
        between(0.0, 0.5, random),
    );
    Requirements {
        sensor: Sensor::new(design).unwrap(),
        stiffest: tissue.unwrap(),
        deepest: if random.uniform() < 0.5 {
            Depth::Stage { along_probe_mm }
        } else {
            Depth::Indentation { along_probe_mm }
        },
        law: random.pick(&[ContactLaw::Sneddon, ContactLaw::Hertz, ContactLaw::NeoHookean]),
        friction: random.pick(&[
            Friction::Sticking,
            Friction::Frictionless,
            Friction::Elastic { tangential_ratio: 0.4 },
        ]),
        tilt_max_rad: between(0.0, 0.8, random),
        needs_impedance: random.uniform() < 0.3,
    }
}

/// A random contact of a scene.
fn contact(required: &Requirements, random: &mut Stream) -> (Tissue, Contact) {
    // The ends of the ranges come up as often as all of the rest.
    let mut share = || (1.5 * random.uniform()).min(1.0);
    let [stiffness, depth, tilt] = [share(), share(), share()];
    let direction = random.pick(&Direction::ALL);
    let pose = Pose::leaning(direction, tilt * required.tilt_max_rad).unwrap();
    let Requirements { stiffest, deepest, law, friction, .. } = *required;
    (
        stiffest.times(stiffness.max(0.01)),
        Contact { pose, depth: deepest.times(depth), law, friction },
    )
}

/// Over 60 random scenes with 150 random contacts each: the tier agrees with the reference as stated,
/// and every cheaper one exceeds the tolerance somewhere.
#[test]
fn the_chosen_tier_agrees_as_stated_and_no_cheaper_one_would() {
    let (mut chosen, mut spared) = ([0; Tier::ALL.len()], 0);
    for seed in 0..60 {
        let mut random = Stream::new(seed, 15);
        let required = scene(&mut random);
        let tolerance_hz = 0.1 * 50.0_f64.powf(random.uniform());
        let Ok(choice) = Tier::cheapest_for(&required, tolerance_hz) else { continue };
        let measured = Measured::new(&required).unwrap();
        let contacts: Vec<_> = (0..150).map(|_| contact(&required, &mut random)).collect();
        let largest = |tier: Tier| {
            contacts.iter().fold(0.0, |largest, (tissue, contact)| {
                let expected = measured.shift_hz(Tier::Reference, tissue, contact).unwrap();
                let found = measured.shift_hz(tier, tissue, contact);
                f64::max(largest, found.map_or(f64::INFINITY, |found| (found - expected).abs()))
            })
        };
        let found = largest(choice.tier);
        assert!(found <= choice.difference_hz, "scene {seed}: {choice}, found {found}");
        chosen[choice.tier as usize] += 1;
        spared += usize::from(Tier::ALL.into_iter().take_while(|tier| *tier != choice.tier).any(
            |cheaper| {
                let is_able = cheaper.validity().has_impedance || !required.needs_impedance;
                is_able && largest(cheaper) <= tolerance_hz / MARGIN
            },
        ));
    }
    assert!(chosen.iter().sum::<usize>() > 50, "{chosen:?}");
    assert!(chosen.iter().filter(|count| **count > 0).count() >= 5, "{chosen:?}");
    assert!(spared <= 1, "a cheaper tier would have done in {spared} scenes; chosen {chosen:?}");
}
