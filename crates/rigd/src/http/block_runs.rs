//! Runs that clients have judged for the calibration of a bench.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use axum::{Extension, Json, extract::State, http::StatusCode, routing::post};
use rig_commission::{Finding, Verdict, temperature};
use rig_model::with_causes;
use rig_store::{Reader, Run, StoreError};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    Inner, Problem, Shared,
    object::{Object, ObjectBody},
    route::{Route, json},
};
use crate::{
    block_geometry::keep_geometry,
    block_runs::{Bench, BlockRunError, keep_latency, keep_probe_radius, keep_repeatability},
    operator::Operator,
};

/// A run whose touches calibrate the bench.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct BlockRunForm {
    /// Its id, its short name such as `touches-1`, or `latest`.
    run: String,
    /// Temperature at the bench for the record, °C, from −50 to 100.
    #[serde(default)]
    temperature_c: Option<f64>,
}

/// Runs on hard flat blocks.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct BlocksForm {
    /// Id of the run on the first block, its short name such as `block-1`, or `latest`.
    run: String,
    /// Runs on further blocks.
    #[serde(default)]
    raised: Vec<RaisedForm>,
    /// Temperature at the bench for the record, °C, from −50 to 100.
    #[serde(default)]
    temperature_c: Option<f64>,
}

/// A run on a block of another height.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct RaisedForm {
    /// As of the first run.
    run: String,
    /// Height of its block above the first one, mm.
    by_mm: f64,
}

/// A run on a pin.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct PinRunForm {
    /// Its id, its short name such as `pin-1`, or `latest`.
    run: String,
    /// Radius of the pin, half of its diameter, mm.
    pin_radius_mm: f64,
    /// Temperature at the bench for the record, °C, from −50 to 100.
    #[serde(default)]
    temperature_c: Option<f64>,
}

/// A calibration that was made.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct CalibrationView {
    /// `accepted`, `rig file` or `failed`.
    verdict: &'static str,
    /// Why it is not accepted.
    reason: Option<String>,
    values: Vec<ValueView>,
    /// Name of its file in `calibrations` of the data directory.
    file: String,
}

/// A quantity that was found.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct ValueView {
    name: &'static str,
    value: f64,
    standard_uncertainty: f64,
    unit: &'static str,
}

pub(super) fn routes() -> Vec<Route> {
    vec![
        Route::post(
            "/commission/blocks",
            "findGeometry",
            "Finds the geometry and the error of the screw by runs on hard flat blocks",
            json::<BlocksForm>(),
            201,
            json::<CalibrationView>(),
            || post(blocks),
        ),
        Route::post(
            "/commission/touches",
            "judgeTouches",
            "Judges how well the touches of a run on a hard block repeat",
            json::<BlockRunForm>(),
            201,
            json::<CalibrationView>(),
            || post(touches),
        ),
        Route::post(
            "/commission/latency",
            "judgeLatency",
            "Finds the latency between stage and analyzer by a run whose descents have two speeds",
            json::<BlockRunForm>(),
            201,
            json::<CalibrationView>(),
            || post(latency),
        ),
        Route::post(
            "/commission/pin",
            "findProbeRadius",
            "Finds the radius of the ball by the touches of a run on a pin",
            json::<PinRunForm>(),
            201,
            json::<CalibrationView>(),
            || post(pin),
        ),
    ]
}

async fn touches(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
    form: ObjectBody<BlockRunForm>,
) -> Result<(StatusCode, Json<CalibrationView>), Problem> {
    judged(shared, &operator, form, |run, inner, person| {
        keep_repeatability(run, bench(inner), person)
    })
    .await
}

async fn latency(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
    form: ObjectBody<BlockRunForm>,
) -> Result<(StatusCode, Json<CalibrationView>), Problem> {
    judged(shared, &operator, form, |run, inner, person| {
        let stated = inner.facts.limits.analyzer.stream;
        keep_latency(run, stated, bench(inner), person)
    })
    .await
}

/// Judges a run for a person at a temperature, °C, and keeps the record.
type Judge =
    fn((&Reader, &Run), &Inner, (String, Option<f64>)) -> Result<(Finding, PathBuf), BlockRunError>;

/// The bench of the daemon.
fn bench(inner: &Inner) -> Bench<'_> {
    Bench { rig: &inner.facts.name, basis: &inner.facts.basis, data: &inner.data }
}

