use rig_model::random::Stream;

use super::*;
use crate::{ContactLaw, Direction, Friction, LawError, Sensor};

fn models() -> Models {
    Models::new(&Sensor::reference(), ContactLaw::Sneddon)
}

fn contact(direction: Direction, degrees: f64, depth: Depth) -> Contact {
    Contact::new(Pose::leaning(direction, degrees.to_radians()).unwrap(), depth)
}

const SUNK: Depth = Depth::Indentation { along_probe_mm: 0.5 };
const MOVED: Depth = Depth::Stage { along_probe_mm: 0.5 };

#[test]
fn every_tier_finds_back_the_stiffness_that_it_started_from() {
    let models = models();
    for tier in Tier::ALL {
        let depths: &[Depth] =
            if tier.validity().takes_stage_moves { &[SUNK, MOVED] } else { &[SUNK] };
        for &depth in depths {
            for direction in Direction::ALL {
                for young_mpa in [1e-9, 1e-3, 0.045, 0.649, 1.1] {
                    let contact = contact(direction, 40.0, depth);
                    let tissue = TissueKind::SOFT.with(young_mpa).unwrap();
                    let shift = models.predict(tier, &tissue, &contact).unwrap().shift_hz;
                    let found =
                        models.young_of_shift_mpa(tier, shift, TissueKind::SOFT, &contact).unwrap();
                    // Two tiers know a shift as a difference of resonances.
                    let is_difference = matches!(tier, Tier::Exact | Tier::Reference);
                    let tolerance = if is_difference { 1e-6 } else { 1e-10 };
                    let error = (found / young_mpa - 1.0).abs();
                    assert!(
                        error < tolerance,
                        "{tier:?} {depth:?} {direction:?} {young_mpa}: {found}"
                    );
                }
            }
        }
    }
}

#[test]
fn what_is_no_contact_and_what_is_beyond_the_tier_is_refused() {
    let models = models();
    let invert = |tier, shift_hz, contact: &Contact| {
        models.young_of_shift_mpa(tier, shift_hz, TissueKind::SOFT, contact)
    };
    let upright = contact(Direction::Front, 0.0, SUNK);
    for shift_hz in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let refusal = invert(Tier::E1, shift_hz, &upright);
        assert!(matches!(refusal, Err(InverseError::NoContact { .. })), "{shift_hz}: {refusal:?}");
    }
    let clear = contact(Direction::Front, 0.0, Depth::Indentation { along_probe_mm: 0.0 });
    assert!(matches!(invert(Tier::E1, 5.0, &clear), Err(InverseError::NoContact { .. })));
    // Thirty sensor stiffnesses shift tier E1 by 494 Hz; the exact beam ends at 1666 Hz. A contact so
    // shallow turns no sensor.
    let upright = contact(Direction::Front, 0.0, Depth::Indentation { along_probe_mm: 1e-12 });
    let most = |tier| {
        let stiffest = TissueKind::SOFT.with(1e9).unwrap();
        models.shift_of_load(
            tier,
            &stiffest,
            &upright.pose,
            &models.sensor().load(&stiffest, &upright).unwrap(),
        )
    };
    assert!(invert(Tier::E1, 450.0, &upright).is_ok());
    assert!(matches!(
        invert(Tier::E1, 650.0, &upright),
        Err(InverseError::Refused(Refusal::OutOfReach { .. }))
    ));
    assert!(invert(Tier::Exact, most(Tier::Exact) * 0.99, &upright).is_ok());
    assert!(matches!(
        invert(Tier::Exact, 1666.1, &upright),
        Err(InverseError::Refused(Refusal::OutOfReach { .. }))
    ));
    let moved = contact(Direction::Front, 0.0, MOVED);
    assert!(matches!(
        invert(Tier::E1, 5.0, &moved),
        Err(InverseError::Refused(Refusal::StageMove { .. }))
    ));
    let deep = contact(Direction::Front, 0.0, Depth::Indentation { along_probe_mm: 1.01 });
    assert!(matches!(
        invert(Tier::E1, 5.0, &deep),
        Err(InverseError::Refused(Refusal::Law(LawError::Depth { .. })))
    ));
}

