//! Advice for a port that does not open and a device with a wrong answer.
//!
//! Advice names the thing to check and never a cause that was not observed. It mentions serial
//! settings for serial lines only, cables not for a network, and it never moves an axis.

use rig_analyzer::{AnalyzerError, UnexpectedTerminator};
use rig_link::LineError;
use rig_model::PortKind;
use rig_stage::{BusError, LineFault, StageError, Symptom};

use crate::{
    hint::LOST,
    rig::{DeviceError, OpenError},
};

/// Advice for an axis that is not homed. The drive's settings fix the direction of homing.
pub(super) const NOT_HOMED: &str = "clear the whole travel of the axis before the rig is opened for work: \
    the rotary stage is homed then; the linear stage only with `homes = \"up\"` in the rig file, or after \
    `rigd home --nothing-below-probe`";

/// Advice for a rig that cannot be opened, if there is any.
pub(crate) fn on_rig(error: &OpenError) -> Option<&'static str> {
    match error {
        OpenError::Port { source, .. } => Some(on_port(source)),
        OpenError::Device { kind, source, .. } => Some(on_device(source, *kind)),
        _ => None,
    }
}

/// Advice for a port that cannot be opened.
pub(super) const fn on_port(error: &rig_link::OpenError) -> &'static str {
    use rig_link::OpenError;
    match error {
        OpenError::Absent { .. } => {
            "plug it in; `rigd ports` shows what is attached, and the rig file must name it"
        }
        OpenError::NotAPort { .. } => {
            "name a port in the rig file; `rigd ports` shows which there are"
        }
        OpenError::NoStatusByte { .. } => {
            "install another release of Linux: some of the year 2025 do not give it"
        }
        OpenError::Busy { .. } => "end that program",
        OpenError::Permission { .. } => on_permission(cfg!(target_os = "linux")),
        OpenError::TimedOut { .. } => {
            "check the address in the rig file, the network, and that the device is switched on"
        }
        OpenError::Unconnected { .. } => {
            "check address and port number in the rig file, and that the device is switched on"
        }
        OpenError::Io { .. } => "check the adapter and its cable, and its settings in the rig file",
    }
}

/// Advice for a port that this user may not open. Neither macOS nor Windows has the group of Linux, or its udev.
pub(super) const fn on_permission(is_linux: bool) -> &'static str {
    if is_linux {
        "add this user to the group of the device (often dialout), and log in again; if that group is root, \
         install the udev rules (`rigd doctor --udev-rules`) first"
    } else {
        "give this user the right to read and to write the device, or run rigd as a user who has it"
    }
}

/// Advice for a device with a wrong answer.
pub(super) fn on_device(error: &DeviceError, kind: PortKind) -> &'static str {
    match error {
        DeviceError::Analyzer(error) => on_analyzer(error, kind),
        DeviceError::Linear(error) => on_stage(error, kind),
        DeviceError::Rotary(error) => on_stage(error, kind),
    }
}

fn on_analyzer(error: &AnalyzerError, kind: PortKind) -> &'static str {
    match error {
        AnalyzerError::WrongInstrument { .. } | AnalyzerError::Swapped { .. } => {
            "name its dialect in the rig file, or connect the instrument that is named there"
        }
        AnalyzerError::Line {
            unexpected_terminator: Some(UnexpectedTerminator::CrForLf), ..
        } => {
            "write terminator = \"cr\" in [analyzer] of the rig file, or have the instrument end \
             its \
             answers in LF"
        }
        AnalyzerError::Line {
            unexpected_terminator: Some(UnexpectedTerminator::LfForCr), ..
        } => {
            "correct terminator in [analyzer] of the rig file, or have the instrument end its \
             answers \
             in CR"
        }
        AnalyzerError::Line { source: LineError::TimedOut { arrived, .. }, .. }
            if !arrived.bytes.is_empty() =>
        {
            "increase reply_timeout_s in [analyzer] of the rig file; if the answer stays \
             incomplete, compare it with the manual of the instrument"
        }
        AnalyzerError::Line { source: LineError::TimedOut { .. }, .. } if is_serial(kind) => {
            "check its power and cable, then compare speed, parity and terminator in the rig file \
             with its settings"
        }
        AnalyzerError::Line { source: LineError::TimedOut { .. }, .. } if is_usb(kind) => {
            "read the display of the instrument; then check that its terminator is the one in the rig file, and \
             that no other program uses it"
        }
        AnalyzerError::Line { source: LineError::TimedOut { .. }, .. } => {
            "check that this is the instrument's port for commands, and that its terminator is \
             the one in the rig file"
        }
        AnalyzerError::Frame { .. } if is_serial(kind) => {
            "compare speed and parity in the rig file with the settings of the instrument"
        }
        AnalyzerError::Frame { .. } if is_usb(kind) => {
            "check that usbtmc in the rig file names the instrument, and that no other program uses it"
        }
        AnalyzerError::Frame { .. } => {
            "check that address and port in the rig file are those of the instrument"
        }
        AnalyzerError::Line { .. }
        | AnalyzerError::Reopen { .. }
        | AnalyzerError::Unquiet { .. }
        | AnalyzerError::Strays { .. } => on_lost(kind),
        AnalyzerError::Answer { .. } => {
            "compare the answer with the manual of the instrument, and its model with the dialect \
             in \
             the rig file"
        }
        AnalyzerError::HeldUp { .. } => {
            "look for the load of this computer and of its disk, and keep it from sleeping"
        }
        _ => "read the display of the instrument, and find the command in its manual",
    }
}

