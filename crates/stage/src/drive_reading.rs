//! A reading of the status registers of a drive.

use std::fmt;

use rig_files::instrument::drive::{AlarmSource, Block, EmergencyStop, Field, Flag, Table, Width};
use rig_model::{Position, RigTime};

use crate::{RegisterMap, Reply, Request};

/// An alarm of a drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Alarm {
    /// The drive's code.
    pub code: u16,
    /// Its name in the manual.
    pub name: &'static str,
}

impl fmt::Display for Alarm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:#04x} ({})", self.code, self.name)
    }
}

/// The status of an axis, read from its drive.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::struct_excessive_bools, reason = "each is a flag of the drive")]
pub struct AxisStatus<U> {
    /// When it was read.
    pub at: RigTime,
    /// Position of the encoder.
    pub position: Position<U>,
    /// Target that the drive reports.
    pub target: Position<U>,
    /// Whether it moves.
    pub is_moving: bool,
    /// Whether the drive accepts a move.
    pub is_ready: bool,
    /// Whether the axis is homed.
    pub is_homed: bool,
    /// The alarm of the drive, if there is one.
    pub alarm: Option<Alarm>,
    /// Whether the drive says that its emergency stop is pressed.
    pub is_emergency_stopped: bool,
}

/// The status registers of a drive, in counts.
#[derive(Debug, Clone, Copy)]
#[expect(clippy::struct_excessive_bools, reason = "each is a flag of the drive")]
pub(crate) struct DriveReading {
    pub(crate) position: i32,
    pub(crate) target: i32,
    pub(crate) is_moving: bool,
    pub(crate) is_ready: bool,
    pub(crate) is_homed: bool,
    /// The code, where it is part of the status; zero for none.
    pub(crate) alarm_code: u16,
    /// The register to be read, where the status has only a flag and it is set.
    pub(crate) alarm_block: Option<Block>,
    /// Whether a flag of the status says that the emergency stop is pressed.
    pub(crate) has_stop_flag: bool,
}

impl DriveReading {
    /// Reads it out of the replies to the status blocks of a map.
    pub(crate) fn new(map: &RegisterMap, replies: &[Reply]) -> Self {
        let view = View { map, replies };
        let (alarm_code, alarm_block) = match map.alarm {
            AlarmSource::Code(field) => (view.code(field), None),
            AlarmSource::Flagged { flag, code } => (0, view.flag(flag).then_some(code)),
        };
        Self {
            position: view.number(map.position),
            target: view.number(map.target.field()),
            is_moving: view.flag(map.moving),
            is_ready: view.flag(map.ready),
            is_homed: view.flag(map.homed),
            alarm_code,
            alarm_block,
            has_stop_flag: matches!(map.emergency_stop, Some(EmergencyStop::Flag(flag)) if view.flag(flag)),
        }
    }
}

/// The number at an address of a block, from the reply to it.
pub(crate) fn number(block: Block, reply: &Reply, address: u16, width: Width) -> i32 {
    let word = |address: u16| {
        let index = usize::from(address - block.address);
        match reply {
            Reply::Words(words) => words[index],
            Reply::Bits(bits) => u16::from(bits[index]),
            Reply::Written => unreachable!("a read is not answered by a write"),
        }
    };
    match width {
        Width::U16 => i32::from(word(address)),
        Width::I32 => {
            let ([a, b], [c, d]) = (word(address).to_be_bytes(), word(address + 1).to_be_bytes());
            i32::from_be_bytes([a, b, c, d])
        }
    }
}

/// The alarm of a code, zero for none.
pub(crate) fn alarm(map: &'static RegisterMap, code: u16) -> Option<Alarm> {
    (code != 0).then(|| alarm_of_code(map, code))
}

/// The alarm of a drive that says it has one.
pub(crate) fn alarm_of_code(map: &'static RegisterMap, code: u16) -> Alarm {
    let known = map.alarms.iter().find(|(known, _)| *known == code);
    Alarm { code, name: known.map_or("see its manual", |(_, name)| name) }
}

/// The request that reads a block.
pub(crate) fn read_request(block: Block) -> Request {
    let Block { table, address, count } = block;
    match table {
        Table::Coil => Request::ReadCoils { address, count },
        Table::DiscreteInput => Request::ReadDiscreteInputs { address, count },
        Table::Holding => Request::ReadHolding { address, count },
        Table::Input => Request::ReadInput { address, count },
    }
}

/// The replies to the status blocks of a map.
struct View<'a> {
    map: &'a RegisterMap,
    replies: &'a [Reply],
}

impl View<'_> {
    fn number(&self, Field { block, address, width }: Field) -> i32 {
        number(self.map.status[block], &self.replies[block], address, width)
    }

    fn code(&self, field: Field) -> u16 {
        u16::try_from(self.number(field)).expect("a code is in one register")
    }

    fn flag(&self, Flag { block, address, bit, is_set_when }: Flag) -> bool {
        let word = self.number(Field { block, address, width: Width::U16 });
        (word >> bit & 1 == 1) == is_set_when
    }
}
