//! Tables and what is asked of them.

use std::ops::RangeInclusive;

use toml::{
    Spanned,
    de::{DeTable, DeValue},
};

use crate::{
    Choice, Complaint, Flag, Interval, Kind, List, Number, Place, Section, Setting, Text, Whole,
    kind::Slot, shape::Record, source::Source, wrong::Limit,
};

/// A table of the file while it is read.
///
/// Each method names a key and says what it holds; the [`Entry`] that it returns says what
/// happens when the key is not there.
#[derive(Debug)]
pub struct Table<'d> {
    source: &'d Source<'d>,
    /// `None` when the table is not there, which has been noted already.
    entries: Option<&'d DeTable<'d>>,
    record: Record,
}

/// A key and what it holds. The value comes with [`required`](Entry::required),
/// [`optional`](Entry::optional) or [`or`](Entry::or).
#[derive(Debug)]
#[must_use = "a key is read by `required`, `optional` or `or`"]
pub struct Entry<'t, 'd, K> {
    table: &'t mut Table<'d>,
    key: &'static str,
    kind: K,
}

impl<'d> Table<'d> {
    /// A finite number. What it may be is said with [`range`](Entry::range) and its likes.
    pub fn number(&mut self, key: &'static str) -> Entry<'_, 'd, Number> {
        self.entry(key, Number::default())
    }

    /// A whole number that fits in 32 bits.
    pub fn count(&mut self, key: &'static str) -> Entry<'_, 'd, Whole<u32>> {
        self.entry(key, Whole { min: 0, max: u32::MAX })
    }

    /// A whole number that fits in 64 bits.
    pub fn whole(&mut self, key: &'static str) -> Entry<'_, 'd, Whole<u64>> {
        self.entry(key, Whole { min: 0, max: u64::MAX })
    }

    /// True or false.
    pub fn flag(&mut self, key: &'static str) -> Entry<'_, 'd, Flag> {
        self.entry(key, Flag)
    }

    /// Text in one line that is not empty.
    pub fn text(&mut self, key: &'static str) -> Entry<'_, 'd, Text> {
        self.entry(key, Text { max_chars: 250 })
    }

    /// One of a few words, each with its meaning. The first stands in for a faulty one.
    ///
    /// # Panics
    /// When there are no words.
    pub fn choice<T: Clone>(
        &mut self,
        key: &'static str,
        words: impl IntoIterator<Item = (&'static str, T)>,
    ) -> Entry<'_, 'd, Choice<T>> {
        let words: Vec<_> = words.into_iter().collect();
        assert!(!words.is_empty(), "a choice for `{key}` among no words");
        self.entry(key, Choice { words })
    }

    /// A table of its own, read by `reader`.
    pub fn section<T, F: Fn(&mut Table<'_>) -> T>(
        &mut self,
        key: &'static str,
        reader: F,
    ) -> Entry<'_, 'd, Section<F>> {
        self.entry(key, Section { reader })
    }

    /// Notes a complaint about a setting that was read well by itself.
    pub fn refuse(&self, place: impl Into<Place>, complaint: &impl Complaint) {
        self.source.refuse(place.into(), complaint);
    }

    /// Where the table begins.
    pub fn place(&self) -> Place {
        self.record.place
    }

    /// Whether the file has this table. When it has not, every value read is a placeholder.
    pub fn is_there(&self) -> bool {
        self.entries.is_some()
    }

    pub(crate) fn new(
        source: &'d Source<'d>,
        path: String,
        place: Place,
        entries: Option<&'d DeTable<'d>>,
    ) -> Self {
        Self { source, entries, record: Record::new(path, place) }
    }

    /// Lets the reader take what it wants; what it left is reported.
    pub(crate) fn read<T>(mut self, reader: impl FnOnce(&mut Self) -> T) -> T {
        let value = reader(&mut self);
        let Self { source, entries, mut record } = self;
        for key in entries.into_iter().flat_map(DeTable::keys) {
            let name = key.get_ref().as_ref();
            if !record.asked.contains(&name) {
                record.unknown.push((name.to_owned(), source.place(key.span().start)));
            }
        }
        source.record(record);
        value
    }

    fn entry<K>(&mut self, key: &'static str, kind: K) -> Entry<'_, 'd, K> {
        self.record.asked.push(key);
        Entry { table: self, key, kind }
    }
}

impl<'t, 'd, K: Kind> Entry<'t, 'd, K> {
    /// The value; it is a fault when the key is not there.
    pub fn required(mut self) -> Setting<K::Value> {
        let value = self.find();
        if value.is_none() && self.table.is_there() {
            self.table.record.missing.push(self.key);
        }
        self.slot(value).setting(&self.kind, value)
    }

    /// The value, if the key is there.
    pub fn optional(mut self) -> Option<Setting<K::Value>> {
        let value = self.find();
        let slot = self.slot(value);
        if value.is_none() {
            // Only to learn the keys of a section that is not there.
            self.kind.placeholder(&slot);
        }
        value.map(|value| slot.setting(&self.kind, Some(value)))
    }

    /// The value, or `default` when the key is not there.
    pub fn or(self, default: K::Value) -> Setting<K::Value> {
        let (key, place, is_sound) = (self.key, self.table.place(), self.table.is_there());
        self.optional().unwrap_or(Setting { value: default, place, key, is_item: false, is_sound })
    }

    /// A list of at least one and at most a thousand such values.
    pub fn list(self) -> Entry<'t, 'd, List<K>> {
        let Self { table, key, kind } = self;
        Entry { table, key, kind: List { items: kind, max_items: 1000 } }
    }

    /// The value of the key, if it is there.
    fn find(&mut self) -> Option<&'d Spanned<DeValue<'d>>> {
        let value = self.table.entries?.get(self.key)?;
        self.table.record.present.push(self.key);
        Some(value)
    }

    fn slot(&self, value: Option<&Spanned<DeValue<'_>>>) -> Slot<'d> {
        let Record { path, place, .. } = &self.table.record;
        let source = self.table.source;
        let place = value.map_or(*place, |value| source.place(value.span().start));
        let path = if path.is_empty() { self.key.into() } else { format!("{path}.{}", self.key) };
        Slot { source, path, key: self.key, is_item: false, place }
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

impl<T> Entry<'_, '_, Whole<T>> {
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
