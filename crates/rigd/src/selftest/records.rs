//! What the calibrations of a bench show, as checks of a self-test.

use rig_commission::{Basis, Calibration, Kind, holding};

use super::{Check, Quantity};

/// A value of a calibration.
struct Row {
    kind: Kind,
    /// Its name in the record.
    value: &'static str,
    /// The check in words.
    check: &'static str,
    limit: f64,
    unit: &'static str,
    /// Whether the uncertainty is what is limited.
    is_uncertainty: bool,
}

const fn row(
    kind: Kind,
    value: &'static str,
    check: &'static str,
    limit: f64,
    unit: &'static str,
) -> Row {
    Row { kind, value, check, limit, unit, is_uncertainty: false }
}

const fn uncertainty(
    kind: Kind,
    value: &'static str,
    check: &'static str,
    limit: f64,
    unit: &'static str,
) -> Row {
    Row { is_uncertainty: true, ..row(kind, value, check, limit, unit) }
}

/// What belongs to motion. The limits are those of the steps of commissioning.
const MOTION: [Row; 2] = [
    row(Kind::Homing, "linear.homing", "linear stage after its power was off", 0.005, "mm"),
    row(Kind::Homing, "rotary.homing", "rotary stage after its power was off", 0.02, "°"),
];

/// What belongs to metrology. Of a length by touches, a tenth of what a rule shows is enough for a search.
const METROLOGY: [Row; 10] = [
    row(Kind::Touches, "touches.scatter", "scatter of a touch on a block", 0.025, "mm"),
    row(Kind::Touches, "touches.trend", "trend of ten touches", 0.025, "mm"),
    uncertainty(Kind::Blocks, "geometry.surface_mm", "uncertainty of the surface", 0.05, "mm"),
    uncertainty(
        Kind::Blocks,
        "geometry.surface_above_pivot_mm",
        "uncertainty of the rotary axis",
        0.05,
        "mm",
    ),
    uncertainty(
        Kind::Blocks,
        "geometry.probe_beside_pivot_mm",
        "uncertainty of the probe beside it",
        0.1,
        "mm",
    ),
    uncertainty(
        Kind::Pin,
        "geometry.probe_radius_mm",
        "uncertainty of the radius of the ball",
        0.025,
        "mm",
    ),
    uncertainty(Kind::Latency, "analyzer.latency_s", "uncertainty of the latency", 0.003, "s"),
    row(Kind::Sensor, "sensor.drift", "drift of the free sensor", 1.0, "Hz/h"),
    row(Kind::Sensor, "sensor.level", "shift from the lowest level to the highest", 0.2, "Hz"),
    row(Kind::Sensor, "sensor.loss", "dielectric loss of the sensor", 0.05, "1"),
];

/// The checks of motion.
pub(crate) fn of_motion(records: &[Calibration], basis: &Basis, unix_s: i64) -> Vec<Check> {
    let kinds = [Kind::Limits, Kind::Homing];
    of(&kinds, &MOTION, (records, basis, unix_s))
}

/// The checks of metrology.
pub(crate) fn of_metrology(records: &[Calibration], basis: &Basis, unix_s: i64) -> Vec<Check> {
    let kinds = [Kind::Touches, Kind::Blocks, Kind::Pin, Kind::Latency, Kind::Sensor];
    of(&kinds, &METROLOGY, (records, basis, unix_s))
}

fn of(
    kinds: &[Kind],
    rows: &[Row],
    (records, basis, unix_s): (&[Calibration], &Basis, i64),
) -> Vec<Check> {
    let mut checks = Vec::new();
    for &kind in kinds {
        match holding(kind, records, basis, unix_s) {
            Err(why) => {
                let text = format!("no record that holds: {}", why.text());
                checks.push(Check::problem("calibrations", kind.name(), text, how(kind)));
            }
            Ok(record) => {
                let made = format!("accepted {}, {}", record.made(), record.person());
                checks.push(Check::fact("calibrations", kind.name(), made));
                let of_kind = rows.iter().filter(|row| row.kind == kind);
                checks.extend(of_kind.filter_map(|row| quantity(row, record)));
            }
        }
    }
    checks
}

fn quantity(row: &Row, record: &Calibration) -> Option<Check> {
    let found = record.values.iter().find(|value| value.name == row.value)?;
    let (value, uncertainty) = if row.is_uncertainty {
        (found.standard_uncertainty, None)
    } else {
        (found.value.abs(), Some(found.standard_uncertainty))
    };
    let quantity = Quantity { value, uncertainty, limit: row.limit, unit: row.unit };
    Some(Check::quantity("calibrations", row.check, quantity, row.kind.remedy()))
}

/// How a record is made.
const fn how(kind: Kind) -> &'static str {
    match kind {
        Kind::Touches => {
            "put the block in place, `rigd run config/protocols/touches.toml`, then `rigd commission touches latest`"
        }
        Kind::Blocks => {
            "put the block in place, `rigd run config/protocols/block.toml`, then `rigd commission blocks latest`"
        }
        Kind::Latency => {
            "put a sample in place, `rigd run config/protocols/latency.toml`, then `rigd commission latency latest`; a rig whose \
             protocols find surfaces in steps needs none"
        }
        Kind::Pin => {
            "put the pin in place, add its pin_radius_mm to a copy of the rig file, `rigd run config/protocols/pin.toml --rig COPY`, \
             then `rigd commission pin latest --pin-radius-mm RADIUS`"
        }
        Kind::Sensor => "`rigd commission sensor`",
        _ => "`rigd commission` asks for what is missing",
    }
}

#[cfg(test)]
mod tests {
    use rig_commission::{Circumstances, Finding, Value};
    use rig_files::rig_file::RigFile;

    use super::*;
    use crate::doctor::Level;

    #[test]
    fn a_record_that_is_missing_is_a_problem_and_a_value_beyond_its_limit_too() {
        let text = include_str!("../../../../config/rigs/simulated.toml");
        let basis = Basis::of(&RigFile::read("rig.toml", text).unwrap(), [None, None]);
        let value = |name, value| Value { name, value, standard_uncertainty: 0.001, unit: "mm" };
        let values = vec![value("touches.scatter", 0.03), value("touches.trend", -0.002)];
        let around = Circumstances {
            sequence: 1,
            unix_s: 10,
            made: "2026-11-26T00:00:00Z".to_owned(),
            person: "ada".to_owned(),
            software: "rigd 0".to_owned(),
            journal: Vec::new(),
            temperature_c: None,
        };
        let finding = Finding::of(values, Vec::new());
        let records = [Calibration::new(Kind::Touches, finding, &basis, around)];
        let checks = of_metrology(&records, &basis, 11);
        let said: Vec<_> = checks.iter().map(|check| (check.name.as_str(), check.level)).collect();
        assert_eq!(
            said,
            [
                ("touches", Level::Ok),
                ("scatter of a touch on a block", Level::Problem),
                ("trend of ten touches", Level::Ok),
                ("blocks", Level::Problem),
                ("pin", Level::Problem),
                ("latency", Level::Problem),
                ("sensor", Level::Problem),
            ]
        );
        assert!(checks[3].advice.unwrap().contains("block.toml"));
        assert!(of_motion(&[], &basis, 11).iter().all(|check| check.level == Level::Problem));
    }
}
