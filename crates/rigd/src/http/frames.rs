//! The last frames of each port, for a person who looks for the reason of a silence. Nothing is sent.

use axum::{Json, extract::State};
use rig_store::BlackBox;
use schemars::JsonSchema;
use serde::Serialize;

use super::Shared;

/// The last frames of each port, oldest first.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct FramesView {
    ports: Vec<BlackBox>,
}

pub(super) async fn show(State(shared): State<Shared>) -> Json<FramesView> {
    let ports = shared.inner.rig.status().borrow().ports.clone();
    Json(FramesView { ports: ports.iter().map(crate::rig::PortFrames::read).collect() })
}
