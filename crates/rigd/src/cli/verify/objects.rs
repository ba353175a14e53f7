//! `rigd verify` of objects: each from its own bytes, without a journal.

use std::{fs, path::Path};

use rig_model::with_causes;
use rig_ship::{Address, ObjectStore, PublicKey, ShipError, objects};
use rig_verify::{ObjectVerdict, verify_object};
use serde::Serialize;

use super::{Failure, VerifyArgs, concluded, print, print_json};

/// Objects that a person names in place of a run.
pub(super) enum Objects<'a> {
    /// One file.
    File(&'a Path),
    /// All of an object store.
    Store(Address),
}

/// The verdict on an object, for a program.
#[derive(Debug, Serialize)]
struct ObjectView {
    object: String,
    /// None for one that cannot be read.
    #[serde(flatten)]
    verdict: Option<ObjectVerdict>,
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<String>,
}

impl<'a> Objects<'a> {
    /// The objects that a text names; none for a run.
    pub(super) fn named(text: &'a str) -> Option<Self> {
        let path = Path::new(text);
        if path.extension().is_some_and(|extension| extension == "parquet") {
            return Some(Self::File(path));
        }
        text.parse().ok().map(Self::Store)
    }

    pub(super) fn verify(self, args: &VerifyArgs) -> Result<(), Failure> {
        let key = args.signed_by.as_ref();
        let views = match self {
            Self::File(path) => vec![of_file(path, key)?],
            Self::Store(address) => of_store(address, key)?,
        };
        let printed =
            if args.output.json { print_json(&views) } else { views.iter().try_for_each(say) };
        let is_sound = |view: &ObjectView| view.verdict.as_ref().is_some_and(|one| one.is_sound);
        let verdict = if views.iter().all(is_sound) { Ok(()) } else { Err(Failure::NotSound) };
        concluded(printed, verdict)
    }
}

fn of_file(path: &Path, key: Option<&PublicKey>) -> Result<ObjectView, Failure> {
    let bytes =
        fs::read(path).map_err(|source| Failure::File { path: path.to_path_buf(), source })?;
    let object = path.display().to_string();
    let checked = verify_object(bytes.into(), key.map(PublicKey::bytes));
    let checked = checked.map_err(|source| ShipError::Object { object: object.clone(), source });
    ObjectView::new(object, checked)
}

fn of_store(address: Address, key: Option<&PublicKey>) -> Result<Vec<ObjectView>, Failure> {
    let store = ObjectStore::at(address)?;
    let found = objects(&store)?;
    if found.is_empty() {
        return Err(Failure::NoObjects { store: store.address().to_string() });
    }
    let view = |object: rig_ship::StoredObject| {
        let checked = object.check(&store, key);
        ObjectView::new(object.name, checked)
    };
    found.into_iter().map(view).collect()
}

impl ObjectView {
    fn new(object: String, checked: Result<ObjectVerdict, ShipError>) -> Result<Self, Failure> {
        match checked {
            Ok(verdict) => Ok(Self { object, verdict: Some(verdict), reason: None }),
            Err(error) if error.is_of_run() => {
                Ok(Self { object, verdict: None, reason: Some(with_causes(&error)) })
            }
            Err(error) => Err(error.into()),
        }
    }
}

fn say(view: &ObjectView) -> Result<(), Failure> {
    let ObjectView { object, verdict, reason } = view;
    let Some(verdict) = verdict else { return print(reason.as_deref().unwrap_or(object)) };
    verdict.findings.iter().try_for_each(|finding| print(&finding.to_string()))?;
    print(&format!("{object}: {} {}: {}", verdict.kind, verdict.name, verdict.sentence()))
}
