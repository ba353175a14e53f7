//! The keys of the integration and of the answer of an analyzer.

use super::{
    dialect::{AnswerField, AnswerForm, CyclesRule, IntegrationRule, StatusMeaning, StatusWords},
    fault::InstrumentFault,
};
use crate::settings::{Setting, Table};

/// Reads the cycles of one measurement.
pub(super) fn integration(table: &mut Table<'_>) -> IntegrationRule {
    let averages_max = table.count("averages_max").range(1..=100_000).required().value;
    let cycles = table.count("cycles").range(1..=10_000).optional();
    let times = table.section("times", time).list().at_most(100).optional();
    let cycles = match (cycles, times) {
        (Some(cycles), None) => CyclesRule::Fixed(cycles.value),
        (None, Some(times)) => CyclesRule::Times(rising(table, &times)),
        _ => {
            if table.is_there() {
                table.refuse(table.location(), &InstrumentFault::Integration);
            }
            CyclesRule::Fixed(1)
        }
    };
    IntegrationRule { averages_max, cycles }
}

fn time(table: &mut Table<'_>) -> (f64, f64) {
    let frequency_hz = table.number("frequency_hz").above(0.0).required().value;
    (frequency_hz, table.number("time_s").above(0.0).required().value)
}

fn rising(table: &Table<'_>, times: &Setting<Vec<Setting<(f64, f64)>>>) -> Vec<(f64, f64)> {
    let list: Vec<_> = times.value.iter().map(|time| time.value).collect();
    let is_rising = list.len() >= 2 && list.windows(2).all(|pair| pair[0].0 < pair[1].0);
    if times.sound().is_some() && !is_rising {
        table.refuse(times, &InstrumentFault::Times(list.len()));
    }
    list
}

const FIELDS: [(&str, AnswerField); 9] = [
    ("ignored", AnswerField::Ignored),
    ("resistance_ohm", AnswerField::Resistance),
    ("reactance_ohm", AnswerField::Reactance),
    ("impedance_ohm", AnswerField::Impedance),
    ("phase_deg", AnswerField::PhaseDeg),
    ("phase_rad", AnswerField::PhaseRad),
    ("conductance_s", AnswerField::Conductance),
    ("susceptance_s", AnswerField::Susceptance),
    ("status", AnswerField::Status),
];

/// Reads the fields of the answer.
pub(super) fn answer(table: &mut Table<'_>) -> AnswerForm {
    let fields = table.choice("fields", FIELDS).list().at_most(20).required();
    let spare_fields = table.count("spare_fields").at_most(20).or(0).value;
    let status = table.section("status", status).optional();
    let list: Vec<_> = fields.value.iter().map(|field| field.value).collect();
    if fields.sound().is_some() && fields.value.iter().all(|field| field.sound().is_some()) {
        impedance(table, &fields, &list);
        match (&status, list.contains(&AnswerField::Status)) {
            (None, true) => table.refuse(&fields, &InstrumentFault::NoStatusWords),
            (Some(status), false) => table.refuse(status, &InstrumentFault::NoStatusField),
            _ => {}
        }
    }
    let spare_fields = usize::try_from(spare_fields).unwrap_or(usize::MAX);
    AnswerForm { fields: list, spare_fields, status: status.map(|status| status.value) }
}

/// Checks that the fields have one impedance.
fn impedance(table: &Table<'_>, fields: &Setting<Vec<Setting<AnswerField>>>, list: &[AnswerField]) {
    use AnswerField as F;
    for (word, field) in FIELDS {
        let count = list.iter().filter(|known| **known == field).count();
        if count > 1 && field != F::Ignored {
            table.refuse(fields, &InstrumentFault::FieldTwice(word));
        }
    }
    let pairs = [
        (F::Resistance, F::Reactance),
        (F::Impedance, F::PhaseDeg),
        (F::Impedance, F::PhaseRad),
        (F::Conductance, F::Susceptance),
    ];
    let is_value = |field: &&F| !matches!(field, F::Status | F::Ignored);
    let values: Vec<_> = list.iter().filter(is_value).collect();
    let is_pair = |(a, b): &(F, F)| values.len() == 2 && values.contains(&a) && values.contains(&b);
    if !pairs.iter().any(is_pair) {
        table.refuse(fields, &InstrumentFault::NoImpedance);
    }
}

fn status(table: &mut Table<'_>) -> StatusWords {
    let keys = [
        ("pending", StatusMeaning::Pending),
        ("sound", StatusMeaning::Sound),
        ("low_signal", StatusMeaning::LowSignal),
        ("overload", StatusMeaning::Overload),
    ];
    let mut words: Vec<(i64, StatusMeaning)> = Vec::new();
    for (key, meaning) in keys {
        let Some(list) = table.integer(key).list().optional() else { continue };
        for word in &list.value {
            if words.iter().any(|(known, _)| *known == i64::from(word.value)) {
                table.refuse(word, &InstrumentFault::TwoMeanings { word: word.value });
            }
            words.push((word.value.into(), meaning));
        }
    }
    let others = [("overload", StatusMeaning::Overload), ("low-signal", StatusMeaning::LowSignal)];
    let other = table.choice("other", others).or(StatusMeaning::Overload).value;
    StatusWords { words, other }
}
