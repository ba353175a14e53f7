//! The keys of the file of a drive.

use rig_model::{DriveMake, Parity};

use super::{
    drive::{
        AccelerationUnit, AlarmSource, Block, DriveSettings, EmergencyStop, Field, Flag,
        MakeSignature, Quantity, RegisterContent, RegisterMap, Resolution, SpeedUnit, Step,
        TargetReadBack, Width,
    },
    fault::InstrumentFault,
    refuse_what_is_code,
    register_keys::{
        block, code, contents, field, flag, place, register_address, register_block, steps,
    },
};
use crate::settings::{Setting, Table};

/// Reads the file of a drive from its root.
pub(super) fn drive(table: &mut Table<'_>) -> RegisterMap {
    refuse_what_is_code(table);
    let name = table.text("name").max_chars(40).required().value;
    let drives = table.text("drives").required().value;
    let makes = DriveMake::ALL.map(|make| (make.name(), make));
    let simulated_as = table.choice("simulated_as", makes).optional();
    let parities = [("none", Parity::None), ("even", Parity::Even), ("odd", Parity::Odd)];
    let parity = table.choice("parity", parities).required().value;
    let is_to_be_verified = table.flag("to_be_verified").or(false).value;
    let speeds =
        [("counts/s", SpeedUnit::CountsPerSecond), ("rpm", SpeedUnit::RevolutionsPerMinute)];
    let speed = table.choice("speed_unit", speeds).required().value;
    let accelerations = [
        ("counts/s2", AccelerationUnit::CountsPerSecond2),
        ("0.01 g", AccelerationUnit::HundredthsOfG),
        ("ms per 1000 rpm", AccelerationUnit::MillisecondsPer1000Rpm),
    ];
    let acceleration = table.choice("acceleration_unit", accelerations).required().value;
    let start_within_ms = table.count("start_within_ms").range(1..=5000).or(100).value;
    let ignored_hint = table.text("ignored_hint").or(IGNORED_HINT.to_owned()).value;
    let signature = table.section("signature", signature).required().value;
    let resolution = table.section("resolution", resolution).optional();
    let status = table.section("status", status).required().value;
    let commands = table.section("steps", commands).required();
    let settings = table.section("settings", settings).required().value;
    let alarms = table.section("alarms", alarms).optional();
    let alarms = alarms.map(|alarms| alarms.value).unwrap_or_default();

    if let Some(resolution) = &resolution {
        within_signature(table, resolution, &signature);
    }
    if commands.sound().is_some() && table.is_there() && !commands.value.sets_target() {
        table.refuse(&commands, &InstrumentFault::NoTarget);
    }
    if commands.sound().is_some() && commands.value.stops_again() {
        table.refuse(&commands, &InstrumentFault::StopTwice);
    }
    differing_lengths(table, &status.blocks, &settings, &signature);
    let Commands { prepare, start, home, stop, release_stop, reset } = commands.value;
    RegisterMap {
        name,
        simulated_as: simulated_as.map(|make| make.value),
        parity,
        drives,
        is_to_be_verified,
        signature,
        resolution: resolution.map(|resolution| resolution.value),
        status: status.blocks.into_iter().map(|block| block.value).collect(),
        position: status.position,
        target: status.target,
        moving: status.moving,
        ready: status.ready,
        homed: status.homed,
        alarm: status.alarm,
        emergency_stop: status.emergency_stop.or(alarms.emergency_stop),
        alarms: alarms.names,
        speed,
        acceleration,
        start_within_ms: u16::try_from(start_within_ms).unwrap_or(u16::MAX),
        prepare,
        start,
        home,
        stop,
        release_stop,
        reset,
        settings,
        ignored_hint,
    }
}

const IGNORED_HINT: &str = "is it enabled, and is a stop input on?";

/// The resolution is read with the signature.
fn within_signature(
    table: &Table<'_>,
    resolution: &Setting<Resolution>,
    signature: &MakeSignature,
) {
    let places = [Some(resolution.value.dividend), resolution.value.divisor];
    for (address, width) in places.into_iter().flatten() {
        if !signature.read.contains(address, width.registers()) {
            outside(table, resolution, "resolution", address, width.registers());
        }
    }
}

fn signature(table: &mut Table<'_>) -> MakeSignature {
    let what = table.text("what").required().value;
    let read = table.section("read", register_block).required();
    let ranges = table.section("ranges", range).list().at_most(20).required();
    for range in &ranges.value {
        let (address, width, min, max) = range.value;
        if read.sound().is_some() && !read.value.contains(address, width.registers()) {
            outside(table, range, "ranges", address, width.registers());
        }
        if range.sound().is_some() && (min <= 0 || max < min) {
            table.refuse(range, &InstrumentFault::Range { min, max });
        }
    }
    let ranges = ranges.value.into_iter().map(|range| range.value).collect();
    MakeSignature { what, read: read.value, ranges }
}

