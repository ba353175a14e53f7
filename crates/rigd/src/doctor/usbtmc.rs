//! The driver of an instrument on USB: whether it has the instrument, and under which name.

use std::{
    fs,
    os::unix::fs::FileTypeExt,
    path::{Path, PathBuf},
};

use super::{Findings, host::entries};

/// Class and subclass of an interface of USB for instruments, as the system writes them.
///
/// # Source
/// USBTMC 1.0, table 43.
const USBTMC_CLASS: (&str, &str) = ("fe", "03");

/// The driver of Linux for such instruments.
const DRIVER: &str = "usbtmc";

/// The driver by which a program has a device of USB in its own hands, as libusb does.
const DRIVER_OF_PROGRAMS: &str = "usbfs";

/// What the computer shows of an instrument on USB.
#[derive(Debug)]
pub(super) struct UsbtmcFacts {
    /// The device file of the rig.
    path: String,
    has_file: bool,
    /// Whether the driver is loaded.
    is_loaded: bool,
    instruments: Vec<Instrument>,
}

/// An instrument that is on USB.
#[derive(Debug)]
struct Instrument {
    /// Vendor, product and, if it tells it, serial number.
    name: String,
    /// The driver that has it.
    driver: Option<String>,
}

impl UsbtmcFacts {
    /// Looks for the instruments of a computer. `None` for a socket, which stands for an instrument and needs no
    /// driver.
    pub(super) fn below(root: &Path, path: &str) -> Option<Self> {
        let file = fs::metadata(path).ok();
        if file.as_ref().is_some_and(|file| file.file_type().is_socket()) {
            return None;
        }
        let usb = root.join("sys/bus/usb");
        Some(Self {
            path: path.to_owned(),
            has_file: file.is_some(),
            is_loaded: usb.join("drivers").join(DRIVER).exists(),
            instruments: entries(&usb.join("devices"))
                .iter()
                .filter_map(|interface| instrument(interface))
                .collect(),
        })
    }
}

/// The instrument behind an interface, if it is one of its class. The name of the interface is that of its
/// device and a number: `1-2:1.0`.
fn instrument(interface: &Path) -> Option<Instrument> {
    let text = |file: PathBuf| Some(fs::read_to_string(file).ok()?.trim().to_owned());
    let class = text(interface.join("bInterfaceClass"))?;
    let subclass = text(interface.join("bInterfaceSubClass"))?;
    if (class.as_str(), subclass.as_str()) != USBTMC_CLASS {
        return None;
    }
    let (device, _) = interface.file_name()?.to_str()?.split_once(':')?;
    let device = interface.with_file_name(device);
    let mut name =
        format!("{}:{}", text(device.join("idVendor"))?, text(device.join("idProduct"))?);
    if let Some(number) = text(device.join("serial")) {
        name = format!("{name} with serial number {number}");
    }
    let driver = fs::read_link(interface.join("driver")).ok();
    let driver = driver.and_then(|link| Some(link.file_name()?.to_str()?.to_owned()));
    Some(Instrument { name, driver })
}

pub(super) fn findings(findings: &mut Findings, facts: &UsbtmcFacts) {
    const CHECK: &str = "driver of USB instruments";
    if facts.instruments.is_empty() {
        findings.problem(
            CHECK,
            "no instrument of the class USBTMC is on USB",
            "check its cable, and that it is switched on",
        );
    }
    for Instrument { name, driver } in &facts.instruments {
        match driver.as_deref() {
            Some(DRIVER) if facts.has_file => findings.ok(CHECK, format!("has {name}")),
            Some(DRIVER) => findings.problem(
                CHECK,
                format!("has {name}, and there is no file {}", facts.path),
                "write the name that `rigd ports` shows into the rig file",
            ),
            Some(DRIVER_OF_PROGRAMS) => findings.problem(
                CHECK,
                format!("a program has {name} through usbfs, and not the driver usbtmc"),
                "end that program (one that uses VISA or libusb), and plug the instrument in again",
            ),
            Some(other) => findings.problem(
                CHECK,
                format!("the driver {other} has {name}, and not the driver usbtmc"),
                "plug the instrument in again, and look for its name in `sudo dmesg`",
            ),
            None if facts.is_loaded => findings.problem(
                CHECK,
                format!("no driver has {name}"),
                "plug the instrument in again, and look for its name in `sudo dmesg`",
            ),
            None => findings.problem(
                CHECK,
                format!("no driver has {name}, and the module usbtmc is not loaded"),
                "`sudo modprobe usbtmc`; if there is no such module, install the extra modules of the kernel \
                 (linux-modules-extra on Ubuntu)",
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use tempfile::TempDir;

    use super::*;
    use crate::doctor::Level::{self, Ok as Well, Problem};

    /// A computer with an instrument of this driver, and its finding.
    #[track_caller]
    fn check(driver: Option<&str>, is_loaded: bool, has_file: bool, expected: (Level, &str)) {
        let root = TempDir::new().unwrap();
        let usb = root.path().join("sys/bus/usb");
        let write = |path: &str, text: &str| {
            let path = usb.join("devices").join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        for (name, text) in
            [("idVendor", "0957\n"), ("idProduct", "0909\n"), ("serial", "MY46100001\n")]
        {
            write(&format!("1-2/{name}"), text);
        }
        for (interface, class) in [("1-2:1.0", "fe"), ("1-2:1.1", "08")] {
            write(&format!("{interface}/bInterfaceClass"), &format!("{class}\n"));
            write(&format!("{interface}/bInterfaceSubClass"), "03\n");
        }
        if is_loaded {
            fs::create_dir_all(usb.join("drivers/usbtmc")).unwrap();
        }
        if let Some(driver) = driver {
            let target = format!("../../drivers/{driver}");
            symlink(target, usb.join("devices/1-2:1.0/driver")).unwrap();
        }
        let file = root.path().join("usbtmc0");
        if has_file {
            fs::write(&file, "").unwrap();
        }
        let mut found = Findings::of("computer");
        let facts = UsbtmcFacts::below(root.path(), file.to_str().unwrap()).unwrap();
        findings(&mut found, &facts);
        let [only] = found.all.as_slice() else { panic!("{found:?}", found = found.all) };
        assert_eq!(only.level, expected.0, "{only:?}");
        assert!(only.text.contains(expected.1), "{only:?}");
    }

    #[test]
    fn what_has_the_instrument_is_named() {
        let here = "0957:0909 with serial number MY46100001";
        check(Some("usbtmc"), true, true, (Well, here));
        check(Some("usbtmc"), true, false, (Problem, "there is no file"));
        check(Some("usbfs"), true, false, (Problem, "a program has 0957:0909"));
        check(Some("usbhid"), true, false, (Problem, "the driver usbhid has 0957:0909"));
        check(None, true, false, (Problem, here));
        check(None, false, false, (Problem, "the module usbtmc is not loaded"));
    }

    #[test]
    fn a_computer_without_an_instrument_is_told_so_and_a_socket_needs_no_driver() {
        let root = TempDir::new().unwrap();
        let mut found = Findings::of("computer");
        let facts = UsbtmcFacts::below(root.path(), "/dev/no-such-instrument").unwrap();
        findings(&mut found, &facts);
        assert_eq!(found.all[0].text, "no instrument of the class USBTMC is on USB");
        let socket = root.path().join("socket");
        let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        assert!(UsbtmcFacts::below(root.path(), socket.to_str().unwrap()).is_none());
    }
}