/// A soft sample slips from tan α = μ/τ on, 8.53° for the paper's 0.1; the arm drags the ball on a stiff
/// one even upright.
#[test]
fn a_contact_that_slips_is_refused() {
    let models = models();
    let at = |shift_hz: f64, degrees: f64| {
        let friction = Friction::Coulomb { coefficient: 0.1 };
        let contact = Contact { friction, ..contact(Direction::Back, degrees, SUNK) };
        models.young_of_shift_mpa(Tier::E1, shift_hz, TissueKind::SOFT, &contact)
    };
    assert!(at(0.01, 8.52).is_ok());
    assert_eq!(
        at(0.01, 8.54).unwrap_err().to_string(),
        "a contact at 8.54° slips at a friction coefficient of 0.1: it sticks from 0.100 on"
    );
    assert!(at(5.0, 0.0).is_ok());
    let stiff = at(89.0, 0.0).unwrap_err();
    let InverseError::Refused(Refusal::Slips { needed, .. }) = stiff else { panic!("{stiff}") };
    assert!((needed - 0.26).abs() < 0.02, "{needed}");
}

const SIGMAS: TouchSigmas = TouchSigmas { shift_hz: 0.3, depth_mm: 0.02, angle_rad: 0.017_453 };

/// Relative standard deviations from a separate program.
#[test]
fn the_uncertainty_of_a_touch_leaning_back() {
    let models = models();
    for (young_mpa, expected) in [
        (0.045, [4.1, 4.4, 5.0, 5.8]),
        (0.235, [1.5, 1.8, 2.0, 2.3]),
        (0.649, [1.3, 1.6, 1.8, 2.0]),
    ] {
        for (degrees, expected) in [0.0, 15.0, 30.0, 45.0].into_iter().zip(expected) {
            let contact = contact(Direction::Back, degrees, SUNK);
            let tissue = TissueKind::SOFT.with(young_mpa).unwrap();
            let shift = models.predict(Tier::E1, &tissue, &contact).unwrap().shift_hz;
            let found = models
                .stiffness_of_touch(Tier::E1, shift, SIGMAS, TissueKind::SOFT, &contact)
                .unwrap();
            let percent = 100.0 * found.sigma_mpa / found.young_mpa;
            assert!((percent - expected).abs() < 0.13, "{young_mpa} MPa {degrees}°: {percent} %");
            let parts =
                [found.sigma_of_shift_mpa, found.sigma_of_depth_mpa, found.sigma_of_angle_mpa];
            let together = parts.iter().map(|part| part * part).sum::<f64>().sqrt();
            assert!((together / found.sigma_mpa - 1.0).abs() < 1e-12);
        }
    }
}

#[test]
fn a_stiffness_lost_in_the_noise_is_refused() {
    let models = models();
    let upright = contact(Direction::Front, 0.0, SUNK);
    let touch = |shift_hz| {
        models.stiffness_of_touch(Tier::E1, shift_hz, SIGMAS, TissueKind::SOFT, &upright)
    };
    assert!(touch(0.62).is_ok());
    assert!(matches!(touch(0.58), Err(InverseError::TooUncertain { .. })));
}

/// Depth, angle and shift at random; the model's own, so that only the arithmetic is on trial.
#[test]
fn nineteen_in_twenty_intervals_hold_the_truth() {
    const SEED: u64 = 41;
    const TRIALS: u32 = 4000;
    let models = models();
    let mut random = Stream::new(SEED, 1);
    let mut covered = 0;
    for _ in 0..TRIALS {
        let young_mpa = 0.03 * (0.649_f64 / 0.03).powf(random.uniform());
        let degrees = 45.0 * random.uniform();
        let direction = random.pick(&Direction::ALL);
        let meant = contact(direction, degrees, MOVED);
        let real = leaning(
            &deeper(&meant, SIGMAS.depth_mm * random.normal()),
            SIGMAS.angle_rad * random.normal(),
        );
        let tissue = TissueKind::SOFT.with(young_mpa).unwrap();
        let shift = models.predict(Tier::E1s, &tissue, &real).unwrap().shift_hz
            + SIGMAS.shift_hz * random.normal();
        let found =
            models.stiffness_of_touch(Tier::E1s, shift, SIGMAS, TissueKind::SOFT, &meant).unwrap();
        if (found.young_mpa - young_mpa).abs() <= 1.96 * found.sigma_mpa {
            covered += 1;
        }
    }
    let share = f64::from(covered) / f64::from(TRIALS);
    assert!((0.94..0.96).contains(&share), "seed {SEED}: {share}");
}
