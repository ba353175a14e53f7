//! Names of serial ports: COM1, COM2 and so on.

use std::path::{Path, PathBuf};

/// Written before the name of a device by programs that open it as a file, needed above COM9.
const PREFIX: &str = r"\\.\";

pub(super) fn device_of(name: &Path) -> Option<PathBuf> {
    let name = name.to_str()?;
    Some(PathBuf::from(name.strip_prefix(PREFIX).unwrap_or(name)))
}

pub(super) fn what_it_is(device: &Path) -> Option<&'static str> {
    (!is_com(device)).then_some("a name that Windows gives no serial port")
}

fn is_com(device: &Path) -> bool {
    let name = device.to_str().unwrap_or_default();
    let number = name.get(..3).filter(|letters| letters.eq_ignore_ascii_case("COM"));
    number.is_some_and(|_| name[3..].parse::<u16>().is_ok_and(|number| number > 0))
}

pub(super) fn is_there(device: &Path) -> bool {
    let is_it = |port: &tokio_serial::SerialPortInfo| {
        device.to_str().is_some_and(|name| port.port_name.eq_ignore_ascii_case(name))
    };
    tokio_serial::available_ports().unwrap_or_default().iter().any(is_it)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_is_com_and_a_number_with_or_without_the_prefix() {
        for name in ["COM1", "com3", "COM10", r"\\.\COM10"] {
            let device = device_of(Path::new(name)).unwrap();
            assert!(what_it_is(&device).is_none(), "{name}");
            assert!(!device.to_string_lossy().starts_with('\\'), "{name}");
        }
        for name in ["/dev/ttyUSB0", "COM", "COM0", "COMx", "LPT1", "", "\u{e9}\u{e9}"] {
            assert!(what_it_is(&device_of(Path::new(name)).unwrap()).is_some(), "{name}");
        }
    }
}
