//! Checks of a computer with macOS or Windows: whether the ports of the rig are among those of the computer, and adapters
//! that hold back bytes.
//!
//! Groups, udev rules, brltty, `ModemManager` and the driver usbtmc are of Linux, and are not looked for.

use rig_files::rig_file::{Connection, PortFile, RigFile};
use rig_link::{AttachedPort, attached_ports, device_of};

use super::{Finding, Findings};

/// Vendor of adapters with a latency timer, of which neither system tells the value.
const FTDI: u16 = 0x0403;

/// What a person can do about the timer.
const LATENCY: &str = if cfg!(windows) {
    "set Latency Timer to 1 ms: Device Manager, Ports (COM & LPT), the adapter, Port Settings, Advanced"
} else {
    "macOS has no setting for it: use an adapter of another maker where the time of a transaction counts"
};

/// What to do about a port that is not there.
const ABSENT: &str = if cfg!(windows) {
    "plug the adapter in, and write the name that `rigd ports` shows: another USB socket may give it another number"
} else {
    "plug the adapter in, and write the name that `rigd ports` shows; an adapter without a port may need the driver of \
     its maker, allowed in the settings of Privacy & Security"
};

/// What the computer shows.
#[derive(Debug, Default)]
pub(crate) struct HostFacts {
    /// The serial ports of the rig.
    wanted: Vec<String>,
    /// The serial ports of the computer.
    attached: Vec<AttachedPort>,
}

impl HostFacts {
    /// Looks at this computer, for the serial ports of a rig; `None` for a rig without one.
    pub(crate) fn look(rig: &RigFile) -> Option<Self> {
        let ports = [&rig.analyzer.port, &rig.bus];
        let serial = ports.into_iter().filter(|port| matches!(port, PortFile::Serial { .. }));
        let wanted: Vec<_> = serial.map(|port| port.place().to_owned()).collect();
        let is_of_ports = rig.connection == Connection::Ports && !wanted.is_empty();
        is_of_ports.then(|| Self { wanted, attached: attached_ports() })
    }
}

/// The findings about a computer.
pub(crate) fn findings(host: &HostFacts) -> Vec<Finding> {
    let mut findings = Findings::of("computer");
    for name in &host.wanted {
        match attached(name, &host.attached) {
            Some(port) => findings.ok("port", format!("{name} is {}", described(port))),
            None => findings.problem("port", no_such(name, &host.attached), ABSENT),
        }
    }
    let is_of_ftdi = |port: &&AttachedPort| {
        host.wanted.iter().any(|name| is_at(name, port))
            && port.usb.as_ref().is_some_and(|usb| usb.vendor_id == FTDI)
    };
    for port in host.attached.iter().filter(is_of_ftdi) {
        findings.warning(
            "adapter",
            format!("{}: an adapter by FTDI may hold back received bytes for 16 ms", port.device),
            LATENCY,
        );
    }
    findings.all
}

fn attached<'a>(name: &str, ports: &'a [AttachedPort]) -> Option<&'a AttachedPort> {
    ports.iter().find(|port| is_at(name, port))
}

/// Windows makes no difference between large and small letters.
fn is_at(name: &str, port: &AttachedPort) -> bool {
    let device = device_of(name.as_ref()).unwrap_or_else(|| name.into());
    let device = device.to_string_lossy();
    if cfg!(windows) { device.eq_ignore_ascii_case(&port.device) } else { device == port.device }
}

fn described(port: &AttachedPort) -> String {
    let Some(usb) = &port.usb else { return "a port of this computer".to_owned() };
    let product = usb.product.as_deref().unwrap_or("an adapter");
    format!("{product} ({:04x}:{:04x})", usb.vendor_id, usb.product_id)
}

fn no_such(name: &str, ports: &[AttachedPort]) -> String {
    let names: Vec<_> = ports.iter().map(|port| port.device.as_str()).collect();
    let known = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
    format!("{name} is not among the serial ports of this computer: {known}")
}

#[cfg(test)]
mod tests {
    use rig_link::UsbIdentity;

    use super::*;
    use crate::doctor::Level;

    #[test]
    fn a_port_that_is_not_there_is_told_with_those_that_are() {
        let (here, gone) =
            if cfg!(windows) { ("COM7", "COM3") } else { ("/dev/cu.a", "/dev/cu.b") };
        let usb = UsbIdentity {
            vendor_id: FTDI,
            product_id: 0x6001,
            serial_number: None,
            manufacturer: None,
            product: Some("FT232R".to_owned()),
        };
        let port = AttachedPort {
            device: here.to_owned(),
            stable_name: None,
            usb: Some(usb),
            latency_ms: None,
            holders: Vec::new(),
        };
        let wanted = vec![here.to_owned(), gone.to_owned()];
        let found = findings(&HostFacts { wanted, attached: vec![port] });
        let levels: Vec<_> = found.iter().map(|finding| finding.level).collect();
        assert_eq!(levels, [Level::Ok, Level::Problem, Level::Warning]);
        assert!(found[1].text.ends_with(here), "{}", found[1].text);
    }
}
