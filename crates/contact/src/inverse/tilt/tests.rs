use rig_model::random::Stream;

use super::*;
use crate::{Sensor, SensorDesign};

fn models() -> Models {
    Models::new(&Sensor::reference(), ContactLaw::Sneddon)
}

const TOUCH_MODEL: TouchModel = TouchModel {
    tier: Tier::E1,
    law: ContactLaw::Sneddon,
    friction: Friction::Sticking,
    kind: TissueKind::SOFT,
    shared_depth_sigma_mm: 0.0,
    depth_sigma_mm: 0.0,
};
const TO_45: AnglePrior = AnglePrior::Within { max_rad: std::f64::consts::FRAC_PI_4 };

/// What touches at these spins in quarters and depths would read.
fn touches(
    models: &Models,
    young_mpa: f64,
    degrees: f64,
    azimuth_rad: f64,
    ways: &[(f64, f64)],
) -> Vec<SiteTouch> {
    ways.iter()
        .map(|&(quarters, along_probe_mm)| {
            let spin_rad = quarters * std::f64::consts::FRAC_PI_2;
            let pose = Pose::new(degrees.to_radians(), azimuth_rad - spin_rad).unwrap();
            let depth = Depth::Indentation { along_probe_mm };
            let contact = Contact::new(pose, depth);
            let tissue = TissueKind::SOFT.with(young_mpa).unwrap();
            let shift_hz = models.predict(Tier::E1, &tissue, &contact).unwrap().shift_hz;
            SiteTouch { shift_hz, sigmas: ShiftSigmas::of_resonance(0.1), spin_rad, depth }
        })
        .collect()
}

const FOUR_SPINS: [(f64, f64); 4] = [(0.0, 0.5), (1.0, 0.5), (2.0, 0.5), (3.0, 0.5)];

fn infer(
    models: &Models,
    touches: &[SiteTouch],
    azimuth: AzimuthPrior,
) -> Result<TiltInference, InverseError> {
    infer_tilt(models, touches, &TOUCH_MODEL, TO_45, azimuth)
}

/// Standard deviations for sample 3 from a separate program: 0.2 % and 0.7° at 10°, 1.0 % and 1.2°
/// at 30°; with a shared depth of 20 µm 1.7 % and 1.2°.
#[test]
fn four_spins_give_stiffness_angle_and_azimuth() {
    let models = models();
    for (degrees, azimuth, percent, sigma_deg) in
        [(10.0, 0.0, 0.25, 0.71), (30.0, 0.0, 1.03, 1.23), (30.0, 2.5, 0.98, 1.17)]
    {
        let touches = touches(&models, 0.235, degrees, azimuth, &FOUR_SPINS);
        let found = infer(&models, &touches, AzimuthPrior::Unknown).unwrap();
        let TiltInference { young_mpa, angle_rad, azimuth_rad, .. } = found;
        assert!((young_mpa.value / 0.235 - 1.0).abs() < 0.2 * percent / 100.0, "{found:?}");
        assert!((100.0 * young_mpa.sigma / 0.235 - percent).abs() < 0.1 * percent, "{found:?}");
        assert!((angle_rad.value.to_degrees() - degrees).abs() < 0.2 * sigma_deg, "{found:?}");
        assert!((angle_rad.sigma.to_degrees() - sigma_deg).abs() < 0.1 * sigma_deg, "{found:?}");
        assert!((azimuth_rad.value - azimuth).abs() < 0.02, "{found:?}");
        assert!(found.is_angle_identified && found.is_azimuth_identified);
        assert_eq!(found.freedom, 1);
    }
    let touches = touches(&models, 0.235, 30.0, 0.0, &FOUR_SPINS);
    let touch_model = TouchModel { shared_depth_sigma_mm: 0.02, ..TOUCH_MODEL };
    let found = infer_tilt(&models, &touches, &touch_model, TO_45, AzimuthPrior::Unknown).unwrap();
    assert!((100.0 * found.young_mpa.sigma / 0.235 - 1.69).abs() < 0.05, "{found:?}");
    // That program leaves out the force, which turns the sensor.
    assert!((found.angle_rad.sigma.to_degrees() - 1.23).abs() < 0.08, "{found:?}");
}

