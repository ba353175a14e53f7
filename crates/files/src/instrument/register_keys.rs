//! The keys of registers, bits and steps of a drive.

use super::{
    drive::{Block, Field, Flag, Quantity, RegisterContent, Step, Table as RegisterTable, Width},
    fault::InstrumentFault,
};
use crate::settings::{Setting, Table};

/// The most registers that one request writes, or reads with room to spare.
const REGISTERS_MAX: u16 = 123;

/// A number in some block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct FieldPlace {
    table: RegisterTable,
    address: u16,
    width: Width,
}

/// A bit in some block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct FlagPlace {
    table: RegisterTable,
    address: u16,
    bit: Option<u32>,
    is_set_when: bool,
}

/// Reads an address and the table that it is in.
pub(super) fn address(table: &mut Table<'_>) -> (u16, RegisterTable) {
    let tables = [
        ("holding", RegisterTable::Holding),
        ("input", RegisterTable::Input),
        ("coil", RegisterTable::Coil),
        ("discrete-input", RegisterTable::DiscreteInput),
    ];
    let address = register(table, "address");
    (address, table.choice("table", tables).or(RegisterTable::Holding).value)
}

/// Reads the address of a register and the table that it is in. Coils and inputs have no numbers.
pub(super) fn register_address(table: &mut Table<'_>) -> (u16, RegisterTable) {
    let tables = [("holding", RegisterTable::Holding), ("input", RegisterTable::Input)];
    let address = register(table, "address");
    (address, table.choice("table", tables).or(RegisterTable::Holding).value)
}

/// Reads neighbouring addresses that are read in one request.
pub(super) fn block(table: &mut Table<'_>) -> Block {
    let place = address(table);
    neighbours(table, place)
}

/// Reads neighbouring registers that are read in one request.
pub(super) fn register_block(table: &mut Table<'_>) -> Block {
    let place = register_address(table);
    neighbours(table, place)
}

fn neighbours(table: &mut Table<'_>, (address, table_of): (u16, RegisterTable)) -> Block {
    let count = table.count("count").range(1..=u32::from(REGISTERS_MAX)).required().value;
    let count = u16::try_from(count).unwrap_or(REGISTERS_MAX);
    if table.is_there() && address.checked_add(count - 1).is_none() {
        table.refuse(table.location(), &InstrumentFault::BeyondLast { address, count });
    }
    Block { table: table_of, address, count }
}

/// Reads the address and the width of a number.
pub(super) fn place(table: &mut Table<'_>) -> (u16, Width) {
    let widths = [("u16", Width::U16), ("i32", Width::I32)];
    (register(table, "address"), table.choice("width", widths).required().value)
}

/// Reads a number of the status.
pub(super) fn field(table: &mut Table<'_>) -> FieldPlace {
    field_of(table, &[("u16", Width::U16), ("i32", Width::I32)])
}

/// Reads the code of an alarm in the status, which is in one register.
pub(super) fn code(table: &mut Table<'_>) -> FieldPlace {
    field_of(table, &[("u16", Width::U16)])
}

fn field_of(table: &mut Table<'_>, widths: &[(&'static str, Width)]) -> FieldPlace {
    let (address, table_of) = register_address(table);
    let widths = widths.iter().copied();
    let width = table.choice("width", widths).required().value;
    FieldPlace { table: table_of, address, width }
}

/// Reads a bit of the status.
pub(super) fn flag(table: &mut Table<'_>) -> FlagPlace {
    let (address, table_of) = address(table);
    let bit = table.count("bit").optional().map(|bit| bit.value);
    let is_set_when = table.flag("set_when").or(true).value;
    FlagPlace { table: table_of, address, bit, is_set_when }
}

impl FieldPlace {
    /// The field in the first block that has it.
    pub(super) fn within(
        self,
        table: &Table<'_>,
        at: &Setting<Self>,
        blocks: &[Setting<Block>],
    ) -> Field {
        let Self { address, width, .. } = self;
        let block = find(table, at, blocks, (self.table, address, width.registers()));
        Field { block, address, width }
    }
}

impl FlagPlace {
    /// The flag in the first block that has it.
    pub(super) fn within(
        self,
        table: &Table<'_>,
        at: &Setting<Self>,
        blocks: &[Setting<Block>],
    ) -> Flag {
        let Self { address, is_set_when, .. } = self;
        let block = find(table, at, blocks, (self.table, address, 1));
        let is_word = matches!(self.table, RegisterTable::Holding | RegisterTable::Input);
        let bit = self.bit.unwrap_or(0);
        if at.sound().is_some() && bit >= if is_word { 16 } else { 1 } {
            let what = if is_word { "the register" } else { "the coil or input" };
            table.refuse(at, &InstrumentFault::NoBit { key: at.key, bit, what, address });
        }
        Flag { block, address, bit: u8::try_from(bit).unwrap_or(0), is_set_when }
    }
}

fn find<T>(
    table: &Table<'_>,
    at: &Setting<T>,
    blocks: &[Setting<Block>],
    (table_of, address, registers): (RegisterTable, u16, u16),
) -> usize {
    let has = |block: &Setting<Block>| {
        block.value.table == table_of && block.value.contains(address, registers)
    };
    blocks.iter().position(has).unwrap_or_else(|| {
        if at.sound().is_some() && table.is_there() {
            let fault = InstrumentFault::OutsideBlock { key: at.key, address, registers };
            table.refuse(at, &fault);
        }
        0
    })
}

/// The command that makes a move.
const START: &str = "start";

