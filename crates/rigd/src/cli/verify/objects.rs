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
        let (views, failure) = match self {
            Self::File(path) => (vec![of_file(path, key)?], None),
            Self::Store(address) => of_store(address, key)?,
        };
        let printed =
            if args.output.json { print_json(&views) } else { views.iter().try_for_each(say) };
        let is_sound = |view: &ObjectView| view.verdict.as_ref().is_some_and(|one| one.is_sound);
        let verdict = match failure {
            Some((unread, failure))
                if views.iter().all(|view| is_sound(view) || unread.contains(&view.object)) =>
            {
                Err(failure)
            }
            _ if views.iter().all(is_sound) => Ok(()),
            _ => Err(Failure::NotSound),
        };
        concluded(printed, verdict)
    }
}

fn of_file(path: &Path, key: Option<&PublicKey>) -> Result<ObjectView, Failure> {
    let bytes =
        fs::read(path).map_err(|source| Failure::File { path: path.to_path_buf(), source })?;
    let object = path.display().to_string();
    let checked = verify_object(bytes.into(), key.map(PublicKey::bytes));
    let checked = checked.map_err(|source| ShipError::Object { object: object.clone(), source });
    Ok(ObjectView::new(object, checked.map_err(|error| with_causes(&error))))
}

/// After this many objects in a row that cannot be read, the store, or the way to it, is taken for what fails.
const FAILURES_MAX: usize = 3;

/// The objects of a store, and of those that the system did not let read the names, and why the first one was not.
type OfStore = (Vec<ObjectView>, Option<(Vec<String>, Failure)>);

fn of_store(address: Address, key: Option<&PublicKey>) -> Result<OfStore, Failure> {
    let store = ObjectStore::at(address)?;
    let found = objects(&store)?;
    if found.is_empty() {
        return Err(Failure::NoObjects { store: store.address().to_string() });
    }
    let (mut views, mut unread, mut in_a_row) = (Vec::new(), None::<(Vec<String>, Failure)>, 0);
    for object in found {
        let checked = object.check(&store, key);
        let reason = checked.map_err(|error| (with_causes(&error), error));
        let is_unread = reason.as_ref().is_err_and(|(_, error)| !error.is_of_run());
        let checked = reason.map_err(|(reason, error)| {
            if is_unread {
                let (names, _) = unread.get_or_insert_with(|| (Vec::new(), error.into()));
                names.push(object.name.clone());
            }
            reason
        });
        views.push(ObjectView::new(object.name, checked));
        in_a_row = if is_unread { in_a_row + 1 } else { 0 };
        if in_a_row == FAILURES_MAX {
            break;
        }
    }
    Ok((views, unread))
}

impl ObjectView {
    fn new(object: String, checked: Result<ObjectVerdict, String>) -> Self {
        match checked {
            Ok(verdict) => Self { object, verdict: Some(verdict), reason: None },
            Err(reason) => Self { object, verdict: None, reason: Some(reason) },
        }
    }
}

fn say(view: &ObjectView) -> Result<(), Failure> {
    let ObjectView { object, verdict, reason } = view;
    let Some(verdict) = verdict else { return print(reason.as_deref().unwrap_or(object)) };
    verdict.findings.iter().try_for_each(|finding| print(&finding.to_string()))?;
    print(&format!("{object}: {} {}: {}", verdict.kind, verdict.name, verdict.sentence()))
}
