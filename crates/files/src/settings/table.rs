//! Tables and their entries.

use std::ops::RangeInclusive;

use toml::{
    Spanned,
    de::{DeTable, DeValue},
};

use super::{
    Choice, ChoiceOrFile, Flag, Integer, Interval, Kind, List, Number, Section, Setting, Text,
    keys::{Described, TableKeys},
    kind::Slot,
    source::Source,
    value_fault::Limit,
};
use crate::{Complaint, Location};

/// A table of the file during the reading.
///
/// Each method takes a key and the kind of its value. The methods of the [`Entry`] that it returns
/// say whether the key is required.
#[derive(Debug)]
pub struct Table<'d> {
    source: &'d Source<'d>,
    /// `None` if the file does not have the table, which has been reported.
    entries: Option<&'d DeTable<'d>>,
    keys: TableKeys,
}

/// A key and the kind of its value. [`required`](Entry::required), [`optional`](Entry::optional) or
/// [`or`](Entry::or) reads the value.
#[derive(Debug)]
#[must_use = "a key is read by `required`, `optional` or `or`"]
pub struct Entry<'t, 'd, K> {
    table: &'t mut Table<'d>,
    key: &'static str,
    kind: K,
}

/// Whether a file must give a key. Two kinds of file may share keys and differ in this.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Presence {
    /// A missing key is a fault.
    Required,
    /// A missing key has its default.
    Optional,
}

impl Presence {
    /// Reads the value of an entry.
    pub fn read<K: Kind>(self, entry: Entry<'_, '_, K>, default: K::Value) -> Setting<K::Value> {
        match self {
            Self::Required => entry.required(),
            Self::Optional => entry.or(default),
        }
    }
}

impl<'d> Table<'d> {
    /// A finite number. [`range`](Entry::range) and the methods after it limit the number.
    pub fn number(&mut self, key: &'static str) -> Entry<'_, 'd, Number> {
        self.entry(key, Number::default())
    }

    /// A whole number that fits in 32 bits.
    pub fn count(&mut self, key: &'static str) -> Entry<'_, 'd, Integer<u32>> {
        self.entry(key, Integer { min: 0, max: u32::MAX })
    }

    /// A whole number that fits in 64 bits.
    pub fn whole(&mut self, key: &'static str) -> Entry<'_, 'd, Integer<u64>> {
        self.entry(key, Integer { min: 0, max: u64::MAX })
    }

    /// A whole number with a sign that fits in 32 bits.
    pub fn integer(&mut self, key: &'static str) -> Entry<'_, 'd, Integer<i32>> {
        self.entry(key, Integer { min: i32::MIN, max: i32::MAX })
    }

    /// `true` or `false`.
    pub fn flag(&mut self, key: &'static str) -> Entry<'_, 'd, Flag> {
        self.entry(key, Flag)
    }

    /// Text of one line that is not empty.
    pub fn text(&mut self, key: &'static str) -> Entry<'_, 'd, Text> {
        self.entry(key, Text { max_chars: 250 })
    }

