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
        let (stable_name, holders) = (stable_name(path), others(path));
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
                holders: others(device),
                device: port.port_name,
            }
        })
        .collect()
}

/// The other programs that have a device file open, as far as this user may know.
pub(crate) fn others(device: &Path) -> Vec<Holder> {
    let own = std::process::id();
    holders(device).into_iter().filter(|holder| holder.pid != own).collect()
}

/// The same, and this program if it has it open as another port.
pub(crate) fn holders(device: &Path) -> Vec<Holder> {
    holders_in(Path::new("/proc"), device)
}

/// The name that stays with the adapter or the instrument behind a device file.
pub(crate) fn stable_name(device: &Path) -> Option<String> {
    let is_instrument = device_of(device).is_some_and(|device| is_of_usbtmc(&device));
    let names = if is_instrument { BY_SERIAL_NUMBER } else { BY_ID };
    stable_name_in(Path::new(names), device)
}

/// The name of the adapter or the instrument itself, in place of that of its device file. None for a link, by which a person
/// says a place or an adapter, and for an adapter without a serial number of its own: another one has the same name.
pub(crate) fn own_name(path: &Path) -> Option<String> {
    if path.is_symlink() {
        return None;
    }
    let is_own = is_of_usbtmc(path) || has_own_number(&path.to_string_lossy(), &serial_ports());
    stable_name(path).filter(|_| is_own)
}

/// Whether the adapter behind a device file has a serial number that no other one has. All ports of one adapter have the same,
/// and each of them a name of its own; of two adapters with the same, one has none.
fn has_own_number(device: &str, ports: &[AttachedPort]) -> bool {
    let of = |port: &AttachedPort| {
        let usb = port.usb.as_ref()?;
        Some((usb.vendor_id, usb.product_id, usb.serial_number.clone()?))
    };
    let own = ports.iter().find(|port| port.device == device).and_then(of);
    let mut of_number = ports.iter().filter(|port| own.is_some() && of(port) == own);
    own.is_some() && of_number.all(|port| port.stable_name.is_some())
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
    let mut holders: Vec<Holder> = entries(proc)
        .filter_map(|process| {
            let pid = process.file_name()?.to_str()?.parse().ok()?;
            let is_open = entries(&process.join("fd"))
                .any(|open| fs::read_link(open).is_ok_and(|target| target == device));
            let name = fs::read_to_string(process.join("comm")).unwrap_or_default();
            is_open.then(|| Holder { pid, name: name.trim().to_owned() })
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
    fn a_link_stays_as_it_was_named() {
        let scratch = Scratch::new("by-path");
        fs::write(scratch.path("ttyUSB0"), "").unwrap();
        let by_path = scratch.path("pci-0000:00:14.0-usb-0:2:1.0-port0");
        symlink("ttyUSB0", &by_path).unwrap();
        assert_eq!(own_name(&by_path), None);
    }

    #[test]
    fn only_a_serial_number_that_no_other_adapter_has_names_one() {
        let port = |device: &str, name: Option<&str>, serial_number: Option<&str>| AttachedPort {
            device: device.to_owned(),
            stable_name: name.map(str::to_owned),
            usb: Some(UsbIdentity {
                vendor_id: 0x1A86,
                product_id: 0x7523,
                serial_number: serial_number.map(str::to_owned),
                manufacturer: None,
                product: None,
            }),
            latency_ms: None,
            holders: Vec::new(),
        };
        let ports = [
            // Without a number, with one of its own, and two with the same.
            port("/dev/a", Some("if00"), None),
            port("/dev/b", Some("1-if00"), Some("1")),
            port("/dev/c", Some("0001-if00"), Some("0001")),
            port("/dev/d", None, Some("0001")),
            // The ports of one adapter.
            port("/dev/f", Some("2-if00"), Some("2")),
            port("/dev/g", Some("2-if01"), Some("2")),
        ];
        let devices = ports.iter().map(|port| &*port.device);
        let own: Vec<&str> = devices.filter(|device| has_own_number(device, &ports)).collect();
        assert_eq!(own, ["/dev/b", "/dev/f", "/dev/g"]);
        assert!(!has_own_number("/dev/e", &ports));
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
