//! A JSON object in a request.

use std::{fmt, marker::PhantomData};

use axum::{Json, body::Bytes, extract::rejection::JsonRejection};
use serde::{
    Deserialize, Deserializer,
    de::{DeserializeOwned, MapAccess, Visitor, value::MapAccessDeserializer},
};

use super::Problem;

/// The body of a request that must be a JSON object.
pub(super) type ObjectBody<T> = Result<Json<Object<T>>, JsonRejection>;

/// The object in a body.
///
/// # Errors
/// The problem of a body that is no such object.
pub(super) fn object<T: DeserializeOwned>(body: &Bytes) -> Result<T, Problem> {
    let Json(Object(members)) = Json::<Object<T>>::from_bytes(body)?;
    Ok(members)
}

/// The object in a body, or its defaults without a body.
///
/// # Errors
/// As [`object`].
pub(super) fn object_or_default<T: Default + DeserializeOwned>(body: &Bytes) -> Result<T, Problem> {
    if body.is_empty() { Ok(T::default()) } else { object(body) }
}

/// The members of a JSON object. The derived readers of structures accept an array of their values too.
#[derive(Debug)]
pub(super) struct Object<T>(pub(super) T);

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Object<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Members<T>(PhantomData<T>);

        impl<'de, T: Deserialize<'de>> Visitor<'de> for Members<T> {
            type Value = T;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a JSON object")
            }

            fn visit_map<A: MapAccess<'de>>(self, members: A) -> Result<T, A::Error> {
                T::deserialize(MapAccessDeserializer::new(members))
            }
        }

        deserializer.deserialize_map(Members(PhantomData)).map(Self)
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
        assert!(read(r#"{"count": 2, "count": 3}"#).is_err());
    }
}