fn range(table: &mut Table<'_>) -> (u16, Width, i32, i32) {
    let (address, width) = place(table);
    (address, width, table.integer("min").required().value, table.integer("max").required().value)
}

fn resolution(table: &mut Table<'_>) -> Resolution {
    Resolution {
        factor: table.number("factor").above(0.0).required().value,
        dividend: table.section("dividend", place).required().value,
        divisor: table.section("divisor", place).optional().map(|divisor| divisor.value),
    }
}

struct Status {
    blocks: Vec<Setting<Block>>,
    position: Field,
    target: TargetReadBack,
    moving: Flag,
    ready: Flag,
    homed: Flag,
    emergency_stop: Option<EmergencyStop>,
    alarm: AlarmSource,
}

fn status(table: &mut Table<'_>) -> Status {
    let blocks = table.section("blocks", block).list().at_most(20).required().value;
    let position = table.section("position", field).required();
    let command = table.section("command_position", field).optional();
    let register = table.section("target_register", field).optional();
    let moving = table.section("moving", flag).required();
    let ready = table.section("ready", flag).required();
    let homed = table.section("homed", flag).required();
    let emergency_stop = table.section("emergency_stop", flag).optional();
    let code = table.section("alarm", code).optional();
    let alarm_flag = table.section("alarm_flag", flag).optional();
    let alarm_register = table.section("alarm_register", alarm_block).optional();

    if let Some(command) = &command
        && command.sound().is_some()
        && position.sound().is_some()
        && command.value == position.value
    {
        table.refuse(command, &InstrumentFault::OnePosition);
    }
    // The opposite levels of one bit are a busy line.
    if moving.sound().is_some() && ready.sound().is_some() && moving.value == ready.value {
        table.refuse(&ready, &InstrumentFault::OneBit);
    }
    let target = match (&command, &register) {
        (Some(at), None) => TargetReadBack::CommandPosition(at.value.within(table, at, &blocks)),
        (None, Some(at)) => TargetReadBack::Register(at.value.within(table, at, &blocks)),
        _ => {
            one_of(table, "command_position", "target_register");
            TargetReadBack::Register(position.value.within(table, &position, &blocks))
        }
    };
    let alarm = match (&code, &alarm_flag, &alarm_register) {
        (Some(at), None, None) => AlarmSource::Code(at.value.within(table, at, &blocks)),
        (None, Some(at), Some(code)) => {
            AlarmSource::Flagged { flag: at.value.within(table, at, &blocks), code: code.value }
        }
        (None, Some(_), None) => {
            let (key, beside) = ("alarm_register", "alarm_flag");
            table.refuse(table.location(), &InstrumentFault::Beside { key, beside });
            AlarmSource::Code(position.value.within(table, &position, &blocks))
        }
        _ => {
            one_of(table, "alarm", "alarm_flag");
            AlarmSource::Code(position.value.within(table, &position, &blocks))
        }
    };
    Status {
        position: position.value.within(table, &position, &blocks),
        target,
        moving: moving.value.within(table, &moving, &blocks),
        ready: ready.value.within(table, &ready, &blocks),
        homed: homed.value.within(table, &homed, &blocks),
        emergency_stop: emergency_stop
            .map(|at| EmergencyStop::Flag(at.value.within(table, &at, &blocks))),
        alarm,
        blocks,
    }
}

fn alarm_block(table: &mut Table<'_>) -> Block {
    let (address, table_of) = register_address(table);
    Block { table: table_of, address, count: 1 }
}

struct Commands {
    prepare: Vec<Step>,
    start: Vec<Step>,
    home: Vec<Step>,
    stop: Vec<Step>,
    release_stop: Vec<Step>,
    reset: Vec<Step>,
}

impl Commands {
    /// Whether the release of a stop is the stop.
    fn stops_again(&self) -> bool {
        !self.stop.is_empty() && self.stop == self.release_stop
    }

    /// Whether the start of a move writes the target.
    fn sets_target(&self) -> bool {
        let is_target =
            |content: &RegisterContent| matches!(content, RegisterContent::Of(Quantity::Target, _));
        let writes_it = |step: &Step| match step {
            Step::Registers { contents, .. } => contents.iter().any(is_target),
            Step::Register { .. } | Step::Coil { .. } | Step::Hold { .. } => false,
        };
        self.start.iter().any(writes_it)
    }
}

fn commands(table: &mut Table<'_>) -> Commands {
    Commands {
        prepare: steps(table, "prepare", false),
        start: steps(table, "start", true),
        home: steps(table, "home", true),
        stop: steps(table, "stop", true),
        release_stop: steps(table, "release_stop", false),
        reset: steps(table, "reset", true),
    }
}

