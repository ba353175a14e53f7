//! A value with its location in the file.

use std::fmt;

use crate::{Complaint, Faults, Location};

/// A value of a file with its location.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting<T> {
    /// The value, or a placeholder for a faulty one: see [`Setting::sound`].
    pub value: T,
    /// Location of the value. For a default, the start of its table.
    pub location: Location,
    /// Key of the value.
    pub key: &'static str,
    /// Whether the value is an item of a list.
    pub(crate) is_item: bool,
    pub(crate) is_sound: bool,
}

impl<T> From<&Setting<T>> for Location {
    fn from(setting: &Setting<T>) -> Self {
        setting.location
    }
}

impl<T> Setting<T> {
    /// The value, unless it is a placeholder. A later check that uses this does not complain about a
    /// value that is not in the file.
    pub fn sound(&self) -> Option<&T> {
        self.is_sound.then_some(&self.value)
    }

    /// Adds the complaint of `rule` about a sound value.
    pub fn check<C: Complaint>(&self, faults: &mut Faults, rule: impl FnOnce(&T) -> Option<C>) {
        if let Some(complaint) = self.sound().and_then(rule) {
            faults.refuse(self.location, &complaint);
        }
    }

    /// The setting with its value changed.
    pub fn map<U>(self, change: impl FnOnce(T) -> U) -> Setting<U> {
        let Self { value, location, key, is_item, is_sound } = self;
        Setting { value: change(value), location, key, is_item, is_sound }
    }
}

/// The form of messages: `settle_s = 70`, or `70 in angles_deg` for an item of a list.
impl<T: fmt::Display> fmt::Display for Setting<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { key, value, is_item, .. } = self;
        if *is_item { write!(f, "{value} in {key}") } else { write!(f, "{key} = {value}") }
    }
}
