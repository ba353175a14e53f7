//! The index at the address that `rigd serve` prints.

use axum::{
    Json,
    extract::State,
    http::{HeaderMap, header},
    response::{IntoResponse, Response},
};
use serde::Serialize;

use super::{Shared, page};
use crate::rig_view::{RigView, RunProgress};

const DOCUMENTATION: &str = include_str!("../../../../docs/http.md");

/// Links that are valid in every state of the rig.
const LINKS: [(&str, &str); 6] = [
    ("/api/v1/rig", "the rig as it is now"),
    ("/api/v1/runs", "every run"),
    ("/api/v1/events", "every record of the journal, as server-sent events"),
    ("/docs/http", "how to use this interface"),
    ("/openapi.json", "this interface for programs"),
    ("/reference", "the same for a person"),
];

/// The rig, and where to read on.
#[derive(Debug, Serialize)]
struct Index {
    rig: RigView,
    links: Vec<Link>,
}

#[derive(Debug, Serialize)]
struct Link {
    href: String,
    title: String,
}

/// The page for a browser, JSON for everything else.
pub(super) async fn show(State(shared): State<Shared>, headers: HeaderMap) -> Response {
    if page::is_wanted(&headers) {
        return page::start(&headers);
    }
    let rig = super::rig::view_now(&shared);
    let link =
        |(href, title): (&str, &str)| Link { href: href.to_owned(), title: title.to_owned() };
    let mut links: Vec<Link> = LINKS.map(link).into();
    if let Some(RunProgress { id, protocol, .. }) = &rig.run {
        let run = format!("/api/v1/runs/{id}");
        links.push(Link { title: format!("the run of {protocol} under way"), href: run.clone() });
        links.push(Link { title: "its report".to_owned(), href: format!("{run}/report") });
    }
    let index = Index { rig, links };
    Json(index).into_response()
}

/// The documentation of the interface.
pub(super) async fn documentation() -> impl IntoResponse {
    ([(header::CONTENT_TYPE, "text/plain; charset=utf-8")], DOCUMENTATION)
}
