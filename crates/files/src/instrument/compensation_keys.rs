//! The keys of the corrections for cable and fixture.

use super::{
    dialect::{CableLength, Compensation, Correction},
    dialect_keys::{required_message, setting},
    template::Quantity,
};
use crate::settings::Table;

/// Reads the corrections for cable and fixture.
pub(super) fn compensation(table: &mut Table<'_>) -> Compensation {
    Compensation {
        cable: table.section("cable", cable).optional().map(|cable| cable.value),
        open: table.section("open", correction).required().value,
        short: table.section("short", correction).required().value,
        load: table.section("load", correction).optional().map(|load| load.value),
    }
}

fn cable(table: &mut Table<'_>) -> CableLength {
    let set = setting(table, "set", Quantity::Cable);
    let ask = required_message(table, "ask", &[], 1);
    let lengths = table.number("lengths_m").range(0.0..=100.0).list().required().value;
    CableLength { set, ask, lengths_m: lengths.into_iter().map(|length| length.value).collect() }
}

fn correction(table: &mut Table<'_>) -> Correction {
    Correction {
        measure: required_message(table, "measure", &[], 0),
        within_s: table.number("within_s").range(1.0..=3600.0).required().value,
        switch_on: required_message(table, "switch_on", &[], 0),
        state: required_message(table, "state", &[], 1),
    }
}