    /// One of a few words, each with its meaning. The first meaning replaces a faulty word.
    ///
    /// # Panics
    /// If there are no words.
    pub fn choice<T: Clone + PartialEq>(
        &mut self,
        key: &'static str,
        words: impl IntoIterator<Item = (&'static str, T)>,
    ) -> Entry<'_, 'd, Choice<T>> {
        let words: Vec<_> = words.into_iter().collect();
        assert!(!words.is_empty(), "a choice for `{key}` among no words");
        self.entry(key, Choice { words })
    }

    /// One of a few words, each with its meaning, or the path of an instrument file.
    ///
    /// # Panics
    /// If there are no words.
    pub fn choice_or_file<T: Clone + PartialEq>(
        &mut self,
        key: &'static str,
        words: impl IntoIterator<Item = (&'static str, T)>,
    ) -> Entry<'_, 'd, ChoiceOrFile<T>> {
        let Entry { table, key, kind: choice } = self.choice(key, words);
        Entry { table, key, kind: ChoiceOrFile { choice } }
    }

    /// A table with its own keys, read by `reader`.
    pub fn section<T, F: Fn(&mut Table<'_>) -> T>(
        &mut self,
        key: &'static str,
        reader: F,
    ) -> Entry<'_, 'd, Section<F>> {
        self.entry(key, Section { reader })
    }

    /// Adds a complaint about a setting.
    pub fn refuse(&self, location: impl Into<Location>, complaint: &impl Complaint) {
        self.source.refuse(location.into(), complaint);
    }

    /// Refuses a key that the table must not have, with a reason of its own.
    pub fn refuse_key(&mut self, key: &'static str, complaint: &impl Complaint) {
        let Some((written, _)) = self.entries.and_then(|entries| entries.get_key_value(key)) else {
            return;
        };
        self.keys.asked.push(key);
        self.keys.present.push(key);
        self.source.refuse(self.source.location(written.span().start), complaint);
    }

    /// Start of the table.
    pub fn location(&self) -> Location {
        self.keys.location
    }

    /// Whether the file gives a value for this key.
    pub fn states(&self, key: &str) -> bool {
        self.entries.is_some_and(|entries| entries.get(key).is_some())
    }

    /// Whether the file has this table. Otherwise every value is a placeholder.
    pub fn is_there(&self) -> bool {
        self.entries.is_some()
    }

    /// Whether a key of this name is written, sound or not.
    pub fn has(&self, key: &str) -> bool {
        self.entries.is_some_and(|entries| entries.contains_key(key))
    }

    pub(crate) fn new(
        source: &'d Source<'d>,
        path: String,
        location: Location,
        entries: Option<&'d DeTable<'d>>,
    ) -> Self {
        Self { source, entries, keys: TableKeys::new(path, location) }
    }

    /// Runs the reader, and reports the keys that it did not ask for.
    pub(crate) fn read<T>(mut self, reader: impl FnOnce(&mut Self) -> T) -> T {
        let value = reader(&mut self);
        let Self { source, entries, mut keys } = self;
        for key in entries.into_iter().flat_map(DeTable::keys) {
            let name = key.get_ref().as_ref();
            if !keys.asked.contains(&name) {
                keys.unknown.push((name.to_owned(), source.location(key.span().start)));
            }
        }
        source.close(keys);
        value
    }

    fn entry<K>(&mut self, key: &'static str, kind: K) -> Entry<'_, 'd, K> {
        self.keys.asked.push(key);
        Entry { table: self, key, kind }
    }
}

impl<'t, 'd, K: Kind> Entry<'t, 'd, K> {
    /// The value. A missing key is a fault.
    pub fn required(mut self) -> Setting<K::Value> {
        self.describe(true);
        let value = self.find();
        if value.is_none() && self.table.is_there() {
            self.table.keys.missing.push(self.key);
        }
        self.slot(value).setting(&self.kind, value)
    }

    /// The value. A missing key is a fault, unless another section chooses the value: then it is a placeholder,
    /// which is not [sound](Setting::sound). In the schema the key may be left out.
    pub fn required_unless(mut self, is_chosen: bool) -> Setting<K::Value> {
        self.describe(false);
        let value = self.find();
        let slot = self.slot(value);
        if value.is_none() && is_chosen {
            slot.record(None);
        } else if value.is_none() && self.table.is_there() {
            self.table.keys.missing.push(self.key);
        }
        slot.setting(&self.kind, value)
    }

    /// The value, if the table has the key.
    pub fn optional(mut self) -> Option<Setting<K::Value>> {
        self.describe(false);
        let value = self.find();
        let slot = self.slot(value);
        if value.is_none() {
            // This registers the keys of a section that the file does not have.
            slot.source.idly(|| _ = self.kind.placeholder(&slot));
            if !self.kind.has_tables() {
                slot.record(None);
            }
        }
        value.map(|value| slot.setting(&self.kind, Some(value)))
    }

    /// The value, or `default` if the table does not have the key.
    pub fn or(mut self, default: K::Value) -> Setting<K::Value> {
        self.describe(false);
        let value = self.find();
        let slot = self.slot(value);
        if value.is_some() {
            return slot.setting(&self.kind, value);
        }
        let recorded = slot.source.recorded();
        // This registers the keys of a section that the file does not have.
        self.kind.placeholder(&slot);
        if slot.source.recorded() == recorded {
            slot.record(self.kind.written(&default));
        }
        let (location, is_sound) = (self.table.location(), self.table.is_there());
        Setting { value: default, location, key: self.key, is_item: false, is_sound }
    }

    /// A list of 1 to 1000 such values.
    pub fn list(self) -> Entry<'t, 'd, List<K>> {
        let Self { table, key, kind } = self;
        Entry { table, key, kind: List { items: kind, max_items: 1000 } }
    }

    /// The value of the key, if the table has it.
    fn find(&mut self) -> Option<&'d Spanned<DeValue<'d>>> {
        let value = self.table.entries?.get(self.key)?;
        self.table.keys.present.push(self.key);
        Some(value)
    }

    /// Notes the schema of the value, while one is made.
    fn describe(&mut self, is_required: bool) {
        if self.table.source.is_described {
            let schema = self.kind.schema(&self.path());
            let described = Described { key: self.key, schema, is_required };
            self.table.keys.described.push(described);
        }
    }

    /// Dotted name of the value.
    fn path(&self) -> String {
        let path = &self.table.keys.path;
        if path.is_empty() { self.key.into() } else { format!("{path}.{}", self.key) }
    }

    fn slot(&self, value: Option<&Spanned<DeValue<'_>>>) -> Slot<'d> {
        let TableKeys { location, .. } = &self.table.keys;
        let source = self.table.source;
        let location = value.map_or(*location, |value| source.location(value.span().start));
        let path = self.path();
        Slot { source, path, key: self.key, is_item: false, location }
    }
}

impl<'t, 'd> Entry<'t, 'd, Number> {
    /// An interval: the lowest and the highest of such numbers.
    pub fn interval(self) -> Entry<'t, 'd, Interval> {
        let Self { table, key, kind } = self;
        Entry { table, key, kind: Interval { ends: kind } }
    }

    /// The number lies in this range.
    pub fn range(mut self, range: RangeInclusive<f64>) -> Self {
        let (least, most) = range.into_inner();
        self.kind.limits = [Some(Limit::at_least(least)), Some(Limit::at_most(most))];
        self
    }

    /// The number is larger than `limit`.
    pub fn above(mut self, limit: f64) -> Self {
        self.kind.limits[0] = Some(Limit::above(limit));
        self
    }

    /// The number is not smaller than `limit`.
    pub fn at_least(mut self, limit: f64) -> Self {
        self.kind.limits[0] = Some(Limit::at_least(limit));
        self
    }

    /// The number is not larger than `limit`.
    pub fn at_most(mut self, limit: f64) -> Self {
        self.kind.limits[1] = Some(Limit::at_most(limit));
        self
    }
}

impl<K> Entry<'_, '_, List<K>> {
    /// The list has at most `count` entries.
    pub fn at_most(mut self, count: usize) -> Self {
        self.kind.max_items = count;
        self
    }
}

impl Entry<'_, '_, Text> {
    /// The text has at most `count` characters, instead of 250.
    pub fn max_chars(mut self, count: usize) -> Self {
        self.kind.max_chars = count;
        self
    }
}

impl<T> Entry<'_, '_, Integer<T>> {
    /// The number lies in this range.
    pub fn range(mut self, range: RangeInclusive<T>) -> Self {
        (self.kind.min, self.kind.max) = range.into_inner();
        self
    }

    /// The number is not smaller than `limit`.
    pub fn at_least(mut self, limit: T) -> Self {
        self.kind.min = limit;
        self
    }

    /// The number is not larger than `limit`.
    pub fn at_most(mut self, limit: T) -> Self {
        self.kind.max = limit;
        self
    }
}
