//! Plans the points of a sweep.
//!
//! The planner neither measures nor has a clock. The caller requests points, adds the readings, and
//! repeats this until there is an outcome. The readings carry their own times, the caller supplies the
//! total elapsed time, and the planner counts its own work.

pub(crate) mod decay;
pub(crate) mod limit;
pub(crate) mod prior;
mod survey;

use rig_model::{Reading, SweepMethod, SweepPoint, SweepRequest, Window};

use crate::{
    Bench, Circuit, FitOptions, FitOutcome, Fitter, Limit, Reason, Refusal, Timing,
    diagnose::doubts::{doubt_capacitance, doubt_place},
    fit::decay::learn::learn,
};
use decay::Decay;
use limit::{READINGS_MAX, ROWS_PER_PLAN, ROWS_PER_READING_JUDGED, SECONDS_PER_ROW, VERDICTS_MAX};
use prior::{Estimate, Prior, elapsed_s};

/// The next action.
#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "one is alive at a time")]
pub enum Next {
    /// Measure these points in this order, and add the readings.
    Measure(Vec<SweepPoint>),
    /// The sweep has ended with this outcome.
    Finished(FitOutcome),
}

/// Chooses the points of one sweep.
#[derive(Debug, Clone)]
pub struct Planner {
    request: SweepRequest,
    options: FitOptions,
    /// The static capacitance of the sensor and its standard deviation, F, if known.
    capacitance_farad: Option<(f64, f64)>,
    readings: Vec<Reading>,
    fitter: Fitter,
    method: Method,
    /// Number of judgements of the readings.
    verdicts: usize,
    /// Time since the start of the sweep, s.
    passed_s: f64,
    /// Rows computed so far, without those of the method.
    work: u64,
}

#[derive(Debug, Clone)]
enum Method {
    Uniform { points: u32, is_asked: bool },
    Adaptive { decay: Box<Decay>, survey: Survey },
}

/// The survey of the bench, after an adaptive sweep that finds the resonance roughly.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Survey {
    None,
    /// Still to be made, for this many seconds.
    Ahead {
        seconds: u32,
    },
    /// Measured this many times.
    Measured {
        seconds: u32,
        rounds: u32,
    },
}

/// A survey that misses its target is continued, up to this many times its duration.
const ROUNDS_MAX: u32 = 4;

/// Target of the sweep before a survey, relative to that of the survey.
const ROUGHLY: f64 = 10.0;

impl Survey {
    /// Target of the adaptive part, Hz.
    fn target_hz(self, request: &SweepRequest) -> f64 {
        if self == Self::None { request.target_sigma_hz } else { ROUGHLY * request.target_sigma_hz }
    }

    /// The points of a survey that is still to be made, beside this circuit.
    fn begin(&mut self, circuit: &Circuit, window: Window) -> Option<Vec<SweepPoint>> {
        let Self::Ahead { seconds } = *self else { return None };
        *self = Self::Measured { seconds, rounds: 1 };
        Some(survey::points(circuit, window, seconds))
    }
}

impl Planner {
    /// Creates a planner for a request, with the prior if there is one.
    pub fn new(request: &SweepRequest, prior: Option<&Prior>) -> Self {
        let adaptive = |survey| {
            let target_sigma_hz = Survey::target_hz(survey, request);
            let request = SweepRequest { target_sigma_hz, ..*request };
            let decay = Box::new(Decay::new(&request, prior));
            (Method::Adaptive { decay, survey }, Timing::AnyPhase)
        };
        let (method, timing) = match request.method {
            SweepMethod::Uniform { points } => {
                (Method::Uniform { points, is_asked: false }, Timing::Waited)
            }
            SweepMethod::Adaptive => adaptive(Survey::None),
            SweepMethod::Survey { seconds } => adaptive(Survey::Ahead { seconds }),
        };
        let options = FitOptions {
            window: Some(request.window),
            noise: prior.and_then(|prior| prior.noise),
            timing,
            always_loss: true,
            near: None,
            bench: prior.and_then(|prior| prior.bench),
        };
        Self {
            request: *request,
            options,
            capacitance_farad: prior.and_then(|prior| prior.capacitance_farad),
            readings: Vec::new(),
            fitter: Fitter::default(),
            method,
            verdicts: 0,
            passed_s: 0.0,
            work: 0,
        }
    }

    /// Sets the shortest integration time of the analyzer, s: fewer cycles than it has take this long.
    #[must_use]
    pub fn with_shortest_integration(mut self, integration_s: f64) -> Self {
        if let Method::Adaptive { decay, .. } = &mut self.method {
            decay.set_shortest(integration_s);
        }
        self
    }

