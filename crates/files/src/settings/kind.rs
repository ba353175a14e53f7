//! The kinds of value that a key may hold.

use std::{fmt, path::PathBuf};

use serde_json::{Map, Value, json};
use toml::{Spanned, de::DeValue};

use super::{
    InForce, Setting, Table,
    keys::{nearest, shortened},
    schema::TABLE,
    source::Source,
    unit_hint::unit_hint,
    value_fault::{Bound, FaultyValue, Limit, ValueFault},
};
use crate::{
    Location,
    instrument::{ENDING, Named},
};

/// A kind of value. Only this module has kinds.
pub trait Kind: sealed::Sealed {
    /// The type of the value in Rust.
    type Value;

    /// The value, or `None` after its faults were reported.
    #[doc(hidden)]
    fn read<'d>(&self, slot: &Slot<'d>, value: &'d Spanned<DeValue<'d>>) -> Option<Self::Value>;

    /// The value that replaces a missing or faulty one.
    #[doc(hidden)]
    fn placeholder(&self, slot: &Slot<'_>) -> Self::Value;

    /// What the value at this path may be, as JSON Schema.
    #[doc(hidden)]
    fn schema(&self, path: &str) -> Value;

    /// The value as TOML; `None` if it has no form of its own, as a table.
    #[doc(hidden)]
    fn written(&self, value: &Self::Value) -> Option<String>;

    /// Whether it is a table or a list of tables, whose values are recorded one by one.
    #[doc(hidden)]
    fn has_tables(&self) -> bool {
        false
    }
}

mod sealed {
    pub trait Sealed {}
    impl Sealed for super::Number {}
    impl<T> Sealed for super::Integer<T> {}
    impl Sealed for super::Flag {}
    impl Sealed for super::Text {}
    impl<T> Sealed for super::Choice<T> {}
    impl<T> Sealed for super::ChoiceOrFile<T> {}
    impl<K> Sealed for super::List<K> {}
    impl<F> Sealed for super::Section<F> {}
    impl Sealed for super::Interval {}
}

/// The location of a value, also of a missing one.
#[doc(hidden)]
#[derive(Debug, Clone)]
pub struct Slot<'d> {
    pub(crate) source: &'d Source<'d>,
    /// Dotted name of the value, used if it is a table.
    pub(crate) path: String,
    pub(crate) key: &'static str,
    pub(crate) is_item: bool,
    pub(crate) location: Location,
}

impl Slot<'_> {
    fn subject(&self, value: &Spanned<DeValue<'_>>) -> FaultyValue {
        let is_long = matches!(value.get_ref(), DeValue::Array(_) | DeValue::Table(_));
        let written = (!is_long).then(|| shortened(self.source.written(value.span())));
        FaultyValue { key: self.key, written, is_item: self.is_item }
    }

    fn refuse<T>(&self, fault: &ValueFault) -> Option<T> {
        self.source.refuse(self.location, fault);
        None
    }

    /// Records a default in force.
    pub(crate) fn record(&self, text: Option<String>) {
        let value = || InForce { name: self.path.clone(), text, location: None };
        self.source.record(value);
    }

    fn expected<T>(&self, expected: &'static str, value: &Spanned<DeValue<'_>>) -> Option<T> {
        self.refuse(&ValueFault::kind(self.subject(value), expected, value.get_ref()))
    }
}

/// A finite number; it may have a fraction.
#[derive(Debug, Clone, Copy, Default)]
pub struct Number {
    pub(crate) limits: [Option<Limit<f64>>; 2],
}

impl Kind for Number {
    type Value = f64;

