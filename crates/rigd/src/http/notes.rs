//! Notes of people about runs. They are not in the journal: a person may change them at any time.

use std::{collections::BTreeMap, fs, io, path::Path, sync::Arc};

use axum::{
    Json,
    body::Bytes,
    extract::{Path as UrlPath, State},
    http::StatusCode,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Problem, Shared, object::object};
use crate::durable;

const FILE: &str = "notes.json";
/// Longer texts belong into a document of their own, characters.
const LENGTH_MAX: usize = 2000;

/// A note about a run.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Note {
    /// The text; empty for none.
    note: String,
    /// A person marked the run.
    is_starred: bool,
}

/// The notes by the id of their run.
pub(super) type Notes = BTreeMap<String, Note>;

pub(super) async fn list(State(shared): State<Shared>) -> Result<Json<Notes>, Problem> {
    let path = shared.inner.data.join(FILE);
    shared.read(move |_| read(&path)).await.map(Json)
}

pub(super) async fn write(
    State(shared): State<Shared>,
    UrlPath(id): UrlPath<String>,
    body: Bytes,
) -> Result<StatusCode, Problem> {
    let id = shared.run(&id).await?;
    let note: Note = object(&body)?;
    if note.note.chars().count() > LENGTH_MAX {
        return Err(Problem::bad_request(format!("a note has at most {LENGTH_MAX} characters")));
    }
    let data = shared.inner.data.clone();
    // One writer at a time: each writes the whole file. It has its turn until the file is written, also when its client
    // goes away.
    let turn = Arc::clone(&shared.inner.noted).lock_owned().await;
    shared
        .read(move |reader| {
            let _turn = turn;
            reader.run(id)?;
            let path = data.join(FILE);
            let mut notes = read(&path)?;
            if note == Note::default() {
                notes.remove(&id.to_string());
            } else {
                notes.insert(id.to_string(), note);
            }
            durable::replace(&path, &notes, durable::FOR_ALL).map_err(|error| failed(&path, &error))
        })
        .await?;
    Ok(StatusCode::NO_CONTENT)
}

fn read(path: &Path) -> Result<Notes, Problem> {
    match fs::read(path) {
        Ok(text) => serde_json::from_slice(&text).map_err(|error| failed(path, &error.into())),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Notes::new()),
        Err(error) => Err(failed(path, &error)),
    }
}

fn failed(path: &Path, error: &io::Error) -> Problem {
    tracing::warn!(%error, path = %path.display(), "the notes cannot be read or written");
    Problem::of(StatusCode::INTERNAL_SERVER_ERROR, format!("{FILE}: {error}"))
}
