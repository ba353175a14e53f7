//! The keys of a port.

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
            if tcp.sound().is_some_and(|address| !is_address(address)) {
                table.refuse(tcp, &RigFileFault::NotAnAddress { address: tcp.value.clone() });
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

fn is_address(address: &str) -> bool {
    let parts = address.rsplit_once(':');
    parts.is_some_and(|(host, port)| !host.is_empty() && port.parse::<u16>().is_ok())
}
