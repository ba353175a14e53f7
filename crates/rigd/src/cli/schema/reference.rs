//! The reference of a kind of file: a table of its keys for each section, as a page of the manual.

use std::fmt::Write as _;

use serde_json::{Map, Value};

use super::KeyComment;

/// Units by the ends of the names of keys, the longest first.
const UNITS: [(&str, &str); 26] = [
    ("_hz_per_sqrt_hour", "Hz/√h"),
    ("_nf_per_m", "nF/m"),
    ("_kg_per_m3", "kg/m³"),
    ("_c_per_m2", "C/m²"),
    ("_j_per_m2", "J/m²"),
    ("_mm_per_s2", "mm/s²"),
    ("_deg_per_s2", "°/s²"),
    ("_mm_per_s", "mm/s"),
    ("_deg_per_s", "°/s"),
    ("mm_per_step", "mm per step"),
    ("deg_per_step", "° per step"),
    ("steps_per_revolution", "steps"),
    ("_above_mm", "mm"),
    ("encoder_steps", "steps"),
    ("_gpa", "GPa"),
    ("_mpa", "MPa"),
    ("_deg", "°"),
    ("_mm", "mm"),
    ("_hz", "Hz"),
    ("_rel", "1"),
    ("_g", "g"),
    ("_v", "V"),
    ("_s", "s"),
    ("cycles", "1"),
    ("baud", "bit/s"),
    ("_loss", "1"),
];

/// The page of a kind of file, from its schema with descriptions; its keys are in the order of the manual.
pub(super) fn page(kind: &str, schema: &Value, manual: &[KeyComment]) -> String {
    let title = kind.to_uppercase().chars().take(1).chain(kind.chars().skip(1)).collect::<String>();
    let mut text = format!(
        "# {title} files: every key\n\n`rigd schema {kind} --markdown` writes this page from the code that reads \
         the files. [{} has a file with all of it.\n",
        if matches!(kind, "analyzer" | "drive") {
            "Instruments](../instruments.md)"
        } else {
            "Protocol, rig and scene files](../files.md)"
        }
    );
    section(&mut text, "", schema, &Manual(manual));
    text
}

/// The keys of a manual, for their order and values.
struct Manual<'a>(&'a [KeyComment]);

impl Manual<'_> {
    fn place(&self, path: &str) -> usize {
        self.0.iter().position(|key| key.name == path).unwrap_or(self.0.len())
    }

    fn value(&self, path: &str) -> Option<&str> {
        self.0.get(self.place(path)).map(|key| key.value.as_str())
    }
}

