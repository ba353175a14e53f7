//! The requests of the Linux driver `usbtmc`, for instruments on USB.
//!
//! A read and a write of the device file carry messages; the requests here are what is beside them. This is
//! the only crate of the workspace with unsafe code.
//!
//! # Source
//! Linux, `include/uapi/linux/usb/tmc.h` (numbers and arguments) and `drivers/usb/class/usbtmc.c`. All of
//! them are there since Linux 4.20.

#![cfg(target_os = "linux")]

use std::{io, time::Duration};

use rustix::{
    fd::AsFd,
    ioctl::{NoArg, Opcode, Setter, Updater, ioctl, opcode},
};

/// Number of the driver in all of its requests (`USBTMC_IOC_NR`).
const DRIVER: u8 = 91;

/// `USBTMC_IOCTL_CLEAR`.
const CLEAR: Opcode = opcode::none(DRIVER, 2);
/// `USBTMC_IOCTL_SET_TIMEOUT`, with milliseconds.
const SET_TIMEOUT: Opcode = opcode::write::<u32>(DRIVER, 10);
/// `USBTMC488_IOCTL_READ_STB`, which gives the status byte.
const READ_STB: Opcode = opcode::read::<u8>(DRIVER, 18);
/// `USBTMC_IOCTL_MSG_IN_ATTR`, which gives the attributes of the last transfer that was read.
const MSG_IN_ATTR: Opcode = opcode::read::<u8>(DRIVER, 24);

/// The bit of [`MSG_IN_ATTR`] of a transfer that ends its message.
///
/// # Source
/// USBTMC 1.0, table 9.
const END_OF_MESSAGE: u8 = 1;

/// The bit of a status byte of an instrument that has a response to be read (MAV).
///
/// # Source
/// IEEE 488.2, 11.2.1.2.
pub const MESSAGE_AVAILABLE: u8 = 1 << 4;

/// The shortest time limit that the driver takes.
pub const TIMEOUT_MIN: Duration = Duration::from_millis(100);

/// Clears the device: what was sent and what was to be read is discarded on both sides, and the instrument
/// waits for a message. Its settings stay.
///
/// # Errors
/// The error of the driver, such as `ENODEV` of an instrument that was unplugged.
pub fn clear(instrument: impl AsFd) -> io::Result<()> {
    // SAFETY: the request has no argument.
    #[expect(unsafe_code, reason = "a request to a driver")]
    unsafe {
        ioctl(instrument, NoArg::<CLEAR>::new())?;
    }
    Ok(())
}

/// Sets the time limit of each transfer of this file descriptor.
///
/// # Errors
/// `EINVAL` for less than [`TIMEOUT_MIN`], and `ENOTTY` of a device of another driver.
pub fn set_timeout(instrument: impl AsFd, within: Duration) -> io::Result<()> {
    let milliseconds = u32::try_from(within.as_millis()).unwrap_or(u32::MAX);
    // SAFETY: the driver reads an u32, and keeps no address.
    #[expect(unsafe_code, reason = "a request to a driver")]
    unsafe {
        ioctl(instrument, Setter::<SET_TIMEOUT, u32>::new(milliseconds))?;
    }
    Ok(())
}

/// The status byte of an instrument. It does not disturb a measurement.
///
/// # Errors
/// The error of the driver, such as `ENODEV` of an instrument that was unplugged.
pub fn status_byte(instrument: impl AsFd) -> io::Result<u8> {
    status_byte_over(instrument, 0)
}

/// Whether the driver gives the status byte. That of some releases of Linux of the year 2025 reports success
/// and gives none.
///
/// # Errors
/// As [`status_byte`].
///
/// # Source
/// Linux, "usb: usbtmc: Fix `read_stb` function and `get_stb` ioctl", which mends commit cac01bd178d6.
pub fn gives_status_byte(instrument: impl AsFd) -> io::Result<bool> {
    let over_zeros = status_byte_over(&instrument, 0)?;
    let over_ones = status_byte_over(&instrument, u8::MAX)?;
    Ok((over_zeros, over_ones) != (0, u8::MAX))
}

/// The status byte; `before` if the driver gives none.
fn status_byte_over(instrument: impl AsFd, before: u8) -> io::Result<u8> {
    let mut status = before;
    // SAFETY: the driver writes one byte at this address at most, and keeps no address.
    #[expect(unsafe_code, reason = "a request to a driver")]
    unsafe {
        ioctl(instrument, Updater::<READ_STB, u8>::new(&mut status))?;
    }
    Ok(status)
}

/// Whether the last transfer that was read from this file descriptor has ended its message.
///
/// # Errors
/// The error of the driver, such as `ENODEV` of an instrument that was unplugged.
pub fn has_message_ended(instrument: impl AsFd) -> io::Result<bool> {
    let mut attributes = 0;
    // SAFETY: the driver writes one byte at this address at most, and keeps no address.
    #[expect(unsafe_code, reason = "a request to a driver")]
    unsafe {
        ioctl(instrument, Updater::<MSG_IN_ATTR, u8>::new(&mut attributes))?;
    }
    Ok(attributes & END_OF_MESSAGE != 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `ENOTTY`: the file belongs to no such driver.
    const NOT_FOR_IT: Option<i32> = Some(25);

    #[test]
    fn the_requests_have_the_numbers_of_the_header_of_linux() {
        // As the C compiler gives them for x86-64 and ARM.
        let numbers = [CLEAR, SET_TIMEOUT, READ_STB, MSG_IN_ATTR];
        assert_eq!(numbers, [0x5B02, 0x4004_5B0A, 0x8001_5B12, 0x8001_5B18]);
    }

    #[test]
    fn a_file_of_another_driver_refuses_each_request() {
        let file = std::fs::File::open("/dev/null").unwrap();
        let errors = [
            clear(&file).unwrap_err(),
            set_timeout(&file, TIMEOUT_MIN).unwrap_err(),
            status_byte(&file).unwrap_err(),
            gives_status_byte(&file).unwrap_err(),
            has_message_ended(&file).unwrap_err(),
        ];
        for error in errors {
            assert_eq!(error.raw_os_error(), NOT_FOR_IT, "{error}");
        }
    }
}
