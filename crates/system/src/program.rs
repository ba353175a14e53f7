//! One program in the place of another.

use std::{io, process::Command};

/// The variable by which a program knows that it replaces one that may still be ending.
#[cfg(windows)]
pub(crate) const REPLACES: &str = "RIGD_REPLACES";

/// Puts another program in the place of this one. Returns only where that has failed.
///
/// Unix ends all threads of this program before the new one begins, which keeps the process id and is what the parent waits for.
/// Windows has no such call: the new program is started, this one ends with `exit_code`, and the new one waits for that with
/// [`wait_for_the_replaced`]. Its parent sees the end of the old program, and only that code.
pub fn replace_by(command: Command, exit_code: i32) -> io::Error {
    crate::system::replace_by(command, exit_code)
}

/// Waits until the program that this one replaces has ended, if there is such a program; nothing is to do on Unix.
pub fn wait_for_the_replaced() {
    crate::system::wait_for_the_replaced();
}
