//! What a Modbus axis drive must be told, as data.

use rig_model::{DriveMake, Parity, Scale};

/// One of the four tables of a Modbus device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Table {
    /// Bits that can be written.
    Coil,
    /// Bits that can only be read.
    DiscreteInput,
    /// Registers that can be written.
    Holding,
    /// Registers that can only be read.
    Input,
}

/// Neighbouring addresses that are read in one request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Block {
    /// Table of the addresses.
    pub table: Table,
    /// Address of the first register or coil.
    pub address: u16,
    /// Number of addresses.
    pub count: u16,
}

impl Block {
    /// Whether it has these neighbouring addresses.
    pub const fn contains(self, address: u16, count: u16) -> bool {
        self.address <= address
            && address as u32 + count as u32 <= self.address as u32 + self.count as u32
    }
}

/// A number in a status block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Field {
    /// Index of the block.
    pub block: usize,
    /// Address of its first register.
    pub address: u16,
    /// Number of registers and sign of the value.
    pub width: Width,
}

/// The layout of a number in registers, high word first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Width {
    /// One register, unsigned.
    U16,
    /// Two registers, signed.
    I32,
}

impl Width {
    /// Number of registers.
    pub const fn registers(self) -> u16 {
        match self {
            Self::U16 => 1,
            Self::I32 => 2,
        }
    }
}

/// A bit in a status block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Flag {
    /// Index of the block.
    pub block: usize,
    /// The register, coil or input.
    pub address: u16,
    /// The bit of the register; zero for coils and inputs.
    pub bit: u8,
    /// The level that means yes.
    pub is_set_when: bool,
}

/// One write of a command.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Step {
    /// Several registers in one request.
    Registers {
        /// First register.
        address: u16,
        /// Values of the registers.
        contents: Vec<RegisterContent>,
    },
    /// Writes one register.
    Register {
        /// Address of the register.
        address: u16,
        /// Value of the register or coil.
        value: u16,
    },
    /// Writes one coil.
    Coil {
        /// Address of the coil.
        address: u16,
        /// Value of the register or coil.
        is_on: bool,
    },
    /// The drive needs the level for this time before the next step.
    Hold {
        /// Time, ms.
        ms: u16,
    },
}

/// The content of registers of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RegisterContent {
    /// A constant in one register.
    Word(u16),
    /// A constant in two registers.
    Long(i32),
    /// A quantity of the move.
    Of(Quantity, Width),
}

impl RegisterContent {
    /// Number of registers.
    pub const fn registers(self) -> u16 {
        match self {
            Self::Word(_) => 1,
            Self::Long(_) => 2,
            Self::Of(_, width) => width.registers(),
        }
    }
}

/// The quantities of a move, in the drive's own units.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Target position, counts.
    Target,
    /// Speed, in the unit of the map.
    Speed,
    /// Acceleration, in the unit of the map.
    Acceleration,
    /// Deceleration, in the unit of the map.
    Deceleration,
    /// The lower limit of position.
    LimitMin,
    /// The upper limit of position.
    LimitMax,
}

impl Quantity {
    /// Its name in an instrument file.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Target => "target",
            Self::Speed => "speed",
            Self::Acceleration => "acceleration",
            Self::Deceleration => "deceleration",
            Self::LimitMin => "limit_min",
            Self::LimitMax => "limit_max",
        }
    }

    /// Whether it is of a move, and not of the axis.
    pub const fn is_of_a_move(self) -> bool {
        !matches!(self, Self::LimitMin | Self::LimitMax)
    }
}

/// The unit in which a drive takes its speed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SpeedUnit {
    /// Counts per second.
    CountsPerSecond,
    /// Revolutions of the motor per minute.
    RevolutionsPerMinute,
}

impl SpeedUnit {
    /// This unit for a count per second of an axis.
    pub fn per_count_per_s<U>(self, scale: &Scale<U>) -> f64 {
        match self {
            Self::CountsPerSecond => 1.0,
            Self::RevolutionsPerMinute => 60.0 / scale.counts_per_revolution,
        }
    }

    /// The slowest move of an axis, in its unit per second: a drive takes whole numbers.
    pub fn slowest_per_s<U>(self, scale: &Scale<U>) -> f64 {
        scale.per_count.abs() / self.per_count_per_s(scale)
    }
}

/// The unit in which a drive takes its acceleration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AccelerationUnit {
    /// Counts per second squared.
    CountsPerSecond2,
    /// Hundredths of the standard acceleration of free fall, of an axis in millimetres.
    HundredthsOfG,
    /// Milliseconds for a change of 1000 revolutions per minute.
    MillisecondsPer1000Rpm,
}

/// The read-back of the drive's target.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TargetReadBack {
    /// The position that the drive commands its motor to; equal to the target after the move.
    CommandPosition(Field),
    /// The register to which the target was written.
    Register(Field),
}

