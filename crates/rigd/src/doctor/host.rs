//! Checks of the computer: programs that take ports away, adapters that cannot be told apart, permissions, and the
//! driver of an instrument on USB.
//!
//! Everything is read below a root directory, so that a test can make a computer of its own.

use std::{
    fs,
    path::{Path, PathBuf},
};

use rig_files::rig_file::{Connection, PortFile, RigFile};
use rig_link::{AttachedPort, attached_ports};
use rig_model::PortKind;

use super::{
    Finding, Findings,
    usbtmc::{self, UsbtmcFacts},
};

/// Where udev rules are.
const RULES: [&str; 3] = [
    "etc/udev/rules.d/99-rigd.rules",
    "lib/udev/rules.d/99-rigd.rules",
    "usr/lib/udev/rules.d/99-rigd.rules",
];

/// Adapters that brltty before 6.5 takes for a Braille display, by vendor and product.
///
/// # Source
/// arduino-ide issue 1788 (CH340 and others).
const TAKEN_BY_BRLTTY: [(u16, u16); 2] = [(0x1A86, 0x7523), (0x10C4, 0xEA60)];

/// What the computer shows.
#[derive(Debug, Default)]
pub(crate) struct HostFacts {
    /// Names of the programs that run.
    programs: Vec<String>,
    /// Vendor and product of each device on USB that has no serial port, and could have one.
    without_port: Vec<(u16, u16)>,
    /// The serial ports of the computer.
    attached: Vec<AttachedPort>,
    /// Device files of the rig, each with its group and whether this user may open it.
    files: Vec<(String, Option<Group>)>,
    has_rules: bool,
    /// Whether one of those files is a serial port.
    has_serial: bool,
    /// The analyzer, if it is an instrument on USB.
    usbtmc: Option<UsbtmcFacts>,
}

/// The group of a device file.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Group {
    name: String,
    is_mine: bool,
}

impl HostFacts {
    /// Looks at this computer, for the serial ports of a rig and its instrument on USB; `None` for a rig without
    /// either.
    pub(crate) fn look(rig: &RigFile) -> Option<Self> {
        let ports = [&rig.analyzer.port, &rig.bus];
        let ports: Vec<_> =
            ports.into_iter().filter(|port| !matches!(port, PortFile::Tcp { .. })).collect();
        let is_of_ports = rig.connection == Connection::Ports && !ports.is_empty();
        is_of_ports.then(|| Self::below(Path::new("/"), &ports, attached_ports()))
    }

    fn below(root: &Path, ports: &[&PortFile], attached: Vec<AttachedPort>) -> Self {
        let (groups, is_superuser) = (groups(root), is_superuser(root));
        let group_of = |port: &&PortFile| {
            let path = port.place();
            let group = group_of(Path::new(path)).map(|id| Group {
                name: name_of(root, id),
                is_mine: is_superuser || groups.contains(&id),
            });
            (path.to_owned(), group)
        };
        let usbtmc = ports.iter().find_map(|port| match port {
            PortFile::Usbtmc { path } => UsbtmcFacts::below(root, path),
            PortFile::Serial { .. } | PortFile::Tcp { .. } => None,
        });
        Self {
            programs: programs(root),
            without_port: without_port(root),
            attached,
            files: ports.iter().map(group_of).collect(),
            has_rules: RULES.iter().any(|rules| root.join(rules).exists()),
            has_serial: ports.iter().any(|port| port.kind() == PortKind::Serial),
            usbtmc,
        }
    }

    fn runs(&self, name: &str) -> bool {
        self.programs.iter().any(|program| program == name)
    }
}

/// The findings about a computer.
pub(crate) fn findings(host: &HostFacts) -> Vec<Finding> {
    let mut findings = Findings::of("computer");
    permissions(&mut findings, host);
    if let Some(facts) = &host.usbtmc {
        usbtmc::findings(&mut findings, facts);
    }
    if host.has_serial {
        names(&mut findings, host);
        brltty(&mut findings, host);
        modem_manager(&mut findings, host);
    }
    if host.has_rules {
        findings.ok("udev rules", "99-rigd.rules is installed");
    } else {
        findings.warning(
            "udev rules",
            "no 99-rigd.rules",
            "`rigd doctor --udev-rules | sudo tee /etc/udev/rules.d/99-rigd.rules`, then \
             `sudo udevadm control --reload`, and plug the adapters in again",
        );
    }
    findings.all
}