    fn read<'d>(&self, slot: &Slot<'d>, value: &'d Spanned<DeValue<'d>>) -> Option<f64> {
        let number = match value.get_ref() {
            DeValue::Float(float) => float.as_str().parse().ok(),
            DeValue::Integer(whole) => {
                i128::from_str_radix(whole.as_str(), whole.radix()).ok().map(|whole| whole as f64)
            }
            _ => return slot.expected("a number", value),
        };
        let Some(number) = number.filter(|number: &f64| number.is_finite()) else {
            return slot.refuse(&ValueFault::NotFinite(slot.subject(value)));
        };
        let broken = self.limits.into_iter().flatten().find(|limit| !limit.allows(number));
        match broken {
            Some(limit) => {
                let is_right =
                    |meant| self.limits.into_iter().flatten().all(|limit| limit.allows(meant));
                let hint = unit_hint(slot.key, number, is_right);
                slot.refuse(&ValueFault::outside(slot.subject(value), limit, hint))
            }
            None => Some(number),
        }
    }

    fn placeholder(&self, _: &Slot<'_>) -> f64 {
        self.limits[0].map_or(0.0, |limit| limit.value)
    }

    fn schema(&self, _: &str) -> Value {
        let limits = self.limits.into_iter().flatten().map(|limit| {
            let key = match limit.bound {
                Bound::AtLeast => "minimum",
                Bound::Above => "exclusiveMinimum",
                Bound::AtMost => "maximum",
            };
            (key.to_owned(), json!(limit.value))
        });
        [("type".to_owned(), json!("number"))]
            .into_iter()
            .chain(limits)
            .collect::<Map<_, _>>()
            .into()
    }

    fn written(&self, value: &f64) -> Option<String> {
        Some(value.to_string())
    }
}

/// A whole number.
#[derive(Debug, Clone, Copy)]
pub struct Integer<T> {
    pub(crate) min: T,
    pub(crate) max: T,
}

impl<T: Copy + fmt::Display + TryFrom<i128> + Into<i128>> Kind for Integer<T> {
    type Value = T;

    fn read<'d>(&self, slot: &Slot<'d>, value: &'d Spanned<DeValue<'d>>) -> Option<T> {
        let DeValue::Integer(whole) = value.get_ref() else {
            return slot.expected("a whole number", value);
        };
        // A number beyond 128 bits is beyond any limit.
        let beyond = if whole.as_str().starts_with('-') { i128::MIN } else { i128::MAX };
        let whole = i128::from_str_radix(whole.as_str(), whole.radix()).unwrap_or(beyond);
        let (min, max) = (self.min.into(), self.max.into());
        if whole < min {
            let limit = Limit { bound: Bound::AtLeast, value: min };
            return slot.refuse(&ValueFault::outside(slot.subject(value), limit, None));
        }
        if whole > max {
            let limit = Limit { bound: Bound::AtMost, value: max };
            return slot.refuse(&ValueFault::outside(slot.subject(value), limit, None));
        }
        T::try_from(whole).ok()
    }

    fn placeholder(&self, _: &Slot<'_>) -> T {
        self.min
    }

    fn schema(&self, _: &str) -> Value {
        let limit = |value: T| {
            let value: i128 = value.into();
            let below_zero = || json!(i64::try_from(value).unwrap_or(i64::MIN));
            u64::try_from(value).map_or_else(|_| below_zero(), |value| json!(value))
        };
        json!({ "type": "integer", "minimum": limit(self.min), "maximum": limit(self.max) })
    }

    fn written(&self, value: &T) -> Option<String> {
        Some(value.to_string())
    }
}

/// `true` or `false`.
#[derive(Debug, Clone, Copy)]
pub struct Flag;

impl Kind for Flag {
    type Value = bool;

    fn read<'d>(&self, slot: &Slot<'d>, value: &'d Spanned<DeValue<'d>>) -> Option<bool> {
        value.get_ref().as_bool().or_else(|| slot.expected("true or false", value))
    }

    fn placeholder(&self, _: &Slot<'_>) -> bool {
        false
    }

    fn schema(&self, _: &str) -> Value {
        json!({ "type": "boolean" })
    }

    fn written(&self, value: &bool) -> Option<String> {
        Some(value.to_string())
    }
}

/// Text of one line that is not empty.
#[derive(Debug, Clone, Copy)]
pub struct Text {
    pub(crate) max_chars: usize,
}

impl Kind for Text {
    type Value = String;

