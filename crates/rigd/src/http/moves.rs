//! Moves by hand.

use axum::{Extension, Json, extract::State, http::StatusCode};
use rig_engine::Command;
use rig_model::Position;
use schemars::JsonSchema;
use serde::Deserialize;

use super::{
    Problem, Shared,
    object::{Object, ObjectBody},
    rig,
};
use crate::{operator::Operator, rig_view::RigView};

/// The request of a client. The axis has no default.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(tag = "axis", rename_all = "lowercase", deny_unknown_fields)]
pub(super) enum MoveForm {
    Linear {
        /// Height of the probe, mm.
        to: f64,
    },
    Rotary {
        /// Tilt of the sample, degrees.
        to: f64,
    },
}

/// Begins a move. The status of the rig and its events have the new position.
pub(super) async fn begin(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
    order: ObjectBody<MoveForm>,
) -> Result<(StatusCode, Json<RigView>), Problem> {
    let Json(Object(order)) = order?;
    let command = match order {
        MoveForm::Linear { to } => Command::MoveLinear(Position::new(to)),
        MoveForm::Rotary { to } => Command::MoveRotary(Position::new(to)),
    };
    shared.inner.rig.command(command, None, operator.as_str()).await?;
    Ok((StatusCode::ACCEPTED, Json(rig::view_now(&shared))))
}