impl TargetReadBack {
    /// Where it is read.
    pub const fn field(self) -> Field {
        match self {
            Self::CommandPosition(field) | Self::Register(field) => field,
        }
    }
}

/// The source of the alarm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AlarmSource {
    /// By a code in its status, zero for none.
    Code(Field),
    /// By a flag in its status, and a code that is read only then.
    Flagged {
        /// Flag of an alarm.
        flag: Flag,
        /// The register of the code.
        code: Block,
    },
}

/// How a drive says that its emergency stop is pressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EmergencyStop {
    /// By a flag in its status, as long as it is pressed.
    Flag(Flag),
    /// By the alarm with this code, which stays until it is reset.
    Alarm(u16),
}

/// Settings that are written to the drive once: its own soft limits, if it has them, against a
/// faulty host. Their values are known from then on, so that they also identify the drive after a
/// fault of the line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DriveSettings {
    /// Steps that write the settings.
    pub write: Vec<Step>,
    /// Reads them back.
    pub read: Block,
    /// Values that a read of the settings must give.
    pub expect: Vec<RegisterContent>,
}

impl DriveSettings {
    /// Whether all that is written is read back.
    pub fn are_all_read(&self) -> bool {
        let is_read = |table, address: u16, count: u16| {
            self.read.table == table && self.read.contains(address, count)
        };
        self.write.iter().all(|step| match step {
            Step::Registers { address, contents } => {
                let registers = contents.iter().map(|content| content.registers()).sum();
                is_read(Table::Holding, *address, registers)
            }
            Step::Register { address, .. } => is_read(Table::Holding, *address, 1),
            Step::Coil { address, .. } => is_read(Table::Coil, *address, 1),
            Step::Hold { .. } => true,
        })
    }
}

/// Registers that distinguish a drive of this make from another device: quantities that are never
/// zero in a drive that is switched on, and that rigd never writes. No make here has a register with
/// its name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MakeSignature {
    /// Name of the quantity, with its unit.
    pub what: String,
    /// Where. Its answer has another length than that to the settings.
    pub read: Block,
    /// The addresses of the quantities, and the least and the most that each can be.
    pub ranges: Vec<(u16, Width, i32, i32)>,
}

/// The counts for one revolution of the motor, from registers of the signature:
/// factor · dividend / divisor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resolution {
    /// Counts if dividend and divisor are equal, or the factor of a register of counts.
    pub factor: f64,
    /// Address and width of the dividend.
    pub dividend: (u16, Width),
    /// Address and width of the divisor; `None` for 1.
    pub divisor: Option<(u16, Width)>,
}

/// Everything that differs between two makes of drive.
#[derive(Debug, Clone, PartialEq)]
pub struct RegisterMap {
    /// Name in rig files and messages.
    pub name: String,
    /// The make that plays it on a simulated rig; `None` if none does.
    pub simulated_as: Option<DriveMake>,
    /// The parity of its serial line as it leaves the factory.
    pub parity: Parity,
    /// The drives it is for, as people read them.
    pub drives: String,
    /// Whether it was tried on no hardware and its sources disagree.
    pub is_to_be_verified: bool,
    /// Registers that distinguish the drive from another device.
    pub signature: MakeSignature,
    /// The resolution that is set in the drive, which decides what a count means; `None` where it cannot
    /// be set.
    pub resolution: Option<Resolution>,
    /// The blocks of one status reading, in order. The answers to these blocks and to the settings
    /// all have different lengths, so that none is ever taken for another.
    pub status: Vec<Block>,
    /// Measured position, counts.
    pub position: Field,
    /// The target, counts.
    pub target: TargetReadBack,
    /// Whether it moves.
    pub moving: Flag,
    /// Whether the drive accepts a move.
    pub ready: Flag,
    /// Whether the axis is homed.
    pub homed: Flag,
    /// Source of the alarm in the status.
    pub alarm: AlarmSource,
    /// How the drive says that its emergency stop is pressed; `None` where it does not.
    pub emergency_stop: Option<EmergencyStop>,
    /// Names of the alarm codes.
    pub alarms: Vec<(u16, String)>,
    /// Unit of speed.
    pub speed: SpeedUnit,
    /// Unit of acceleration.
    pub acceleration: AccelerationUnit,
    /// Longest delay between the start of a move and its first sign, ms.
    pub start_within_ms: u16,
    /// Makes the drive take commands from here. Moves nothing.
    pub prepare: Vec<Step>,
    /// Starts a move.
    pub start: Vec<Step>,
    /// Steps that start homing.
    pub home: Vec<Step>,
    /// Stops with deceleration, and keeps the axis from moving where the signal is a level.
    pub stop: Vec<Step>,
    /// Releases the stop after the axis has come to rest.
    pub release_stop: Vec<Step>,
    /// Clears an alarm.
    pub reset: Vec<Step>,
    /// Settings of the drive.
    pub settings: DriveSettings,
    /// Usual cause when the drive ignores a move, and what to check.
    pub ignored_hint: String,
}