/// A section with its keys, and then the sections in it.
fn section(text: &mut String, path: &str, schema: &Value, manual: &Manual<'_>) {
    let (table, is_list) = match schema.get("items") {
        Some(items) => (items, true),
        None => (schema, false),
    };
    if !path.is_empty() {
        let (open, close) = if is_list { ("[[", "]]") } else { ("[", "]") };
        _ = write!(text, "\n## `{open}{path}{close}`\n");
        let about = schema["description"].as_str().unwrap_or_default();
        if !about.is_empty() {
            _ = write!(text, "\n{}\n", escaped(about));
        }
    }
    let empty = Map::new();
    let keys = table["properties"].as_object().unwrap_or(&empty);
    let required: Vec<_> =
        table["required"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
    let full = |key: &str| if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") };
    let mut keys: Vec<_> = keys.iter().collect();
    keys.sort_by_key(|(key, _)| manual.place(&full(key)));
    let (sections, values): (Vec<_>, Vec<_>) =
        keys.into_iter().partition(|(key, schema)| is_section(schema, &full(key), manual));
    if !values.is_empty() {
        text.push_str(
            "\n| key | type | unit, range | default | meaning |\n|---|---|---|---|---|\n",
        );
    }
    let about = schema["description"].as_str().unwrap_or_default();
    let are_in_manual = about.contains("The values below are the defaults.");
    // "Each is zero if left out."
    let of_all = split_default(about).1;
    let of_all = of_all.as_deref().and_then(|value| value.strip_prefix("Each is "));
    let mut last: Option<(&String, &Value)> = None;
    for (key, schema) in values {
        let about = &schema["description"];
        // Keys that share a comment.
        let like = last.filter(|(_, text)| !text.is_null() && *text == about).map(|(key, _)| key);
        if like.is_none() {
            last = Some((key, about));
        }
        let default = match (required.contains(&key.as_str()), of_all) {
            (true, _) => Some("required"),
            (false, None) if are_in_manual => manual.value(&full(key)),
            (false, of_all) => of_all,
        };
        row(text, key, schema, default, like);
        for (inner, schema) in schema["properties"].as_object().into_iter().flatten() {
            row(text, &format!("{key}.{inner}"), schema, None, Some(key));
        }
    }
    for (key, schema) in sections {
        section(text, &full(key), schema, manual);
    }
}

/// Whether a table has a header in the manual; others stand behind their key.
fn is_section(schema: &Value, path: &str, manual: &Manual<'_>) -> bool {
    let inner = |schema: &Value| schema["properties"].as_object().cloned().unwrap_or_default();
    let keys = [inner(schema), schema.get("items").map(inner).unwrap_or_default()];
    let is_known = |key: &String| manual.value(&format!("{path}.{key}")).is_some();
    keys.iter().flat_map(Map::keys).any(is_known)
}

fn row(text: &mut String, key: &str, schema: &Value, known: Option<&str>, like: Option<&String>) {
    let about = schema["description"].as_str().unwrap_or_default();
    let (rest, default) = match (known, split_default(about)) {
        (Some(known), _) => (about.to_owned(), known.to_owned()),
        (None, (rest, default)) => (rest, default.unwrap_or_else(|| "optional".to_owned())),
    };
    let about = match like {
        Some(like) => format!("see `{like}`"),
        None if rest.is_empty() => "see the other keys of the section".to_owned(),
        None => escaped(&rest),
    };
    let (kind, range) = (kind(schema), range(key, schema));
    _ = writeln!(text, "| `{key}` | {kind} | {range} | {} | {about} |", escaped(&default));
}

/// A meaning without its sentence `… if left out.`, and the value in that sentence.
fn split_default(about: &str) -> (String, Option<String>) {
    const END: &str = " if left out";
    if let Some((before, value)) = about.split_once("If left out, ") {
        let (value, rest) = value.split_once(". ").unwrap_or((value, ""));
        return (format!("{before}{rest}"), Some(value.trim_end_matches('.').to_owned()));
    }
    let Some(at) = about.find(END) else { return (about.to_owned(), None) };
    let (before, rest) = (&about[..at], about[at + END.len()..].trim_start_matches('.'));
    let begins = |mark: &str| before.rfind(mark).map(|place| place + mark.len());
    // A bracket that is closed again belongs to the value.
    let bracket = || begins("(").filter(|start| !before[*start..].contains(')'));
    let start = match before.strip_suffix('"') {
        Some(word) => word.rfind('"'),
        None => begins(". ").max(bracket()),
    };
    let start = start.unwrap_or(0);
    let value = before[start..].split_once("_deg is ").map_or(&before[start..], |(_, value)| value);
    if before[..start].ends_with('(') {
        return (about.to_owned(), Some(value.to_owned()));
    }
    (format!("{}{rest}", before[..start].trim_end()), Some(value.to_owned()))
}

fn kind(schema: &Value) -> String {
    if let Some(words) = schema["enum"].as_array() {
        let words: Vec<_> = words.iter().filter_map(Value::as_str).collect();
        return format!("`{}`", words.join("`, `"));
    }
    // A shipped instrument, or the path of a file.
    if let Some([words, _]) = schema["anyOf"].as_array().map(Vec::as_slice) {
        return format!("{}, or a path that ends in `.toml`", kind(words));
    }
    match schema["type"].as_str() {
        Some("number") => "number".to_owned(),
        Some("integer") => "whole number".to_owned(),
        Some("string") => "text".to_owned(),
        Some("boolean") => "true or false".to_owned(),
        Some("array") => {
            let (min, max) = (&schema["minItems"], &schema["maxItems"]);
            let count = if min == max { min.to_string() } else { format!("{min} to {max}") };
            format!("list of {count}: {}", kind(&schema["items"]))
        }
        _ => "table".to_owned(),
    }
}

/// The unit by the name, and the limits.
fn range(key: &str, schema: &Value) -> String {
    let values = schema.get("items").unwrap_or(schema);
    let is_number = matches!(values["type"].as_str(), Some("number" | "integer"));
    let unit = UNITS.iter().find(|(end, _)| is_number && key.ends_with(end));
    let unit = unit.map(|(_, unit)| (*unit).to_owned());
    // What a whole number can hold is no limit of the key.
    let is_told = |limit: &&Value| limit.as_f64().is_some_and(|limit| limit < f64::from(u32::MAX));
    let limit = |name: &str| values.get(name).filter(is_told).map(shown);
    let range = match (limit("minimum"), limit("exclusiveMinimum"), limit("maximum")) {
        (Some(min), _, Some(max)) => Some(format!("{min} to {max}")),
        (_, Some(min), Some(max)) => Some(format!("above {min}, up to {max}")),
        (Some(min), _, None) => Some(format!("{min} or more")),
        (_, Some(min), None) => Some(format!("above {min}")),
        (None, None, max) => max.map(|max| format!("up to {max}")),
    };
    let parts: Vec<String> = unit.into_iter().chain(range).collect();
    parts.join(", ")
}

/// A limit without the point of a whole one.
fn shown(limit: &Value) -> String {
    let text = limit.to_string();
    text.strip_suffix(".0").map_or(text.clone(), ToOwned::to_owned)
}

/// Text in a cell of a table.
fn escaped(text: &str) -> String {
    text.replace('|', "\\|").replace('<', "&lt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_the_value_in_its_sentence_or_bracket() {
        #[track_caller]
        fn check(about: &str, rest: &str, default: &str) {
            assert_eq!(split_default(about), (rest.to_owned(), Some(default.to_owned())));
        }
        check("A ratio. 2(1 - nu)/(2 - nu) if left out.", "A ratio.", "2(1 - nu)/(2 - nu)");
        check("Pace. \"virtual\" if left out.", "Pace.", "\"virtual\"");
        let about = "Parity (\"none\" here) and stop bits (1 if left out, or 2)";
        check(about, about, "1");
    }
}