fn settings(table: &mut Table<'_>) -> DriveSettings {
    let write = steps(table, "write", true);
    let read = table.section("read", register_block).required();
    let expect = contents(table, "expect");
    let found: u16 = expect.value.iter().map(|content| content.registers()).sum();
    let expected = read.value.count;
    if read.sound().is_some() && expect.sound().is_some() && table.is_there() && found != expected {
        table.refuse(&expect, &InstrumentFault::ExpectLength { found, expected });
    }
    // With a content too few, every register after it has that of another one.
    if found == expected
        && let Some(fault) = other_limit(&write, read.value, &expect.value)
    {
        table.refuse(&expect, &fault);
    }
    DriveSettings { write, read: read.value, expect: expect.value }
}

/// A limit that is written to one register and expected in another one.
fn other_limit(write: &[Step], read: Block, expect: &[RegisterContent]) -> Option<InstrumentFault> {
    let expected = limits_at(read.address, expect);
    let written = write.iter().flat_map(|step| match step {
        Step::Registers { address, contents } => limits_at(*address, contents),
        Step::Register { .. } | Step::Coil { .. } | Step::Hold { .. } => Vec::new(),
    });
    written.into_iter().find_map(|(address, written)| {
        let (_, found) = expected.iter().find(|(other, _)| *other == address)?;
        let (found, written) = (found.name(), written.name());
        (found != written).then_some(InstrumentFault::OtherLimit { address, found, written })
    })
}

/// The limits in registers from an address on, each with its own address.
fn limits_at(mut address: u16, contents: &[RegisterContent]) -> Vec<(u16, Quantity)> {
    let mut found = Vec::new();
    for content in contents {
        if let RegisterContent::Of(quantity, _) = *content
            && !quantity.is_of_a_move()
        {
            found.push((address, quantity));
        }
        address = address.saturating_add(content.registers());
    }
    found
}

#[derive(Default)]
struct Alarms {
    names: Vec<(u16, String)>,
    emergency_stop: Option<EmergencyStop>,
}

fn alarms(table: &mut Table<'_>) -> Alarms {
    let names = table.section("names", alarm_name).list().required().value;
    for (at, name) in names.iter().enumerate() {
        let code = name.value.0;
        if let Some(first) = names[..at].iter().find(|first| first.value.0 == code)
            && name.sound().is_some()
            && first.sound().is_some()
        {
            let (first, second) = (first.value.1.clone(), name.value.1.clone());
            table.refuse(name, &InstrumentFault::TwoNames { code, first, second });
        }
    }
    let code = table.count("emergency_stop").range(1..=0xFFFF).optional();
    let code = code.and_then(|code| u16::try_from(code.value).ok());
    Alarms {
        names: names.into_iter().map(|name| name.value).collect(),
        emergency_stop: code.map(EmergencyStop::Alarm),
    }
}

fn alarm_name(table: &mut Table<'_>) -> (u16, String) {
    let code = table.count("code").range(1..=0xFFFF).required().value;
    (u16::try_from(code).unwrap_or(u16::MAX), table.text("name").required().value)
}

/// The answers to all blocks that are read in turn have different lengths, so that a late one is never
/// taken for another.
fn differing_lengths(
    table: &Table<'_>,
    blocks: &[Setting<Block>],
    settings: &DriveSettings,
    signature: &MakeSignature,
) {
    let name = |block: &Block| format!("the block at {:#06x}", block.address);
    for (at, block) in blocks.iter().enumerate() {
        let others = blocks[..at].iter().map(|other| (other.value, name(&other.value)));
        let settings = [(settings.read, "[settings]".to_owned())];
        for (other, second) in others.chain(settings) {
            if block.sound().is_some() && block.value.count == other.count {
                let (count, first) = (other.count, name(&block.value));
                table.refuse(block, &InstrumentFault::EqualLengths { count, first, second });
            }
        }
    }
    if table.is_there() && signature.read.count == settings.read.count {
        let (first, second) = ("[signature]".to_owned(), "[settings]".to_owned());
        let count = settings.read.count;
        let fault = InstrumentFault::EqualLengths { count, first, second };
        table.refuse(table.location(), &fault);
    }
}

fn one_of(table: &Table<'_>, first: &'static str, second: &'static str) {
    if table.is_there() {
        table.refuse(table.location(), &InstrumentFault::OneOf(first, second));
    }
}

fn outside<T>(table: &Table<'_>, at: &Setting<T>, key: &'static str, address: u16, registers: u16) {
    if at.sound().is_some() {
        table.refuse(at, &InstrumentFault::OutsideBlock { key, address, registers });
    }
}