/// Upright there is no azimuth to find, but stiffness and angle are known best.
#[test]
fn an_upright_probe_has_no_azimuth() {
    let models = models();
    let touches = touches(&models, 0.235, 0.0, 0.0, &FOUR_SPINS);
    let found = infer(&models, &touches, AzimuthPrior::Unknown).unwrap();
    assert!(!found.is_azimuth_identified, "{found:?}");
    assert!(found.is_angle_identified && found.angle_rad.high.to_degrees() < 2.0, "{found:?}");
    assert!(found.young_mpa.sigma / 0.235 < 0.002, "{found:?}");
}

/// Shallow contacts determine only E √cos α.
#[test]
fn two_depths_know_one_combination_and_say_so() {
    let models = models();
    let touch_model = TouchModel { shared_depth_sigma_mm: 0.02, ..TOUCH_MODEL };
    let back = AzimuthPrior::Known(0.0);
    for degrees in [5.0, 30.0, 40.0] {
        let two = touches(&models, 0.235, degrees, 0.0, &[(2.0, 0.25), (2.0, 0.5)]);
        let found = infer_tilt(&models, &two, &touch_model, TO_45, back).unwrap();
        assert!(!found.is_angle_identified, "{degrees}°: {found:?}");
        assert!(found.correlation > 0.97, "{degrees}°: {found:?}");
        assert!(found.young_mpa.contains(0.235), "{degrees}°: {found:?}");
        // The same two depths on opposite sides tell it.
        let sides = touches(&models, 0.235, degrees, 0.0, &[(0.0, 0.5), (2.0, 0.5)]);
        let found = infer_tilt(&models, &sides, &touch_model, TO_45, back).unwrap();
        assert!(found.is_angle_identified, "{degrees}°: {found:?}");
    }
}

#[test]
fn spins_that_repeat_each_other_tell_no_angle() {
    let models = models();
    let same = touches(&models, 0.235, 20.0, 0.0, &[(0.0, 0.5); 4]);
    let found = infer(&models, &same, AzimuthPrior::Unknown).unwrap();
    assert!(!found.is_angle_identified && !found.is_azimuth_identified, "{found:?}");
    assert!(found.young_mpa.contains(0.235), "{found:?}");
    let turned = touches(&models, 0.235, 20.0, 0.0, &FOUR_SPINS);
    assert!(infer(&models, &turned, AzimuthPrior::Unknown).unwrap().is_angle_identified);
}

/// Front and back are alike where h cos α (1 − τ) = τ R: with this arm at 30°, but for the turn of the
/// sensor by the force.
#[test]
fn the_arm_that_makes_front_and_back_alike_hides_the_angle() {
    let information = |arm_mm: f64| {
        let design = SensorDesign { arm_mm, ..SensorDesign::reference() };
        let models = Models::new(&Sensor::new(design).unwrap(), ContactLaw::Sneddon);
        let sides = touches(&models, 0.235, 30.0, 0.0, &[(0.0, 0.5), (2.0, 0.5)]);
        let difference = sides[0].shift_hz - sides[1].shift_hz;
        let found = infer(&models, &sides, AzimuthPrior::Known(0.0)).unwrap();
        (difference, found)
    };
    let alike_mm = 2.0 * 0.5 / 30.0_f64.to_radians().cos();
    let (difference, found) = information(alike_mm);
    assert!(difference.abs() < 0.3, "{difference}");
    assert!(!found.is_angle_identified && found.correlation > 0.95, "{found:?}");
    let (difference, found) = information(8.0);
    assert!(difference > 3.0 && found.is_angle_identified, "{found:?}");
}

#[test]
fn touches_that_no_tilt_explains_are_refused() {
    let models = models();
    let with_error = |sigmas: f64| {
        let mut touches = touches(&models, 0.235, 20.0, 0.3, &FOUR_SPINS);
        touches[1].shift_hz += sigmas * touches[1].sigmas.whole_hz();
        infer(&models, &touches, AzimuthPrior::Unknown)
    };
    assert!(with_error(2.0).is_ok());
    let refusal = with_error(40.0);
    assert!(matches!(refusal, Err(InverseError::Inconsistent { freedom: 1, .. })), "{refusal:?}");
    // No degree of freedom is left, but no angle up to 45° makes front and left so different.
    let mut two = touches(&models, 0.235, 45.0, 0.0, &FOUR_SPINS[..2]);
    assert!(infer(&models, &two, AzimuthPrior::Unknown).is_ok());
    two[1].shift_hz *= 0.5;
    let refusal = infer(&models, &two, AzimuthPrior::Unknown);
    assert!(matches!(refusal, Err(InverseError::Inconsistent { freedom: 0, .. })), "{refusal:?}");
}

