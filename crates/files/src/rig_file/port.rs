//! The keys of a port.

use std::num::NonZeroU16;

use rig_model::{LineSettings, Parity, StopBits};

use super::{PortFile, fault::RigFileFault};
use crate::{
    Complaint, Location,
    settings::{Setting, Table},
};

/// The devices on a port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    /// The analyzer, which may be on USB.
    Analyzer,
    /// The drives of both axes, on one line.
    Drives,
}

impl Role {
    /// The keys of which a port has one.
    const fn choices(self) -> &'static str {
        match self {
            Self::Analyzer => "serial, tcp or usbtmc",
            Self::Drives => "serial or tcp",
        }
    }
}

/// A fault of the keys of a port.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
enum PortFault {
    #[error("a port is {}", role.choices())]
    NoPort { role: Role },
    #[error("a port is {}, not several of them", role.choices())]
    SeveralPorts { role: Role },
    #[error("usbtmc is for the analyzer: the drives are on a line for Modbus")]
    DrivesOnUsb,
    #[error("usbtmc = \"{text}\" is not a device file")]
    NoDeviceFile { text: String },
    #[error("serial = \"{path}\" waits for the carrier of a modem")]
    WaitsForCarrier { path: String },
    #[error("usbtmc needs the driver of Linux, and this system is {system}")]
    UsbWithoutLinux { system: String },
    #[error("{key} is for a serial port")]
    NotSerial { key: &'static str },
    #[error("a serial port needs the key baud")]
    NoBaud,
    #[error("tcp = \"{address}\" is not of the form host:port")]
    NotAnAddress { address: String },
    #[error("tcp = \"{address}\": the port {port} does not exist")]
    NoSuchPort { address: String, port: String },
    #[error("serial = \"{address}\" is an address, not a device file")]
    NotADevice { address: String },
}

impl Complaint for PortFault {
    fn suggestion(&self) -> Option<String> {
        let suggestion = match self {
            Self::NoPort { role: Role::Analyzer } => {
                "write { serial = \"/dev/…\", baud = … }, { tcp = \"host:port\" } or { usbtmc = \"/dev/usbtmc0\" }".into()
            }
            Self::NoPort { role: Role::Drives } | Self::DrivesOnUsb => {
                "write { serial = \"/dev/…\", baud = … } or { tcp = \"host:port\" }".into()
            }
            Self::NoDeviceFile { .. } => {
                "name the device file, such as \"/dev/usbtmc0\"; `rigd ports` shows it".into()
            }
            Self::WaitsForCarrier { path } => {
                format!("write serial = \"{}\"", path.replacen("/dev/tty.", "/dev/cu.", 1))
            }
            Self::UsbWithoutLinux { .. } => {
                "write { tcp = \"host:port\" } for an instrument on the network".into()
            }
            Self::SeveralPorts { .. } | Self::NotSerial { .. } => "remove one".into(),
            Self::NoBaud => "read it from the display or the switches of the device".into(),
            Self::NotADevice { address } => format!("write {{ tcp = \"{address}\" }}"),
            Self::NoSuchPort { .. } => "use the port of the device, from 1 to 65535".into(),
            Self::NotAnAddress { address } if address.starts_with('/') => {
                format!("write {{ serial = \"{address}\", baud = … }}")
            }
            Self::NotAnAddress { .. } => "write it like \"192.168.0.10:3500\"".into(),
        };
        Some(suggestion)
    }
}

/// What is written of a port.
struct Written {
    serial: Option<Setting<String>>,
    tcp: Option<Setting<String>>,
    usbtmc: Option<Setting<String>>,
    baud: Option<Setting<u32>>,
    parity: Option<Setting<Parity>>,
    stop_bits: Option<Setting<u32>>,
}

/// Reads a port. `parity` is the factory setting of the devices on the line, or the reason why there
/// is none.
pub(super) fn port(
    table: &mut Table<'_>,
    role: Role,
    parity: Result<Parity, RigFileFault>,
) -> PortFile {
    let words = [("none", Parity::None), ("even", Parity::Even), ("odd", Parity::Odd)];
    let written = Written {
        serial: table.text("serial").optional(),
        tcp: table.text("tcp").optional(),
        usbtmc: match role {
            Role::Analyzer => table.text("usbtmc").optional(),
            Role::Drives => {
                table.refuse_key("usbtmc", &PortFault::DrivesOnUsb);
                None
            }
        },
        baud: table.count("baud").range(300..=4_000_000).optional(),
        parity: table.choice("parity", words).optional(),
        stop_bits: table.count("stop_bits").range(1..=2).optional(),
    };
    refuse_choice(table, role, &written);
    refuse_values(table, &written);
    if let Written { serial: Some(serial), tcp: None, parity: None, .. } = &written
        && let Err(refusal) = &parity
    {
        table.refuse(serial, refusal);
    }
    match written {
        Written { serial: None, tcp: Some(tcp), .. } => PortFile::Tcp { address: tcp.value },
        Written { serial: None, usbtmc: Some(usbtmc), .. } => {
            PortFile::Usbtmc { path: usbtmc.value }
        }
        Written { serial, baud, parity: given, stop_bits, .. } => PortFile::Serial {
            path: serial.map(|serial| serial.value).unwrap_or_default(),
            line: LineSettings {
                baud: baud.map_or(0, |baud| baud.value),
                parity: given.map_or(parity.unwrap_or(Parity::None), |given| given.value),
                stop_bits: match stop_bits {
                    Some(Setting { value: 2, .. }) => StopBits::Two,
                    _ => StopBits::One,
                },
            },
        },
    }
}

/// Refuses none and several of the keys of which a port has one.
fn refuse_choice(table: &Table<'_>, role: Role, written: &Written) {
    let given = [&written.serial, &written.tcp, &written.usbtmc];
    let mut given = given.into_iter().flatten();
    match (given.next(), given.next()) {
        // The key that drives do not have is refused with a reason of its own.
        (None, _) if table.is_there() && !table.has("usbtmc") => {
            table.refuse(table.location(), &PortFault::NoPort { role });
        }
        (_, Some(second)) => table.refuse(second, &PortFault::SeveralPorts { role }),
        _ => {}
    }
}

/// Refuses a name that is not one of its key, and keys of a serial port beside another one.
fn refuse_values(table: &Table<'_>, written: &Written) {
    match written {
        Written { serial: Some(serial), tcp: None, usbtmc: None, baud, .. } => {
            if is_address(&serial.value) && !serial.value.contains('/') {
                table.refuse(serial, &PortFault::NotADevice { address: serial.value.clone() });
            } else if let Some(fault) = serial_fault(&serial.value, std::env::consts::OS) {
                table.refuse(serial, &fault);
            } else if baud.is_none() {
                table.refuse(serial, &PortFault::NoBaud);
            }
        }
        Written { serial: None, tcp: Some(tcp), usbtmc: None, .. } => {
            if let Some(fault) = tcp.sound().and_then(|address| address_fault(address)) {
                table.refuse(tcp, &fault);
            }
        }
        Written { serial: None, tcp: None, usbtmc: Some(usbtmc), .. } => {
            let fault = usbtmc.sound().and_then(|path| usbtmc_fault(path, std::env::consts::OS));
            if let Some(fault) = fault {
                table.refuse(usbtmc, &fault);
            }
        }
        _ => return,
    }
    if written.serial.is_none() {
        let serial_only = [
            location(written.baud.as_ref()),
            location(written.parity.as_ref()),
            location(written.stop_bits.as_ref()),
        ];
        for (key, location) in serial_only.into_iter().flatten() {
            table.refuse(location, &PortFault::NotSerial { key });
        }
    }
}

/// Why a system of this name does not open this as a serial port. macOS has two files for each.
fn serial_fault(path: &str, system: &str) -> Option<PortFault> {
    let waits = system == "macos" && path.starts_with("/dev/tty.");
    waits.then(|| PortFault::WaitsForCarrier { path: path.to_owned() })
}

/// Why a system of this name cannot open this as an instrument on USB.
fn usbtmc_fault(path: &str, system: &str) -> Option<PortFault> {
    if !path.contains('/') {
        return Some(PortFault::NoDeviceFile { text: path.to_owned() });
    }
    (system != "linux").then(|| PortFault::UsbWithoutLinux { system: system.to_owned() })
}

fn location<T>(setting: Option<&Setting<T>>) -> Option<(&'static str, Location)> {
    setting.map(|setting| (setting.key, setting.location))
}

/// Why this is not a host and a port of TCP.
fn address_fault(address: &str) -> Option<PortFault> {
    let port = |(host, port): (&'_ str, &str)| {
        let is_number = !port.is_empty() && port.bytes().all(|byte| byte.is_ascii_digit());
        (!host.is_empty() && is_number).then(|| port.to_owned())
    };
    let address = address.to_owned();
    match address.rsplit_once(':').and_then(port) {
        None => Some(PortFault::NotAnAddress { address }),
        Some(port) if port.parse::<NonZeroU16>().is_err() => {
            Some(PortFault::NoSuchPort { address, port })
        }
        Some(_) => None,
    }
}

fn is_address(address: &str) -> bool {
    address_fault(address).is_none()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_of_macos_is_the_one_that_waits_for_no_carrier() {
        let tty = "/dev/tty.usbserial-A1";
        let fault = serial_fault(tty, "macos").unwrap();
        assert_eq!(
            fault.to_string(),
            "serial = \"/dev/tty.usbserial-A1\" waits for the carrier of a modem"
        );
        assert_eq!(fault.suggestion().unwrap(), "write serial = \"/dev/cu.usbserial-A1\"");
        for (path, system) in
            [("/dev/cu.usbserial-A1", "macos"), (tty, "linux"), ("COM3", "windows")]
        {
            assert_eq!(serial_fault(path, system), None);
        }
    }

    #[test]
    fn an_instrument_on_usb_is_for_linux_which_has_its_driver() {
        assert_eq!(usbtmc_fault("/dev/usbtmc0", "linux"), None);
        let fault = usbtmc_fault("/dev/usbtmc0", "macos").unwrap();
        assert_eq!(fault.to_string(), "usbtmc needs the driver of Linux, and this system is macos");
        assert!(fault.suggestion().unwrap().contains("tcp"));
        let fault = usbtmc_fault("USB0::2391::2313::MY46100001::INSTR", "linux").unwrap();
        let said = "usbtmc = \"USB0::2391::2313::MY46100001::INSTR\" is not a device file";
        assert_eq!(fault.to_string(), said);
    }
}
