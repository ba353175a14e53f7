//! Numbers that are right in another unit than that of their key.

/// Units that a person may use by mistake: the factor to the unit of the key, and the unit in words.
type OtherUnits = &'static [(f64, &'static str)];

/// The units by the ending of the key. Longer endings come first: `_mm_per_s` also ends in `_s`.
const OTHER_UNITS: [(&str, OtherUnits); 14] = [
    ("_mm_per_s2", &[(1e3, "in m/s²"), (1e-3, "in µm/s²")]),
    ("_mm_per_s", &[(1e3, "in m/s"), (1e-3, "in µm/s"), (1.0 / 60.0, "in mm/min")]),
    ("_per_s", &[]),
    ("_gpa", &[(1e-9, "in Pa"), (1e-3, "in MPa")]),
    ("_kg_per_m3", &[(1e3, "in g/cm³")]),
    ("_nf_per_m", &[(1e9, "in F/m"), (1e-3, "in pF/m")]),
    ("_c_per_m2", &[]),
    ("_mm", &[(1e3, "in metres"), (1e-3, "in micrometres"), (10.0, "in centimetres")]),
    ("_hz", &[(1e3, "in kHz")]),
    ("_mpa", &[(1e-3, "in kPa"), (1e-6, "in Pa")]),
    ("_s", &[(1e-3, "in milliseconds")]),
    ("_v", &[(1e-3, "in mV")]),
    ("_deg", &[]),
    ("_ohm", &[]),
];

/// Units of a number whose key has no unit: it is a share of one.
const SHARE: OtherUnits = &[(0.01, "per cent")];

/// A number that is within this factor of the range was meant in the unit of its key.
const NEAR: f64 = 3.0;
/// The same for a number without a unit.
const NEAR_SHARE: f64 = 1.5;

/// Advice for a number that is far outside its range but right in another unit: `if 0.0005 is in
/// metres, write 0.5`.
pub fn unit_hint(key: &str, found: f64, is_right: impl Fn(f64) -> bool) -> Option<String> {
    let known = OTHER_UNITS.iter().find(|(ending, _)| key.ends_with(ending));
    let units = known.map_or(SHARE, |(_, units)| units);
    let near = if known.is_some() { NEAR } else { NEAR_SHARE };
    if is_right(near * found) || is_right(found / near) {
        return None;
    }
    // Twelve digits: more than a person writes, and fewer than the rounding of a product spoils.
    let meant = |factor: f64| format!("{:.11e}", found * factor).parse::<f64>().ok();
    // A number without a unit is a share only below 1; a count is none.
    let is_right = |meant: f64| is_right(meant) && (known.is_some() || meant < 1.0);
    units.iter().find_map(|&(factor, unit)| {
        let meant = meant(factor).filter(|meant| *meant != 0.0 && is_right(*meant))?;
        Some(format!("if {found} is {unit}, write {meant}"))
    })
}

/// Advice with its hint about the unit, if there is one.
pub(crate) fn with_unit_hint(
    advice: String,
    key: &str,
    found: f64,
    is_right: impl Fn(f64) -> bool,
) -> String {
    match unit_hint(key, found, is_right) {
        Some(hint) => format!("{advice}; {hint}"),
        None => advice,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_that_is_right_in_another_unit_gets_a_hint() {
        #[track_caller]
        fn check(key: &str, found: f64, range: (f64, f64), expected: Option<&str>) {
            let hint = unit_hint(key, found, |meant| range.0 <= meant && meant <= range.1);
            assert_eq!(hint.as_deref(), expected, "{key} = {found}");
        }
        let depth = (0.005, 20.0);
        check("indentation_mm", 0.0005, depth, Some("if 0.0005 is in metres, write 0.5"));
        check("indentation_mm", 500.0, depth, Some("if 500 is in micrometres, write 0.5"));
        check("cycles", 2e6, (1.0, 1e5), None);
        check("indentation_mm", 0.0, depth, None);
        check("indentation_mm", 30.0, depth, None);
        check("indentation_mm", 0.003, depth, None);
        check("indentation_mm", -0.0005, depth, None);
        check("speed_mm_per_s", 0.0007, (0.1, 9.0), Some("if 0.0007 is in m/s, write 0.7"));
        check("settle_s", 500.0, (0.0, 60.0), Some("if 500 is in milliseconds, write 0.5"));
        check("min_hz", 0.125, (20.0, 2000.0), Some("if 0.125 is in kHz, write 125"));
        check("modulus_gpa", 61e9, (0.001, 1500.0), Some("if 61000000000 is in Pa, write 61"));
        check("density_kg_per_m3", 7.75, (100.0, 25e3), Some("if 7.75 is in g/cm³, write 7750"));
        check(
            "permittivity_nf_per_m",
            13e-9,
            (0.01, 200.0),
            Some("if 0.000000013 is in F/m, write 13"),
        );
        check("sample_rel", 3.0, (0.0, 1.0), Some("if 3 is per cent, write 0.03"));
        check("contact_threshold", 7.0, (0.001, 1.0), Some("if 7 is per cent, write 0.07"));
        check("poisson", 0.6, (0.0, 0.5), None);
        check("angle_deg", 700.0, (0.0, 45.0), None);
    }
}
