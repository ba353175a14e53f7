use super::*;
use crate::{Direction, SensorDesign};

#[track_caller]
fn close(found: f64, expected: f64, relative: f64) {
    assert!((found / expected - 1.0).abs() <= relative, "{found} is not {expected}");
}

fn reference(law: ContactLaw) -> Lumped {
    Lumped::new(&Sensor::reference(), law)
}

/// Contact stiffness of an incompressible sample at half a millimetre.
fn stiffness(law: ContactLaw, young_mpa: f64) -> f64 {
    2.0 * young_mpa * 1e6 / 0.75 * law.at(1.0).unwrap().radius_rel * 0.5e-3
}

#[test]
fn the_two_printed_numbers_come_back_for_every_law() {
    for law in ContactLaw::ALL {
        let lumped = reference(law);
        assert_eq!(lumped.no_load_hz(), 140.4);
        let chord = |shift: &dyn Fn(f64) -> f64| {
            (shift(stiffness(law, 0.649)) - shift(stiffness(law, 0.045))) / 0.604
        };
        close(chord(&|k| lumped.proportional_hz(k)), 134.11, 1e-12);
        close(chord(&|k| lumped.loaded_hz(k)), 134.11, 1e-12);
        close(chord(&|k| lumped.upright_hz(k)), 134.11, 1e-12);
        close(chord(&|k| lumped.tilted_hz(&Pose::UPRIGHT, k, 2.0 / 3.0)), 134.11, 1e-12);
    }
}

#[test]
fn the_sensors_stiffness_for_each_law() {
    for (law, expected) in
        [(ContactLaw::Paper, 449.5), (ContactLaw::Sneddon, 432.6), (ContactLaw::Hertz, 519.0)]
    {
        let found = reference(law).contact_n_per_m;
        assert!((found - expected).abs() < 0.06, "{law:?}: {found}");
    }
}

#[test]
fn shifts_of_the_five_samples_upright() {
    let law = ContactLaw::Paper;
    let lumped = reference(law);
    let rows = [
        (0.045, 6.03, 9.68, 7.89),
        (0.104, 13.95, 20.83, 17.65),
        (0.235, 31.52, 41.67, 37.40),
        (0.320, 42.92, 53.33, 49.12),
        (0.649, 87.04, 90.68, 88.90),
    ];
    for (young_mpa, proportional, loaded, upright) in rows {
        let k = stiffness(law, young_mpa);
        assert!((lumped.proportional_hz(k) - proportional).abs() < 0.006);
        assert!((lumped.loaded_hz(k) - loaded).abs() < 0.006, "{}", lumped.loaded_hz(k));
        assert!((lumped.upright_hz(k) - upright).abs() < 0.006, "{}", lumped.upright_hz(k));
    }
}

#[test]
fn the_inverse_of_the_tilted_tier_inverts_from_the_softest_to_the_stiffest() {
    let lumped = reference(ContactLaw::Sneddon);
    let pose = Pose::leaning(Direction::Back, 0.6).unwrap();
    for exponent in -160..=60 {
        let k = 450.0 * 10.0_f64.powf(f64::from(exponent) / 10.0);
        let shift = lumped.tilted_hz(&pose, k, 0.5);
        close(lumped.stiffness_of_tilted(&pose, shift, 0.5), k, 1e-14);
    }
}

/// The naive form √(1 + r) − 1 has lost every digit at a ratio of 1e-16.
#[test]
fn small_stiffness_ratios_keep_their_digits() {
    let lumped = reference(ContactLaw::Sneddon);
    for exponent in 8..=300 {
        let ratio = 10.0_f64.powi(-exponent);
        let shift = lumped.upright_hz(ratio * lumped.contact_n_per_m);
        close(shift, 0.5 * 140.4 * ratio, 0.3 * ratio + 1e-15);
        let loaded = |ratio: f64| lumped.loaded_hz(ratio * lumped.contact_n_per_m);
        close(loaded(ratio), 0.5 * loaded(2.0 * ratio), 3.0 * ratio + 1e-15);
    }
    assert_eq!((1.0_f64 + 1e-16).sqrt() - 1.0, 0.0);
}

#[test]
fn a_shorter_sensor_is_stiffer_and_less_sensitive() {
    let design = SensorDesign { length_mm: 20.0, ..SensorDesign::reference() };
    let short = Lumped::new(&Sensor::new(design).unwrap(), ContactLaw::Sneddon);
    assert!((short.no_load_hz() - 340.06).abs() < 0.01, "{}", short.no_load_hz());
    let long = reference(ContactLaw::Sneddon);
    close(short.tip_n_per_m, long.tip_n_per_m * 1.75_f64.powi(3), 1e-12);
    assert!(short.upright_hz(100.0) < long.upright_hz(100.0));
    // ω L in the denominator of one, L in that of the other.
    let per_length = short.no_load_hz() * 20.0 / (140.4 * 35.0);
    close(long.proportional_hz(1.0) / short.proportional_hz(1.0), per_length, 1e-12);
    let product =
        |sensor: &Lumped| (sensor.no_load_hz() + sensor.loaded_hz(9.0)) * sensor.loaded_hz(9.0);
    close(product(&long) / product(&short), 20.0 / 35.0, 1e-12);
}
