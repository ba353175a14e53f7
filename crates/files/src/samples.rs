//! The list `[[samples]]`, which a rig file and a scene file share.

use crate::{
    Complaint,
    settings::{Presence, Table},
};

/// A sample with a known stiffness.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownSample {
    /// Name on its label.
    pub name: String,
    /// Young's modulus, MPa.
    pub stiffness_mpa: f64,
}

/// Two samples with one name.
#[derive(Debug, thiserror::Error)]
#[error("there are two samples named \"{name}\"")]
struct RepeatedSample {
    name: String,
}

impl Complaint for RepeatedSample {
    fn suggestion(&self) -> Option<String> {
        Some("remove one".to_owned())
    }
}

/// Reads the list of samples. `rest` reads the other keys of a sample.
pub fn samples<T>(
    table: &mut Table<'_>,
    presence: Presence,
    rest: impl Fn(&mut Table<'_>, KnownSample) -> T,
) -> Vec<T> {
    let sample = |table: &mut Table<'_>| {
        let name = table.text("name").required();
        let stiffness_mpa = table.number("stiffness_mpa").range(1e-5..=1000.0).required().value;
        let known = KnownSample { name: name.value.clone(), stiffness_mpa };
        (name, rest(table, known))
    };
    let listed = presence.read(table.section("samples", sample).list(), Vec::new()).value;
    let (names, samples): (Vec<_>, Vec<_>) = listed.into_iter().map(|sample| sample.value).unzip();
    for (index, name) in names.iter().enumerate() {
        let is_repeated = names[..index].iter().any(|earlier| earlier.value == name.value);
        if is_repeated && name.sound().is_some() {
            table.refuse(name, &RepeatedSample { name: name.value.clone() });
        }
    }
    samples
}
