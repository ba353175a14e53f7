//! The answer to a measurement, by the fields of an instrument file.

use rig_files::instrument::dialect::{AnswerField, AnswerForm, StatusMeaning};
use rig_model::{Impedance, PointResult, ReadingFlag};
use rig_scpi::{DataError, Datum};

use crate::point::measured;

/// Two fields, and the impedance that they make.
type Pair = (AnswerField, AnswerField, fn(f64, f64) -> Impedance);

/// Reads an answer. `None` while the measurement is under way.
///
/// # Errors
/// [`DataError`] when it has other fields than the form.
pub(crate) fn reading(data: &[Datum], form: &AnswerForm) -> Result<Option<PointResult>, DataError> {
    let (expected, found) = (form.fields.len(), data.len());
    if found < expected || expected + form.spare_fields < found {
        return Err(DataError::FieldCount { expected, found });
    }
    let at = |wanted: AnswerField| {
        let index = form.fields.iter().position(|field| *field == wanted)?;
        data.get(index)
    };
    let flag = match (at(AnswerField::Status), &form.status) {
        (Some(status), Some(words)) => match words.meaning(status.integer()?) {
            StatusMeaning::Pending => return Ok(None),
            StatusMeaning::Sound => None,
            StatusMeaning::Overload => Some(ReadingFlag::Overload),
            StatusMeaning::LowSignal => Some(ReadingFlag::LowSignal),
        },
        _ => None,
    };
    let pairs: [Pair; 4] = [
        (AnswerField::Resistance, AnswerField::Reactance, cartesian),
        (AnswerField::Impedance, AnswerField::PhaseRad, polar),
        (AnswerField::Impedance, AnswerField::PhaseDeg, |ohm, deg| polar(ohm, deg.to_radians())),
        (AnswerField::Conductance, AnswerField::Susceptance, inverse),
    ];
    for (first, second, impedance) in pairs {
        if let (Some(first), Some(second)) = (at(first), at(second)) {
            let result = measured(first, second, flag)?;
            return Ok(Some(converted(result, impedance)));
        }
    }
    Err(DataError::FieldCount { expected, found })
}

/// A result whose two numbers are not resistance and reactance. One without a finite impedance, such as
/// the inverse of an admittance of zero, has no value.
fn converted(result: PointResult, impedance: fn(f64, f64) -> Impedance) -> PointResult {
    let of = |raw: Impedance| {
        let value = impedance(raw.resistance_ohm, raw.reactance_ohm);
        (value.resistance_ohm.is_finite() && value.reactance_ohm.is_finite()).then_some(value)
    };
    match result {
        PointResult::Value(raw) => of(raw).map_or(PointResult::Overload, PointResult::Value),
        PointResult::LowSignal(raw) => {
            of(raw).map_or(PointResult::Overload, PointResult::LowSignal)
        }
        PointResult::Overload => PointResult::Overload,
    }
}

const fn cartesian(resistance_ohm: f64, reactance_ohm: f64) -> Impedance {
    Impedance { resistance_ohm, reactance_ohm }
}

fn polar(ohm: f64, rad: f64) -> Impedance {
    Impedance { resistance_ohm: ohm * rad.cos(), reactance_ohm: ohm * rad.sin() }
}

fn inverse(conductance_s: f64, susceptance_s: f64) -> Impedance {
    let square = conductance_s * conductance_s + susceptance_s * susceptance_s;
    Impedance { resistance_ohm: conductance_s / square, reactance_ohm: -susceptance_s / square }
}

#[cfg(test)]
mod tests {
    use rig_files::instrument::dialect::StatusWords;

    use super::*;

    fn form(fields: &[AnswerField]) -> AnswerForm {
        let words = vec![
            (-1, StatusMeaning::Pending),
            (0, StatusMeaning::Sound),
            (1, StatusMeaning::Overload),
        ];
        let status = Some(StatusWords { words, other: StatusMeaning::LowSignal });
        AnswerForm { fields: fields.to_vec(), spare_fields: 1, status }
    }

    const CARTESIAN: [AnswerField; 3] =
        [AnswerField::Resistance, AnswerField::Reactance, AnswerField::Status];

    #[test]
    fn the_status_says_whether_there_is_a_value() {
        let data = |status| [Datum::Real(1.0), Datum::Real(2.0), Datum::Integer(status)];
        let value = Impedance { resistance_ohm: 1.0, reactance_ohm: 2.0 };
        let form = form(&CARTESIAN);
        let read = |status| reading(&data(status), &form).unwrap();
        assert_eq!(read(-1), None);
        assert_eq!(read(0), Some(PointResult::Value(value)));
        assert_eq!(read(1), Some(PointResult::Overload));
        assert_eq!(read(4), Some(PointResult::LowSignal(value)));
        assert!(reading(&data(0)[..2], &form).is_err());
        let with = |spare: usize| [data(0).to_vec(), vec![Datum::Integer(7); spare]].concat();
        assert!(reading(&with(1), &form).is_ok());
        assert!(reading(&with(2), &form).is_err());
    }

    #[test]
    fn every_pair_gives_the_same_impedance() {
        // 3 − 4i Ω has the admittance 0.12 + 0.16i S.
        let angle = (-4.0_f64).atan2(3.0);
        let rows = [
            (AnswerField::Resistance, 3.0, AnswerField::Reactance, -4.0),
            (AnswerField::Impedance, 5.0, AnswerField::PhaseRad, angle),
            (AnswerField::Impedance, 5.0, AnswerField::PhaseDeg, angle.to_degrees()),
            (AnswerField::Conductance, 0.12, AnswerField::Susceptance, 0.16),
        ];
        for (first, a, second, b) in rows {
            let form = form(&[AnswerField::Ignored, second, AnswerField::Status, first]);
            let data = [Datum::Integer(9), Datum::Real(b), Datum::Integer(0), Datum::Real(a)];
            let Some(PointResult::Value(found)) = reading(&data, &form).unwrap() else {
                panic!("{first:?}: no value")
            };
            assert!((found.resistance_ohm - 3.0).abs() < 1e-12, "{first:?}: {found:?}");
            assert!((found.reactance_ohm + 4.0).abs() < 1e-12, "{first:?}: {found:?}");
        }
        let form = form(&[AnswerField::Conductance, AnswerField::Susceptance, AnswerField::Status]);
        let zero = [Datum::Real(0.0), Datum::Real(0.0), Datum::Integer(0)];
        assert_eq!(reading(&zero, &form), Ok(Some(PointResult::Overload)));
    }
}
