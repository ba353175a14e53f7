use super::*;
use crate::{Direction, Friction, Validity};

const SUNK: Depth = Depth::Indentation { along_probe_mm: 0.5 };
const MOVED: Depth = Depth::Stage { along_probe_mm: 0.5 };

fn models() -> Models {
    Models::new(&Sensor::reference(), ContactLaw::Sneddon)
}

fn leaning(direction: Direction, degrees: f64, depth: Depth) -> Contact {
    Contact::new(Pose::leaning(direction, degrees.to_radians()).unwrap(), depth)
}

/// The tissue whose contact is `ratio` times as stiff as the sensor's tip.
fn tissue_of(models: &Models, contact: &Contact, ratio: f64) -> Tissue {
    let load = models.sensor().load(&Tissue::soft(1.0).unwrap(), contact).unwrap();
    Tissue::soft(ratio / models.stiffness_ratio(&load)).unwrap()
}

/// So shallow that the force turns no sensor.
const TOUCHED: Depth = Depth::Indentation { along_probe_mm: 1e-4 };
const SHALLOWEST: Depth = Depth::Indentation { along_probe_mm: 1e-13 };

#[test]
fn every_tier_holds_up_to_its_stiffness_and_is_refused_just_beyond() {
    let models = models();
    let contact = leaning(Direction::Front, 20.0, TOUCHED);
    for tier in Tier::ALL {
        let limit = tier.validity().stiffness_ratio_max;
        let at = |ratio: f64| models.predict(tier, &tissue_of(&models, &contact, ratio), &contact);
        if limit.is_infinite() {
            let deep = leaning(Direction::Front, 20.0, SHALLOWEST);
            let at = |ratio: f64| models.predict(tier, &tissue_of(&models, &deep, ratio), &deep);
            assert!(at(1e12).unwrap().shift_hz < 1667.0 - 140.0, "{tier:?}");
            continue;
        }
        assert!(at(limit * (1.0 - 1e-9)).is_ok(), "{tier:?}");
        let refusal = at(limit * (1.0 + 1e-9)).unwrap_err();
        assert!(matches!(refusal, Refusal::TooStiff { .. }), "{tier:?}: {refusal}");
    }
}

/// No digit is lost down to a contact of 1e-16 of the sensor's stiffness, in any direction, with
/// any friction.
#[test]
fn shifts_rise_from_the_softest_contact_to_the_stiffest_that_the_tier_takes() {
    let models = models();
    for tier in Tier::ALL {
        for direction in Direction::ALL {
            for friction in [Friction::Sticking, Friction::Frictionless] {
                let contact = Contact { friction, ..leaning(direction, 30.0, SHALLOWEST) };
                let shift = |ratio: f64| {
                    let tissue = tissue_of(&models, &contact, ratio);
                    models.predict(tier, &tissue, &contact).unwrap().shift_hz
                };
                let case = format!("{tier:?} {direction:?} {friction:?}");
                let double = shift(2e-16) / shift(1e-16);
                assert!((double - 2.0).abs() < 1e-8, "{case}: {double}");
                let limit = tier.validity().stiffness_ratio_max.min(1e6);
                let decades = (limit / 1e-16).log10();
                let mut before = 0.0;
                for step in 0..=88 {
                    let ratio = 1e-16 * 10.0_f64.powf(decades * f64::from(step) / 88.0);
                    let found = shift(ratio * (1.0 - 1e-9));
                    assert!(
                        found > before * (1.0 - 1e-9),
                        "{case} {ratio}: {found} after {before}"
                    );
                    before = found;
                }
            }
        }
    }
}

/// A contact that is nearly beside the surface is nearly none; beside it there is no pose.
#[test]
fn shifts_vanish_towards_ninety_degrees() {
    let models = models();
    let tissue = Tissue::soft(0.649).unwrap();
    for tier in Tier::ALL {
        for direction in Direction::ALL {
            let shift = |degrees: f64| {
                let contact = leaning(direction, degrees, SUNK);
                models.predict(tier, &tissue, &contact).unwrap().shift_hz
            };
            let mut before = f64::INFINITY;
            for beside in [10.0, 1.0, 0.1, 1e-3, 1e-6, 1e-9] {
                let found = shift(90.0 - beside);
                assert!(found > 0.0 && found < before, "{tier:?} {direction:?} {beside}: {found}");
                // At least as the square root of the remaining depth.
                assert!(found < 40.0 * beside.sqrt(), "{tier:?} {direction:?} {beside}: {found}");
                before = found;
            }
        }
    }
    assert!(Pose::leaning(Direction::Front, 90.0_f64.to_radians()).is_err());
}

#[test]
fn a_ball_is_sunk_to_its_top_and_no_deeper() {
    let models = models();
    let tissue = Tissue::soft(0.1).unwrap();
    for degrees in [0.0_f64, 45.0] {
        let to_top_mm = 2.0 * 0.5 / degrees.to_radians().cos();
        let at = |factor: f64| {
            let depth = Depth::Indentation { along_probe_mm: factor * to_top_mm };
            models.predict(Tier::E1, &tissue, &leaning(Direction::Left, degrees, depth))
        };
        assert!(at(1.0 - 1e-12).is_ok());
        for factor in [1.0 + 1e-12, 2.0 - 1e-12, 2.0 + 1e-12, 10.0] {
            assert!(matches!(at(factor), Err(Refusal::Law(_))), "{degrees}°, {factor}");
        }
    }
}

#[test]
fn what_a_tier_does_not_know_it_refuses() {
    let models = models();
    let tissue = Tissue::soft(0.235).unwrap();
    let moved = leaning(Direction::Back, 30.0, MOVED);
    for tier in Tier::ALL {
        let Validity { takes_stage_moves, has_impedance, .. } = tier.validity();
        let found = models.predict(tier, &tissue, &moved);
        assert_eq!(found.is_ok(), takes_stage_moves, "{tier:?}");
        assert!(takes_stage_moves || found == Err(Refusal::StageMove { tier }));
        let circuit = models.circuit(tier, &tissue, &leaning(Direction::Back, 30.0, SUNK));
        assert_eq!(circuit.is_ok(), has_impedance, "{tier:?}");
        assert!(has_impedance || circuit == Err(Refusal::NoImpedance { tier }));
    }
}
