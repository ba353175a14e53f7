//! The commissioning of the rig by clients.

use axum::{
    Extension, Json,
    extract::State,
    http::StatusCode,
    routing::{get, post},
};
use rig_commission::{Kind, temperature};
use rig_model::with_causes;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    Problem, Shared,
    object::{Object, ObjectBody},
    route::{Content, Route, json},
};
use crate::{
    commissioning::{Commissioned, Commissioning, CommissioningRefusal},
    operator::Operator,
    rig::RigHandle,
    sensor_check::SensorWatch,
};

/// The commissioning as it is now.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct CommissionView {
    /// The steps in their order.
    steps: Vec<CommissionStep>,
    /// Name of the step under way; `null` while nobody commissions.
    under_way: Option<&'static str>,
    /// What waits for an answer.
    question: Option<QuestionView>,
    /// What was said and seen since the start, the oldest first; the last line says how it ended.
    said: Vec<String>,
}

/// A step of commissioning.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct CommissionStep {
    step: &'static str,
    /// What it shows.
    shows: &'static str,
    /// When it is accepted.
    accepted_when: &'static str,
    /// What a person does when it fails.
    remedy: &'static str,
    /// The bench as the person sees it, as text in lines of equal letters.
    picture: &'static str,
    is_held: bool,
    /// Why it is missing.
    why: Option<&'static str>,
    /// When it was made, UTC.
    made: Option<String>,
    person: Option<String>,
}

/// A question to the person at the bench.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct QuestionView {
    /// Its number, which an answer names.
    number: u64,
    text: String,
    /// The words that answer it; none for a reading.
    choices: Vec<&'static str>,
    /// What answers it, for a person.
    expected: String,
}

/// A request to begin.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct CommissionForm {
    /// Temperature at the bench for the records, °C, from −50 to 100.
    #[serde(default)]
    temperature_c: Option<f64>,
}

/// An answer.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct CommissionAnswer {
    /// Number of the question.
    question: u64,
    /// A word of `choices`, or a number.
    answer: String,
}

pub(super) fn routes() -> Vec<Route> {
    vec![
        Route::get(
            "/commission",
            "getCommission",
            "The steps of commissioning, and what is asked",
            json::<CommissionView>(),
            || get(show),
        ),
        Route::post(
            "/commission",
            "commission",
            "Begins with the first step of commissioning that is missing",
            json::<CommissionForm>(),
            202,
            json::<CommissionView>(),
            || post(start),
        ),
        Route::post(
            "/commission/answer",
            "answerCommission",
            "Answers what the step of commissioning asks",
            json::<CommissionAnswer>(),
            202,
            json::<CommissionView>(),
            || post(answer),
        ),
        Route::post(
            "/commission/abort",
            "abortCommission",
            "Ends the step of commissioning under way, and stops an axis that moves",
            Content::None,
            202,
            json::<CommissionView>(),
            || post(abort),
        ),
    ]
}

async fn show(State(shared): State<Shared>) -> Result<Json<CommissionView>, Problem> {
    Ok(Json(view(shared.commissioning()?).await?))
}

async fn start(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
    form: ObjectBody<CommissionForm>,
) -> Result<(StatusCode, Json<CommissionView>), Problem> {
    let Json(Object(CommissionForm { temperature_c })) = form?;
    let temperature_c = temperature_c.map(temperature).transpose()?;
    let commissioning = shared.commissioning()?;
    commissioning.start(operator.as_str().to_owned(), temperature_c).await?;
    Ok((StatusCode::ACCEPTED, Json(view(commissioning).await?)))
}

async fn answer(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
    form: ObjectBody<CommissionAnswer>,
) -> Result<(StatusCode, Json<CommissionView>), Problem> {
    let Json(Object(CommissionAnswer { question, answer })) = form?;
    let commissioning = shared.commissioning()?;
    commissioning.answer(question, &answer, operator.as_str().to_owned())?;
    Ok((StatusCode::ACCEPTED, Json(view(commissioning).await?)))
}

async fn abort(
    State(shared): State<Shared>,
    Extension(operator): Extension<Operator>,
) -> Result<(StatusCode, Json<CommissionView>), Problem> {
    let commissioning = shared.commissioning()?;
    commissioning.abort(operator.as_str().to_owned())?;
    Ok((StatusCode::ACCEPTED, Json(view(commissioning).await?)))
}

async fn view(commissioning: &Commissioning) -> Result<CommissionView, Problem> {
    // In this order: a step that is no longer under way has left its record.
    let (under_way, question, said) = {
        let progress = commissioning.progress();
        let question = progress.question.map(|(number, question)| QuestionView {
            number,
            text: question.text(),
            choices: question.asked().choices().iter().map(|choice| choice.name()).collect(),
            expected: question.asked().expected(),
        });
        (progress.step.map(rig_commission::Step::name), question, progress.said.clone())
    };
    let standing = commissioning.standing().await?;
    let step = |(step, found): &(rig_commission::Step, Result<rig_commission::Calibration, _>)| {
        let record = found.as_ref().ok();
        CommissionStep {
            step: step.name(),
            shows: step.shows(),
            accepted_when: step.limit(),
            remedy: Kind::from(*step).remedy(),
            picture: step.picture(),
            is_held: record.is_some(),
            why: found.as_ref().err().map(|why: &rig_commission::Why| why.text()),
            made: record.map(|record| record.made().to_owned()),
            person: record.map(|record| record.person().to_owned()),
        }
    };
    Ok(CommissionView {
        steps: standing.steps.iter().map(step).collect(),
        under_way,
        question,
        said,
    })
}

impl Shared {
    /// Lets clients commission the rig, and check its sensor.
    pub(crate) fn open_commissioning(&self, rig: &RigHandle, of: Commissioned) {
        _ = self.inner.sensor.set(SensorWatch::new(rig.clone(), of.clone()));
        _ = self.inner.commissioning.set(Commissioning::new(rig.clone(), of));
    }

    fn commissioning(&self) -> Result<&Commissioning, Problem> {
        let closed = || Problem::not_found("this daemon commissions no rig".to_owned());
        self.inner.commissioning.get().ok_or_else(closed)
    }
}

impl From<CommissioningRefusal> for Problem {
    fn from(refusal: CommissioningRefusal) -> Self {
        let detail = with_causes(&refusal);
        match refusal {
            CommissioningRefusal::NotAnAnswer(_) => Self::unprocessable(detail),
            CommissioningRefusal::Calibrations(_) | CommissioningRefusal::Panicked(_) => {
                Self::internal(&detail)
            }
            _ => Self::of(StatusCode::CONFLICT, detail),
        }
    }
}