fn permissions(findings: &mut Findings, host: &HostFacts) {
    for (path, group) in &host.files {
        match group {
            // That the port is not there is told with the port.
            None => {}
            Some(Group { name, is_mine: true }) => {
                findings.ok(
                    "permission",
                    format!(
                        "{path} is of the group {name}, and this user is in it or is the superuser"
                    ),
                );
            }
            // It would be the group of the superuser to join.
            Some(Group { name, is_mine: false }) if name == "root" => findings.warning(
                "permission",
                format!("{path} is of the group root, and this user is not in it"),
                "install the udev rules, which give it to the group dialout (`rigd doctor --udev-rules`)",
            ),
            Some(Group { name, is_mine: false }) => findings.warning(
                "permission",
                format!("{path} is of the group {name}, and this user is not in it"),
                "`sudo usermod -aG GROUP USER` with the group of the port, and log in again",
            ),
        }
    }
}

/// Two adapters of one product without serial numbers, or with one number, have one name by their id.
fn names(findings: &mut Findings, host: &HostFacts) {
    let id = |port: &AttachedPort| {
        let usb = port.usb.as_ref()?;
        Some((usb.vendor_id, usb.product_id, usb.serial_number.clone()))
    };
    let shared = host.attached.iter().enumerate().find_map(|(at, port)| {
        let wanted = id(port)?;
        let other = host.attached[..at].iter().find(|other| id(other).as_ref() == Some(&wanted))?;
        // The interfaces of one adapter have its number in common, and names of their own.
        let is_one = wanted.2.is_some()
            && other.stable_name.is_some()
            && other.stable_name != port.stable_name;
        (!is_one).then(|| format!("{} and {}", other.device, port.device))
    });
    match shared {
        None => findings.ok("names", "each adapter has a name of its own"),
        Some(pair) => findings.warning(
            "names",
            format!(
                "{pair} cannot be told apart: same product, and no serial numbers of their own"
            ),
            "name them by their place: /dev/serial/by-path, or /dev/rigd/by-port of the udev rules",
        ),
    }
}

fn brltty(findings: &mut Findings, host: &HostFacts) {
    let taken = TAKEN_BY_BRLTTY.iter().find(|id| host.without_port.contains(id));
    match (host.runs("brltty"), taken) {
        (false, None) => findings.ok("brltty", "does not run"),
        (true, None) => findings.warning(
            "brltty",
            "runs, and takes adapters by CH340 and CP210x before version 6.5",
            "remove it if nobody needs a Braille display: `sudo apt remove brltty`",
        ),
        (is_running, Some((vendor, product))) => {
            let who = if is_running { "brltty runs" } else { "no port" };
            findings.problem(
                "brltty",
                format!("{who}: the adapter {vendor:04x}:{product:04x} is on USB, and has no serial port"),
                "look for `claimed by` in `sudo dmesg`; if it names brltty, `sudo apt remove brltty`, \
                 and plug the adapter in again",
            );
        }
    }
}

fn modem_manager(findings: &mut Findings, host: &HostFacts) {
    let has_modem_like = host.files.iter().any(|(path, _)| {
        fs::canonicalize(path).is_ok_and(|device| device.to_string_lossy().contains("ttyACM"))
    });
    match (host.runs("ModemManager"), host.has_rules) {
        (false, _) => findings.ok("ModemManager", "does not run"),
        (true, true) => {
            findings.ok(
                "ModemManager",
                "runs, and the udev rules tell it which adapters to leave alone",
            );
        }
        (true, false) => {
            let which =
                if has_modem_like { "among them a port of this rig" } else { "ttyACM above all" };
            findings.warning(
                "ModemManager",
                format!("runs, and asks each new serial port for some seconds whether it is a modem, {which}"),
                "install the udev rules (`rigd doctor --udev-rules`)",
            );
        }
    }
}

/// The entries of a directory, sorted; none if it does not exist.
pub(super) fn entries(directory: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(directory).into_iter().flatten().flatten();
    let mut paths: Vec<_> = entries.map(|entry| entry.path()).collect();
    paths.sort();
    paths
}

/// Names of the programs that run, as far as this user may know.
fn programs(root: &Path) -> Vec<String> {
    let name = |process: PathBuf| {
        process.file_name()?.to_str()?.parse::<u32>().ok()?;
        Some(fs::read_to_string(process.join("comm")).ok()?.trim().to_owned())
    };
    entries(&root.join("proc")).into_iter().filter_map(name).collect()
}

