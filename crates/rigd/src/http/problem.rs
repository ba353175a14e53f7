//! Errors as RFC 9457 problem details.

use std::error::Error as _;

use axum::{
    Json,
    extract::rejection::{JsonRejection, QueryRejection},
    http::{HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};
use rig_commission::NoTemperature;
use rig_engine::{CommandRefusal, TouchPlace};
use rig_files::Faults;
use rig_model::with_causes;
use rig_record::{NotARunId, UnreadableRecord};
use rig_store::StoreError;
use schemars::JsonSchema;
use serde::Serialize;

use super::limits::{BODY_MAX, BODY_TIME};
use crate::{
    cli::SALVAGE,
    hint,
    rig::{RequestRefusal, ResumeRefusal},
    tokens::Role,
};

/// A problem document (RFC 9457).
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Problem {
    title: &'static str,
    status: u16,
    detail: String,
    /// What the client can do about it.
    #[serde(skip_serializing_if = "Option::is_none")]
    hint: Option<&'static str>,
    /// Every fault of a protocol, with its place.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    faults: Vec<FaultView>,
    /// A header that belongs to the status.
    #[serde(skip)]
    header: Option<(&'static str, &'static str)>,
}

/// A fault of a protocol that was posted.
#[derive(Debug, Serialize, JsonSchema)]
#[schemars(rename = "ProtocolFault")]
struct FaultView {
    line: usize,
    column: usize,
    message: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    suggestion: Option<String>,
}

/// The type of an error in the sense of RFC 9457.
pub(super) const PROBLEM_JSON: &str = "application/problem+json";

impl Problem {
    fn new(status: StatusCode, title: &'static str, detail: String) -> Self {
        Self {
            title,
            status: status.as_u16(),
            detail,
            hint: None,
            faults: Vec::new(),
            header: None,
        }
    }

    /// An error with the title that belongs to its status.
    pub(super) fn of(status: StatusCode, detail: String) -> Self {
        let title = match status {
            StatusCode::BAD_REQUEST => "bad request",
            StatusCode::UNAUTHORIZED => "unauthorized",
            StatusCode::FORBIDDEN => "forbidden",
            StatusCode::NOT_FOUND => "not found",
            StatusCode::PRECONDITION_FAILED => "changed",
            StatusCode::METHOD_NOT_ALLOWED => "method not allowed",
            StatusCode::REQUEST_TIMEOUT => "request timeout",
            StatusCode::PAYLOAD_TOO_LARGE => "content too large",
            StatusCode::UNSUPPORTED_MEDIA_TYPE => "unsupported media type",
            StatusCode::MISDIRECTED_REQUEST => "misdirected request",
            StatusCode::GONE => "gone",
            StatusCode::CONFLICT => "conflict",
            StatusCode::TOO_MANY_REQUESTS => "too many requests",
            StatusCode::UNPROCESSABLE_ENTITY => "cannot be done",
            StatusCode::INTERNAL_SERVER_ERROR => "internal error",
            StatusCode::SERVICE_UNAVAILABLE => "service unavailable",
            other => other.canonical_reason().unwrap_or("error"),
        };
        Self::new(status, title, detail)
    }

    pub(super) fn detail(&self) -> &str {
        &self.detail
    }

    pub(super) fn not_found(detail: String) -> Self {
        Self::of(StatusCode::NOT_FOUND, detail)
    }

    pub(super) fn method_not_allowed(detail: String) -> Self {
        Self::of(StatusCode::METHOD_NOT_ALLOWED, detail)
    }

    pub(super) fn bad_request(detail: String) -> Self {
        Self::of(StatusCode::BAD_REQUEST, detail)
    }

    pub(super) fn unsupported_media_type(detail: String) -> Self {
        Self::of(StatusCode::UNSUPPORTED_MEDIA_TYPE, detail)
    }

    /// The daemon was called by a name that is not its own.
    pub(super) fn misdirected(detail: String) -> Self {
        let hint = "use localhost or the address on which it listens, or start it with \
                    --allow-host and the name";
        Self { hint: Some(hint), ..Self::of(StatusCode::MISDIRECTED_REQUEST, detail) }
    }

    /// A page of another site has asked.
    pub(super) fn forbidden(detail: String) -> Self {
        let hint = "type or paste the address into the browser; a script sends neither Origin nor \
                    Sec-Fetch-Site";
        Self { hint: Some(hint), ..Self::of(StatusCode::FORBIDDEN, detail) }
    }

    /// Without the token.
    pub(super) fn unauthorized(detail: String) -> Self {
        Self {
            hint: Some(
                "send `Authorization: Bearer` with a token that `rigd token new` has made, or with \
                 the one in the file given by --token-file; `rigd open` lets a browser in",
            ),
            header: Some(("www-authenticate", "Bearer realm=\"rigd\"")),
            ..Self::of(StatusCode::UNAUTHORIZED, detail)
        }
    }

    /// The cookie belongs to a token that has been revoked.
    pub(super) fn session_is_over() -> Self {
        Self::unauthorized("the token of this browser has been revoked".to_owned())
    }

    /// An address has sent too many wrong tokens.
    pub(super) fn too_many_guesses() -> Self {
        let detail = "this address has sent too many wrong tokens".to_owned();
        Self {
            hint: Some("send the right token; one more try is allowed every 6 s"),
            header: Some(("retry-after", "6")),
            ..Self::of(StatusCode::TOO_MANY_REQUESTS, detail)
        }
    }

    /// The token is not for such requests.
    pub(super) fn not_allowed(role: Role, needed: Role) -> Self {
        let (role, needed) = (role.name(), needed.name());
        let detail = format!("this needs a token with the role {needed}; yours has {role}");
        let hint = "ask who looks after the daemon for such a token (`rigd token new`); a stop is \
                    allowed for every token";
        Self { hint: Some(hint), ..Self::of(StatusCode::FORBIDDEN, detail) }
    }

    /// Another client operates the rig.
    pub(super) fn not_your_lease(holder: &str) -> Self {
        let detail = format!("{holder} operates the rig");
        let hint = "POST /api/v1/lease with {\"take_over\": true} takes the lease over, and the \
                    journal records it; a stop needs no lease";
        let title = "operated by another";
        Self { hint: Some(hint), ..Self::new(StatusCode::CONFLICT, title, detail) }
    }

    /// A link that was opened before, or is too old.
    pub(super) fn link_is_over() -> Self {
        Self {
            hint: Some("`rigd open` makes a new one"),
            ..Self::of(StatusCode::GONE, "this link has been used, or is too old".to_owned())
        }
    }

    /// The rig is no longer in the state that the client means.
    pub(super) fn changed(detail: String) -> Self {
        let hint = "read GET /api/v1/rig again, and send the command with its new ETag if it is still wanted";
        Self { hint: Some(hint), ..Self::of(StatusCode::PRECONDITION_FAILED, detail) }
    }

    /// All of something are in use.
    pub(super) fn busy(detail: String) -> Self {
        Self {
            hint: Some("close connections that are not needed, and try again"),
            header: Some(("retry-after", "5")),
            ..Self::of(StatusCode::SERVICE_UNAVAILABLE, detail)
        }
    }

    /// The service is not as it should be.
    pub(super) fn unwell(because: &[&str]) -> Self {
        Self::of(StatusCode::SERVICE_UNAVAILABLE, because.join("; "))
    }

    /// The body of the answer.
    pub(super) fn to_json(&self) -> String {
        // Text and numbers always have a JSON.
        serde_json::to_string(self).unwrap_or_default()
    }

    pub(super) fn too_large() -> Self {
        let detail = format!("the body has more than {BODY_MAX} bytes");
        let header = Some(("connection", "close"));
        Self { header, ..Self::of(StatusCode::PAYLOAD_TOO_LARGE, detail) }
    }

    pub(super) fn head_too_slow() -> Self {
        let detail = "the head of the request did not arrive in time".to_owned();
        Self::of(StatusCode::REQUEST_TIMEOUT, detail)
    }

    pub(super) fn too_slow() -> Self {
        let detail = format!("the body did not arrive within {} s", BODY_TIME.as_secs());
        let header = Some(("connection", "close"));
        Self { header, ..Self::of(StatusCode::REQUEST_TIMEOUT, detail) }
    }

    /// A run cannot be resumed or amended.
    fn of_resume(refusal: &ResumeRefusal, detail: String) -> Self {
        match refusal {
            ResumeRefusal::Store(StoreError::NoSuchRun { .. })
            | ResumeRefusal::NoSuchTouch { .. } => Self::not_found(detail),
            ResumeRefusal::Sealed { .. } | ResumeRefusal::Store(StoreError::Sealed { .. }) => {
                Self {
                    hint: Some(
                        "POST /api/v1/runs/ID/redo measures one touch again; POST /api/v1/runs begins a new run",
                    ),
                    ..Self::new(StatusCode::CONFLICT, "not in this state", detail)
                }
            }
            ResumeRefusal::Store(StoreError::UnderWay { .. } | StoreError::Archived { .. })
            | ResumeRefusal::UnderWay { .. } => {
                Self::new(StatusCode::CONFLICT, "not in this state", detail)
            }
            ResumeRefusal::Changed { .. } => Self {
                hint: Some("send {\"accept_changes\": true} to confirm the change"),
                ..Self::new(StatusCode::CONFLICT, "changed", detail)
            },
            ResumeRefusal::Protocol(faults) => Self::protocol(faults),
            ResumeRefusal::OtherKind { .. } => Self::unprocessable(detail),
            ResumeRefusal::Store(error) => Self::of_journal(error),
            ResumeRefusal::NoBeginning { .. } => Self::internal(&detail),
        }
    }

    /// The journal cannot be read or written.
    fn of_journal(error: &StoreError) -> Self {
        let hint = error.is_damage().then_some(SALVAGE);
        Self { hint, ..Self::internal(&with_causes(error)) }
    }

    /// The request is well formed, but it cannot be carried out.
    pub(super) fn unprocessable(detail: String) -> Self {
        Self::of(StatusCode::UNPROCESSABLE_ENTITY, detail)
    }

    pub(super) fn internal(detail: &str) -> Self {
        Self::of(StatusCode::INTERNAL_SERVER_ERROR, detail.to_owned())
    }

    pub(super) fn protocol(faults: &Faults) -> Self {
        let count = faults.iter().count();
        let detail = format!("the protocol has {count} fault{}", if count == 1 { "" } else { "s" });
        let view = |fault: &rig_files::Fault| FaultView {
            line: fault.location.line,
            column: fault.location.column,
            message: fault.message.clone(),
            suggestion: fault.suggestion.clone(),
        };
        Self { faults: faults.iter().map(view).collect(), ..Self::unprocessable(detail) }
    }
}

impl From<RequestRefusal> for Problem {
    fn from(refusal: RequestRefusal) -> Self {
        let detail = refusal.to_string();
        match refusal {
            RequestRefusal::Command(CommandRefusal::State { state, .. }) => {
                let hint = hint::while_in(state);
                Self { hint, ..Self::new(StatusCode::CONFLICT, "not in this state", detail) }
            }
            RequestRefusal::Command(CommandRefusal::NoSuchTouch { .. }) => Self::not_found(detail),
            RequestRefusal::Command(CommandRefusal::NotAhead { place, .. }) => Self {
                hint: (place == TouchPlace::Begun)
                    .then_some("leave out a touch that has begun when the run is over"),
                ..Self::new(StatusCode::CONFLICT, "not ahead", detail)
            },
            RequestRefusal::Command(CommandRefusal::NotClear { .. }) => Self {
                hint: Some("retract first: move the linear stage to its clear position"),
                ..Self::new(StatusCode::CONFLICT, "not in this state", detail)
            },
            RequestRefusal::Command(CommandRefusal::TiltUnknown { .. }) => {
                Self::new(StatusCode::CONFLICT, "not in this state", detail)
            }
            RequestRefusal::Command(
                CommandRefusal::LinearTarget(_)
                | CommandRefusal::RotaryTarget(_)
                | CommandRefusal::TooDeep { .. }
                | CommandRefusal::TooFar { .. },
            ) => Self::unprocessable(detail),
            RequestRefusal::NotUnderWay { .. } => {
                Self::new(StatusCode::CONFLICT, "not under way", detail)
            }
            RequestRefusal::NoSpace { .. } => Self {
                hint: Some("move old runs elsewhere, or start the daemon with another --data"),
                ..Self::new(StatusCode::INSUFFICIENT_STORAGE, "no space", detail)
            },
            RequestRefusal::Resume(refusal) => Self::of_resume(&refusal, detail),
            RequestRefusal::Interlock(_) => {
                Self::new(StatusCode::CONFLICT, "refused by the interlock", detail)
            }
            RequestRefusal::NotCommissioned { .. } => Self {
                hint: Some(
                    "POST /api/v1/commission asks for one step after the other, as `rigd commission` does \
                     after this daemon has ended",
                ),
                ..Self::new(StatusCode::CONFLICT, "not commissioned", detail)
            },
            RequestRefusal::InService
            | RequestRefusal::StepUnderWay
            | RequestRefusal::Identifying => {
                Self::new(StatusCode::CONFLICT, "not in this state", detail)
            }
            RequestRefusal::NotAsked { .. } => Self {
                hint: Some("read the open prompt in GET /api/v1/rig"),
                ..Self::new(StatusCode::CONFLICT, "not asked", detail)
            },
            RequestRefusal::Journal { .. } => Self {
                hint: Some(
                    "check the disk of the data directory, and start the daemon again when the probe is clear",
                ),
                ..Self::new(StatusCode::SERVICE_UNAVAILABLE, "no journal", detail)
            },
            RequestRefusal::Silent(_) => Self {
                hint: Some(hint::WHILE_SILENT),
                ..Self::new(StatusCode::SERVICE_UNAVAILABLE, "no answer", detail)
            },
            RequestRefusal::Closed => Self::new(StatusCode::SERVICE_UNAVAILABLE, "closed", detail),
        }
    }
}

impl From<StoreError> for Problem {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::NoSuchRun { .. } => Self::not_found(error.to_string()),
            StoreError::Archived { .. } => Self {
                hint: Some("read it there: `rigd show RUN --data PLACE`"),
                ..Self::new(StatusCode::GONE, "archived", error.to_string())
            },
            error => Self::of_journal(&error),
        }
    }
}

