//! Who an instrument says it is.

use std::fmt;

/// The answer to `*IDN?`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Identity {
    /// Who made it.
    pub manufacturer: String,
    /// Which model.
    pub model: String,
    /// Which one of them, if it says so.
    pub serial: Option<String>,
    /// Version of its firmware, if it says so.
    pub firmware: Option<String>,
}

impl From<rig_scpi::Identity> for Identity {
    fn from(found: rig_scpi::Identity) -> Self {
        let rig_scpi::Identity { manufacturer, model, serial, firmware } = found;
        Self { manufacturer, model, serial, firmware }
    }
}

impl fmt::Display for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.manufacturer, self.model)?;
        if let Some(serial) = &self.serial {
            write!(f, ", serial number {serial}")?;
        }
        if let Some(firmware) = &self.firmware {
            write!(f, ", firmware {firmware}")?;
        }
        Ok(())
    }
}
