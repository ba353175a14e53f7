//! The status model: status byte, standard events, and the two registers of SCPI.
//!
//! # Source
//! IEEE 488.2, section 11; SCPI-99, volume 1, chapter 9, and volume 2, chapter 20.

/// Bit of the status byte: the error queue is not empty.
const ERROR_QUEUE: u8 = 0x04;
const QUESTIONABLE: u8 = 0x08;
const MESSAGE_AVAILABLE: u8 = 0x10;
const EVENT_SUMMARY: u8 = 0x20;
const MASTER_SUMMARY: u8 = 0x40;
const OPERATION: u8 = 0x80;

/// Bit 15 of a register of SCPI is never used, so that its value stays positive in 16 bits.
pub(crate) const REGISTER_MASK: u16 = 0x7FFF;

/// A condition, the events that its changes leave behind, and which of them are reported.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Register {
    condition: u16,
    event: u16,
    /// Events that reach the status byte.
    pub enable: u16,
    /// Bits whose rise is an event.
    pub positive_transition: u16,
    /// Bits whose fall is an event.
    pub negative_transition: u16,
}

impl Default for Register {
    fn default() -> Self {
        Self {
            condition: 0,
            event: 0,
            enable: 0,
            positive_transition: REGISTER_MASK,
            negative_transition: 0,
        }
    }
}

impl Register {
    /// Bits that are true now.
    pub const fn condition(&self) -> u16 {
        self.condition
    }

    /// Sets the bits that are true now; what changed becomes an event where the filters let it.
    pub(crate) const fn set_condition(&mut self, condition: u16) {
        let condition = condition & REGISTER_MASK;
        let rose = condition & !self.condition & self.positive_transition;
        let fell = !condition & self.condition & self.negative_transition;
        self.event |= rose | fell;
        self.condition = condition;
    }

    /// Sets or clears the bits of `mask` in the condition.
    pub const fn set(&mut self, mask: u16, is_on: bool) {
        let condition = if is_on { self.condition | mask } else { self.condition & !mask };
        self.set_condition(condition);
    }

    /// The events since the last time, which are forgotten by this.
    pub(crate) const fn take_event(&mut self) -> u16 {
        let event = self.event;
        self.event = 0;
        event
    }

    const fn preset(&mut self) {
        self.enable = 0;
        self.positive_transition = REGISTER_MASK;
        self.negative_transition = 0;
    }

    const fn summary(&self) -> bool {
        self.event & self.enable != 0
    }
}

/// All registers of an instrument.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Status {
    /// `STATus:OPERation`.
    pub operation: Register,
    /// `STATus:QUEStionable`.
    pub questionable: Register,
    standard_event: u8,
    /// `*ESE`.
    pub event_enable: u8,
    service_enable: u8,
}

impl Status {
    /// Sets bits of the standard event status register.
    pub const fn raise(&mut self, event_bits: u8) {
        self.standard_event |= event_bits;
    }

    /// `*ESR?`: the standard events since the last time, which are forgotten by this.
    pub(crate) const fn take_standard_event(&mut self) -> u8 {
        let event = self.standard_event;
        self.standard_event = 0;
        event
    }

    /// `*SRE?`.
    pub(crate) const fn service_enable(&self) -> u8 {
        self.service_enable
    }

    /// `*SRE`. Bit 6 is not kept: a request for service cannot ask for itself.
    pub(crate) const fn set_service_enable(&mut self, mask: u8) {
        self.service_enable = mask & !MASTER_SUMMARY;
    }

    /// `*CLS`, without the error queue. The enable registers keep their values.
    pub(crate) const fn clear_events(&mut self) {
        self.standard_event = 0;
        self.operation.event = 0;
        self.questionable.event = 0;
    }

    /// `STATus:PRESet`.
    pub(crate) const fn preset(&mut self) {
        self.operation.preset();
        self.questionable.preset();
    }

    /// `*STB?`, with the master summary in bit 6.
    pub const fn byte(&self, has_errors: bool, has_output: bool) -> u8 {
        let mut byte = 0;
        if has_errors {
            byte |= ERROR_QUEUE;
        }
        if self.questionable.summary() {
            byte |= QUESTIONABLE;
        }
        if has_output {
            byte |= MESSAGE_AVAILABLE;
        }
        if self.standard_event & self.event_enable != 0 {
            byte |= EVENT_SUMMARY;
        }
        if self.operation.summary() {
            byte |= OPERATION;
        }
        if byte & self.service_enable != 0 {
            byte |= MASTER_SUMMARY;
        }
        byte
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filters_choose_which_change_is_an_event() {
        let mut register = Register::default();
        register.set_condition(0b11);
        assert_eq!((register.condition(), register.take_event()), (0b11, 0b11));
        register.set_condition(0b01);
        assert_eq!(register.take_event(), 0, "a fall is no event by default");
        register.negative_transition = 0b01;
        register.set(0b01, false);
        assert_eq!((register.condition(), register.take_event()), (0, 0b01));
        register.set_condition(0x8000);
        assert_eq!(register.condition(), 0, "bit 15 is never used");
    }

    #[test]
    fn the_status_byte_sums_up_what_is_enabled() {
        let mut status = Status::default();
        assert_eq!(status.byte(true, true), 0x14);
        status.raise(0x20);
        assert_eq!(status.byte(false, false), 0);
        status.event_enable = 0x20;
        assert_eq!(status.byte(false, false), 0x20);
        status.set_service_enable(0xFF);
        assert_eq!(status.service_enable(), 0xBF);
        assert_eq!(status.byte(true, false), 0x64);
        status.operation.enable = 8;
        status.operation.set(8, true);
        status.questionable.enable = 1;
        status.questionable.set(1, true);
        assert_eq!(status.byte(false, false), 0xE8);
        status.clear_events();
        assert_eq!(status.byte(false, false), 0);
        assert_eq!((status.event_enable, status.operation.enable), (0x20, 8));
        status.preset();
        assert_eq!((status.event_enable, status.operation.enable), (0x20, 0));
    }
}
