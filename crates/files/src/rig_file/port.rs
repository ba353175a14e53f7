//! The keys of a port.

use std::num::NonZeroU16;

use rig_model::{LineSettings, Parity, StopBits};

use super::{PortFile, fault::RigFileFault};
use crate::{
    Location,
    settings::{Setting, Table},
};

/// Reads a port. `parity` is the factory setting of the devices on the line, or the reason why there
/// is none.
pub(super) fn port(table: &mut Table<'_>, parity: Result<Parity, RigFileFault>) -> PortFile {
    let serial = table.text("serial").optional();
    let tcp = table.text("tcp").optional();
    let baud = table.count("baud").range(300..=4_000_000).optional();
    let words = [("none", Parity::None), ("even", Parity::Even), ("odd", Parity::Odd)];
    let parity_given = table.choice("parity", words).optional();
    let stop_bits = table.count("stop_bits").range(1..=2).optional();

    match (&serial, &tcp) {
        (None, None) if table.is_there() => {
            table.refuse(table.location(), &RigFileFault::NeitherPort);
        }
        (Some(_), Some(tcp)) => table.refuse(tcp, &RigFileFault::BothPorts),
        (Some(serial), None) if is_address(&serial.value) && !serial.value.contains('/') => {
            table.refuse(serial, &RigFileFault::NotADevice { address: serial.value.clone() });
        }
        (Some(serial), None) if baud.is_none() => table.refuse(serial, &RigFileFault::NoBaud),
        (None, Some(tcp)) => {
            if let Some(fault) = tcp.sound().and_then(|address| address_fault(address)) {
                table.refuse(tcp, &fault);
            }
            let serial_only = [
                location(baud.as_ref()),
                location(parity_given.as_ref()),
                location(stop_bits.as_ref()),
            ];
            for (key, location) in serial_only.into_iter().flatten() {
                table.refuse(location, &RigFileFault::NotSerial { key });
            }
        }
        _ => {}
    }
    if let (Some(serial), None, None, Err(refusal)) = (&serial, &tcp, &parity_given, &parity) {
        table.refuse(serial, refusal);
    }
    match (serial, tcp) {
        (None, Some(tcp)) => PortFile::Tcp { address: tcp.value },
        (serial, _) => PortFile::Serial {
            path: serial.map(|serial| serial.value).unwrap_or_default(),
            line: LineSettings {
                baud: baud.map_or(0, |baud| baud.value),
                parity: parity_given.map_or(parity.unwrap_or(Parity::None), |given| given.value),
                stop_bits: match stop_bits {
                    Some(Setting { value: 2, .. }) => StopBits::Two,
                    _ => StopBits::One,
                },
            },
        },
    }
}

fn location<T>(setting: Option<&Setting<T>>) -> Option<(&'static str, Location)> {
    setting.map(|setting| (setting.key, setting.location))
}

/// Why this is not a host and a port of TCP.
fn address_fault(address: &str) -> Option<RigFileFault> {
    let port = |(host, port): (&'_ str, &str)| {
        let is_number = !port.is_empty() && port.bytes().all(|byte| byte.is_ascii_digit());
        (!host.is_empty() && is_number).then(|| port.to_owned())
    };
    let address = address.to_owned();
    match address.rsplit_once(':').and_then(port) {
        None => Some(RigFileFault::NotAnAddress { address }),
        Some(port) if port.parse::<NonZeroU16>().is_err() => {
            Some(RigFileFault::NoSuchPort { address, port })
        }
        Some(_) => None,
    }
}

fn is_address(address: &str) -> bool {
    address_fault(address).is_none()
}
