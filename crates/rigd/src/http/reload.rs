//! `POST /config/reload`: the daemon reads its configuration again.
//!
//! The task of the daemon that knows its flags and its files does it (`cli/reload.rs`), one request after the
//! other.

use axum::{Extension, Json, extract::State, http::StatusCode};
use rig_model::with_causes;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tokio::sync::{mpsc, oneshot};

use super::{
    Problem, Shared,
    access::{HostName, Token},
};
use crate::{operator::Operator, rig::RequestRefusal};

/// Requests that wait; a person gives one.
const WAITING_MAX: usize = 4;

/// A request to read the configuration again.
#[derive(Debug)]
pub(crate) struct ReloadRequest {
    /// Who asked, for the journal.
    pub(crate) by: String,
    pub(crate) reply: oneshot::Sender<Result<Reloaded, ReloadRefusal>>,
}

/// What a reload has done.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub(crate) struct Reloaded {
    /// The settings that are in force from now on.
    pub(crate) changed: Vec<Changed>,
    /// The settings whose change needs a restart. They are as they were.
    pub(crate) kept: Vec<Kept>,
}

/// A setting that has changed.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub(crate) struct Changed {
    /// Its name, as in `rigd config show`.
    pub(crate) name: String,
    /// Its value as text; `null` if it had none.
    pub(crate) from: Option<String>,
    pub(crate) to: Option<String>,
}

/// A setting that the files change, and a reload does not.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub(crate) struct Kept {
    pub(crate) name: String,
    /// The value in force.
    pub(crate) value: Option<String>,
    /// The value in the files.
    pub(crate) wanted: Option<String>,
    /// Why it needs a restart.
    pub(crate) reason: String,
}

/// Why the configuration stays as it was.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ReloadRefusal {
    /// Every fault of the files, each with its place.
    #[error("{0}")]
    Files(String),
    #[error(
        "other computers can reach this daemon, and could move the rig: it needs `token_file` or tokens \
         (`rigd token new`)"
    )]
    Open,
    #[error("the journal has no note of it: {}", with_causes(.0))]
    Unrecorded(RequestRefusal),
    #[error("the notifications cannot be changed: {0}")]
    Notifications(String),
}

impl From<ReloadRefusal> for Problem {
    fn from(refusal: ReloadRefusal) -> Self {
        let detail = format!("the configuration is as it was: {refusal}");
        match refusal {
            ReloadRefusal::Files(_) | ReloadRefusal::Open => Self::unprocessable(detail),
            ReloadRefusal::Unrecorded(refusal) => Self::from(refusal),
            ReloadRefusal::Notifications(_) => Self::internal(&detail),
        }
    }
}

pub(super) async fn reload(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
) -> Result<Json<Reloaded>, Problem> {
    let closing = || {
        let detail = "this daemon does not read its configuration again now".to_owned();
        Problem::of(StatusCode::SERVICE_UNAVAILABLE, detail)
    };
    let reloads = shared.inner.reloads.get().ok_or_else(closing)?;
    let (reply, answer) = oneshot::channel();
    let request = ReloadRequest { by: operator.as_str().to_owned(), reply };
    reloads.send(request).await.map_err(|_| closing())?;
    Ok(Json(answer.await.map_err(|_| closing())??))
}

impl Shared {
    /// The requests of clients, for the task that reads the configuration again. There is one such task.
    pub(crate) fn take_reloads(&self) -> mpsc::Receiver<ReloadRequest> {
        let (requests, reloads) = mpsc::channel(WAITING_MAX);
        // A second task would get no requests.
        _ = self.inner.reloads.set(requests);
        reloads
    }

    /// Notes in the journal what was done to the configuration.
    ///
    /// # Errors
    /// [`ReloadRefusal::Unrecorded`].
    pub(crate) async fn note_reload(&self, what: String, by: &str) -> Result<(), ReloadRefusal> {
        self.inner.rig.note(what, by).await.map_err(ReloadRefusal::Unrecorded)
    }

    /// Whether this is the secret for everybody that is in force.
    pub(crate) fn has_token(&self, token: Option<&Token>) -> bool {
        self.inner.access.has_token(token)
    }

    /// Checks that not everybody could move the rig with this secret for everybody.
    ///
    /// # Errors
    /// [`ReloadRefusal::Open`].
    pub(crate) fn check_access(&self, token: Option<&Token>) -> Result<(), ReloadRefusal> {
        if self.inner.access.is_open_with(token) { Err(ReloadRefusal::Open) } else { Ok(()) }
    }

    /// Changes the names of the daemon and the secret for everybody.
    pub(crate) fn change_access(&self, allowed: Vec<HostName>, token: Option<Token>) {
        self.inner.access.change(allowed, token);
    }
}
