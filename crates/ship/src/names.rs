//! Names of objects: `lab=L/bench=B/month=YYYY-MM/RUN.HEAD.parquet`, with the id of the run and the first eight
//! digits of the digest of its last record.
//!
//! The parts of the path are those of Hive, from which other programs make columns. A receipt begins with `_`, so
//! that these programs do not take it for a table.

use std::{fmt, str::FromStr};

use rig_store::{Digest, RunId};

/// Longest name of a laboratory or bench, bytes.
const LENGTH_MAX: usize = 64;
const OBJECT: &str = ".parquet";
const RECEIPT: &str = ".seal.json";

/// The name of a laboratory or a bench in the names of objects.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Label(String);

/// A text that cannot name a laboratory or a bench.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{text}` cannot be a part of a name: give 1 to {LENGTH_MAX} letters from a to z, digits, `.`, `_` or `-`, \
     the first a letter or a digit"
)]
pub struct LabelError {
    text: String,
}

impl FromStr for Label {
    type Err = LabelError;

    fn from_str(text: &str) -> Result<Self, LabelError> {
        let is_kept = |byte: u8| byte.is_ascii_alphanumeric() || b"._-".contains(&byte);
        let is_label = text.len() <= LENGTH_MAX
            && text.bytes().all(is_kept)
            && text.bytes().next().is_some_and(|first| first.is_ascii_alphanumeric());
        if is_label { Ok(Self(text.to_owned())) } else { Err(LabelError { text: text.to_owned() }) }
    }
}

impl fmt::Display for Label {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// The folder of the objects of a bench, with a slash at its end.
pub(crate) fn of_bench(lab: &Label, bench: &Label) -> String {
    format!("lab={lab}/bench={bench}/")
}

/// The names of a run in an object store.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Names {
    /// Its object.
    pub(crate) object: String,
    /// Its receipt.
    pub(crate) receipt: String,
    /// How the names of all objects of the run begin, whatever their records.
    pub(crate) run: String,
}

impl Names {
    /// The names of a run that began at `started_at`, RFC 3339.
    pub(crate) fn new(of_bench: &str, run: RunId, started_at: &str, head: Digest) -> Self {
        let month = started_at.get(..7).unwrap_or("unknown");
        let folder = format!("{of_bench}month={month}/");
        let stem = stem(&run.to_string(), &head.to_string());
        Self {
            object: format!("{folder}{stem}{OBJECT}"),
            receipt: format!("{folder}_{stem}{RECEIPT}"),
            run: format!("{folder}{run}."),
        }
    }
}

fn stem(run: &str, head: &str) -> String {
    format!("{run}.{}", head.get(..8).unwrap_or(head))
}

/// Whether a name is that of an object.
pub(crate) fn is_object(name: &str) -> bool {
    name.ends_with(OBJECT)
}

/// The name of the receipt of an object.
pub(crate) fn receipt_of(object: &str) -> String {
    let (folder, file) =
        object.rsplit_once('/').map_or(("", object), |(folder, file)| (folder, file));
    let slash = if folder.is_empty() { "" } else { "/" };
    format!("{folder}{slash}_{}{RECEIPT}", file.strip_suffix(OBJECT).unwrap_or(file))
}

/// The name of the object of a receipt; none for another name.
pub(crate) fn object_of(receipt: &str) -> Option<String> {
    let (folder, file) = receipt.rsplit_once('/').unwrap_or(("", receipt));
    let stem = file.strip_prefix('_')?.strip_suffix(RECEIPT)?;
    let slash = if folder.is_empty() { "" } else { "/" };
    Some(format!("{folder}{slash}{stem}{OBJECT}"))
}

/// The id of a run in the name of its object.
pub(crate) fn run_of(object: &str) -> &str {
    let file = object.rsplit('/').next().unwrap_or(object);
    file.split('.').next().unwrap_or(file)
}

/// Whether an object with this name is one of this run with this last digest.
pub(crate) fn is_named(object: &str, run: &str, head: &str) -> bool {
    let file = object.rsplit('/').next().unwrap_or(object);
    file.strip_suffix(OBJECT) == Some(&stem(run, head))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_paths_of_hive() {
        let run = "0195a0c2-0000-7000-8000-000000000001".parse().unwrap();
        let bench = of_bench(&"lab-1".parse().unwrap(), &"left".parse().unwrap());
        let names = Names::new(&bench, run, "2026-11-22T08:00:00.000Z", Digest::START);
        let folder = "lab=lab-1/bench=left/month=2026-11";
        assert_eq!(names.object, format!("{folder}/{run}.00000000.parquet"));
        assert_eq!(names.receipt, format!("{folder}/_{run}.00000000.seal.json"));
        assert_eq!(receipt_of(&names.object), names.receipt);
        assert_eq!(object_of(&names.receipt).as_ref(), Some(&names.object));
        assert_eq!(object_of(&names.object), None);
        assert!(names.object.starts_with(&names.run) && is_object(&names.object));
        assert!(is_named(&names.object, &run.to_string(), &Digest::START.to_string()));
        assert_eq!(run_of(&names.object), run.to_string());
        assert!(!is_named(&names.object, &run.to_string(), "11111111"));
    }

    #[test]
    fn a_label_is_safe_in_every_path() {
        let long = "a".repeat(65);
        for wrong in ["", "a/b", "..", "_x", ".x", "a b", "é", "a=b", &long] {
            assert!(wrong.parse::<Label>().is_err(), "{wrong}");
        }
        assert_eq!("Bench-1.b_2".parse::<Label>().unwrap().to_string(), "Bench-1.b_2");
    }
}
