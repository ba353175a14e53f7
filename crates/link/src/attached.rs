//! The ports of this computer: serial ports with their USB adapters, instruments on USB, and the programs that
//! have them open.

use std::{
    fmt, fs,
    path::{Path, PathBuf},
};

use crate::device::{device_of, is_to_open};

/// Names of an adapter that do not depend on the order of plugging in.
const BY_ID: &str = "/dev/serial/by-id";

/// Names of an instrument on USB, by its serial number. The udev rules of rigd make them.
const BY_SERIAL_NUMBER: &str = "/dev/rigd/by-serial";

/// A serial port of this computer, or an instrument on USB.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AttachedPort {
    /// The device file, such as `/dev/ttyUSB0` or `/dev/usbtmc0`.
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

/// The identity of an adapter or an instrument on USB.
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

/// All serial ports that have hardware behind them, and all instruments on USB that have a device file, by
/// name.
pub fn attached_ports() -> Vec<AttachedPort> {
    let serial = serial_ports();
    let instruments = instruments_in(Path::new("/sys")).into_iter().map(|(device, usb)| {
        let path = Path::new(&device);
        let (stable_name, holders) = (stable_name(path), holders(path));
        AttachedPort { device, stable_name, usb: Some(usb), latency_ms: None, holders }
    });
    let mut ports: Vec<AttachedPort> = serial.into_iter().chain(instruments).collect();
    ports.sort_by(|a, b| a.device.cmp(&b.device));
    ports
}

fn serial_ports() -> Vec<AttachedPort> {
    tokio_serial::available_ports()
        .unwrap_or_default()
        .into_iter()
        .filter(|port| is_to_open(&port.port_name))
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
        .collect()
}

/// The programs that have a device file open, as far as this user may know.
pub(crate) fn holders(device: &Path) -> Vec<Holder> {
    holders_in(Path::new("/proc"), device)
}

/// The name that stays with the adapter or the instrument behind a device file.
pub(crate) fn stable_name(device: &Path) -> Option<String> {
    let is_instrument = device_of(device).is_some_and(|device| is_of_usbtmc(&device));
    let names = if is_instrument { BY_SERIAL_NUMBER } else { BY_ID };
    stable_name_in(Path::new(names), device)
}

/// Whether a device file is one of the driver `usbtmc`, by its name.
pub(crate) fn is_of_usbtmc(device: &Path) -> bool {
    let name = device.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    name.strip_prefix("usbtmc").is_some_and(|number| number.parse::<u32>().is_ok())
}

/// The device files of the driver `usbtmc` and the instruments behind them.
fn instruments_in(sys: &Path) -> Vec<(String, UsbIdentity)> {
    let instrument = |class: PathBuf| {
        // The class has a link to the interface, which is below the device.
        let interface = fs::canonicalize(class.join("device")).ok()?;
        let device = interface.parent()?;
        let text = |name: &str| {
            fs::read_to_string(device.join(name)).ok().map(|text| text.trim().to_owned())
        };
        let number = |name| text(name).and_then(|text| u16::from_str_radix(&text, 16).ok());
        let identity = UsbIdentity {
            vendor_id: number("idVendor")?,
            product_id: number("idProduct")?,
            serial_number: text("serial"),
            manufacturer: text("manufacturer"),
            product: text("product"),
        };
        let name = class.file_name()?.to_str()?;
        is_of_usbtmc(&class).then(|| (format!("/dev/{name}"), identity))
    };
    entries(&sys.join("class/usbmisc")).filter_map(instrument).collect()
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
    let device = device_of(device)?;
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

// The folders of Linux are made with symbolic links.
#[cfg(test)]
#[cfg(unix)]
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
    fn an_instrument_on_usb_is_found_behind_its_device_file() {
        let scratch = Scratch::new("usbmisc");
        let interface = scratch.path("devices/1-2/1-2:1.0");
        let class = scratch.path("class/usbmisc");
        for directory in [&interface, &class] {
            fs::create_dir_all(directory).unwrap();
        }
        for (name, text) in
            [("idVendor", "0957\n"), ("idProduct", "0909\n"), ("serial", "MY46100001\n")]
        {
            fs::write(scratch.path("devices/1-2").join(name), text).unwrap();
        }
        for name in ["usbtmc0", "lp0"] {
            fs::create_dir(class.join(name)).unwrap();
            symlink(&interface, class.join(name).join("device")).unwrap();
        }
        let expected = UsbIdentity {
            vendor_id: 0x0957,
            product_id: 0x0909,
            serial_number: Some("MY46100001".to_owned()),
            manufacturer: None,
            product: None,
        };
        assert_eq!(instruments_in(&scratch.0), [("/dev/usbtmc0".to_owned(), expected)]);
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
