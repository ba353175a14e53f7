//! The identity and the errors that an instrument reports.

use std::fmt;

use crate::controller::response::{DataError, Response};

/// The answer to `*IDN?`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Identity {
    /// Name of the manufacturer.
    pub manufacturer: String,
    /// Name of the model.
    pub model: String,
    /// Serial number; `None` if the instrument answers `0` or nothing.
    pub serial: Option<String>,
    /// Version of the firmware, with options; `None` if the instrument answers `0` or nothing.
    pub firmware: Option<String>,
}

impl Identity {
    /// Reads four fields with commas between them. Everything behind the third comma is the firmware.
    ///
    /// # Errors
    /// [`DataError::FieldCount`] when there is no model, [`DataError::Malformed`] beyond ASCII.
    pub fn parse(response: &Response) -> Result<Self, DataError> {
        let text = response.text()?;
        let mut fields = text.splitn(4, ',').map(|field| field.trim().to_owned());
        let known = |field: Option<String>| field.filter(|field| !field.is_empty() && field != "0");
        match (fields.next().filter(|field| !field.is_empty()), fields.next()) {
            (Some(manufacturer), Some(model)) => Ok(Self {
                manufacturer,
                model,
                serial: known(fields.next()),
                firmware: known(fields.next()),
            }),
            (first, _) => {
                Err(DataError::FieldCount { expected: 4, found: usize::from(first.is_some()) })
            }
        }
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

/// One entry of the error queue of an instrument, as `SYSTem:ERRor?` answers it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ErrorReport {
    /// The number; negative for errors of the standard, positive for those of the device.
    pub number: i64,
    /// The text that belongs to the number.
    pub text: String,
    /// Device-dependent information behind a semicolon.
    pub info: Option<String>,
}

impl ErrorReport {
    /// Reads `-113,"Undefined header;FOO"`. `None` when the queue is empty: `+0,"No error"`.
    ///
    /// # Errors
    /// As [`Response::data`], and by type and number of the fields.
    pub fn parse(response: &Response) -> Result<Option<Self>, DataError> {
        let data = response.data()?;
        let [number, description] = &*data else {
            return Err(DataError::FieldCount { expected: 2, found: data.len() });
        };
        let (number, description) = (number.integer()?, description.text()?);
        if number == 0 {
            return Ok(None);
        }
        let (text, info) = match description.split_once(';') {
            Some((text, info)) => (text, Some(info.to_owned())),
            None => (description, None),
        };
        Ok(Some(Self { number, text: text.to_owned(), info }))
    }
}
