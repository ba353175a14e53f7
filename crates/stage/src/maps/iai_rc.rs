//! IAI ROBO Cylinder controllers of the RC series (PCON, ACON, SCON, ERC) on Modbus.
//!
//! Positions are hundredths of a millimetre with every motor. The controller has no soft limits
//! that can be set over Modbus. A target beyond the limits in its parameters moves it to 0.2 mm
//! before the limit, which is reported as a target that was not reached.
//!
//! # Source
//! IAI, Serial Communication \[Modbus Version\] Operation Manual.

use rig_model::DriveMake;

use crate::map::{
    AccelerationUnit, AlarmSource, Block, DriveSettings, Field, Flag, MakeSignature, Quantity,
    RegisterContent, RegisterMap, SpeedUnit, Step, Table, TargetReadBack, Width,
};

/// From the present position to the system status.
const STATUS: usize = 0;
/// The position data that were written last.
const COMMAND: usize = 1;

/// Device status register 1 and the expansion device status register.
const DSS1: u16 = 0x9005;
const DSSE: u16 = 0x9007;

/// First address of the position data.
const PCMD: u16 = 0x9900;
/// The width of the band around the target in which positioning is complete. To write it starts
/// nothing.
const INP: u16 = 0x9902;
/// 0.02 mm: narrower than the tolerance of a measurement, and no default of the controller.
const INP_SLOTS: &[RegisterContent] = &[RegisterContent::Long(2)];

const SERVO_ON: u16 = 0x0403;
const ALARM_RESET: u16 = 0x0407;
const HOME: u16 = 0x040B;
const MODBUS_IN_COMMAND: u16 = 0x0427;
const DECELERATE_TO_STOP: u16 = 0x042C;

/// Commands are to be held for 20 ms.
const HOLD: Step = Step::Hold { ms: 20 };

/// IAI RC. A count is 0.01 mm.
pub static IAI_RC: RegisterMap = RegisterMap {
    make: DriveMake::IaiRc,
    drives: "IAI RC controllers (PCON, ACON, SCON, ERC)",
    is_to_be_verified: false,
    // A controller that is switched on is ready, or has an alarm or an emergency stop.
    signature: MakeSignature {
        what: "device status",
        read: Block { table: Table::Holding, address: DSS1, count: 1 },
        ranges: &[(DSS1, Width::U16, 1, 0xFFFF)],
    },
    // A count is 0.01 mm.
    resolution: None,
    status: &[
        Block { table: Table::Holding, address: 0x9000, count: 10 },
        Block { table: Table::Holding, address: PCMD, count: 4 },
    ],
    position: Field { block: STATUS, address: 0x9000, width: Width::I32 },
    target: TargetReadBack::Register(Field { block: COMMAND, address: PCMD, width: Width::I32 }),
    moving: Flag { block: STATUS, address: DSSE, bit: 5, is_set_when: true },
    // SV: the servo is on. Without it, commands are ignored.
    ready: Flag { block: STATUS, address: DSS1, bit: 12, is_set_when: true },
    homed: Flag { block: STATUS, address: DSS1, bit: 4, is_set_when: true },
    alarm: AlarmSource::Code(Field { block: STATUS, address: 0x9002, width: Width::U16 }),
    alarms: &[],
    // 0.01 mm/s.
    speed: SpeedUnit::CountsPerSecond,
    acceleration: AccelerationUnit::HundredthsOfG,
    start_within_ms: 100,
    prepare: &[
        Step::Coil { address: MODBUS_IN_COMMAND, is_on: true },
        Step::Coil { address: SERVO_ON, is_on: true },
    ],
    // The lower word of PCMD starts the move, so that all of it goes in one request.
    start: &[Step::Registers {
        address: PCMD,
        contents: &[
            RegisterContent::Of(Quantity::Target, Width::I32),
            RegisterContent::Long(2), // INP, as above
            RegisterContent::Of(Quantity::Speed, Width::I32),
            RegisterContent::Of(Quantity::Acceleration, Width::U16),
            RegisterContent::Word(0), // PPOW: no pushing
            RegisterContent::Word(0), // CTLF: absolute, trapezoid
        ],
    }],
    // On the edge from off to on.
    home: &[
        Step::Coil { address: HOME, is_on: false },
        HOLD,
        Step::Coil { address: HOME, is_on: true },
        HOLD,
        Step::Coil { address: HOME, is_on: false },
    ],
    stop: &[Step::Coil { address: DECELERATE_TO_STOP, is_on: true }],
    release_stop: &[Step::Coil { address: DECELERATE_TO_STOP, is_on: false }],
    // On the edge from on to off.
    reset: &[
        Step::Coil { address: ALARM_RESET, is_on: true },
        HOLD,
        Step::Coil { address: ALARM_RESET, is_on: false },
    ],
    settings: DriveSettings {
        write: &[Step::Registers { address: INP, contents: INP_SLOTS }],
        read: Block { table: Table::Holding, address: INP, count: 2 },
        expect: INP_SLOTS,
    },
    ignored_hint: "is the servo on, and the mode switch on automatic?",
};
