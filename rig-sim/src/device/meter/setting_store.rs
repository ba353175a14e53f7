//! Settings that change nothing on this bench: displays, beepers, biases of a linear load.
//!
//! Clients make them and ask for them when they connect, so they are checked, kept and answered. A
//! setting that would change a reading does not belong here.

use std::collections::BTreeMap;

use rig_scpi::{Call, Limits, Node, Param, RealFormat, ScpiError, Unit, Value, command, setting};

/// A setting that is stored and changes nothing.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StoredSetting {
    pattern: &'static str,
    kind: SettingKind,
}

#[derive(Debug, Clone, Copy)]
enum SettingKind {
    Switch(bool),
    Number(Unit, Limits),
    /// One of some whole numbers of a unit, the first unless it is set.
    Whole(Unit, &'static [i64]),
    /// One of some words, the first unless it is set.
    Word(&'static [&'static str]),
    Text,
    /// An action without a stored value.
    Action,
}

/// A switch.
pub(crate) const fn switch(pattern: &'static str, default: bool) -> StoredSetting {
    StoredSetting { pattern, kind: SettingKind::Switch(default) }
}

/// A number within limits.
pub(crate) const fn number(pattern: &'static str, unit: Unit, limits: Limits) -> StoredSetting {
    StoredSetting { pattern, kind: SettingKind::Number(unit, limits) }
}

/// One of some whole numbers, the first unless it is set.
pub(crate) const fn whole(
    pattern: &'static str,
    unit: Unit,
    choices: &'static [i64],
) -> StoredSetting {
    StoredSetting { pattern, kind: SettingKind::Whole(unit, choices) }
}

/// One of some words, the first unless it is set.
pub(crate) const fn word(pattern: &'static str, choices: &'static [&'static str]) -> StoredSetting {
    StoredSetting { pattern, kind: SettingKind::Word(choices) }
}

/// Any text.
pub(crate) const fn text(pattern: &'static str) -> StoredSetting {
    StoredSetting { pattern, kind: SettingKind::Text }
}

/// An action without a stored value.
pub(crate) const fn action(pattern: &'static str) -> StoredSetting {
    StoredSetting { pattern, kind: SettingKind::Action }
}

/// The commands of a table; `id` makes a command of a row.
pub(crate) fn nodes<C: Copy>(
    table: &[StoredSetting],
    id: fn(usize) -> C,
) -> impl Iterator<Item = Node<C>> {
    table.iter().enumerate().map(move |(row, stored)| match stored.kind {
        SettingKind::Action => command(stored.pattern, id(row)),
        _ => setting(stored.pattern, id(row)).asks(0, 0),
    })
}

/// Values by row of the table and suffixes of the header.
#[derive(Debug, Clone, Default)]
pub(crate) struct SettingStore(BTreeMap<(usize, Vec<u32>), Value>);

impl SettingStore {
    /// Sets a row of the table, or answers its value.
    pub(crate) fn obey<C>(
        &mut self,
        stored: &StoredSetting,
        row: usize,
        call: &Call<C>,
        format: RealFormat,
    ) -> Result<Vec<Value>, ScpiError> {
        let suffixes = (0..call.suffixes.len()).map(|index| call.suffix(index)).collect();
        if call.is_query {
            let set = self.0.get(&(row, suffixes)).cloned();
            return Ok(vec![set.unwrap_or_else(|| stored.kind.default(format))]);
        }
        if let Some(value) = stored.kind.read(call, format)? {
            self.0.insert((row, suffixes), value);
        }
        Ok(Vec::new())
    }
}

impl SettingKind {
    fn default(self, format: RealFormat) -> Value {
        match self {
            Self::Switch(is_on) => Value::Boolean(is_on),
            Self::Number(_, limits) => Value::Formatted(limits.default, format),
            Self::Whole(_, choices) => Value::Integer(choices[0]),
            Self::Word(choices) => Value::Characters(choices[0]),
            Self::Text | Self::Action => Value::Text("".into()),
        }
    }

    fn read<C>(self, call: &Call<C>, format: RealFormat) -> Result<Option<Value>, ScpiError> {
        if matches!(self, Self::Action) {
            return Ok(None);
        }
        let param = call.param(0)?;
        Ok(Some(match self {
            Self::Switch(_) => Value::Boolean(param.boolean()?),
            Self::Number(unit, limits) => Value::Formatted(param.real(unit, limits)?, format),
            Self::Whole(unit, choices) => Value::Integer(read_whole(param, unit, choices)?),
            Self::Word(choices) => {
                let words: Vec<_> = choices.iter().map(|word| (*word, *word)).collect();
                Value::Characters(param.choice(&words)?)
            }
            Self::Text | Self::Action => Value::Text(param.text()?.to_owned().into()),
        }))
    }
}

fn read_whole(param: &Param, unit: Unit, choices: &[i64]) -> Result<i64, ScpiError> {
    let as_real = |pick: Option<&i64>| pick.map_or(0.0, |choice| *choice as f64);
    let (min, max) = (as_real(choices.iter().min()), as_real(choices.iter().max()));
    let found = param.real(unit, Limits { min, max, default: as_real(choices.first()) })?;
    let taken = choices.iter().find(|choice| **choice as f64 == found.round());
    taken.copied().ok_or(ScpiError::new(-222))
}
