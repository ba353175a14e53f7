//! `rigd ports`: the serial ports of this computer, its instruments on USB, and the programs that have them open.

use clap::Args;
use rig_link::{AttachedPort, UsbIdentity, attached_ports};
use serde::Serialize;

use super::{
    Failure,
    args::OutputArgs,
    table::{facts, note, print, print_json},
};

#[derive(Debug, Args)]
pub(super) struct PortsArgs {
    #[command(flatten)]
    output: OutputArgs,
}

/// A port, for a program.
#[derive(Debug, Serialize)]
struct PortView {
    device: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    stable_name: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    usb: Option<UsbView>,
    #[serde(skip_serializing_if = "Option::is_none")]
    latency_ms: Option<u32>,
    holders: Vec<HolderView>,
}

#[derive(Debug, Serialize)]
struct UsbView {
    vendor_id: u16,
    product_id: u16,
    #[serde(skip_serializing_if = "Option::is_none")]
    serial_number: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    manufacturer: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    product: Option<String>,
}

#[derive(Debug, Serialize)]
struct HolderView {
    pid: u32,
    name: String,
}

pub(super) fn ports(args: &PortsArgs) -> Result<(), Failure> {
    let ports = attached_ports();
    if args.output.json {
        return print_json(&ports.into_iter().map(PortView::from).collect::<Vec<_>>());
    }
    if ports.is_empty() {
        note("no serial port with hardware behind it, and no instrument on USB (USBTMC)");
        return Ok(());
    }
    print(&text(&ports))
}

/// A block of lines for each port.
fn text(ports: &[AttachedPort]) -> String {
    let block = |port: &AttachedPort| {
        let mut rows = vec![("device", port.device.clone())];
        rows.extend(port.stable_name.clone().map(|name| ("name", name)));
        rows.extend(port.usb.as_ref().map(|usb| ("USB", usb_text(usb))));
        rows.extend(port.latency_ms.map(|delay| ("latency", format!("up to {delay} ms"))));
        rows.extend(port.holders.iter().map(|holder| ("open in", holder.to_string())));
        facts(&rows)
    };
    ports.iter().map(block).collect::<Vec<_>>().join("\n\n")
}

fn usb_text(usb: &UsbIdentity) -> String {
    let mut words = vec![format!("{:04x}:{:04x}", usb.vendor_id, usb.product_id)];
    words.extend(usb.manufacturer.clone());
    words.extend(usb.product.clone());
    words.extend(usb.serial_number.as_ref().map(|number| format!("serial number {number}")));
    words.join(" ")
}

impl From<AttachedPort> for PortView {
    fn from(port: AttachedPort) -> Self {
        let usb = |usb: UsbIdentity| UsbView {
            vendor_id: usb.vendor_id,
            product_id: usb.product_id,
            serial_number: usb.serial_number,
            manufacturer: usb.manufacturer,
            product: usb.product,
        };
        let holder = |holder: rig_link::Holder| HolderView { pid: holder.pid, name: holder.name };
        Self {
            device: port.device,
            stable_name: port.stable_name,
            usb: port.usb.map(usb),
            latency_ms: port.latency_ms,
            holders: port.holders.into_iter().map(holder).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use rig_link::Holder;

    use super::*;

    #[test]
    fn a_port_is_shown_with_its_adapter_and_who_has_it_open() {
        let adapter = AttachedPort {
            device: "/dev/ttyUSB0".to_owned(),
            stable_name: Some("/dev/serial/by-id/usb-FTDI_A-if00-port0".to_owned()),
            usb: Some(UsbIdentity {
                vendor_id: 0x0403,
                product_id: 0x6001,
                serial_number: Some("A5".to_owned()),
                manufacturer: Some("FTDI".to_owned()),
                product: None,
            }),
            latency_ms: Some(16),
            holders: vec![Holder { pid: 11, name: "minicom".to_owned() }],
        };
        let plain = AttachedPort {
            device: "/dev/ttyS0".to_owned(),
            stable_name: None,
            usb: None,
            latency_ms: None,
            holders: Vec::new(),
        };
        let expected = "\
device   /dev/ttyUSB0
name     /dev/serial/by-id/usb-FTDI_A-if00-port0
USB      0403:6001 FTDI serial number A5
latency  up to 16 ms
open in  minicom (process 11)

device  /dev/ttyS0";
        assert_eq!(text(&[adapter.clone(), plain]), expected);
        let json = serde_json::to_value(PortView::from(adapter)).unwrap();
        assert_eq!(json["usb"]["vendor_id"], 0x0403);
        assert_eq!(json["holders"][0]["pid"], 11);
    }
}
