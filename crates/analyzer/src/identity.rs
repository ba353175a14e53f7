//! Who an instrument says it is.

use std::fmt;

/// The answer to `*IDN?`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Identity {
    /// Who made it.
    pub manufacturer: String,
    /// Which model.
    pub model: String,
    /// Which one of them; instruments without a number say `0`.
    pub serial: String,
    /// Version of its firmware.
    pub firmware: String,
}

impl Identity {
    /// Reads the four fields that IEEE 488.2 (10.14) prescribes.
    pub(crate) fn parse(answer: &str) -> Option<Self> {
        let fields: Vec<&str> = answer.splitn(4, ',').map(str::trim).collect();
        let [manufacturer, model, serial, firmware] = fields[..] else { return None };
        let is_named = !manufacturer.is_empty() && !model.is_empty();
        is_named.then(|| Self {
            manufacturer: manufacturer.to_owned(),
            model: model.to_owned(),
            serial: serial.to_owned(),
            firmware: firmware.to_owned(),
        })
    }
}

impl fmt::Display for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { manufacturer, model, serial, firmware } = self;
        write!(f, "{manufacturer} {model}, serial number {serial}, firmware {firmware}")
    }
}