    /// Returns the next action. A call without new readings in between can end the sweep with the
    /// present readings.
    #[expect(
        clippy::should_implement_trait,
        reason = "what comes next depends on the readings added in between"
    )]
    pub fn next(&mut self) -> Next {
        let SweepRequest { window, settle_s, cycles, .. } = self.request;
        match &mut self.method {
            Method::Uniform { points, is_asked } if !*is_asked => {
                *is_asked = true;
                Next::Measure(window.evenly(*points, settle_s, cycles))
            }
            Method::Uniform { .. } => Next::Finished(self.verdict()),
            Method::Adaptive { survey: Survey::Measured { seconds, rounds }, .. } => {
                let (seconds, rounds) = (*seconds, *rounds);
                self.surveyed(seconds, rounds)
            }
            Method::Adaptive { .. } => self.next_stay(),
        }
    }

    /// Sets the time since the start of the sweep, s; the readings carry only their own times.
    pub fn pass(&mut self, since_begin_s: f64) {
        self.passed_s = since_begin_s;
    }

    /// Largest number of judgements of one sweep.
    pub const VERDICTS_MAX: usize = limit::VERDICTS_MAX;

    /// Number of judgements of the readings.
    pub const fn verdicts(&self) -> usize {
        self.verdicts
    }

    /// Largest amount of work between two readings, in the unit of [`Self::work`].
    pub const WORK_MAX: u64 =
        decay::STEP_WORK_MAX + ROWS_PER_PLAN + ROWS_PER_READING_JUDGED * READINGS_MAX as u64;

    /// Work so far, in rows: evaluations of one reading with its derivatives.
    pub fn work(&self) -> u64 {
        let of_method = match &self.method {
            Method::Uniform { .. } => 0,
            Method::Adaptive { decay, .. } => decay.work(),
        };
        self.work + of_method
    }

    /// Time that counts against the limit, s: the elapsed time plus the computing time.
    fn elapsed_s(&self) -> f64 {
        self.passed_s.max(elapsed_s(&self.readings)) + SECONDS_PER_ROW * self.work() as f64
    }

    fn verdict(&mut self) -> FitOutcome {
        self.verdicts += 1;
        self.work += ROWS_PER_READING_JUDGED * self.readings.len() as u64;
        self.options.near = match &self.method {
            Method::Uniform { .. } => None,
            Method::Adaptive { decay, .. } => decay.circuit(),
        };
        let verdict = self.fitter.fit(&self.readings, &self.options);
        let FitOutcome::Accepted(found) = &verdict else { return verdict };
        match self.capacitance_farad.and_then(|known| doubt_capacitance(found, known)) {
            Some(reason) => FitOutcome::Refused(Refusal { reason, estimate: Some(*found) }),
            None => verdict,
        }
    }

    /// The verdict after a survey, with what it says of the bench.
    fn surveyed(&mut self, seconds: u32, rounds: u32) -> Next {
        self.options.bench = None;
        let refused = |reason| FitOutcome::Refused(Refusal { reason, estimate: None });
        let verdict = match learn(&self.readings, &self.options) {
            Ok(bench) => {
                self.options.bench = Some(bench);
                let target_hz = self.request.target_sigma_hz;
                let window = self.request.window;
                self.verdict().held_to(
                    target_hz,
                    self.readings.len(),
                    (window, Limit::Survey { rounds }),
                )
            }
            Err(reason) => refused(reason),
        };
        let FitOutcome::Refused(refusal) = &verdict else { return Next::Finished(verdict) };
        if let (Reason::TargetNotReached { .. }, Some(found)) = (refusal.reason, &refusal.estimate)
            && rounds < ROUNDS_MAX
            && let Method::Adaptive { survey, .. } = &mut self.method
        {
            *survey = Survey::Measured { seconds, rounds: rounds + 1 };
            return Next::Measure(survey::points(&found.circuit(), self.request.window, seconds));
        }
        self.options.bench = None;
        Next::Finished(verdict)
    }

    /// Ends a planned sweep with its verdict. A verdict that misses the target becomes a refusal with
    /// the estimate as evidence, and so does one beside which another circuit stands.
    fn finish(&mut self, limit: Limit) -> Next {
        let verdict = self.verdict();
        let (request, readings) = (self.request, self.readings.len());
        let Method::Adaptive { decay, survey } = &mut self.method else {
            return Next::Finished(verdict);
        };
        let ended = (request.window, limit);
        let found = match verdict.held_to(survey.target_hz(&request), readings, ended) {
            FitOutcome::Accepted(found) => found,
            refused @ FitOutcome::Refused(_) => return Next::Finished(refused),
        };
        if let Some([first_hz, other_hz]) = decay.rivals(request.window) {
            let reason = Reason::Ambiguous { first_hz, other_hz };
            let estimate = Some(found);
            return Next::Finished(FitOutcome::Refused(Refusal { reason, estimate }));
        }
        match survey.begin(&found.circuit(), request.window) {
            Some(points) => Next::Measure(points),
            None => Next::Finished(FitOutcome::Accepted(found)),
        }
    }

    /// The limit that ends the sweep now, regardless of the result.
    fn limit(&self) -> Option<Limit> {
        let limit_s = self.request.time_limit_s;
        if self.elapsed_s() >= limit_s {
            Some(Limit::Time { limit_s })
        } else if self.readings.len() >= READINGS_MAX {
            Some(Limit::Readings { max: READINGS_MAX })
        } else if self.verdicts >= VERDICTS_MAX {
            Some(Limit::Verdicts { max: VERDICTS_MAX })
        } else {
            None
        }
    }

    /// The inputs of the last fit, other than the readings. Target, rival circuits and the capacitance of the sensor are held
    /// against its result.
    pub const fn fit_options(&self) -> FitOptions {
        self.options
    }

    /// The standard deviation that a resonance must have to be accepted, Hz; `None` for a uniform
    /// sweep, which has no target.
    pub const fn target_hz(&self) -> Option<f64> {
        match self.method {
            Method::Uniform { .. } => None,
            Method::Adaptive { .. } => Some(self.request.target_sigma_hz),
        }
    }

    /// The knowledge of the bench after the outcome.
    pub const fn bench(&self) -> Option<Bench> {
        self.options.bench
    }

    /// Time to which the resonance of this verdict refers, s on the clock of the readings.
    pub fn effective_time_s(&self, verdict: &FitOutcome) -> Option<f64> {
        verdict.accepted()?.effective_time_s(&self.readings, &self.options)
    }

    /// The next stay of a sweep that fits the free decay, within the time limit.
    fn next_stay(&mut self) -> Next {
        if let Some(limit) = self.limit() {
            return self.finish(limit);
        }
        let window = self.request.window;
        let is_enough = match &mut self.method {
            Method::Adaptive { decay, .. } => decay.is_enough(window),
            Method::Uniform { .. } => false,
        };
        if is_enough {
            let verdict = self.verdict();
            if let Method::Adaptive { decay, survey } = &mut self.method
                && decay.is_final(&verdict, survey.target_hz(&self.request))
            {
                // What the survey finds may be the reason of a refusal.
                let points = decay.circuit().and_then(|circuit| survey.begin(&circuit, window));
                return points.map_or(Next::Finished(verdict), Next::Measure);
            }
        }
        let (elapsed_s, limit_s) = (self.elapsed_s(), self.request.time_limit_s);
        let Method::Adaptive { decay, .. } = &mut self.method else {
            return self.finish(Limit::Steps { max: decay::STEPS_MAX });
        };
        let points = decay.next(&self.request, &self.readings, elapsed_s);
        let pace = decay.pace();
        self.work += ROWS_PER_PLAN;
        let mut points = match points {
            Ok(points) => points,
            Err(reason) => {
                return Next::Finished(FitOutcome::Refused(Refusal { reason, estimate: None }));
            }
        };
        if points.is_empty() {
            return self.finish(Limit::Steps { max: decay::STEPS_MAX });
        }
        let mut end_s = elapsed_s;
        let is_in_time = |point: &&SweepPoint| {
            end_s += pace.point_s(point);
            end_s <= limit_s
        };
        let count = points.iter().take_while(is_in_time).count();
        points.truncate(count.min(READINGS_MAX - self.readings.len()));
        if points.is_empty() {
            return self.finish(Limit::Time { limit_s });
        }
        Next::Measure(points)
    }

    /// Adds the readings of the last points.
    pub fn add(&mut self, readings: &[Reading]) {
        self.readings.extend_from_slice(readings);
        match &mut self.method {
            Method::Adaptive { survey: Survey::Measured { .. }, .. } | Method::Uniform { .. } => {}
            Method::Adaptive { decay, .. } => decay.add(readings, self.request.window),
        }
    }

    /// The present estimate, once one circuit explains the readings. It is not a result: the fit may
    /// still refuse it.
    pub fn estimate(&self) -> Option<Estimate> {
        match &self.method {
            Method::Uniform { .. } => None,
            Method::Adaptive { decay, .. } => decay.estimate(),
        }
    }

    /// All readings so far.
    pub fn readings(&self) -> &[Reading] {
        &self.readings
    }
}

