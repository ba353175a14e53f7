//! The `OpenAPI` document of the interface, from its routes and types, and a page that shows it.
//!
//! # Source
//! `OpenAPI` Specification 3.1.0, <https://spec.openapis.org/oas/v3.1.0>.

use std::sync::LazyLock;

use axum::{
    http::{Method, header},
    response::{Html, IntoResponse},
};
use maud::html;
use schemars::{SchemaGenerator, generate::SchemaSettings};
use serde_json::{Map, Value, json};

use super::{
    problem::{PROBLEM_JSON, Problem},
    route::{self, Content, Header, KEY, Route},
    runs::RunForm,
};

static DOCUMENT: LazyLock<Value> = LazyLock::new(document);

/// The document as text, as it is in `docs/openapi.json`.
pub fn text() -> String {
    format!("{:#}\n", *DOCUMENT)
}

/// `GET /openapi.json`.
pub(super) async fn show() -> impl IntoResponse {
    ([(header::CONTENT_TYPE, "application/json")], text())
}

/// Schemas of requests and of answers: a key with a default may be missing in a request only.
struct Schemas {
    requests: SchemaGenerator,
    answers: SchemaGenerator,
}

fn document() -> Value {
    let settings = || {
        SchemaSettings::draft2020_12().with(|settings| {
            settings.definitions_path = "/components/schemas".into();
            settings.meta_schema = None;
        })
    };
    let mut schemas = Schemas {
        requests: settings().into_generator(),
        answers: settings().for_serialize().into_generator(),
    };
    let problem = schemas.answers.subschema_for::<Problem>().to_value();
    let mut paths = Map::new();
    for route in route::all() {
        let item = paths.entry(format!("/api/v1{}", route.path)).or_insert_with(|| json!({}));
        item[route.method.as_str().to_lowercase()] = operation(&route, &problem, &mut schemas);
    }
    // A type of both has the form of a request, in which keys with a default may be missing.
    let mut definitions = schemas.answers.take_definitions(true);
    definitions.extend(schemas.requests.take_definitions(true));
    json!({
        "openapi": "3.1.0",
        "info": {
            "title": "rigd",
            "version": env!("CARGO_PKG_VERSION"),
            "description": "Measures the stiffness of soft samples. docs/http.md has the manual.",
            "license": { "name": "MIT OR Apache-2.0", "identifier": "MIT OR Apache-2.0" },
        },
        "servers": [{ "url": "/" }],
        "security": [{}, { "token": [] }],
        "paths": paths,
        "components": {
            "schemas": definitions,
            "securitySchemes": { "token": { "type": "http", "scheme": "bearer" } },
        },
    })
}

fn operation(route: &Route, problem: &Value, schemas: &mut Schemas) -> Value {
    let mut answer = json!({ "description": route.summary });
    if let Some(content) = content(&route.answer, &mut schemas.answers) {
        answer["content"] = content;
    }
    let mut operation = json!({
        "operationId": route.id,
        "summary": route.summary,
        "parameters": parameters(route, schemas),
        "responses": {
            route.status.to_string(): answer,
            "default": {
                "description": "The request was refused, or failed",
                "content": { PROBLEM_JSON: { "schema": problem } },
            },
        },
    });
    if route.status == 201 && route.headers.iter().any(|header| header.name == KEY.name) {
        let mut repeated = operation["responses"]["201"].clone();
        repeated["description"] = json!("The request was repeated, and adds nothing");
        operation["responses"]["200"] = repeated;
    }
    if let Some(content) = content(&route.body, &mut schemas.requests) {
        let is_required = matches!(route.body, Content::Json(_));
        operation["requestBody"] = json!({ "required": is_required, "content": content });
    }
    operation
}

/// The parameters of an operation: in the path, behind `?`, and in headers.
fn parameters(route: &Route, schemas: &mut Schemas) -> Vec<Value> {
    let names = route.path.split('/').filter_map(|part| part.strip_prefix('{')?.strip_suffix('}'));
    let mut all: Vec<Value> = names.map(|name| in_path(route, name)).collect();
    all.extend(in_query(route, schemas));
    let mut headers = route.headers.to_vec();
    // A stop is never refused, whatever its headers are.
    if route.method == Method::POST && route.path != "/stop" {
        headers.extend([OPERATOR, IF_MATCH]);
    }
    all.extend(headers.into_iter().map(|Header { name, pattern, description }| {
        let schema = json!({ "type": "string", "pattern": pattern });
        json!({
            "name": name, "in": "header", "required": false, "schema": schema,
            "description": description,
        })
    }));
    all
}

const OPERATOR: Header = Header {
    name: "X-Operator",
    pattern: r"^[A-Za-z0-9._@'-]([A-Za-z0-9._@' -]{0,62}[A-Za-z0-9._@'-])?$",
    description: "name for the journal; letters of any script are letters",
};

