//! What has changed since a run, for a person who is about to start its protocol again.

use axum::{
    Json,
    extract::{Path, State},
};
use rig_store::Change;
use schemars::JsonSchema;
use serde::Serialize;

use super::{Problem, Shared};
use crate::rig;

/// The present setting beside that of a run.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct ChangesView {
    /// Rig file, scene file, software, devices, calibrations and corrections, where they are others than in the run.
    changes: Vec<Change>,
    /// Free space of the data directory, bytes; none if the system does not say.
    #[serde(skip_serializing_if = "Option::is_none")]
    free_bytes: Option<u64>,
}

pub(super) async fn show(
    State(shared): State<Shared>,
    Path(id): Path<String>,
) -> Result<Json<ChangesView>, Problem> {
    let id = shared.run(&id).await?;
    let setting = shared.inner.rig.status().borrow().setting.clone();
    let data = shared.inner.data.clone();
    let free_bytes = rig::free_bytes(&data);
    let changes = shared.read(move |reader| {
        reader.run(id)?;
        let calibrations = &rig::cited(&data, &setting);
        let now = rig::Present { setting: &setting, calibrations };
        Ok(rig::changes_since(&reader.records(id)?, now)?)
    });
    Ok(Json(ChangesView { changes: changes.await?, free_bytes }))
}