/// Whether a refusal only means that more readings are needed.
fn needs_more(verdict: &FitOutcome) -> bool {
    let FitOutcome::Refused(refusal) = verdict else { return false };
    matches!(refusal.reason, Reason::TooNoisy { .. } | Reason::TooFewPoints { .. })
}

impl FitOutcome {
    /// The final verdict for a target standard deviation `target_hz`, Hz. A result that misses the
    /// target becomes a refusal with the estimate as evidence. An estimate outside of the window says that the window is
    /// wrong, whatever ended the sweep.
    #[must_use]
    pub fn held_to(
        self,
        target_hz: f64,
        readings: usize,
        (window, limit): (Window, Limit),
    ) -> Self {
        let estimate = match &self {
            Self::Accepted(found) => Some(*found),
            Self::Refused(refusal) if needs_more(&self) => refusal.estimate,
            Self::Refused(_) => return self,
        };
        let sigma_hz = estimate.map(|found| found.sigma_hz);
        if sigma_hz.is_some_and(|sigma_hz| sigma_hz <= target_hz) {
            return self;
        }
        let outside = estimate.as_ref().and_then(|found| doubt_place(found, window));
        let limit = match (outside, &estimate) {
            (Some(_), Some(found)) => Limit::Window { estimate_hz: found.resonance_hz },
            _ => limit,
        };
        let reason = Reason::TargetNotReached { sigma_hz, target_hz, readings, limit };
        Self::Refused(Refusal { reason, estimate })
    }
}
