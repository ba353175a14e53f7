//! A value together with where it was written.

use std::fmt;

use crate::{Faults, Place, fault::Complaint};

/// A value from a file that remembers where it stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting<T> {
    /// The value, or a placeholder when it could not be read: see [`Setting::sound`].
    pub value: T,
    /// Where the value stands. For a default, where its table begins.
    pub place: Place,
    /// The key that it stands under.
    pub key: &'static str,
    /// Whether it is one of a list.
    pub(crate) is_item: bool,
    pub(crate) is_sound: bool,
}

impl<T> Setting<T> {
    /// The value, unless it is a placeholder. A later check that starts from here does not
    /// complain about a value that nobody wrote.
    pub fn sound(&self) -> Option<&T> {
        self.is_sound.then_some(&self.value)
    }

    /// Notes the complaint that `rule` finds against a sound value.
    pub fn check<C: Complaint>(&self, faults: &mut Faults, rule: impl FnOnce(&T) -> Option<C>) {
        if let Some(complaint) = self.sound().and_then(rule) {
            faults.refuse(self.place, &complaint);
        }
    }

    /// The same place and key with another value made of this one.
    pub fn map<U>(self, change: impl FnOnce(T) -> U) -> Setting<U> {
        let Self { value, place, key, is_item, is_sound } = self;
        Setting { value: change(value), place, key, is_item, is_sound }
    }
}

/// As messages name it: `settle_s = 70`, and `70 in angles_deg` for one of a list.
impl<T: fmt::Display> fmt::Display for Setting<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { key, value, is_item, .. } = self;
        if *is_item { write!(f, "{value} in {key}") } else { write!(f, "{key} = {value}") }
    }
}
