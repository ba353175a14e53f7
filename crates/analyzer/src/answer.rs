//! Numbers in answers.

use rig_model::ReadingFlag;

/// What one trigger measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Impedance {
    pub(crate) resistance_ohm: f64,
    pub(crate) reactance_ohm: f64,
    pub(crate) flag: ReadingFlag,
}

impl Impedance {
    /// There is no value, and nothing that could be mistaken for one.
    pub(crate) const fn overloaded() -> Self {
        let flag = ReadingFlag::Overload;
        Self { resistance_ohm: f64::NAN, reactance_ohm: f64::NAN, flag }
    }
}

/// Above this, numbers stand for what is not a number: 9.9E37 and 9.91E37.
const SENTINEL: f64 = 9.8e37;

/// A finite number that stands for itself.
pub(crate) fn real(text: &str) -> Option<f64> {
    let is_plain = text.bytes().all(|b| b.is_ascii_digit() || b"+-.eE".contains(&b));
    let value = text.parse::<f64>().ok()?;
    (is_plain && value.abs() < SENTINEL).then_some(value)
}