impl From<NoTemperature> for Problem {
    fn from(error: NoTemperature) -> Self {
        Self::unprocessable(format!("temperature_c: {error}"))
    }
}

impl From<NotARunId> for Problem {
    fn from(error: NotARunId) -> Self {
        StoreError::from(error).into()
    }
}

impl From<UnreadableRecord> for Problem {
    fn from(error: UnreadableRecord) -> Self {
        StoreError::from(error).into()
    }
}

impl From<JsonRejection> for Problem {
    fn from(rejection: JsonRejection) -> Self {
        let cause = rejection.source().map(|cause| in_words_of_json(&cause.to_string()));
        let detail = match (&rejection, cause) {
            (JsonRejection::JsonDataError(_), Some(cause)) => cause,
            (JsonRejection::JsonSyntaxError(_), Some(cause)) => {
                format!("the body is not JSON: {cause}")
            }
            _ => rejection.body_text(),
        };
        Self::of(rejection.status(), detail)
    }
}

impl From<QueryRejection> for Problem {
    fn from(rejection: QueryRejection) -> Self {
        let detail = match rejection.source() {
            Some(cause) => {
                format!("the query of the address: {}", in_words_of_json(&cause.to_string()))
            }
            None => rejection.body_text(),
        };
        Self::of(rejection.status(), detail)
    }
}

