use super::*;
use crate::{Contact, Depth, Direction};

fn reference() -> (Sensor, Element) {
    let sensor = Sensor::reference();
    (sensor, Element::new(&sensor))
}

fn touch(young_mpa: f64, direction: Direction, degrees: f64, depth: Depth) -> (Tissue, Contact) {
    let pose = Pose::leaning(direction, f64::to_radians(degrees)).unwrap();
    (Tissue::soft(young_mpa).unwrap(), Contact::new(pose, depth))
}

const HALF_MM: Depth = Depth::Indentation { along_probe_mm: 0.5 };

/// The load of a touch without its force, which other programs leave out.
fn forceless(sensor: &Sensor, tissue: &Tissue, contact: &Contact) -> Load {
    Load { force_n: 0.0, ..sensor.load(tissue, contact).unwrap() }
}

/// Values from a finite-element program of its own with one element of five motions at its end.
#[test]
fn the_reference_sensor_with_one_element() {
    let (sensor, element) = reference();
    assert!((element.no_load_hz() - 140.453_398_638).abs() < 1e-6, "{}", element.no_load_hz());
    for (young_mpa, shift) in
        [(0.045, 7.992), (0.104, 17.846), (0.235, 37.734), (0.320, 49.491), (0.649, 89.176)]
    {
        let (tissue, contact) = touch(young_mpa, Direction::Front, 0.0, HALF_MM);
        let load = forceless(&sensor, &tissue, &contact);
        let found = element.shift_hz(&contact.pose, &load);
        assert!((found - shift).abs() < 5e-4, "{young_mpa} MPa: {found}");
    }
}

/// Shifts of sample 5 by sixteen elements of five motions, at 0°, 15°, 30° and 45°.
#[test]
fn every_direction_agrees_with_many_elements_within_three_tenths_of_a_hertz() {
    let (sensor, element) = reference();
    let rows = [
        (Direction::Front, [88.986, 89.825, 85.756, 76.815]),
        (Direction::Back, [88.986, 83.853, 75.652, 65.850]),
        (Direction::Left, [88.986, 86.676, 80.116, 70.219]),
    ];
    for (direction, shifts) in rows {
        for (degrees, expected) in [0.0, 15.0, 30.0, 45.0].into_iter().zip(shifts) {
            let (tissue, contact) = touch(0.649, direction, degrees, HALF_MM);
            let load = forceless(&sensor, &tissue, &contact);
            let found = element.shift_hz(&contact.pose, &load);
            assert!((found - expected).abs() < 0.3, "{direction:?} {degrees}°: {found}");
        }
    }
}

#[test]
fn no_contact_is_exactly_the_free_sensor() {
    let (sensor, element) = reference();
    for depth in [0.0, -1.0] {
        for depth in
            [Depth::Indentation { along_probe_mm: depth }, Depth::Stage { along_probe_mm: depth }]
        {
            let (tissue, contact) = touch(0.649, Direction::Left, 45.0, depth);
            let load = sensor.load(&tissue, &contact).unwrap();
            assert_eq!(element.shift_hz(&contact.pose, &load), 0.0);
            assert_eq!(element.circuit(&contact.pose, &load, &tissue), element.free_circuit());
        }
    }
    assert!(
        sensor
            .load(
                &Tissue::soft(0.1).unwrap(),
                &Contact::new(Pose::UPRIGHT, Depth::Stage { along_probe_mm: f64::NAN })
            )
            .is_err()
    );
}

#[test]
fn the_shift_is_proportional_to_the_stiffness_down_to_the_smallest() {
    let (sensor, element) = reference();
    let section = sensor.section();
    for direction in Direction::ALL {
        let pose = Pose::leaning(direction, 0.6).unwrap();
        let load = |normal: f64| Load {
            depth_mm: 0.0,
            radius_mm: 0.0,
            force_n: 0.0,
            normal_n_per_m: normal,
            tangential_n_per_m: normal * 2.0 / 3.0,
        };
        let stiffness = 3.0 * section.bending_n_m2 / section.length_m.powi(3);
        let slope = element.shift_hz(&pose, &load(1e-9 * stiffness)) / 1e-9;
        for exponent in 10..=300 {
            let ratio = 10.0_f64.powi(-exponent);
            let found = element.shift_hz(&pose, &load(ratio * stiffness)) / ratio;
            assert!((found / slope - 1.0).abs() < 2e-9, "1e-{exponent}: {found} against {slope}");
        }
    }
}

#[test]
fn the_circuit_has_the_shift_and_the_losses_of_its_parts() {
    let (sensor, element) = reference();
    let free = element.free_circuit();
    let coupling = |of: &Circuit| of.capacitance_ratio / (1.0 + of.capacitance_ratio);
    assert!((free.series_resonance_hz - element.no_load_hz()).abs() < 1e-9);
    assert!((free.q * sensor.design().beam_loss - 1.0).abs() < 1e-9, "{free:?}");
    assert!((coupling(&free) - 0.075).abs() < 0.005, "{free:?}");
    let (tissue, contact) = touch(0.649, Direction::Front, 0.0, HALF_MM);
    let load = sensor.load(&tissue, &contact).unwrap();
    let circuit = element.circuit(&contact.pose, &load, &tissue);
    let shift = circuit.series_resonance_hz - free.series_resonance_hz;
    assert!((shift - element.shift_hz(&contact.pose, &load)).abs() < 0.1, "{circuit:?}");
    // Most of the strain energy is now the tissue's, with its loss factor of 0.1.
    assert!(10.0 < circuit.q && circuit.q < 20.0, "{circuit:?}");
    assert!((coupling(&circuit) - 0.025).abs() < 0.005, "{circuit:?}");
}

#[test]
fn a_stage_move_indents_a_stiff_sample_less() {
    let (sensor, element) = reference();
    let shift = |depth| {
        let (tissue, contact) = touch(0.649, Direction::Front, 0.0, depth);
        let load = sensor.load(&tissue, &contact).unwrap();
        (load.depth_mm, element.shift_hz(&contact.pose, &load))
    };
    let (_, full) = shift(HALF_MM);
    let (depth, less) = shift(Depth::Stage { along_probe_mm: 0.5 });
    assert!((depth - 0.27).abs() < 0.02, "{depth}");
    assert!((full - less - 14.7).abs() < 0.3, "{}", full - less);
}
