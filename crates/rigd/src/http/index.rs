//! What stands at the address that `rigd serve` prints: where to go from there.

use std::fmt::Write as _;

use axum::{
    Json,
    extract::State,
    http::{HeaderMap, header},
    response::{Html, IntoResponse, Response},
};
use rig_chart::Escaped;
use serde::Serialize;

use super::{Shared, rig::RigView};

const DOCUMENTATION: &str = include_str!("../../../../docs/http.md");

/// The links that hold whatever the rig does.
const LINKS: [(&str, &str); 4] = [
    ("/api/v1/rig", "the rig as it is now"),
    ("/api/v1/runs", "every run"),
    ("/api/v1/events", "what happens, as server-sent events"),
    ("/docs/http", "how to use this interface"),
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

/// A page for a browser, JSON for everything else.
pub(super) async fn show(State(shared): State<Shared>, headers: HeaderMap) -> Response {
    let rig = super::rig::view_now(&shared);
    let link =
        |(href, title): (&str, &str)| Link { href: href.to_owned(), title: title.to_owned() };
    let mut links: Vec<Link> = LINKS.map(link).into();
    if let Some((id, protocol)) = rig.run() {
        let run = format!("/api/v1/runs/{id}");
        links.push(Link { title: format!("the run of {protocol} under way"), href: run.clone() });
        links.push(Link { title: "its report".to_owned(), href: format!("{run}/report") });
    }
    let index = Index { rig, links };
    let accept = headers.get(header::ACCEPT).and_then(|accept| accept.to_str().ok());
    if accept.is_some_and(|accept| accept.contains("text/html")) {
        Html(page(&index)).into_response()
    } else {
        Json(index).into_response()
    }
}

/// The documentation of the interface.
pub(super) async fn documentation() -> impl IntoResponse {
    ([(header::CONTENT_TYPE, "text/plain; charset=utf-8")], DOCUMENTATION)
}

fn page(Index { rig, links }: &Index) -> String {
    let name = Escaped(rig.name());
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n<title>{name}</title>\n\
         </head>\n<body>\n<h1>{name}</h1>\n<p>{}; the probe is {}.</p>\n<ul>\n",
        rig.state(),
        rig.probe()
    );
    for Link { href, title } in links {
        // Writing to a string cannot fail.
        _ = writeln!(html, "<li><a href=\"{}\">{}</a></li>", Escaped(href), Escaped(title));
    }
    html.push_str("</ul>\n</body>\n</html>\n");
    html
}
