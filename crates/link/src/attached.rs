//! The serial ports of this computer: names, USB adapters, and programs that have them open.

use std::{
    fmt, fs,
    path::{Path, PathBuf},
};

/// Names of an adapter that do not depend on the order of plugging in.
const BY_ID: &str = "/dev/serial/by-id";

/// A serial port of this computer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AttachedPort {
    /// The device file, such as `/dev/ttyUSB0`.
    pub device: String,
    /// The name that stays with the adapter, if it has one.
    pub stable_name: Option<String>,
    /// Identity of an adapter on USB.
    pub usb: Option<UsbIdentity>,
    /// Latency timer of the adapter, ms. One millisecond is best; many
    /// begin with 16.
    pub latency_ms: Option<u32>,
    /// The programs that have it open.
    pub holders: Vec<Holder>,
}

/// The identity of an adapter on USB.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UsbIdentity {
    /// USB vendor id.
    pub vendor_id: u16,
    /// USB product id.
    pub product_id: u16,
    /// Serial number; cheap adapters share one or have none.
    pub serial_number: Option<String>,
    /// Name of the manufacturer.
    pub manufacturer: Option<String>,
    /// Name of the product.
    pub product: Option<String>,
}

/// A program that has a port open.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Holder {
    /// Its process id.
    pub pid: u32,
    /// Name of the program.
    pub name: String,
}

impl fmt::Display for Holder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} (process {})", self.name, self.pid)
    }
}

/// All serial ports that have hardware behind them, by name.
pub fn attached_ports() -> Vec<AttachedPort> {
    let mut ports: Vec<AttachedPort> = tokio_serial::available_ports()
        .unwrap_or_default()
        .into_iter()
        .map(|port| {
            let device = Path::new(&port.port_name);
            AttachedPort {
                stable_name: stable_name(device),
                usb: usb_identity(port.port_type),
                latency_ms: latency_ms(device),
                holders: holders(device),
                device: port.port_name,
            }
        })
        .collect();
    ports.sort_by(|a, b| a.device.cmp(&b.device));
    ports
}

/// The programs that have a device file open, as far as this user may know.
pub(crate) fn holders(device: &Path) -> Vec<Holder> {
    holders_in(Path::new("/proc"), device)
}

/// The name that stays with the adapter behind a device file.
pub(crate) fn stable_name(device: &Path) -> Option<String> {
    stable_name_in(Path::new(BY_ID), device)
}

fn holders_in(proc: &Path, device: &Path) -> Vec<Holder> {
    let own = std::process::id();
    let mut holders: Vec<Holder> = entries(proc)
        .filter_map(|process| {
            let pid = process.file_name()?.to_str()?.parse().ok()?;
            let is_open = entries(&process.join("fd"))
                .any(|open| fs::read_link(open).is_ok_and(|target| target == device));
            let name = fs::read_to_string(process.join("comm")).unwrap_or_default();
            (is_open && pid != own).then(|| Holder { pid, name: name.trim().to_owned() })
        })
        .collect();
    holders.sort_by_key(|holder| holder.pid);
    holders
}

fn stable_name_in(by_id: &Path, device: &Path) -> Option<String> {
    let device = fs::canonicalize(device).ok()?;
    let mut names: Vec<PathBuf> = entries(by_id)
        .filter(|name| fs::canonicalize(name).is_ok_and(|target| target == device))
        .collect();
    names.sort();
    names.first()?.to_str().map(str::to_owned)
}

/// The entries of a directory; none if it does not exist.
fn entries(directory: &Path) -> impl Iterator<Item = PathBuf> {
    fs::read_dir(directory).into_iter().flatten().flatten().map(|entry| entry.path())
}

fn usb_identity(kind: tokio_serial::SerialPortType) -> Option<UsbIdentity> {
    let tokio_serial::SerialPortType::UsbPort(usb) = kind else { return None };
    Some(UsbIdentity {
        vendor_id: usb.vid,
        product_id: usb.pid,
        serial_number: usb.serial_number,
        manufacturer: usb.manufacturer,
        product: usb.product,
    })
}

fn latency_ms(device: &Path) -> Option<u32> {
    let name = device.file_name()?;
    let timer = Path::new("/sys/class/tty").join(name).join("device/latency_timer");
    fs::read_to_string(timer).ok()?.trim().parse().ok()
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    /// An empty directory, which is removed after the test.
    struct Scratch(PathBuf);

    impl Scratch {
        fn new(name: &str) -> Self {
            let path = std::env::temp_dir().join(format!("rig-link-{}-{name}", std::process::id()));
            fs::create_dir_all(&path).unwrap();
            Self(fs::canonicalize(path).unwrap())
        }

        fn path(&self, name: &str) -> PathBuf {
            self.0.join(name)
        }
    }

    impl Drop for Scratch {
        fn drop(&mut self) {
            _ = fs::remove_dir_all(&self.0);
        }
    }

    #[test]
    fn an_adapter_is_found_by_the_name_that_stays_with_it() {
        let scratch = Scratch::new("by-id");
        let by_id = scratch.path("by-id");
        fs::create_dir(&by_id).unwrap();
        for device in ["ttyUSB0", "ttyUSB1"] {
            fs::write(scratch.path(device), "").unwrap();
        }
        symlink("../ttyUSB1", by_id.join("usb-FTDI_A-if00-port0")).unwrap();
        let expected = by_id.join("usb-FTDI_A-if00-port0").to_str().map(str::to_owned);
        assert_eq!(stable_name_in(&by_id, &scratch.path("ttyUSB1")), expected);
        assert_eq!(stable_name_in(&by_id, &by_id.join("usb-FTDI_A-if00-port0")), expected);
        assert_eq!(stable_name_in(&by_id, &scratch.path("ttyUSB0")), None);
        assert_eq!(stable_name_in(&by_id, &scratch.path("ttyUSB2")), None);
    }

    #[test]
    fn the_programs_that_have_a_device_open_are_named() {
        let scratch = Scratch::new("proc");
        let device = scratch.path("ttyUSB0");
        fs::write(&device, "").unwrap();
        for (pid, name, target) in [(11, "minicom", &device), (12, "sh", &scratch.path("other"))] {
            let process = scratch.path(&pid.to_string());
            fs::create_dir_all(process.join("fd")).unwrap();
            fs::write(process.join("comm"), format!("{name}\n")).unwrap();
            symlink(target, process.join("fd/3")).unwrap();
        }
        fs::create_dir(scratch.path("self")).unwrap();
        let found = holders_in(&scratch.0, &device);
        assert_eq!(found, [Holder { pid: 11, name: "minicom".to_owned() }]);
        assert_eq!(found[0].to_string(), "minicom (process 11)");
    }
}