const IF_MATCH: Header = Header {
    name: "If-Match",
    pattern: r#"^(\*|"[0-9a-f]{16}")$"#,
    description: "entity tag of GET /api/v1/rig; 412 if the rig has changed since",
};

fn in_path(route: &Route, name: &str) -> Value {
    let (schema, example, description) = match name {
        "number" => {
            let schema = json!({ "type": "integer", "minimum": 1 });
            (schema, json!(1), "number of the sweep in the run")
        }
        _ if route.path.starts_with("/runs") => {
            let description = "id of the run, its name such as `smoke-7`, or `latest`";
            (json!({ "type": "string" }), json!("latest"), description)
        }
        _ => (json!({ "type": "string" }), json!("00000000-1"), "id of the sweep"),
    };
    json!({
        "name": name, "in": "path", "required": true, "schema": schema, "example": example,
        "description": description,
    })
}

fn in_query(route: &Route, schemas: &mut Schemas) -> Vec<Value> {
    let Some(schema_of) = route.query else { return Vec::new() };
    let form = schema_of(&mut schemas.requests).to_value();
    // The form itself is no body, and so no type of the document.
    let name = form["$ref"].as_str().and_then(|path| path.rsplit('/').next()).unwrap_or_default();
    let form = schemas.requests.definitions_mut().remove(name).unwrap_or_default();
    let properties = form["properties"].as_object().cloned().unwrap_or_default();
    let parameter = |(name, mut schema): (String, Value)| {
        let description = schema.as_object_mut().and_then(|schema| schema.remove("description"));
        json!({
            "name": name, "in": "query", "required": false, "schema": schema,
            "description": description.unwrap_or_default(),
        })
    };
    properties.into_iter().map(parameter).collect()
}

fn content(content: &Content, schemas: &mut SchemaGenerator) -> Option<Value> {
    Some(match content {
        Content::None => return None,
        Content::Json(schema_of) | Content::OptionalJson(schema_of) => {
            json!({ "application/json": { "schema": schema_of(schemas) } })
        }
        Content::Protocol => json!({
            "application/toml": { "schema": { "type": "string" } },
            "application/json": { "schema": schemas.subschema_for::<RunForm>() },
        }),
        Content::Text(media_types) => {
            let text = |media_type: &&str| {
                ((*media_type).to_owned(), json!({ "schema": { "type": "string" } }))
            };
            media_types.iter().map(text).collect::<Map<_, _>>().into()
        }
    })
}

/// `GET /reference`: the document for a person. It asks no host for anything.
pub(super) async fn reference() -> Html<String> {
    static PAGE: LazyLock<String> = LazyLock::new(|| page(&DOCUMENT));
    Html(PAGE.clone())
}

const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem}\
    code,pre{font-family:ui-monospace,monospace}pre{overflow:auto;padding:.5rem;\
    border:1px solid;border-radius:.3rem;font-size:.85rem}td,th{text-align:left;padding:.1rem .8rem .1rem 0;\
    vertical-align:top}h2{font-size:1.1rem;margin-top:2rem}";

fn page(document: &Value) -> String {
    let paths = document["paths"].as_object().into_iter().flatten();
    let operations = paths.flat_map(|(path, item)| {
        item.as_object()
            .into_iter()
            .flatten()
            .map(move |(method, operation)| (path, method, operation))
    });
    let pretty = |value: &Value| format!("{value:#}");
    let body = html! {
        h1 { "HTTP reference" }
        p {
            "From " a href="/openapi.json" { "openapi.json" } "; the manual is "
            a href="/docs/http" { "docs/http" } ". Every error is " code { (PROBLEM_JSON) } "."
        }
        @for (path, method, operation) in operations {
            h2 id=(operation["operationId"].as_str().unwrap_or_default()) {
                code { (method.to_uppercase()) " " (path) }
            }
            p { (operation["summary"].as_str().unwrap_or_default()) }
            table {
                @for parameter in operation["parameters"].as_array().into_iter().flatten() {
                    tr {
                        th { code { (parameter["name"].as_str().unwrap_or_default()) } }
                        td { (parameter["in"].as_str().unwrap_or_default()) }
                        td { (parameter["description"].as_str().unwrap_or_default()) }
                    }
                }
            }
            @if let Some(body) = operation.get("requestBody") {
                details { summary { "body" } pre tabindex="0" { (pretty(body)) } }
            }
            details { summary { "answers" } pre tabindex="0" { (pretty(&operation["responses"])) } }
        }
        h1 { "Types" }
        @for (name, schema) in document["components"]["schemas"].as_object().into_iter().flatten() {
            h2 id=(name) { (name) }
            pre tabindex="0" { (pretty(schema)) }
        }
    };
    let title = html! { "rigd: HTTP reference" };
    rig_report::document(&title, &[STYLE], None, &body).into_string()
}
