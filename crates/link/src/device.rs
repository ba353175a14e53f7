//! The serial port behind a name: what Unix tells of its files, and Windows of its names.

#[cfg(unix)]
#[path = "device/unix.rs"]
mod system;
#[cfg(windows)]
#[path = "device/windows.rs"]
mod system;

use std::path::{Path, PathBuf};

/// The device behind a name: the device file behind any symbolic links. `None` where there is none.
///
/// On Windows the name as it is, without the prefix `\\.\`, which the library writes itself: to look closer would open the port.
pub fn device_of(name: &Path) -> Option<PathBuf> {
    system::device_of(name)
}

/// The kind of a file that is not a serial port. A missing file shows when it is opened.
///
/// On Windows a name that is not COM and a number.
pub(crate) fn what_it_is(device: &Path) -> Option<&'static str> {
    system::what_it_is(device)
}

/// Whether there is such a device, which then does not open because another program has it.
pub(crate) fn is_there(device: &Path) -> bool {
    system::is_there(device)
}

/// Whether a name is the one to open of a serial port. macOS has two for each, of which `/dev/tty.…` waits for the carrier of
/// a modem.
pub(crate) fn is_to_open(device: &str) -> bool {
    !(cfg!(target_os = "macos") && device.starts_with("/dev/tty."))
}

/// Whether a port is a pseudo-terminal, which has settings of a line, but no line.
pub(crate) fn is_pseudo_terminal(name: &str) -> bool {
    cfg!(target_os = "linux")
        && device_of(Path::new(name)).is_some_and(|device| device.starts_with("/dev/pts"))
}
