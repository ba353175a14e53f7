//! Entity tags: of the page, and of the state of the rig.

use axum::http::{HeaderMap, Method, StatusCode, header};

use super::Problem;
use crate::rig::Status;

/// A tag of some bytes. FNV-1a: the value must only differ between versions; no attacker gains from a
/// collision.
pub(super) fn of(bytes: impl IntoIterator<Item = u8>) -> String {
    let hash = bytes.into_iter().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    });
    format!("\"{hash:016x}\"")
}

/// Whether one of the tags in a header is this one.
pub(super) fn is_in(headers: &HeaderMap, name: &header::HeaderName, tag: &str) -> bool {
    let values = headers.get_all(name).iter().filter_map(|value| value.to_str().ok());
    values.flat_map(|value| value.split(',')).any(|value| {
        let value = value.trim();
        value == "*" || value.trim_start_matches("W/") == tag
    })
}

/// The tag of the state of the rig that a command depends on: state, clearance, run, step, prompt, refused
/// touch and fault. Positions and times do not change it.
pub(super) fn of_rig(status: &Status) -> String {
    let snapshot = &status.snapshot;
    let run = status.run.as_ref().map(|run| (run.id, run.ending));
    let progress = snapshot.progress.as_ref().map(|progress| (progress.step, progress.is_pausing));
    let parts = (
        (snapshot.state, snapshot.clearance, status.session),
        (run, progress, snapshot.prompt),
        (&snapshot.refused, &snapshot.fault),
    );
    of(format!("{parts:?}").into_bytes())
}

/// The check of `If-Match` before a command. A stop is never refused.
pub(super) fn check(
    method: &Method,
    path: &str,
    headers: &HeaderMap,
    status: &Status,
) -> Result<(), Problem> {
    let is_asked = *method == Method::POST && headers.contains_key(header::IF_MATCH);
    let is_tag = |value: &str| value == "*" || value.trim_start_matches("W/").starts_with('"');
    let mut given = headers.get_all(header::IF_MATCH).iter();
    if is_asked && !given.any(|value| value.to_str().is_ok_and(is_tag)) {
        let detail =
            "If-Match is an entity tag in quotes, as GET /api/v1/rig has it, or *".to_owned();
        return Err(Problem::bad_request(detail));
    }
    if !is_asked || path == "/api/v1/stop" || is_in(headers, &header::IF_MATCH, &of_rig(status)) {
        return Ok(());
    }
    Err(Problem::changed(format!(
        "the rig has changed since the state in If-Match: it is {} now, and the probe is {}",
        status.snapshot.state.name(),
        status.snapshot.clearance.name()
    )))
}

/// The status of an answer with a body, or without one if the client has it.
pub(super) fn status(headers: &HeaderMap, tag: &str) -> StatusCode {
    if is_in(headers, &header::IF_NONE_MATCH, tag) {
        StatusCode::NOT_MODIFIED
    } else {
        StatusCode::OK
    }
}
