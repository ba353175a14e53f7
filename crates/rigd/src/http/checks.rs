//! The daily checks of the bench, for clients.

use std::sync::Arc;

use axum::{Json, extract::State, response::Html, routing::get};
use rig_model::with_causes;
use schemars::JsonSchema;
use serde::Serialize;

use super::{
    Problem, Shared,
    route::{Content, HTML, Route, json},
};
use crate::bench_check::trend::{self, Series};

/// The checks since the bench was changed, which are compared with each other; the oldest first.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct ChecksView {
    checks: Vec<CheckView>,
    /// What is measured, each with its chart.
    quantities: Vec<QuantityView>,
}

/// A check.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct CheckView {
    /// When it was made, UTC.
    made: String,
    person: String,
    /// `accepted`, `look` or `not to be trusted`.
    verdict: String,
    /// Why it is not accepted.
    reason: Option<String>,
}

/// The control chart of a quantity.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct QuantityView {
    /// Its name, as in the records.
    name: &'static str,
    /// What it is, for a person.
    text: &'static str,
    /// Its unit; 1 for a logarithm.
    unit: &'static str,
    /// A point for each check.
    points: Vec<PointView>,
}

/// A point of a chart.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct PointView {
    value: f64,
    /// Normal score against the checks before; `null` for the first ten.
    score: Option<f64>,
    /// Moving average of the scores.
    average: Option<f64>,
    is_alarm: bool,
}

pub(super) fn routes() -> Vec<Route> {
    vec![
        Route::get(
            "/checks",
            "listChecks",
            "The daily checks since the bench was changed, with their control charts",
            json::<ChecksView>(),
            || get(list),
        ),
        Route::get(
            "/checks/trend",
            "getTrend",
            "The trend of the daily checks, as a page",
            Content::Text(HTML),
            || get(page),
        ),
    ]
}

async fn list(State(shared): State<Shared>) -> Result<Json<ChecksView>, Problem> {
    let inner = Arc::clone(&shared.inner);
    let found = shared.read(move |_| {
        let series = Series::read(&inner.facts.basis, &inner.data);
        Ok(view(&series.map_err(|error| Problem::internal(&with_causes(&error)))?))
    });
    found.await.map(Json)
}

async fn page(State(shared): State<Shared>) -> Result<Html<String>, Problem> {
    let inner = Arc::clone(&shared.inner);
    let html = shared.read(move |_| {
        let page = trend::page(&inner.facts.name, &inner.facts.basis, &inner.data);
        page.map_err(|error| Problem::internal(&with_causes(&error)))
    });
    html.await.map(Html)
}

fn view(series: &Series) -> ChecksView {
    let check = |record: &rig_commission::Calibration| CheckView {
        made: record.made().to_owned(),
        person: record.person().to_owned(),
        verdict: record.verdict.clone(),
        reason: record.reason.clone(),
    };
    let point = |charted: &rig_commission::control::Charted| PointView {
        value: charted.value,
        score: charted.against.map(|against| against.score),
        average: charted.against.map(|against| against.average),
        is_alarm: charted.against.is_some_and(|against| against.is_alarm()),
    };
    let quantities = series.charts().map(|(quantity, charted)| QuantityView {
        name: quantity.name(),
        text: quantity.text(),
        unit: quantity.unit(),
        points: charted.iter().map(point).collect(),
    });
    ChecksView {
        checks: series.checks.iter().map(check).collect(),
        quantities: quantities.collect(),
    }
}
