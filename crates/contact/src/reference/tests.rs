use super::*;
use crate::{Contact, Depth, Direction, Element, ExactBeam, SensorDesign};

impl Reference {
    /// The admittance at a frequency above zero, S.
    fn admittance_s(
        &self,
        pose: &Pose,
        load: &Load,
        tissue: &Tissue,
        frequency_hz: f64,
    ) -> Complex64 {
        let omega = TAU * frequency_hz;
        let contact = self.contact(pose, load, tissue);
        let compliance = self.slope_compliance(&contact, Complex64::from(omega * omega));
        let charge = self.held_capacitance() + self.section.moment_n_m_per_v.powi(2) * compliance;
        Complex64::i() * omega * charge
    }
}

const HALF_MM: Depth = Depth::Indentation { along_probe_mm: 0.5 };

fn touch(sensor: &Sensor, tissue: &Tissue, direction: Direction, degrees: f64) -> (Pose, Load) {
    let pose = Pose::leaning(direction, degrees.to_radians()).unwrap();
    (pose, sensor.load(tissue, &Contact::new(pose, HALF_MM)).unwrap())
}

/// The same without the force, which other programs leave out.
fn forceless(sensor: &Sensor, tissue: &Tissue, direction: Direction, degrees: f64) -> (Pose, Load) {
    let (pose, load) = touch(sensor, tissue, direction, degrees);
    (pose, Load { force_n: 0.0, ..load })
}

/// A push of π²EI/4L² along a clamped beam leaves its end without stiffness (Euler).
#[test]
fn a_beam_has_no_stiffness_under_its_buckling_force() {
    let (rigidity, length) = (0.0066, 0.035);
    let buckling_n = (std::f64::consts::FRAC_PI_2 / length).powi(2) * rigidity;
    let determinant = |push_n: f64| {
        let zero = Complex64::ZERO;
        let [[a, b], [c, d]] = bending_at_tip(rigidity.into(), zero, -push_n, length);
        (a * d - b * c).re
    };
    let share = |part: f64| determinant(part * buckling_n) / determinant(0.0);
    assert!(share(1.0 - 1e-6) > 0.0 && share(1.0 + 1e-6) < 0.0, "{}", share(1.0));
}

fn lossless() -> Sensor {
    let design = SensorDesign { beam_loss: 0.0, dielectric_loss: 0.0, ..SensorDesign::reference() };
    Sensor::new(design).unwrap()
}

/// Values of a separate finite-element program with sixteen elements of five motions.
#[test]
fn without_losses_it_is_the_finite_element_solution() {
    let sensor = lossless();
    let reference = Reference::new(&sensor);
    assert!((reference.no_load_hz() - 140.401_567_158).abs() < 1e-7, "{}", reference.no_load_hz());
    let tissue = Tissue::new(0.649, 0.5, 0.0).unwrap();
    for (direction, degrees, expected) in [
        (Direction::Front, 0.0, 88.986),
        (Direction::Front, 15.0, 89.825),
        (Direction::Front, 30.0, 85.756),
        (Direction::Front, 45.0, 76.815),
        (Direction::Back, 15.0, 83.853),
        (Direction::Back, 30.0, 75.652),
        (Direction::Back, 45.0, 65.850),
        (Direction::Left, 15.0, 86.676),
        (Direction::Left, 30.0, 80.116),
        (Direction::Left, 45.0, 70.219),
    ] {
        let (pose, load) = forceless(&sensor, &tissue, direction, degrees);
        let found = reference.shift_hz(&pose, &load, &tissue);
        assert!((found - expected).abs() < 6e-4, "{direction:?} {degrees}°: {found}");
    }
}

/// The exact beam, whose program shares nothing with this one, bends only in the plane.
#[test]
fn it_agrees_with_the_exact_beam_in_the_plane_of_bending() {
    let sensor = lossless();
    let (reference, exact) = (Reference::new(&sensor), ExactBeam::new(&sensor));
    for young_mpa in [1e-6, 0.045, 0.649, 3.0, 30.0] {
        let tissue = Tissue::new(young_mpa, 0.5, 0.0).unwrap();
        for (direction, degrees) in
            [(Direction::Front, 0.0), (Direction::Front, 40.0), (Direction::Back, 40.0)]
        {
            let (pose, load) = forceless(&sensor, &tissue, direction, degrees);
            let error = reference.shift_hz(&pose, &load, &tissue) - exact.shift_hz(&pose, &load);
            assert!(error.abs() < 2e-3, "{young_mpa} MPa {direction:?} {degrees}°: {error}");
        }
    }
}

