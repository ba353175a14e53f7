use std::fmt::Write as _;

use super::*;

fn required(young_mpa: f64, deepest: Depth, tilt_deg: f64, needs_impedance: bool) -> Requirements {
    Requirements {
        sensor: Sensor::reference(),
        stiffest: Tissue::soft(young_mpa).unwrap(),
        deepest,
        tilt_max_rad: f64::to_radians(tilt_deg),
        needs_impedance,
    }
}

/// The measured errors rounded up to a millihertz.
fn rounded_up(table: &ErrorTable) -> ErrorTable {
    let mut rounded = *table;
    for value in rounded.0.as_flattened_mut().as_flattened_mut().as_flattened_mut() {
        *value = (*value * 1e3).ceil() * 1e-3;
    }
    rounded
}

/// The table in the form of `choice/stored.rs`.
fn source(table: &ErrorTable) -> String {
    let mut text = String::new();
    for (tier, controls) in Tier::ALL.into_iter().zip(&table.0) {
        writeln!(text, "    // {}: indentation, then stage.\n    [", tier.name()).unwrap();
        let cell = |v: f64| if v.is_finite() { format!("{v:.3}") } else { "NEVER".into() };
        for cells in controls {
            let first = cells[0][0];
            if cells.as_flattened().iter().all(|&value| value == first) {
                writeln!(text, "        [[{}; 5]; 4],", cell(first)).unwrap();
                continue;
            }
            text.push_str("        [\n");
            for tilt in cells {
                writeln!(text, "            [{}],", tilt.map(cell).join(", ")).unwrap();
            }
            text.push_str("        ],\n");
        }
        text.push_str("    ],\n");
    }
    text
}

#[test]
fn the_stored_errors_are_those_measured_anew() {
    let measured = rounded_up(&ErrorTable::measure(&Sensor::reference()));
    let flat = |table: &ErrorTable| table.0.as_flattened().as_flattened().as_flattened().to_vec();
    for (found, stored) in flat(&measured).into_iter().zip(flat(&stored::REFERENCE)) {
        // One unit of the rounding may differ with the platform's sine.
        let is_same = found == stored || (found - stored).abs() < 1.1e-3;
        assert!(
            is_same,
            "{found} is not the stored {stored}; the table now:\n{}",
            source(&measured)
        );
    }
}

#[track_caller]
fn check(required: &Requirements, tolerance_hz: f64, expected: Tier) {
    let choice = Tier::cheapest_for(required, tolerance_hz).unwrap();
    assert_eq!(choice.tier, expected, "{choice}");
    assert!(choice.error_hz <= tolerance_hz, "{choice}");
}

#[test]
fn a_scene_gets_the_cheapest_tier_that_is_good_enough() {
    let sunk = Depth::Indentation { along_probe_mm: 0.5 };
    let moved = Depth::Stage { along_probe_mm: 0.5 };
    check(&required(0.649, sunk, 0.0, false), 10.0, Tier::T0);
    check(&required(0.649, sunk, 0.0, false), 1.0, Tier::T1);
    check(&required(0.649, sunk, 45.0, false), 1.0, Tier::T2);
    check(&required(0.649, sunk, 45.0, false), 0.3, Tier::E1);
    check(&required(0.649, moved, 45.0, false), 1.0, Tier::T2s);
    check(&required(0.649, moved, 45.0, true), 1.0, Tier::E1s);
    check(&required(0.649, moved, 45.0, false), 0.05, Tier::Exact);
    check(&required(0.649, moved, 45.0, true), 0.05, Tier::Reference);
    check(&required(0.649, moved, 45.0, false), 0.0, Tier::Reference);
}

/// Just inside and just outside of a cell's error, tilt and stiffness.
#[test]
fn the_choice_changes_at_the_edges_of_its_cell() {
    let sunk = Depth::Indentation { along_probe_mm: 0.5 };
    let tilted = required(0.6, sunk, 45.0, false);
    let error = Tier::cheapest_for(&tilted, 1.0).unwrap().error_hz;
    check(&tilted, error, Tier::T2);
    check(&tilted, error - 1e-9, Tier::E1);
    check(&required(0.6, sunk, 45.001, false), 1.0, Tier::Reference);
    check(&required(3.0, sunk, 45.0, false), 2.0, Tier::E1);
    check(&required(3.2, sunk, 45.0, false), 2.0, Tier::Reference);
}

#[test]
fn a_scene_deeper_than_the_series_gets_the_exact_contact() {
    let law = |along_probe_mm| {
        let deepest = Depth::Indentation { along_probe_mm };
        Tier::cheapest_for(&required(0.1, deepest, 0.0, false), 1.0).map(|choice| choice.law)
    };
    assert_eq!(law(0.5), Ok(ContactLaw::SneddonSeries));
    assert_eq!(law(0.501), Ok(ContactLaw::Sneddon));
    assert!(law(1.001).is_err());
}

#[test]
fn another_sensor_is_measured_and_says_why() {
    let design = SensorDesign { length_mm: 20.0, ..SensorDesign::reference() };
    let mut short = required(0.649, Depth::Stage { along_probe_mm: 0.5 }, 45.0, true);
    short.sensor = Sensor::new(design).unwrap();
    let choice = Tier::cheapest_for(&short, 0.5).unwrap();
    assert_eq!(choice.tier, Tier::E1s);
    assert!(choice.to_string().starts_with("tier E1s with sneddon-series contact: within 0."));
}
