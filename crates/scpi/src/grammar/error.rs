//! Error numbers of SCPI, their texts and classes, and the queue that holds them.
//!
//! # Source
//! SCPI-99, volume 2, chapter 21 (`:SYSTem:ERRor` numbers and texts); the bits of the event status
//! register are those of IEEE 488.2, 11.5.1.

use std::{collections::VecDeque, fmt};

/// An error as an instrument queues and reports it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ScpiError {
    number: i16,
    own_text: Option<&'static str>,
    info: Option<Box<str>>,
}

impl ScpiError {
    /// The error with a number of the standard, such as −222. A number that the standard does not
    /// name gets the text of its class.
    pub const fn new(number: i16) -> Self {
        Self { number, own_text: None, info: None }
    }

    /// An error of the device itself with its own text. Numbers of devices are positive.
    pub const fn device(number: i16, text: &'static str) -> Self {
        Self { number, own_text: Some(text), info: None }
    }

    /// Adds device-dependent information, which is reported behind the text and a semicolon.
    #[must_use]
    pub(crate) fn with_info(mut self, info: impl Into<Box<str>>) -> Self {
        self.info = Some(info.into());
        self
    }

    /// The number, 0 for "no error".
    pub const fn number(&self) -> i16 {
        self.number
    }

    /// The text that belongs to the number.
    pub fn text(&self) -> &'static str {
        self.own_text.unwrap_or_else(|| standard_text(self.number))
    }

    /// Device-dependent information.
    pub fn info(&self) -> Option<&str> {
        self.info.as_deref()
    }

    /// The class, which names the bit of the event status register. 0 has none.
    pub(crate) const fn class(&self) -> Option<ErrorClass> {
        match self.number {
            0 => None,
            -199..=-100 => Some(ErrorClass::Command),
            -299..=-200 => Some(ErrorClass::Execution),
            -499..=-400 => Some(ErrorClass::Query),
            -599..=-500 => Some(ErrorClass::PowerOn),
            -699..=-600 => Some(ErrorClass::UserRequest),
            -799..=-700 => Some(ErrorClass::RequestControl),
            -899..=-800 => Some(ErrorClass::OperationComplete),
            // −300 to −399, all positive numbers, and numbers that the standard does not define.
            _ => Some(ErrorClass::Device),
        }
    }
}

impl fmt::Display for ScpiError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.number, self.text())?;
        match &self.info {
            Some(info) => write!(f, "; {info}"),
            None => Ok(()),
        }
    }
}

impl std::error::Error for ScpiError {}

/// Classes of errors and events.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ErrorClass {
    /// −1xx: the message was not understood.
    Command,
    /// −2xx: the message was understood and could not be carried out.
    Execution,
    /// −3xx and positive numbers: something in the device.
    Device,
    /// −4xx: the exchange of messages broke its protocol.
    Query,
    /// −5xx: the power came on.
    PowerOn,
    /// −6xx: someone used the front panel.
    UserRequest,
    /// −7xx: the device wants to be the controller.
    RequestControl,
    /// −8xx: all pending operations are complete.
    OperationComplete,
}

impl ErrorClass {
    /// The bit of the event status register, as a mask.
    pub(crate) const fn event_bit(self) -> u8 {
        match self {
            Self::OperationComplete => 0x01,
            Self::RequestControl => 0x02,
            Self::Query => 0x04,
            Self::Device => 0x08,
            Self::Execution => 0x10,
            Self::Command => 0x20,
            Self::UserRequest => 0x40,
            Self::PowerOn => 0x80,
        }
    }
}

/// First in, first out. When it is full, its newest entry is replaced by −350, so the oldest errors,
/// which usually are the cause, survive.
#[derive(Debug, Clone)]
pub(crate) struct ErrorQueue {
    entries: VecDeque<ScpiError>,
    capacity: usize,
}

impl ErrorQueue {
    /// An empty queue for `capacity` errors; the standard asks for at least 2, and so does this.
    pub(crate) fn new(capacity: usize) -> Self {
        let capacity = capacity.max(2);
        Self { entries: VecDeque::new(), capacity }
    }