#[test]
fn questions_without_an_answer_are_refused() {
    let models = models();
    let good = touches(&models, 0.235, 20.0, 0.3, &FOUR_SPINS);
    let ask = |touches: &[SiteTouch], touch_model: &TouchModel, angle| {
        infer_tilt(&models, touches, touch_model, angle, AzimuthPrior::Unknown)
    };
    assert_eq!(ask(&[], &TOUCH_MODEL, TO_45), Err(InverseError::NoTouches));
    let bare = [SiteTouch { sigmas: ShiftSigmas::default(), ..good[0] }];
    assert!(matches!(ask(&bare, &TOUCH_MODEL, TO_45), Err(InverseError::NotPositive { .. })));
    let touch_model = TouchModel { depth_sigma_mm: -1.0, ..TOUCH_MODEL };
    assert!(matches!(ask(&good, &touch_model, TO_45), Err(InverseError::NotPositive { .. })));
    let none = AnglePrior::Within { max_rad: 0.0 };
    assert!(matches!(ask(&good, &TOUCH_MODEL, none), Err(InverseError::NotPositive { .. })));
    let clear = [SiteTouch { shift_hz: -0.2, ..good[0] }];
    assert!(matches!(ask(&clear, &TOUCH_MODEL, TO_45), Err(InverseError::NoContact { .. })));
    let noise = [SiteTouch { sigmas: ShiftSigmas::of_resonance(100.0), ..good[0] }];
    assert!(matches!(ask(&noise, &TOUCH_MODEL, TO_45), Err(InverseError::TooUncertain { .. })));
    let deep = [SiteTouch { depth: Depth::Indentation { along_probe_mm: 1.5 }, ..good[0] }];
    assert!(matches!(ask(&deep, &TOUCH_MODEL, TO_45), Err(InverseError::Refused(Refusal::Law(_)))));
}

/// Angles and azimuths drawn from the prior, shifts and depth with errors as stated.
#[test]
fn nineteen_in_twenty_intervals_hold_stiffness_and_angle() {
    const SEED: u64 = 7;
    const TRIALS: u32 = 400;
    let models = models();
    let mut random = Stream::new(SEED, 1);
    let touch_model =
        TouchModel { shared_depth_sigma_mm: 0.02, depth_sigma_mm: 0.005, ..TOUCH_MODEL };
    let (mut of_young, mut of_angle) = (0, 0);
    for _ in 0..TRIALS {
        let young_mpa = 0.045 * (0.649_f64 / 0.045).powf(random.uniform());
        let degrees = 45.0 * random.uniform();
        let azimuth = TAU * random.uniform();
        let shared = 0.02 * random.normal();
        let ways = FOUR_SPINS.map(|(spin, depth)| (spin, depth + shared + 0.005 * random.normal()));
        let mut touches = touches(&models, young_mpa, degrees, azimuth, &ways);
        for touch in &mut touches {
            touch.depth = Depth::Indentation { along_probe_mm: 0.5 };
            touch.sigmas = ShiftSigmas::of_resonance(0.3);
            touch.shift_hz += 0.3 * random.normal();
        }
        let found =
            infer_tilt(&models, &touches, &touch_model, TO_45, AzimuthPrior::Unknown).unwrap();
        of_young += u32::from(found.young_mpa.contains(young_mpa));
        of_angle += u32::from(found.angle_rad.contains(degrees.to_radians()));
    }
    for (what, count) in [("stiffness", of_young), ("angle", of_angle)] {
        let share = f64::from(count) / f64::from(TRIALS);
        // Three standard deviations of a count of 400 around 0.95.
        assert!((0.917..0.983).contains(&share), "seed {SEED}, {what}: {share}");
    }
}

mod parts;
