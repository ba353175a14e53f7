//! The JSON Schema of a kind of file, from the keys that its reader asks for.
//!
//! A reader asks for all of its keys, also those of a table that the file does not have. So it describes
//! the whole file while it reads an empty one.
//!
//! # Source
//! JSON Schema 2020-12, <https://json-schema.org/draft/2020-12>.

use std::collections::BTreeMap;

use serde_json::{Map, Value, json};

use super::{
    Table,
    keys::{Described, TableKeys},
    source::Source,
};
use crate::Location;

/// The key under which a section refers to its table until both are put together.
pub(super) const TABLE: &str = "table";

/// The schema of the files that `reader` reads. Relations between keys are not in it: the reader decides.
pub fn schema<T>(title: &str, reader: impl FnOnce(&mut Table<'_>) -> T) -> Value {
    let (mut source, tree) = Source::parse(title, "");
    source.is_described = true;
    let root = Table::new(&source, String::new(), Location::START, Some(tree.get_ref()));
    root.read(reader);
    let tables = source.into_tables();
    let tables: BTreeMap<&str, &TableKeys> =
        tables.iter().map(|table| (table.path.as_str(), table)).collect();
    let mut schema = of_table("", &tables);
    schema["$schema"] = json!("https://json-schema.org/draft/2020-12/schema");
    schema["title"] = json!(title);
    schema
}

/// The schema of the table with this dotted name.
fn of_table(path: &str, tables: &BTreeMap<&str, &TableKeys>) -> Value {
    let (mut properties, mut required) = (Map::new(), Vec::new());
    for Described { key, schema, is_required } in
        tables.get(path).into_iter().flat_map(|table| &table.described)
    {
        properties.insert((*key).to_owned(), put_together(schema, tables));
        if *is_required {
            required.push(*key);
        }
    }
    json!({
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": false,
    })
}

/// A schema with its tables in place of their names.
fn put_together(schema: &Value, tables: &BTreeMap<&str, &TableKeys>) -> Value {
    if let Some(path) = schema.get(TABLE).and_then(Value::as_str) {
        return of_table(path, tables);
    }
    let mut schema = schema.clone();
    if let Some(items) = schema.get_mut("items") {
        *items = put_together(items, tables);
    }
    schema
}