/// Adapters for serial ports on USB that no driver of serial ports has.
fn without_port(root: &Path) -> Vec<(u16, u16)> {
    let id = |device: &Path, name: &str| {
        let text = fs::read_to_string(device.join(name)).ok()?;
        u16::from_str_radix(text.trim(), 16).ok()
    };
    let missing = |device: PathBuf| {
        let found = (id(&device, "idVendor")?, id(&device, "idProduct")?);
        let name = device.file_name()?.to_string_lossy().into_owned();
        // Its interfaces are `1-2:1.0` and so on, each with its port.
        let interfaces = entries(&device).into_iter().filter(|path| {
            path.file_name()
                .is_some_and(|entry| entry.to_string_lossy().starts_with(&format!("{name}:")))
        });
        let has_port = interfaces.flat_map(|interface| entries(&interface)).any(|entry| {
            entry.file_name().is_some_and(|name| name.to_string_lossy().starts_with("tty"))
        });
        (TAKEN_BY_BRLTTY.contains(&found) && !has_port).then_some(found)
    };
    entries(&root.join("sys/bus/usb/devices")).into_iter().filter_map(missing).collect()
}

/// The numbers behind a key of the status of this program.
fn status_of(root: &Path, key: &str) -> Vec<u32> {
    let status = fs::read_to_string(root.join("proc/self/status")).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix(key)).unwrap_or_default();
    line.split_whitespace().filter_map(|id| id.parse().ok()).collect()
}

/// The ids of the groups of this program. The second of its own ones is the effective one.
fn groups(root: &Path) -> Vec<u32> {
    let own = status_of(root, "Gid:").get(1).copied();
    status_of(root, "Groups:").into_iter().chain(own).collect()
}

/// Whether this program runs as the superuser, who may open every port.
fn is_superuser(root: &Path) -> bool {
    status_of(root, "Uid:").get(1) == Some(&0)
}

fn group_of(path: &Path) -> Option<u32> {
    use std::os::unix::fs::MetadataExt;
    fs::metadata(path).ok().map(|file| file.gid())
}