/// A message of the reader of JSON, which names the types of this program.
fn in_words_of_json(message: &str) -> String {
    let types = [
        ("f64", "a number"),
        ("u64", "a whole number from 0"),
        ("u32", "a whole number from 0"),
        ("u16", "a whole number from 0"),
        ("u8", "a whole number from 0"),
        ("usize", "a whole number from 0"),
        ("a nonzero usize", "a whole number from 1"),
        ("i64", "a whole number"),
        ("a sequence", "an array"),
        ("a map", "an object"),
    ];
    let Some((before, expected)) = message.rsplit_once("expected ") else {
        return message.to_owned();
    };
    let (name, place) = expected.split_once(" at line ").unwrap_or((expected, ""));
    let Some((_, word)) = types.into_iter().find(|(of_program, _)| *of_program == name) else {
        return message.to_owned();
    };
    let place = if place.is_empty() { String::new() } else { format!(" at line {place}") };
    format!("{before}expected {word}{place}")
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let status = StatusCode::from_u16(self.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let header = self.header;
        let content_type = [(header::CONTENT_TYPE, PROBLEM_JSON)];
        let mut answer = (status, content_type, Json(self)).into_response();
        if let Some((name, value)) = header {
            answer.headers_mut().insert(name, HeaderValue::from_static(value));
        }
        answer
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::http::guesses;

    #[test]
    fn the_pause_after_wrong_tokens_is_that_of_the_guesses() {
        let problem = Problem::too_many_guesses();
        let pause_s = guesses::PAUSE.as_secs().to_string();
        assert_eq!(problem.header, Some(("retry-after", &*pause_s)));
        assert!(problem.hint.unwrap().ends_with(&format!("every {pause_s} s")), "{problem:?}");
    }

    #[test]
    fn a_fault_of_json_is_in_words_of_json() {
        let said = |value: &str| {
            let faulty = serde_json::from_str::<f64>(value).unwrap_err().to_string();
            in_words_of_json(&faulty)
        };
        assert_eq!(
            said("\"120\""),
            "invalid type: string \"120\", expected a number at line 1 column 5"
        );
        let count = serde_json::from_str::<u64>("-1").unwrap_err().to_string();
        assert_eq!(
            in_words_of_json(&count),
            "invalid value: integer `-1`, expected a whole number from 0 at line 1 column 2"
        );
        assert_eq!(in_words_of_json("missing field `step`"), "missing field `step`");
    }
}
