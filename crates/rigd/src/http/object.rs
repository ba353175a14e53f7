//! A JSON object in a request.

use serde::{Deserialize, Deserializer, de::DeserializeOwned, de::Error};
use serde_json::{Map, Value};

/// The members of a JSON object. The derived readers of structures accept an array of their values too.
#[derive(Debug)]
pub(super) struct Object<T>(pub(super) T);

impl<'de, T: DeserializeOwned> Deserialize<'de> for Object<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let members = Map::deserialize(deserializer)?;
        serde_json::from_value(Value::Object(members)).map(Self).map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_array_is_no_object() {
        #[derive(Debug, Default, Deserialize)]
        #[serde(default)]
        struct Form {
            count: u32,
        }
        let read = |text| serde_json::from_str::<Object<Form>>(text).map(|Object(form)| form.count);
        assert_eq!(read(r#"{"count": 2}"#).unwrap(), 2);
        assert_eq!(read("{}").unwrap(), 0);
        assert!(serde_json::from_str::<Form>("[3]").is_ok() && read("[3]").is_err());
        assert!(read("[]").is_err());
    }
}