/// Judges the run of a form, and keeps the record.
async fn judged(
    shared: Shared,
    operator: &Operator,
    form: ObjectBody<BlockRunForm>,
    keep: Judge,
) -> Result<(StatusCode, Json<CalibrationView>), Problem> {
    let Json(Object(BlockRunForm { run, temperature_c })) = form?;
    let temperature_c = temperature_c.map(temperature).transpose()?;
    let id = shared.run(&run).await?;
    let inner = Arc::clone(&shared.inner);
    let person = (operator.as_str().to_owned(), temperature_c);
    let kept = shared.read(move |reader| Ok(keep((reader, &reader.run(id)?), &inner, person)?));
    let (finding, path) = kept.await?;
    Ok(created(finding, &path))
}

async fn blocks(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
    form: ObjectBody<BlocksForm>,
) -> Result<(StatusCode, Json<CalibrationView>), Problem> {
    let Json(Object(BlocksForm { run, raised, temperature_c })) = form?;
    let temperature_c = temperature_c.map(temperature).transpose()?;
    let mut ids = vec![(shared.run(&run).await?, 0.0)];
    for RaisedForm { run, by_mm } in raised {
        ids.push((shared.run(&run).await?, by_mm));
    }
    let inner = Arc::clone(&shared.inner);
    let person = (operator.as_str().to_owned(), temperature_c);
    let kept = shared.read(move |reader| {
        let runs = ids.into_iter().map(|(id, by_mm)| Ok((reader.run(id)?, by_mm)));
        let runs = runs.collect::<Result<Vec<_>, StoreError>>()?;
        let stated = (&inner.facts.limits, inner.facts.rotary_zero_deg);
        Ok(keep_geometry(reader, &runs, stated, bench(&inner), person)?)
    });
    let kept = kept.await?;
    Ok(created(kept.finding, &kept.path))
}

async fn pin(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
    form: ObjectBody<PinRunForm>,
) -> Result<(StatusCode, Json<CalibrationView>), Problem> {
    let Json(Object(PinRunForm { run, pin_radius_mm, temperature_c })) = form?;
    let temperature_c = temperature_c.map(temperature).transpose()?;
    if pin_radius_mm <= 0.0 {
        return Err(Problem::unprocessable(format!(
            "pin_radius_mm = {pin_radius_mm} is not above 0"
        )));
    }
    let id = shared.run(&run).await?;
    let inner = Arc::clone(&shared.inner);
    let witness = (operator.as_str().to_owned(), temperature_c);
    let kept = shared.read(move |reader| {
        let run = reader.run(id)?;
        let limits = &inner.facts.limits;
        Ok(keep_probe_radius((reader, &run), pin_radius_mm, limits, bench(&inner), witness)?)
    });
    let kept = kept.await?;
    Ok(created(kept.finding, &kept.path))
}

fn created(finding: Finding, path: &Path) -> (StatusCode, Json<CalibrationView>) {
    let file = path.file_name().map(|name| name.to_string_lossy().into_owned());
    (StatusCode::CREATED, Json(CalibrationView::of(finding, file.unwrap_or_default())))
}

impl CalibrationView {
    /// The finding whose record is this file.
    pub(super) fn of(finding: Finding, file: String) -> Self {
        let (verdict, reason) = match finding.verdict {
            Verdict::Accepted => ("accepted", None),
            Verdict::RigFile(changes) => {
                let changes: Vec<_> = changes.iter().map(ToString::to_string).collect();
                ("rig file", Some(changes.join("; ")))
            }
            Verdict::Failed(why) => ("failed", Some(why)),
        };
        let value = |value: rig_commission::Value| ValueView {
            name: value.name,
            value: value.value,
            standard_uncertainty: value.standard_uncertainty,
            unit: value.unit,
        };
        Self { verdict, reason, values: finding.values.into_iter().map(value).collect(), file }
    }
}

impl From<BlockRunError> for Problem {
    fn from(error: BlockRunError) -> Self {
        let detail = with_causes(&error);
        match error {
            BlockRunError::TooFew { .. }
            | BlockRunError::NoLatency { .. }
            | BlockRunError::NoPin { .. }
            | BlockRunError::OtherPin { .. }
            | BlockRunError::InPieces(_)
            | BlockRunError::NoGeometry(_)
            | BlockRunError::NoRadius { .. } => Self::unprocessable(detail),
            BlockRunError::NotOfBench(trouble) if trouble.is_other_run() => {
                Self::unprocessable(detail)
            }
            BlockRunError::Store(error) => error.into(),
            BlockRunError::RigFile(_)
            | BlockRunError::NotOfBench(_)
            | BlockRunError::Calibrations(_) => Self::internal(&detail),
        }
    }
}