    /// Queues an error. Returns false when the queue overflowed and holds −350 instead.
    pub(crate) fn push(&mut self, error: ScpiError) -> bool {
        if self.entries.len() < self.capacity {
            self.entries.push_back(error);
            return true;
        }
        if let Some(last) = self.entries.back_mut() {
            *last = ScpiError::new(-350);
        }
        false
    }

    /// Takes the oldest error.
    pub(crate) fn pop(&mut self) -> Option<ScpiError> {
        self.entries.pop_front()
    }

    /// Number of errors in the queue.
    pub(crate) fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether no error waits.
    pub(crate) fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Forgets all errors.
    pub(crate) fn clear(&mut self) {
        self.entries.clear();
    }
}

/// The text of a number, or that of its class.
pub(crate) fn standard_text(number: i16) -> &'static str {
    match STANDARD.binary_search_by(|(known, _)| number.cmp(known)) {
        Ok(index) => STANDARD[index].1,
        Err(_) => match ScpiError::new(number).class() {
            None => "No error",
            Some(ErrorClass::Command) => "Command error",
            Some(ErrorClass::Execution) => "Execution error",
            Some(ErrorClass::Device) => "Device-specific error",
            Some(ErrorClass::Query) => "Query error",
            Some(ErrorClass::PowerOn) => "Power on",
            Some(ErrorClass::UserRequest) => "User request",
            Some(ErrorClass::RequestControl) => "Request control",
            Some(ErrorClass::OperationComplete) => "Operation complete",
        },
    }
}

