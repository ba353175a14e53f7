//! What differs between Linux, macOS and Windows, behind one set of functions.
//!
//! Each function says what it does on Unix and what Windows cannot do. The two files `unix.rs` and
//! `windows.rs` have one implementation each, with the same signatures; `linux.rs` and `darwin.rs` have the
//! few calls in which the two kinds of Unix differ. Nothing else of rigd asks which system it runs on, except for
//! whole modules that only one of them can have, such as the driver of USB instruments.
//!
//! No test of this project runs on a Mac or on Windows: `docs/bench.md` says what was tried.

pub mod clocks;
pub mod disk;
pub mod files;
pub mod handles;
pub mod network;
pub mod person;
pub mod priority;
pub mod program;
#[cfg(feature = "signals")]
pub mod signals;
pub mod terminal;

#[cfg(target_os = "macos")]
mod darwin;
#[cfg(target_os = "macos")]
use darwin as kind;
#[cfg(target_os = "linux")]
mod linux;
#[cfg(target_os = "linux")]
use linux as kind;
#[cfg(unix)]
#[path = "unix.rs"]
mod system;
#[cfg(windows)]
#[path = "windows.rs"]
mod system;
