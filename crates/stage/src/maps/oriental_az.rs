//! Oriental Motor AZ series, for linear (EZS, EAS) and hollow rotary (DGII) stages.
//!
//! # Source
//! Oriental Motor, AZ Series Function Edition, HM-60262-6E.

use rig_model::DriveMake;

use crate::map::{
    AccelerationUnit, AlarmSource, Block, DriveSettings, Field, Flag, MakeSignature, Quantity,
    RegisterContent, RegisterMap, Resolution, SpeedUnit, Step, Table, TargetReadBack, Width,
};

/// Lower word of the driver output status, and the present alarm.
const OUTPUTS: usize = 0;
/// The 32-bit counters of feedback and command position, which no wrap setting touches.
const POSITIONS: usize = 1;

/// Driver input command, lower word.
const DRIVER_INPUT: u16 = 0x007D;
const INPUT_HOME: u16 = 1 << 4;
const INPUT_STOP: u16 = 1 << 5;
const INPUT_NONE: u16 = 0;

/// The electronic gear: a revolution of the motor is 1000 · B / A steps.
const GEAR_A: u16 = 0x0380;
const GEAR_B: u16 = 0x0382;

/// The soft limits, with the reaction of the drive.
const LIMITS: u16 = 0x0386;
const LIMIT_SLOTS: &[RegisterContent] = &[
    RegisterContent::Long(1), // decelerate to a stop
    RegisterContent::Of(Quantity::LimitMax, Width::I32),
    RegisterContent::Of(Quantity::LimitMin, Width::I32),
];

/// Oriental Motor AZ. A count is one step of the resolution set in the drive.
pub static ORIENTAL_AZ: RegisterMap = RegisterMap {
    make: DriveMake::OrientalAz,
    drives: "Oriental Motor AZ series",
    is_to_be_verified: false,
    // Both are settings of the drive, and 1 as it leaves the factory.
    signature: MakeSignature {
        what: "electronic gear A or B",
        read: Block { table: Table::Holding, address: GEAR_A, count: 4 },
        ranges: &[(GEAR_A, Width::I32, 1, 0xFFFF), (GEAR_B, Width::I32, 1, 0xFFFF)],
    },
    resolution: Some(Resolution {
        factor: 1000.0,
        dividend: (GEAR_B, Width::I32),
        divisor: Some((GEAR_A, Width::I32)),
    }),
    status: &[
        Block { table: Table::Holding, address: 0x007F, count: 3 },
        Block { table: Table::Holding, address: 0x0120, count: 4 },
    ],
    position: Field { block: POSITIONS, address: 0x0120, width: Width::I32 },
    target: TargetReadBack::CommandPosition(Field {
        block: POSITIONS,
        address: 0x0122,
        width: Width::I32,
    }),
    // MOVE, READY and HOME-END as the factory assigns them to the driver output.
    moving: Flag { block: OUTPUTS, address: 0x007F, bit: 13, is_set_when: true },
    ready: Flag { block: OUTPUTS, address: 0x007F, bit: 5, is_set_when: true },
    homed: Flag { block: OUTPUTS, address: 0x007F, bit: 4, is_set_when: true },
    // The lower word; the upper one is always zero.
    alarm: AlarmSource::Code(Field { block: OUTPUTS, address: 0x0081, width: Width::U16 }),
    alarms: &[
        (0x10, "excessive position deviation"),
        (0x20, "overcurrent"),
        (0x21, "main circuit overheat"),
        (0x22, "overvoltage"),
        (0x25, "undervoltage"),
        (0x26, "motor overheat"),
        (0x28, "sensor error"),
        (0x30, "overload"),
        (0x31, "overspeed"),
        (0x41, "EEPROM error"),
        (0x42, "initial sensor error"),
        (0x4A, "return-to-home incomplete"),
        (0x60, "both limit sensors active"),
        (0x61, "reverse limit sensor connection"),
        (0x62, "return-to-home operation error"),
        (0x66, "hardware overtravel"),
        (0x67, "software overtravel"),
        (0x68, "emergency stop"),
        (0x70, "operation data error"),
        (0x84, "RS-485 communication error"),
        (0x85, "RS-485 communication timeout"),
    ],
    speed: SpeedUnit::CountsPerSecond,
    // 0.001 kHz/s.
    acceleration: AccelerationUnit::CountsPerSecond2,
    start_within_ms: 100,
    // An earlier run may have ended with its stop still on.
    prepare: &[Step::Register { address: DRIVER_INPUT, value: INPUT_NONE }],
    // Direct data operation: the trigger is the last of the same request.
    start: &[Step::Registers {
        address: 0x0058,
        contents: &[
            RegisterContent::Long(0), // operation data number
            RegisterContent::Long(1), // absolute positioning
            RegisterContent::Of(Quantity::Target, Width::I32),
            RegisterContent::Of(Quantity::Speed, Width::I32),
            RegisterContent::Of(Quantity::Acceleration, Width::I32),
            RegisterContent::Of(Quantity::Deceleration, Width::I32),
            RegisterContent::Long(1000), // operating current, 0.1 %
            RegisterContent::Long(1),    // start when all of it has arrived
        ],
    }],
    home: &[
        Step::Register { address: DRIVER_INPUT, value: INPUT_HOME },
        Step::Register { address: DRIVER_INPUT, value: INPUT_NONE },
    ],
    stop: &[Step::Register { address: DRIVER_INPUT, value: INPUT_STOP }],
    release_stop: &[Step::Register { address: DRIVER_INPUT, value: INPUT_NONE }],
    // On the edge from 0 to 1.
    reset: &[
        Step::Registers { address: 0x0180, contents: &[RegisterContent::Long(0)] },
        Step::Registers { address: 0x0180, contents: &[RegisterContent::Long(1)] },
        Step::Registers { address: 0x0180, contents: &[RegisterContent::Long(0)] },
    ],
    settings: DriveSettings {
        write: &[Step::Registers { address: LIMITS, contents: LIMIT_SLOTS }],
        read: Block { table: Table::Holding, address: LIMITS, count: 6 },
        expect: LIMIT_SLOTS,
    },
    ignored_hint: "is STOP, FREE or the motor power off, or another move not finished?",
};