/// Reads the steps of a command. Only those of the start of a move have its target, speed and ramps: with another command the
/// axis goes nowhere, and these are 0.
pub(super) fn steps(table: &mut Table<'_>, key: &'static str, is_required: bool) -> Vec<Step> {
    let entry = table.section(key, step).list().at_most(50);
    let found = if is_required { Some(entry.required()) } else { entry.optional() };
    let steps = found.map(|found| found.value).unwrap_or_default();
    for step in steps.iter().filter(|_| key != START) {
        if let Some(quantity) = step.value.as_ref().and_then(of_a_move) {
            table
                .refuse(step, &InstrumentFault::NoMove { command: key, quantity: quantity.name() });
        }
    }
    steps.into_iter().filter_map(|step| step.value).collect()
}

/// The first quantity of a move that a step writes.
fn of_a_move(step: &Step) -> Option<Quantity> {
    let Step::Registers { contents, .. } = step else { return None };
    contents.iter().find_map(|content| match content {
        RegisterContent::Of(quantity, _) if quantity.is_of_a_move() => Some(*quantity),
        _ => None,
    })
}

fn step(table: &mut Table<'_>) -> Option<Step> {
    let registers = address_of(table, "registers");
    let values = table.text("values").list().at_most(usize::from(REGISTERS_MAX)).optional();
    let register = address_of(table, "register");
    let value = table.count("value").at_most(0xFFFF).optional();
    let coil = address_of(table, "coil");
    let is_on = table.flag("on").optional();
    let hold_ms = table.count("hold_ms").range(1..=10_000).optional();

    let given = [registers.is_some(), register.is_some(), coil.is_some(), hold_ms.is_some()];
    let count = given.iter().filter(|given| **given).count();
    if count != 1 {
        if table.is_there() {
            table.refuse(table.location(), &InstrumentFault::Step(count));
        }
        return None;
    }
    beside(table, ("values", values.is_some()), ("registers", registers.is_some()));
    beside(table, ("value", value.is_some()), ("register", register.is_some()));
    beside(table, ("on", is_on.is_some()), ("coil", coil.is_some()));
    let word = |value: u32| u16::try_from(value).unwrap_or(u16::MAX);
    if let (Some(address), Some(values)) = (registers, &values) {
        let contents = contents_of(table, values);
        return Some(Step::Registers { address, contents });
    }
    if let (Some(address), Some(value)) = (register, &value) {
        return Some(Step::Register { address, value: word(value.value) });
    }
    if let (Some(address), Some(is_on)) = (coil, &is_on) {
        return Some(Step::Coil { address, is_on: is_on.value });
    }
    hold_ms.map(|ms| Step::Hold { ms: word(ms.value) })
}

/// Checks that a key is given exactly with the one that it belongs to.
fn beside(table: &Table<'_>, (key, is_there): (&'static str, bool), owner: (&'static str, bool)) {
    let (beside, is_owner_there) = owner;
    if is_there && !is_owner_there {
        table.refuse(table.location(), &InstrumentFault::NotBeside { key, beside });
    } else if is_owner_there && !is_there {
        table.refuse(table.location(), &InstrumentFault::Beside { key, beside });
    }
}

/// Reads the contents of registers.
pub(super) fn contents(table: &mut Table<'_>, key: &'static str) -> Setting<Vec<RegisterContent>> {
    let texts = table.text(key).list().at_most(usize::from(REGISTERS_MAX)).required();
    let contents = contents_of(table, &texts);
    texts.map(|_| contents)
}

fn contents_of(table: &Table<'_>, texts: &Setting<Vec<Setting<String>>>) -> Vec<RegisterContent> {
    let read = |text: &Setting<String>| {
        let content = content(text.sound()?);
        if content.is_none() {
            table.refuse(text, &InstrumentFault::Content(text.value.clone()));
        }
        content
    };
    let contents: Vec<_> = texts.value.iter().filter_map(read).collect();
    let registers: u16 = contents.iter().map(|content| content.registers()).sum();
    if registers > REGISTERS_MAX {
        table.refuse(texts, &InstrumentFault::TooManyRegisters(registers));
    }
    contents
}

/// The content of registers: `target i32`, `0x10 u16`, `-1 i32`.
fn content(text: &str) -> Option<RegisterContent> {
    let (what, width) = text.split_once(' ')?;
    let width = match width.trim() {
        "u16" => Width::U16,
        "i32" => Width::I32,
        _ => return None,
    };
    let quantity = match what {
        "target" => Quantity::Target,
        "speed" => Quantity::Speed,
        "acceleration" => Quantity::Acceleration,
        "deceleration" => Quantity::Deceleration,
        "limit_min" => Quantity::LimitMin,
        "limit_max" => Quantity::LimitMax,
        number => return constant(number, width),
    };
    // A position may be negative.
    let is_position =
        matches!(quantity, Quantity::Target | Quantity::LimitMin | Quantity::LimitMax);
    (width == Width::I32 || !is_position).then_some(RegisterContent::Of(quantity, width))
}

fn constant(text: &str, width: Width) -> Option<RegisterContent> {
    let value = match text.strip_prefix("0x") {
        Some(digits) => i64::from_str_radix(digits, 16).ok()?,
        None => text.parse().ok()?,
    };
    match width {
        Width::U16 => u16::try_from(value).ok().map(RegisterContent::Word),
        Width::I32 => i32::try_from(value).ok().map(RegisterContent::Long),
    }
}

fn register(table: &mut Table<'_>, key: &'static str) -> u16 {
    let address = table.count(key).at_most(0xFFFF).required().value;
    u16::try_from(address).unwrap_or(u16::MAX)
}

fn address_of(table: &mut Table<'_>, key: &'static str) -> Option<u16> {
    let address = table.count(key).at_most(0xFFFF).optional()?;
    Some(u16::try_from(address.value).unwrap_or(u16::MAX))
}
