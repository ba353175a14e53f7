//! Signals that ask the program to end. While a rig is open, none of them ends it directly: the
//! probe is retracted first.

#[cfg(unix)]
mod unix;
#[cfg(windows)]
mod windows;

#[cfg(unix)]
pub(super) use unix::{Hangups, Resizes, Signals};
#[cfg(windows)]
pub(super) use windows::{Hangups, Resizes, Signals};