    fn read<'d>(&self, slot: &Slot<'d>, value: &'d Spanned<DeValue<'d>>) -> Option<String> {
        let Some(text) = value.get_ref().as_str() else {
            return slot.expected("text", value);
        };
        let subject = || slot.subject(value);
        if text.trim().is_empty() {
            return slot.refuse(&ValueFault::EmptyText(subject()));
        }
        if let Some(character) = text.chars().find(|character| character.is_control()) {
            return slot.refuse(&ValueFault::ControlCharacter { subject: subject(), character });
        }
        let count = text.chars().count();
        if count > self.max_chars {
            let max = self.max_chars;
            return slot.refuse(&ValueFault::LongText { subject: subject(), count, max });
        }
        Some(text.to_owned())
    }

    fn placeholder(&self, _: &Slot<'_>) -> String {
        String::new()
    }

    fn schema(&self, _: &str) -> Value {
        // One line, and not of spaces alone.
        json!({
            "type": "string",
            "maxLength": self.max_chars,
            "pattern": r"^[^\p{Cc}]*[^\p{Cc}\s][^\p{Cc}]*$",
        })
    }

    fn written(&self, value: &String) -> Option<String> {
        Some(Value::from(value.as_str()).to_string())
    }
}

/// One of a few words.
#[derive(Debug, Clone)]
pub struct Choice<T> {
    pub(crate) words: Vec<(&'static str, T)>,
}

impl<T: Clone + PartialEq> Kind for Choice<T> {
    type Value = T;

    fn read<'d>(&self, slot: &Slot<'d>, value: &'d Spanned<DeValue<'d>>) -> Option<T> {
        let Some(text) = value.get_ref().as_str() else {
            return slot.expected("text", value);
        };
        let chosen = self.words.iter().find(|(word, _)| *word == text);
        if let Some((_, meaning)) = chosen {
            return Some(meaning.clone());
        }
        let words: Vec<_> = self.words.iter().map(|(word, _)| *word).collect();
        let meant = nearest(text, &words);
        slot.refuse(&ValueFault::NotAChoice { subject: slot.subject(value), words, meant })
    }

    fn placeholder(&self, _: &Slot<'_>) -> T {
        self.words[0].1.clone()
    }

    fn schema(&self, _: &str) -> Value {
        let words: Vec<_> = self.words.iter().map(|(word, _)| *word).collect();
        json!({ "enum": words })
    }

    fn written(&self, value: &T) -> Option<String> {
        let (word, _) = self.words.iter().find(|(_, meaning)| meaning == value)?;
        Some(format!("\"{word}\""))
    }
}

/// One of a few words, or the path of an instrument file.
#[derive(Debug, Clone)]
pub struct ChoiceOrFile<T> {
    pub(crate) choice: Choice<T>,
}

impl<T: Clone + PartialEq> Kind for ChoiceOrFile<T> {
    type Value = Named<T>;

    fn read<'d>(&self, slot: &Slot<'d>, value: &'d Spanned<DeValue<'d>>) -> Option<Named<T>> {
        if value.get_ref().as_str().is_some_and(|text| text.ends_with(ENDING)) {
            let path = Text { max_chars: 250 }.read(slot, value)?;
            return Some(Named::File { path: PathBuf::from(path), location: slot.location });
        }
        self.choice.read(slot, value).map(Named::Shipped)
    }

    fn placeholder(&self, slot: &Slot<'_>) -> Named<T> {
        Named::Shipped(self.choice.placeholder(slot))
    }

    fn schema(&self, path: &str) -> Value {
        let file = json!({ "type": "string", "pattern": r"\.toml$" });
        json!({ "anyOf": [self.choice.schema(path), file] })
    }

    fn written(&self, value: &Named<T>) -> Option<String> {
        match value {
            Named::Shipped(make) => self.choice.written(make),
            Named::File { path, .. } => Some(Value::from(path.to_string_lossy()).to_string()),
        }
    }
}

/// A list that is not empty.
#[derive(Debug, Clone)]
pub struct List<K> {
    pub(crate) items: K,
    pub(crate) max_items: usize,
}

impl<K: Kind> Kind for List<K> {
    type Value = Vec<Setting<K::Value>>;

