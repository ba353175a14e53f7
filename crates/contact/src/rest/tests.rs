use super::*;
use crate::{
    Contact, ContactLaw, Depth, Direction, Models, Refusal, Sensor, SensorDesign, Tier, Tissue,
};

fn lossless() -> Models {
    let design = SensorDesign { beam_loss: 0.0, dielectric_loss: 0.0, ..SensorDesign::reference() };
    Models::new(&Sensor::new(design).unwrap(), ContactLaw::Sneddon)
}

const SUNK: Depth = Depth::Indentation { along_probe_mm: 0.5 };
const MOVED: Depth = Depth::Stage { along_probe_mm: 0.5 };

/// A tissue, a contact in degrees of angle and azimuth, and the shift by other programs, Hz: for front and
/// back a chain of rigid links, for other azimuths a rod with bending both ways and torsion. Both turn
/// by any angle, and vibrate by the second order of their energy around their own equilibrium.
const BY_OTHERS: [(Depth, f64, f64, f64, f64); 24] = [
    (SUNK, 0.045, 0.0, 0.0, 7.9502),
    (SUNK, 0.235, 30.0, 0.0, 36.3670),
    (SUNK, 0.235, 30.0, 90.0, 33.5120),
    (SUNK, 0.235, 45.0, 180.0, 26.7364),
    (SUNK, 0.235, 40.0, 60.0, 32.1421),
    (SUNK, 0.649, 0.0, 0.0, 89.1522),
    (SUNK, 0.649, 15.0, 0.0, 90.0052),
    (SUNK, 0.649, 45.0, 0.0, 76.9667),
    (SUNK, 0.649, 15.0, 180.0, 83.8636),
    (SUNK, 0.649, 30.0, 180.0, 75.4054),
    (SUNK, 0.649, 45.0, 180.0, 65.4286),
    (SUNK, 0.649, 15.0, 90.0, 86.7939),
    (SUNK, 0.649, 30.0, 90.0, 80.1325),
    (SUNK, 0.649, 45.0, 90.0, 70.1660),
    (MOVED, 0.045, 15.0, 180.0, 7.2358),
    (MOVED, 0.235, 30.0, 0.0, 32.8887),
    (MOVED, 0.235, 30.0, 90.0, 31.0488),
    (MOVED, 0.235, 40.0, 60.0, 29.6768),
    (MOVED, 0.649, 0.0, 0.0, 74.2681),
    (MOVED, 0.649, 45.0, 0.0, 64.5987),
    (MOVED, 0.649, 45.0, 180.0, 61.5836),
    (MOVED, 0.649, 15.0, 90.0, 72.7848),
    (MOVED, 0.649, 30.0, 90.0, 68.5420),
    (MOVED, 0.649, 45.0, 90.0, 61.9867),
];

#[test]
fn the_shifts_are_those_of_rods_that_turn_by_any_angle() {
    let models = lossless();
    for (depth, young_mpa, angle_deg, azimuth_deg, expected) in BY_OTHERS {
        let pose = Pose::new(angle_deg.to_radians(), azimuth_deg.to_radians()).unwrap();
        let tissue = Tissue::new(young_mpa, 0.5, 0.0).unwrap();
        let contact = Contact::new(pose, depth);
        // The exact beam lacks lateral bending, and one element the beam's own inertia too.
        for (tier, tolerance_hz) in
            [(Tier::Reference, 0.03), (Tier::Exact, 0.06), (Tier::E1s, 0.24)]
        {
            let found = models.predict(tier, &tissue, &contact).unwrap().shift_hz;
            let case = format!("{depth:?} {young_mpa} MPa {angle_deg}° {azimuth_deg}° {tier:?}");
            assert!((found - expected).abs() < tolerance_hz, "{case}: {found}");
        }
    }
}

/// Near the limit, by the chain of links.
#[test]
fn up_to_the_limit_the_turned_sensor_is_right_to_a_percent() {
    let models = lossless();
    for (young_mpa, direction, degrees, expected) in [
        (2.0, Direction::Front, 0.0, 206.420),
        (4.0, Direction::Front, 0.0, 324.850),
        (4.0, Direction::Front, 45.0, 276.473),
        (4.0, Direction::Back, 30.0, 289.893),
        (6.0, Direction::Back, 45.0, 333.854),
    ] {
        let pose = Pose::leaning(direction, f64::to_radians(degrees)).unwrap();
        let tissue = Tissue::new(young_mpa, 0.5, 0.0).unwrap();
        let contact = Contact::new(pose, SUNK);
        let found = models.predict(Tier::Reference, &tissue, &contact).unwrap().shift_hz;
        let error = found / expected - 1.0;
        assert!(error.abs() < 0.01, "{young_mpa} MPa {direction:?} {degrees}°: {error}");
    }
    let tissue = Tissue::soft(4.1).unwrap();
    let refusal = models.predict(Tier::E1, &tissue, &Contact::new(Pose::UPRIGHT, SUNK));
    assert!(matches!(refusal, Err(Refusal::Turned { .. })), "{refusal:?}");
}

/// A soft contact hardly changes the mode, so that its shift is as the square of the motion of its point. How
/// far the end of the beam turns for its deflection is seen from what the arm adds by friction.
#[test]
fn a_ball_beside_the_axis_moves_with_the_turn_of_the_end() {
    let shift_hz = |probe_offset_mm: [f64; 2], tangential_ratio: f64| {
        let design = SensorDesign { probe_offset_mm, ..*lossless().sensor().design() };
        let models = Models::new(&Sensor::new(design).unwrap(), ContactLaw::Sneddon);
        let friction = crate::Friction::Elastic { tangential_ratio };
        let contact = Contact { friction, ..Contact::new(Pose::UPRIGHT, SUNK) };
        let tissue = Tissue::new(1e-4, 0.5, 0.0).unwrap();
        models.predict(Tier::Reference, &tissue, &contact).unwrap().shift_hz
    };
    let upright_hz = shift_hz([0.0; 2], 0.0);
    let turn_per_mm = (shift_hz([0.0; 2], 1.0) / upright_hz - 1.0).sqrt() / 8.5;
    assert!((0.03..0.05).contains(&turn_per_mm), "{turn_per_mm}");
    let beside = |offset_mm: [f64; 2]| shift_hz(offset_mm, 0.0) / upright_hz;
    for offset_mm in [-0.3, 0.3] {
        let expected = (1.0 + offset_mm * turn_per_mm).powi(2);
        assert!((beside([offset_mm, 0.0]) / expected - 1.0).abs() < 3e-4, "{offset_mm} mm");
    }
    let (left, right) = (beside([0.0, 0.3]), beside([0.0, -0.3]));
    // The twist only gives way a little.
    assert!((0.999..1.0).contains(&left) && (left - right).abs() < 1e-9, "{left} {right}");
}
