//! Whether the daemon lives, and whether a run could begin: for service managers and load balancers.
//!
//! They need no token, and tell nothing about the bench.

use axum::{Json, extract::State};
use rig_engine::RigState;
use rig_model::Clearance;
use serde::Serialize;

use super::{Problem, Shared};
use crate::rig::{RESERVE_BYTES, Status, free_bytes};

/// The service is well.
#[derive(Debug, Serialize)]
pub(super) struct Health {
    is_well: bool,
}

fn judged(because: &[&str]) -> Result<Json<Health>, Problem> {
    if because.is_empty() {
        Ok(Json(Health { is_well: true }))
    } else {
        Err(Problem::unwell(because))
    }
}

/// The HTTP server answers, and the rig loop gives signs of life.
pub(super) async fn live(State(shared): State<Shared>) -> Result<Json<Health>, Problem> {
    judged(&shared.ailments())
}

/// A run could begin now, or is under way.
pub(super) async fn ready(State(shared): State<Shared>) -> Result<Json<Health>, Problem> {
    let mut because = shared.ailments();
    let status = shared.inner.rig.status();
    because.extend(obstacles(&status.borrow()));
    if free_bytes(&shared.inner.data).is_some_and(|free| free < RESERVE_BYTES) {
        because.push("the disk of the data directory is full");
    }
    judged(&because)
}

impl Shared {
    /// Why the daemon should be replaced.
    pub(crate) fn ailments(&self) -> Vec<&'static str> {
        let status = self.inner.rig.status();
        let is_silent = status.borrow().silence.is_some();
        let mut because = Vec::new();
        if is_silent {
            because.push("the rig loop does not answer");
        }
        if !self.inner.rig.is_open() {
            because.push("the rig has been closed");
        }
        because
    }
}

fn obstacles(status: &Status) -> Vec<&'static str> {
    let mut because = Vec::new();
    match status.snapshot.state {
        RigState::Latched => because.push("the rig is latched after a fault"),
        RigState::Preparing => because.push("the rig is being prepared"),
        RigState::Retracting => because.push("the probe is being retracted"),
        RigState::Idle if status.snapshot.clearance != Clearance::Clear => {
            because.push("the probe is not clear");
        }
        _ => {}
    }
    if status.journal_error.is_some() {
        because.push("the journal cannot be written");
    }
    because
}
