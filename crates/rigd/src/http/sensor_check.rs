//! The check of the free sensor by clients.

use axum::{
    Extension, Json,
    extract::State,
    http::StatusCode,
    routing::{get, post},
};
use rig_commission::{Kind, Why, holding, temperature};
use rig_model::{Window, with_causes};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    Problem, Shared,
    block_runs::CalibrationView,
    object::{Object, ObjectBody},
    route::{Content, Route, json},
};
use crate::{
    calibrations,
    operator::Operator,
    sensor_check::{MINUTES, MINUTES_RANGE, SensorCheck, SensorCheckRefusal, SensorWatch, WINDOW},
};

/// A request for a check. The probe is clear, and stays so.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct SensorCheckForm {
    /// Time for which the sensor is watched, by the clock of the rig, minutes: from 1 to 1440.
    #[serde(default = "default_minutes")]
    minutes: u32,
    /// Lower end of the window of the free resonance, Hz.
    #[serde(default = "default_min_hz")]
    min_hz: f64,
    /// Upper end of that window, Hz.
    #[serde(default = "default_max_hz")]
    max_hz: f64,
    /// Temperature at the bench for the record, °C, from −50 to 100.
    #[serde(default)]
    temperature_c: Option<f64>,
}

const fn default_minutes() -> u32 {
    MINUTES
}

const fn default_min_hz() -> f64 {
    WINDOW.min_hz
}

const fn default_max_hz() -> f64 {
    WINDOW.max_hz
}

/// The check of the free sensor as it is now.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct SensorCheckView {
    is_under_way: bool,
    /// Time for which the check under way, or the last one, watches the sensor, minutes; 0 before the first one of this daemon.
    minutes: u32,
    /// Its sweeps so far.
    sweeps: usize,
    /// Refused ones among them.
    refused: usize,
    /// Why the last check of this daemon has no record.
    trouble: Option<String>,
    /// What the last check of this daemon found.
    found: Option<CalibrationView>,
    /// The record that holds.
    record: Option<SensorRecord>,
    /// Why no record holds.
    why: Option<&'static str>,
    /// What a person does when the check fails.
    remedy: &'static str,
}

/// The record that holds.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct SensorRecord {
    /// When it was made, UTC.
    made: String,
    person: String,
}

pub(super) fn routes() -> Vec<Route> {
    vec![
        Route::get(
            "/commission/sensor",
            "getSensorCheck",
            "The check of the free sensor, and its record",
            json::<SensorCheckView>(),
            || get(show),
        ),
        Route::post(
            "/commission/sensor",
            "checkSensor",
            "Begins to measure the free sensor: circuit, drift, and linearity with the level",
            json::<SensorCheckForm>(),
            202,
            json::<SensorCheckView>(),
            || post(start),
        ),
        Route::post(
            "/commission/sensor/abort",
            "abortSensorCheck",
            "Ends the check of the free sensor without a record",
            Content::None,
            202,
            json::<SensorCheckView>(),
            || post(abort),
        ),
    ]
}

async fn show(State(shared): State<Shared>) -> Result<Json<SensorCheckView>, Problem> {
    Ok(Json(view(&shared).await?))
}

async fn start(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
    form: ObjectBody<SensorCheckForm>,
) -> Result<(StatusCode, Json<SensorCheckView>), Problem> {
    let Json(Object(SensorCheckForm { minutes, min_hz, max_hz, temperature_c })) = form?;
    let temperature_c = temperature_c.map(temperature).transpose()?;
    if !MINUTES_RANGE.contains(&minutes) {
        let (least, most) = (MINUTES_RANGE.start(), MINUTES_RANGE.end());
        let detail = format!("minutes = {minutes}: must lie between {least} and {most} min");
        return Err(Problem::unprocessable(detail));
    }
    let check =
        SensorCheck::new(Window { min_hz, max_hz }, minutes, &shared.inner.facts.limits.analyzer)
            .map_err(|faults| Problem::unprocessable(faults.to_string()))?;
    shared.sensor()?.start(check, operator.as_str().to_owned(), temperature_c)?;
    Ok((StatusCode::ACCEPTED, Json(view(&shared).await?)))
}

async fn abort(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
) -> Result<(StatusCode, Json<SensorCheckView>), Problem> {
    shared.sensor()?.abort(operator.as_str().to_owned())?;
    Ok((StatusCode::ACCEPTED, Json(view(&shared).await?)))
}

async fn view(shared: &Shared) -> Result<SensorCheckView, Problem> {
    // First, because a check that is seen to have ended has its record.
    let progress = shared.sensor()?.progress().clone();
    let (basis, data) = (shared.inner.facts.basis.clone(), shared.inner.data.clone());
    let held = tokio::task::spawn_blocking(move || {
        let records = calibrations::read(&data)?;
        let now_s = jiff::Timestamp::now().as_second();
        Ok::<_, calibrations::CalibrationsError>(
            holding(Kind::Sensor, &records, &basis, now_s).map(|record| SensorRecord {
                made: record.made().to_owned(),
                person: record.person().to_owned(),
            }),
        )
    })
    .await
    .map_err(|_| Problem::internal("reading the calibrations has panicked"))?
    .map_err(|error| Problem::internal(&with_causes(&error)))?;
    let why = held.as_ref().err().copied().map(Why::text);
    let found = progress.found.as_ref();
    Ok(SensorCheckView {
        is_under_way: progress.is_under_way,
        minutes: progress.minutes,
        sweeps: progress.sweeps,
        refused: progress.refused,
        trouble: progress.trouble.clone(),
        found: found.map(|(finding, file)| CalibrationView::of(finding.clone(), file.clone())),
        record: held.ok(),
        why,
        remedy: Kind::Sensor.remedy(),
    })
}

impl Shared {
    fn sensor(&self) -> Result<&SensorWatch, Problem> {
        let closed = || Problem::not_found("this daemon checks no sensor".to_owned());
        self.inner.sensor.get().ok_or_else(closed)
    }
}

impl From<SensorCheckRefusal> for Problem {
    fn from(refusal: SensorCheckRefusal) -> Self {
        Self::of(StatusCode::CONFLICT, with_causes(&refusal))
    }
}