/// From the softest contact to the stiffest, with losses; the exact beam has none.
#[test]
fn the_lowest_pole_is_found_from_the_softest_contact_to_the_stiffest() {
    let sensor = Sensor::reference();
    let (reference, exact) = (Reference::new(&sensor), ExactBeam::new(&sensor));
    let tissue = Tissue::soft(1.0).unwrap();
    let check = |pose: &Pose, normal: f64| {
        let load = Load { normal_n_per_m: normal, tangential_n_per_m: normal / 1.5, ..Load::NONE };
        let found = reference.shift_hz(pose, &load, &tissue);
        let expected = exact.shift_hz(pose, &load);
        assert!((found / expected - 1.0).abs() < 0.02, "{pose:?} {normal}: {found} {expected}");
    };
    for exponent in -16..=-1 {
        let normal = 450.0 * 10.0_f64.powi(exponent);
        check(&Pose::UPRIGHT, normal);
    }
    // Somewhere between 28 and 75 times the sensor's stiffness the mode no longer turns the end of
    // the beam, within a percent or two of the stiffness: the steps are smaller.
    for direction in Direction::ALL {
        for degrees in [0.0_f64, 5.0, 15.0, 30.0, 45.0, 70.0] {
            let pose = Pose::leaning(direction, degrees.to_radians()).unwrap();
            for step in -20..=200 {
                let normal = 450.0 * 10.0_f64.powf(f64::from(step) / 50.0);
                check(&pose, normal);
            }
        }
    }
}

/// Over the sweep window of the resonance, in contact and free: the circuit is one resonance and a
/// capacitor with a constant resistance, the reference all of them with constant loss factors.
#[test]
fn the_circuit_is_the_references_impedance_near_resonance() {
    let sensor = Sensor::reference();
    let reference = Reference::new(&sensor);
    for young_mpa in [1e-9, 0.045, 0.235, 0.649] {
        let tissue = Tissue::soft(young_mpa).unwrap();
        for direction in Direction::ALL {
            let (pose, load) = touch(&sensor, &tissue, direction, 30.0);
            let circuit = reference.circuit(&pose, &load, &tissue);
            let worst = worst_over_window(&reference, &circuit, &pose, &load, &tissue);
            assert!(worst < 0.01, "{young_mpa} MPa {direction:?}: {worst}");
        }
    }
}

/// The simulator's circuits come from one element and agree within its error of 0.05 Hz.
#[test]
fn the_single_elements_circuit_has_the_references_losses_and_coupling() {
    let sensor = Sensor::reference();
    let (reference, element) = (Reference::new(&sensor), Element::new(&sensor));
    for young_mpa in [1e-9, 0.045, 0.235, 0.649, 1.0] {
        let tissue = Tissue::soft(young_mpa).unwrap();
        for direction in Direction::ALL {
            let (pose, load) = touch(&sensor, &tissue, direction, 30.0);
            let (fine, coarse) =
                (reference.circuit(&pose, &load, &tissue), element.circuit(&pose, &load, &tissue));
            let shift_error = (coarse.series_resonance_hz - element.no_load_hz())
                - (fine.series_resonance_hz - reference.no_load_hz());
            assert!(shift_error.abs() < 0.35, "{young_mpa} MPa {direction:?}: {shift_error}");
            for (what, found, expected) in [
                ("q", coarse.q, fine.q),
                ("capacitance", coarse.capacitance_f, fine.capacitance_f),
                ("ratio", coarse.capacitance_ratio, fine.capacitance_ratio),
                ("loss", coarse.dielectric_loss, fine.dielectric_loss),
            ] {
                let error = found / expected - 1.0;
                assert!(error.abs() < 0.01, "{young_mpa} MPa {direction:?} {what}: {error}");
            }
        }
    }
}

fn worst_over_window(
    reference: &Reference,
    circuit: &Circuit,
    pose: &Pose,
    load: &Load,
    tissue: &Tissue,
) -> f64 {
    (-20..=20).fold(0.0, |worst, step| {
        let frequency = circuit.series_resonance_hz * (1.0 + f64::from(step) / 100.0);
        let expected = reference.admittance_s(pose, load, tissue, frequency);
        let scale = expected.norm() + TAU * frequency * circuit.capacitance_f;
        let error = (circuit.admittance_s(frequency) - expected).norm() / scale;
        f64::max(worst, error)
    })
}