fn on_stage<U: rig_model::Unit>(error: &StageError<U>, kind: PortKind) -> &'static str {
    match error {
        StageError::Bus(BusError::Failed(LineFault::NoAnswer { symptom, .. })) => {
            on_symptom(*symptom, kind)
        }
        StageError::Bus(BusError::Failed(LineFault::Changed { .. })) => {
            "check that register map and unit id in the rig file are those of the drive, and that \
             no \
             other tool writes to it"
        }
        StageError::Bus(BusError::Failed(_)) => on_lost(kind),
        StageError::Bus(BusError::Refused(_)) => {
            "check that the register map in the rig file is that of the drive"
        }
        StageError::Unrecognised { .. } => {
            "check that address, unit id and register map in the rig file are those of the drive"
        }
        StageError::OtherResolution { .. } => {
            "set the resolution in the drive to that of the rig file; or correct the rig file: \
             steps_per_revolution, and with it mm_per_step or deg_per_step"
        }
        StageError::BeyondTravel { .. } => LOST,
        StageError::Unhomed { .. } => NOT_HOMED,
        _ => "read the display of the drive, and find its state in its manual",
    }
}

const fn on_symptom(symptom: Symptom, kind: PortKind) -> &'static str {
    match symptom {
        Symptom::Silence | Symptom::OnlyEcho if is_serial(kind) => {
            "check its power and cable, then compare speed, parity and unit id in the rig file \
             with its settings"
        }
        Symptom::Silence | Symptom::OnlyEcho => {
            "check its power, and that a device with the unit id of the rig file is at this address"
        }
        Symptom::Garbage if is_serial(kind) => {
            "compare speed and parity in the rig file with the settings of the drive"
        }
        Symptom::Garbage => {
            "check that address and port in the rig file are those of a Modbus TCP device"
        }
        Symptom::Truncated | Symptom::Corrupted if is_serial(kind) => {
            "check the cable, its shield and its termination, and compare speed and parity"
        }
        Symptom::Truncated | Symptom::Corrupted => "check the device or gateway at this address",
        Symptom::ForeignUnit(_) | Symptom::Surplus | Symptom::OtherAnswer if is_serial(kind) => {
            "look for a second master on the line, and for two devices with the same unit id"
        }
        Symptom::ForeignUnit(_)
        | Symptom::Surplus
        | Symptom::OtherAnswer
        | Symptom::WrongCount { .. } => {
            "check that register map and unit id in the rig file are those of the drive"
        }
    }
}

const fn on_lost(kind: PortKind) -> &'static str {
    match kind {
        PortKind::Serial => {
            "check the cable and the adapter, and that no other program uses the port"
        }
        PortKind::Network => {
            "check the network, that the device stays switched on, and that no other program uses it"
        }
        PortKind::Usb => {
            "check the cable, that the instrument stays switched on, and that no other program uses it"
        }
    }
}

const fn is_usb(kind: PortKind) -> bool {
    matches!(kind, PortKind::Usb)
}

const fn is_serial(kind: PortKind) -> bool {
    matches!(kind, PortKind::Serial)
}