/// Falling numbers, as the standard lists them.
const STANDARD: &[(i16, &str)] = &[
    (0, "No error"),
    (-100, "Command error"),
    (-101, "Invalid character"),
    (-102, "Syntax error"),
    (-103, "Invalid separator"),
    (-104, "Data type error"),
    (-105, "GET not allowed"),
    (-108, "Parameter not allowed"),
    (-109, "Missing parameter"),
    (-110, "Command header error"),
    (-111, "Header separator error"),
    (-112, "Program mnemonic too long"),
    (-113, "Undefined header"),
    (-114, "Header suffix out of range"),
    (-115, "Unexpected number of parameters"),
    (-120, "Numeric data error"),
    (-121, "Invalid character in number"),
    (-123, "Exponent too large"),
    (-124, "Too many digits"),
    (-128, "Numeric data not allowed"),
    (-130, "Suffix error"),
    (-131, "Invalid suffix"),
    (-134, "Suffix too long"),
    (-138, "Suffix not allowed"),
    (-140, "Character data error"),
    (-141, "Invalid character data"),
    (-144, "Character data too long"),
    (-148, "Character data not allowed"),
    (-150, "String data error"),
    (-151, "Invalid string data"),
    (-158, "String data not allowed"),
    (-160, "Block data error"),
    (-161, "Invalid block data"),
    (-168, "Block data not allowed"),
    (-170, "Expression error"),
    (-171, "Invalid expression"),
    (-178, "Expression data not allowed"),
    (-180, "Macro error"),
    (-181, "Invalid outside macro definition"),
    (-183, "Invalid inside macro definition"),
    (-184, "Macro parameter error"),
    (-200, "Execution error"),
    (-201, "Invalid while in local"),
    (-202, "Settings lost due to rtl"),
    (-203, "Command protected"),
    (-210, "Trigger error"),
    (-211, "Trigger ignored"),
    (-212, "Arm ignored"),
    (-213, "Init ignored"),
    (-214, "Trigger deadlock"),
    (-215, "Arm deadlock"),
    (-220, "Parameter error"),
    (-221, "Settings conflict"),
    (-222, "Data out of range"),
    (-223, "Too much data"),
    (-224, "Illegal parameter value"),
    (-225, "Out of memory"),
    (-226, "Lists not same length"),
    (-230, "Data corrupt or stale"),
    (-231, "Data questionable"),
    (-232, "Invalid format"),
    (-233, "Invalid version"),
    (-240, "Hardware error"),
    (-241, "Hardware missing"),
    (-250, "Mass storage error"),
    (-251, "Missing mass storage"),
    (-252, "Missing media"),
    (-253, "Corrupt media"),
    (-254, "Media full"),
    (-255, "Directory full"),
    (-256, "File name not found"),
    (-257, "File name error"),
    (-258, "Media protected"),
    (-260, "Expression error"),
    (-261, "Math error in expression"),
    (-270, "Macro error"),
    (-271, "Macro syntax error"),
    (-272, "Macro execution error"),
    (-273, "Illegal macro label"),
    (-274, "Macro parameter error"),
    (-275, "Macro definition too long"),
    (-276, "Macro recursion error"),
    (-277, "Macro redefinition not allowed"),
    (-278, "Macro header not found"),
    (-280, "Program error"),
    (-281, "Cannot create program"),
    (-282, "Illegal program name"),
    (-283, "Illegal variable name"),
    (-284, "Program currently running"),
    (-285, "Program syntax error"),
    (-286, "Program runtime error"),
    (-290, "Memory use error"),
    (-291, "Out of memory"),
    (-292, "Referenced name does not exist"),
    (-293, "Referenced name already exists"),
    (-294, "Incompatible type"),
    (-300, "Device-specific error"),
    (-310, "System error"),
    (-311, "Memory error"),
    (-312, "PUD memory lost"),
    (-313, "Calibration memory lost"),
    (-314, "Save/recall memory lost"),
    (-315, "Configuration memory lost"),
    (-320, "Storage fault"),
    (-321, "Out of memory"),
    (-330, "Self-test failed"),
    (-340, "Calibration failed"),
    (-350, "Queue overflow"),
    (-360, "Communication error"),
    (-361, "Parity error in program message"),
    (-362, "Framing error in program message"),
    (-363, "Input buffer overrun"),
    (-365, "Time out error"),
    (-400, "Query error"),
    (-410, "Query INTERRUPTED"),
    (-420, "Query UNTERMINATED"),
    (-430, "Query DEADLOCKED"),
    (-440, "Query UNTERMINATED after indefinite response"),
    (-500, "Power on"),
    (-600, "User request"),
    (-700, "Request control"),
    (-800, "Operation complete"),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_falls_strictly_so_that_every_entry_is_found() {
        assert!(STANDARD.windows(2).all(|pair| pair[1].0 < pair[0].0));
        for (number, text) in STANDARD {
            assert_eq!(standard_text(*number), *text);
        }
    }

    #[test]
    fn a_number_sets_the_bit_of_its_class() {
        let rows = [
            (-113, Some(0x20)),
            (-199, Some(0x20)),
            (-222, Some(0x10)),
            (-350, Some(0x08)),
            (17, Some(0x08)),
            (-410, Some(0x04)),
            (-500, Some(0x80)),
            (-600, Some(0x40)),
            (-700, Some(0x02)),
            (-800, Some(0x01)),
            (0, None),
        ];
        for (number, bit) in rows {
            let found = ScpiError::new(number).class().map(ErrorClass::event_bit);
            assert_eq!(found, bit, "{number}");
        }
        assert_eq!(standard_text(-199), "Command error");
        assert_eq!(standard_text(-301), "Device-specific error");
    }

    #[test]
    fn a_full_queue_keeps_the_oldest_and_ends_with_overflow() {
        let mut queue = ErrorQueue::new(2);
        assert!(queue.push(ScpiError::new(-113)));
        assert!(queue.push(ScpiError::new(-222)));
        assert!(!queue.push(ScpiError::new(-108)));
        assert_eq!(queue.len(), 2);
        assert_eq!(queue.pop(), Some(ScpiError::new(-113)));
        assert_eq!(queue.pop(), Some(ScpiError::new(-350)));
        assert_eq!(queue.pop(), None);
    }
}