    fn read<'d>(&self, slot: &Slot<'d>, value: &'d Spanned<DeValue<'d>>) -> Option<Self::Value> {
        let Some(items) = value.get_ref().as_array() else {
            return slot.expected("a list", value);
        };
        if items.is_empty() {
            return slot.refuse(&ValueFault::EmptyList(slot.key));
        }
        let (key, count, max) = (slot.key, items.len(), self.max_items);
        if count > max {
            return slot.refuse(&ValueFault::LongList { key, count, max });
        }
        let read_item = |item: &'d Spanned<DeValue<'d>>| {
            let location = slot.source.location(item.span().start);
            let path = format!("[{}]", slot.path);
            let slot = Slot { path, is_item: true, location, ..slot.clone() };
            slot.setting(&self.items, Some(item))
        };
        Some(items.iter().map(read_item).collect())
    }

    fn placeholder(&self, slot: &Slot<'_>) -> Self::Value {
        // This registers the keys of a section that the file does not have.
        let item = Slot { path: format!("[{}]", slot.path), ..slot.clone() };
        slot.source.idly(|| _ = self.items.placeholder(&item));
        Vec::new()
    }

    fn schema(&self, path: &str) -> Value {
        let items = self.items.schema(&format!("[{path}]"));
        json!({ "type": "array", "minItems": 1, "maxItems": self.max_items, "items": items })
    }

    fn written(&self, value: &Self::Value) -> Option<String> {
        let items: Option<Vec<_>> =
            value.iter().map(|item| self.items.written(&item.value)).collect();
        Some(format!("[{}]", items?.join(", ")))
    }

    fn has_tables(&self) -> bool {
        self.items.has_tables()
    }
}

/// Two numbers, the smaller one first.
#[derive(Debug, Clone, Copy)]
pub struct Interval {
    pub(crate) ends: Number,
}

impl Kind for Interval {
    type Value = (f64, f64);

    fn read<'d>(&self, slot: &Slot<'d>, value: &'d Spanned<DeValue<'d>>) -> Option<(f64, f64)> {
        let ends = List { items: self.ends, max_items: usize::MAX }.read(slot, value)?;
        if ends.iter().any(|end| end.sound().is_none()) {
            return None;
        }
        match ends[..] {
            [min, max] if min.value < max.value => Some((min.value, max.value)),
            _ => {
                let are_equal = matches!(&ends[..], [min, max] if min.value == max.value);
                let (key, count) = (slot.key, ends.len());
                slot.refuse(&ValueFault::NotAnInterval { key, count, are_equal })
            }
        }
    }

    fn placeholder(&self, slot: &Slot<'_>) -> (f64, f64) {
        let end = self.ends.placeholder(slot);
        (end, end)
    }

    fn schema(&self, path: &str) -> Value {
        json!({ "type": "array", "minItems": 2, "maxItems": 2, "items": self.ends.schema(path) })
    }

    fn written(&self, (least, most): &(f64, f64)) -> Option<String> {
        Some(format!("[{least}, {most}]"))
    }
}

/// A table with its own keys.
#[derive(Debug, Clone, Copy)]
pub struct Section<F> {
    pub(crate) reader: F,
}

impl<T, F: Fn(&mut Table<'_>) -> T> Kind for Section<F> {
    type Value = T;

    fn read<'d>(&self, slot: &Slot<'d>, value: &'d Spanned<DeValue<'d>>) -> Option<T> {
        let Some(entries) = value.get_ref().as_table() else {
            return slot.expected("a table", value);
        };
        Some(
            Table::new(slot.source, slot.path.clone(), slot.location, Some(entries))
                .read(&self.reader),
        )
    }

    fn placeholder(&self, slot: &Slot<'_>) -> T {
        Table::new(slot.source, slot.path.clone(), slot.location, None).read(&self.reader)
    }

    fn schema(&self, path: &str) -> Value {
        json!({ TABLE: path })
    }

    fn written(&self, _: &T) -> Option<String> {
        None
    }

    fn has_tables(&self) -> bool {
        true
    }
}

impl<'d> Slot<'d> {
    /// Reads the value, or replaces it by a placeholder.
    pub(crate) fn setting<K: Kind>(
        &self,
        kind: &K,
        value: Option<&'d Spanned<DeValue<'d>>>,
    ) -> Setting<K::Value> {
        let is_broken = self.source.is_broken(self.location);
        if let Some(given) = value.filter(|_| !self.is_item && !kind.has_tables()) {
            self.source.record(|| {
                let words = self.source.written(given.span()).split_whitespace();
                let text = Some(words.collect::<Vec<_>>().join(" "));
                InForce { name: self.path.clone(), text, location: Some(self.location) }
            });
        }
        let read = value.filter(|_| !is_broken).and_then(|value| kind.read(self, value));
        let is_sound = read.is_some();
        let value = read.unwrap_or_else(|| kind.placeholder(self));
        Setting { value, location: self.location, key: self.key, is_item: self.is_item, is_sound }
    }
}
