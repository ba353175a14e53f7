//! Leadshine drives with position registers (CL2C-RS, DM556RS, iEM-RS).
//!
//! To be verified on hardware before it moves anything that can break. Four public drivers were
//! compared, and they disagree: one writes the ramps to 0x6205 and 0x6206, one address further; one
//! header says that mode 0 is relative, where the others write 0x41; one decodes bits 4 to 6 of the
//! status as a number. The map follows the majority.
//!
//! Nothing here writes 0x2211 to 0x1801: it saves to the EEPROM, which wears.

use rig_model::DriveMake;

use crate::map::{
    AccelerationUnit, AlarmSource, Block, DriveSettings, Field, Flag, MakeSignature, Quantity,
    RegisterContent, RegisterMap, Resolution, SpeedUnit, Step, Table, TargetReadBack, Width,
};

const STATUS: usize = 0;
const POSITION: usize = 1;
const PATH: usize = 2;

const MOTION_STATUS: u16 = 0x1003;
const PATH_CONTROL: u16 = 0x6000;
const TRIGGER: u16 = 0x6002;
const LIMITS: u16 = 0x6006;
/// Path 0: mode, position, speed, ramps, pause, trigger.
const PATH_0: u16 = 0x6200;

const LIMIT_SLOTS: &[RegisterContent] = &[
    RegisterContent::Of(Quantity::LimitMax, Width::I32),
    RegisterContent::Of(Quantity::LimitMin, Width::I32),
];

/// Leadshine with position registers. A count is one pulse of the resolution set in the drive.
pub static LEADSHINE_PR: RegisterMap = RegisterMap {
    make: DriveMake::LeadshinePr,
    drives: "Leadshine CL2C-RS, DM556RS, iEM-RS",
    is_to_be_verified: true,
    // A stepping motor has two hundred full steps.
    signature: MakeSignature {
        what: "pulses per revolution",
        read: Block { table: Table::Holding, address: 0x0001, count: 1 },
        ranges: &[(0x0001, Width::U16, 200, 0xFFFF)],
    },
    resolution: Some(Resolution { factor: 1.0, dividend: (0x0001, Width::U16), divisor: None }),
    status: &[
        Block { table: Table::Holding, address: MOTION_STATUS, count: 1 },
        Block { table: Table::Holding, address: 0x602C, count: 2 },
        Block { table: Table::Holding, address: PATH_0, count: 3 },
    ],
    position: Field { block: POSITION, address: 0x602C, width: Width::I32 },
    target: TargetReadBack::Register(Field { block: PATH, address: 0x6201, width: Width::I32 }),
    moving: Flag { block: STATUS, address: MOTION_STATUS, bit: 2, is_set_when: true },
    ready: Flag { block: STATUS, address: MOTION_STATUS, bit: 1, is_set_when: true },
    homed: Flag { block: STATUS, address: MOTION_STATUS, bit: 6, is_set_when: true },
    alarm: AlarmSource::Flagged {
        flag: Flag { block: STATUS, address: MOTION_STATUS, bit: 0, is_set_when: true },
        code: Block { table: Table::Holding, address: 0x2203, count: 1 },
    },
    alarms: &[
        (0x00E0, "overcurrent"),
        (0x00C0, "overvoltage"),
        (0x00A1, "current sampling"),
        (0x0152, "shaft lock"),
        (0x0240, "EEPROM"),
        (0x0180, "position deviation"),
        (0x0150, "encoder"),
        (0x00F0, "over-temperature"),
        (0x0210, "input configuration"),
    ],
    speed: SpeedUnit::RevolutionsPerMinute,
    acceleration: AccelerationUnit::MillisecondsPer1000Rpm,
    start_within_ms: 100,
    prepare: &[Step::Register { address: 0x000F, value: 1 }],
    start: &[Step::Registers {
        address: PATH_0,
        contents: &[
            RegisterContent::Word(1), // absolute positioning
            RegisterContent::Of(Quantity::Target, Width::I32),
            RegisterContent::Of(Quantity::Speed, Width::U16),
            RegisterContent::Of(Quantity::Acceleration, Width::U16),
            RegisterContent::Of(Quantity::Deceleration, Width::U16),
            RegisterContent::Word(0),    // no pause
            RegisterContent::Word(0x10), // run path 0
        ],
    }],
    home: &[Step::Register { address: TRIGGER, value: 0x20 }],
    // Quick stop.
    stop: &[Step::Register { address: TRIGGER, value: 0x40 }],
    release_stop: &[],
    reset: &[Step::Register { address: 0x1801, value: 0x1111 }],
    settings: DriveSettings {
        write: &[
            Step::Registers { address: LIMITS, contents: LIMIT_SLOTS },
            // Soft limits on.
            Step::Register { address: PATH_CONTROL, value: 1 << 1 },
        ],
        read: Block { table: Table::Holding, address: LIMITS, count: 4 },
        expect: LIMIT_SLOTS,
    },
    ignored_hint: "is it enabled, and its configuration for this map?",
};