/// The name of a group; its number where no file has it.
fn name_of(root: &Path, id: u32) -> String {
    let text = fs::read_to_string(root.join("etc/group")).unwrap_or_default();
    let name = text.lines().find_map(|line| {
        let mut parts = line.split(':');
        let name = parts.next()?;
        (parts.nth(1)?.parse() == Ok(id)).then(|| name.to_owned())
    });
    name.unwrap_or_else(|| id.to_string())
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::MetadataExt;

    use rig_link::UsbIdentity;
    use rig_model::{LineSettings, Parity, StopBits};
    use tempfile::TempDir;

    use super::*;
    use crate::doctor::Level;

    fn write(root: &Path, path: &str, text: &str) {
        let path = root.join(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }

    fn adapter(device: &str, serial_number: Option<&str>, stable_name: &str) -> AttachedPort {
        AttachedPort {
            device: device.to_owned(),
            stable_name: Some(stable_name.to_owned()),
            usb: Some(UsbIdentity {
                vendor_id: 0x1A86,
                product_id: 0x7523,
                serial_number: serial_number.map(str::to_owned),
                manufacturer: None,
                product: None,
            }),
            latency_ms: None,
            holders: Vec::new(),
        }
    }

    /// The checks and levels of a computer, and all of their text.
    fn look(root: &Path, paths: &[String], attached: Vec<AttachedPort>) -> (Vec<Level>, String) {
        let line = LineSettings { baud: 9600, parity: Parity::None, stop_bits: StopBits::One };
        let serial = |path: &String| PortFile::Serial { path: path.clone(), line };
        let ports: Vec<_> = paths.iter().map(serial).collect();
        look_at(root, &ports, attached)
    }

    fn look_at(
        root: &Path,
        ports: &[PortFile],
        attached: Vec<AttachedPort>,
    ) -> (Vec<Level>, String) {
        let ports: Vec<_> = ports.iter().collect();
        let found = findings(&HostFacts::below(root, &ports, attached));
        let text: Vec<_> = found.iter().map(|finding| finding.text.clone()).collect();
        (found.iter().map(|finding| finding.level).collect(), text.join("\n"))
    }

    use Level::{Ok as Well, Problem, Warning};

    #[test]
    fn a_computer_in_order_has_nothing_to_be_told() {
        let root = TempDir::new().unwrap();
        let root = root.path();
        write(root, "dev/ttyUSB0", "");
        let device = root.join("dev/ttyUSB0");
        let group = fs::metadata(&device).unwrap().gid();
        write(root, "proc/self/status", &format!("Uid:\t7\t7\nGid:\t9\t9\nGroups:\t{group} \n"));
        write(root, "proc/11/comm", "bash\n");
        write(root, "etc/group", &format!("dialout:x:{group}:ada\n"));
        write(root, "etc/udev/rules.d/99-rigd.rules", "");
        write(root, "sys/bus/usb/devices/1-2/idVendor", "1a86\n");
        write(root, "sys/bus/usb/devices/1-2/idProduct", "7523\n");
        write(root, "sys/bus/usb/devices/1-2/1-2:1.0/ttyUSB0/uevent", "");
        let attached =
            vec![adapter("/dev/ttyUSB0", None, "a"), adapter("/dev/ttyUSB1", Some("1"), "b")];
        let (levels, text) = look(root, &[device.to_str().unwrap().to_owned()], attached);
        assert_eq!(levels, [Well; 5], "{text}");
        assert!(text.contains("is of the group dialout, and this user is in it"), "{text}");
    }

    #[test]
    fn what_takes_a_port_away_is_named() {
        let root = TempDir::new().unwrap();
        let root = root.path();
        write(root, "dev/ttyUSB0", "");
        write(root, "proc/self/status", "Uid:\t7\t7\nGid:\t4294967294\t4294967294\nGroups:\t\n");
        write(root, "proc/11/comm", "brltty\n");
        write(root, "proc/12/comm", "ModemManager\n");
        write(root, "sys/bus/usb/devices/1-2/idVendor", "1a86\n");
        write(root, "sys/bus/usb/devices/1-2/idProduct", "7523\n");
        write(root, "sys/bus/usb/devices/1-2/1-2:1.0/uevent", "");
        let path = root.join("dev/ttyUSB0").to_str().unwrap().to_owned();
        let attached = vec![adapter("/dev/ttyUSB0", None, "a"), adapter("/dev/ttyUSB1", None, "a")];
        let (levels, text) = look(root, &[path], attached);
        assert_eq!(levels, [Warning, Warning, Problem, Warning, Warning], "{text}");
        for said in [
            "and this user is not in it",
            "/dev/ttyUSB0 and /dev/ttyUSB1 cannot be told apart",
            "brltty runs: the adapter 1a86:7523 is on USB, and has no serial port",
            "asks each new serial port",
            "no 99-rigd.rules",
        ] {
            assert!(text.contains(said), "{text}\ndoes not say: {said}");
        }
    }

    #[test]
    fn the_interfaces_of_one_adapter_are_told_apart() {
        let root = TempDir::new().unwrap();
        let attached =
            vec![adapter("/dev/ttyUSB0", Some("7"), "a"), adapter("/dev/ttyUSB1", Some("7"), "b")];
        let (levels, text) = look(root.path(), &["/dev/ttyUSB0".to_owned()], attached);
        assert_eq!(levels[levels.len() - 4], Well, "{text}");
    }

    #[test]
    fn a_device_file_of_the_group_root_asks_for_the_rules() {
        let root = TempDir::new().unwrap();
        let root = root.path();
        write(root, "dev/usbtmc0", "");
        let group = fs::metadata(root.join("dev/usbtmc0")).unwrap().gid();
        write(root, "proc/self/status", "Uid:\t7\t7\nGid:\t4294967294\t4294967294\nGroups:\t\n");
        write(root, "etc/group", &format!("root:x:{group}:\n"));
        let path = root.join("dev/usbtmc0").to_str().unwrap().to_owned();
        let found = HostFacts::below(root, &[&PortFile::Usbtmc { path }], Vec::new());
        let found = findings(&found);
        // Nothing is said of serial ports.
        let checks: Vec<_> = found.iter().map(|finding| finding.check).collect();
        assert_eq!(checks, ["permission", "driver of USB instruments", "udev rules"]);
        assert!(found[0].text.ends_with("is of the group root, and this user is not in it"));
        assert!(found[0].advice.is_some_and(|advice| advice.contains("--udev-rules")));
    }
}
