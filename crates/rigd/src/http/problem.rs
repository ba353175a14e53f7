//! Errors as RFC 9457 problem details.

use axum::{
    Json,
    extract::rejection::{JsonRejection, QueryRejection},
    http::{StatusCode, header},
    response::{IntoResponse, Response},
};
use rig_engine::Denied;
use rig_model::with_causes;
use rig_settings::Faults;
use rig_store::StoreError;
use serde::Serialize;

use crate::{hint, rig::Refusal};

/// What a client is told when something cannot be done.
#[derive(Debug, Serialize)]
pub(super) struct Problem {
    title: &'static str,
    status: u16,
    detail: String,
    /// What to do about it.
    #[serde(skip_serializing_if = "Option::is_none")]
    hint: Option<&'static str>,
    /// Every fault of a protocol, with its place.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    faults: Vec<FaultView>,
}

/// A fault of a protocol that was posted.
#[derive(Debug, Serialize)]
struct FaultView {
    line: usize,
    column: usize,
    message: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    suggestion: Option<String>,
}

impl Problem {
    fn new(status: StatusCode, title: &'static str, detail: String) -> Self {
        Self { title, status: status.as_u16(), detail, hint: None, faults: Vec::new() }
    }

    pub(super) fn not_found(detail: String) -> Self {
        Self::new(StatusCode::NOT_FOUND, "not found", detail)
    }

    pub(super) fn method_not_allowed(detail: String) -> Self {
        Self::new(StatusCode::METHOD_NOT_ALLOWED, "method not allowed", detail)
    }

    pub(super) fn bad_request(detail: String) -> Self {
        Self::new(StatusCode::BAD_REQUEST, "bad request", detail)
    }

    pub(super) fn unsupported_media_type(detail: String) -> Self {
        Self::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "unsupported media type", detail)
    }

    /// The request is well formed, but what it asks for cannot be done.
    pub(super) fn unprocessable(detail: String) -> Self {
        Self::new(StatusCode::UNPROCESSABLE_ENTITY, "cannot be done", detail)
    }

    pub(super) fn internal(detail: &str) -> Self {
        Self::new(StatusCode::INTERNAL_SERVER_ERROR, "internal error", detail.to_owned())
    }

    pub(super) fn protocol(faults: &Faults) -> Self {
        let count = faults.iter().count();
        let detail = format!("the protocol has {count} fault{}", if count == 1 { "" } else { "s" });
        let view = |fault: &rig_settings::Fault| FaultView {
            line: fault.place.line,
            column: fault.place.column,
            message: fault.message.clone(),
            suggestion: fault.suggestion.clone(),
        };
        Self { faults: faults.iter().map(view).collect(), ..Self::unprocessable(detail) }
    }
}

impl From<Refusal> for Problem {
    fn from(refusal: Refusal) -> Self {
        let detail = refusal.to_string();
        match refusal {
            Refusal::Denied(Denied::State { state, .. }) => {
                let hint = hint::while_in(state);
                Self { hint, ..Self::new(StatusCode::CONFLICT, "not in this state", detail) }
            }
            Refusal::Denied(Denied::NotClear { .. }) => Self {
                hint: Some("retract first: move the linear stage to its clear position"),
                ..Self::new(StatusCode::CONFLICT, "not in this state", detail)
            },
            Refusal::Denied(
                Denied::LinearTarget(_) | Denied::RotaryTarget(_) | Denied::TooDeep { .. },
            ) => Self::unprocessable(detail),
            Refusal::NotUnderWay { .. } => Self::new(StatusCode::CONFLICT, "not under way", detail),
            Refusal::Journal { .. } => Self {
                hint: Some("free the disk and start the daemon again"),
                ..Self::new(StatusCode::SERVICE_UNAVAILABLE, "no journal", detail)
            },
            Refusal::Closed => Self::new(StatusCode::SERVICE_UNAVAILABLE, "closed", detail),
        }
    }
}

impl From<StoreError> for Problem {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::NoSuchRun { .. } => Self::not_found(error.to_string()),
            error => Self::internal(&with_causes(&error)),
        }
    }
}

impl From<JsonRejection> for Problem {
    fn from(rejection: JsonRejection) -> Self {
        Self::new(rejection.status(), "bad request", rejection.body_text())
    }
}

impl From<QueryRejection> for Problem {
    fn from(rejection: QueryRejection) -> Self {
        Self::new(rejection.status(), "bad request", rejection.body_text())
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let status = StatusCode::from_u16(self.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let content_type = [(header::CONTENT_TYPE, "application/problem+json")];
        (status, content_type, Json(self)).into_response()
    }
}
