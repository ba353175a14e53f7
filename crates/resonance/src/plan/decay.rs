//! A sweep that never waits: the free decay after each change of frequency is fitted.
//!
//! During the first stay the free decay beats against the drive; the beat gives the resonance to a
//! fraction of a hertz. After that, each stay is chosen to reach the target uncertainty soonest. At
//! most half of it is measured before the circuit is fitted and the rest is planned again. The
//! uncertainty includes a possible second mode of any size, so that both flanks are measured as far as
//! necessary. A verdict is requested once no other circuit explains the readings nearly as well.

mod options;

use rig_model::{Reading, SweepPoint, SweepRequest, Window};

use crate::{
    Bench, Circuit, FitOutcome, Reason,
    circuit::trace::ModelEstimate,
    diagnose::doubts::{GAIN_MIN, POINTS_MIN},
    fit::decay::{
        self, Hypothesis, Known, Stays,
        judge::MODE_WIDENS,
        mode::{Modes, SecondMode},
        outliers::{self, CERTAIN, Criteria},
        search::{self, Effort, Search},
        start::Trials,
    },
    fit::grid::{CircuitPrior, Q_TYPICAL},
    noise::NOISE,
    noise::PooledVariance,
    plan::{
        limit::READINGS_MAX,
        prior::{Estimate, Prior},
    },
};
use options::{Aim, PlanStart};

pub(crate) use options::Pace;

/// The first stay: cycles per reading and number of readings.
const OPENING: (u32, usize) = (2, 5);
/// Largest frequency ratio of two adjacent first stays, and largest number of first stays.
const OPENING_RATIO: f64 = 1.52;
const OPENINGS_MAX: usize = 24;
/// First frequency of a sweep with a prior circuit, in linewidths above the last resonance.
const OPENING_OFF: f64 = 0.3;
/// Largest number of searches for alternatives to a circuit that does not describe the readings.
const SEARCHES_MAX: usize = 2;
/// Largest number of searches for wrong readings.
const SEARCHES_WITHOUT_MAX: usize = 12;
/// Number of extra stays after which a misfit or a rival circuit is no longer attributed to chance.
const FORCED_MAX: usize = 6;
/// Extra stays that resolve a doubt: cycles per reading and number of readings, and offsets from the
/// resonance in linewidths.
const FORCED: (u32, usize) = (4, 8);
const FORCED_AT: [f64; 6] = [0.5, -0.5, 0.9, -0.9, 0.0, 0.3];
/// Largest number of stays that search for a second mode.
const MODE_STAYS_MAX: usize = 10;
/// Gain in twice the log-likelihood that a real second mode reaches after these stays.
const MODE_SURE: f64 = 16.0;
/// Planned standard deviation relative to the target. The profile likelihood is slightly wider than its
/// curvature indicates.
const AIM: f64 = 0.97;
/// Smallest ratio of a new planned standard deviation to the previous one.
const NARROWER: f64 = 0.85;
/// Largest number of steps of a sweep, far more than a sweep that reaches its target takes.
pub(crate) const STEPS_MAX: usize = 150;
/// Searches between two readings: among the trials, beside the best circuit and without a wrong reading,
/// each after readings and before a verdict.
const SEARCHES_PER_STEP: u64 = 6;
/// Largest number of rows between two readings: all searches and a verdict.
pub(crate) const STEP_WORK_MAX: u64 = {
    let rounds = 6;
    let descent = (crate::numeric::descent::STEPS_MAX + 2) * rounds * READINGS_MAX;
    let rows = outliers::ROWS_MAX + search::ROWS_MAX;
    SEARCHES_PER_STEP * (rows + (search::DESCENTS_MAX * descent) as u64)
};

/// The plan of one sweep.
#[derive(Debug, Clone)]
pub(crate) struct Decay {
    within: Window,
    last_circuit: Option<Circuit>,
    expected: CircuitPrior,
    noise: PooledVariance,
    known: Known,
    bench: Option<Bench>,
    stays: Option<Stays>,
    trials: Trials,
    hypotheses: Vec<Hypothesis>,
    /// The evidence for second modes, once a resonance is certain.
    modes: Option<Modes>,
    seen: Vec<SecondMode>,
    steps: usize,
    searches: usize,
    searches_without: usize,
    forced: usize,
    mode_stays: usize,
    /// Whether the whole window has been searched since the last reading.
    is_searched: bool,
    /// The planned standard deviation, Hz.
    aim_hz: f64,
    /// The reason of the last refusal.
    doubt: Option<Reason>,
    /// The analyzer integrates no shorter than this, s.
    shortest_s: f64,
}

impl Decay {
    pub(crate) fn new(request: &SweepRequest, prior: Option<&Prior>) -> Self {
        let within = prior.map_or(request.window, |prior| prior.within);
        let noise = PooledVariance::known(&prior.and_then(|prior| prior.noise).unwrap_or(NOISE));
        let last_circuit = prior.and_then(|prior| prior.circuit);
        let known = Known::with(noise.variance());
        let q = last_circuit.map_or(Q_TYPICAL, |circuit| circuit.q);
        Self {
            within,
            last_circuit,
            expected: CircuitPrior::any(q).within(within),
            noise,
            known,
            bench: prior.and_then(|prior| prior.bench),
            stays: None,
            trials: Trials::new(within),
            hypotheses: Vec::new(),
            modes: None,
            seen: Vec::new(),
            steps: 0,
            searches: 0,
            searches_without: 0,
            forced: 0,
            mode_stays: 0,
            is_searched: false,
            aim_hz: AIM * request.target_sigma_hz,
            doubt: None,
            shortest_s: 0.0,
        }
    }

    pub(crate) const fn set_shortest(&mut self, integration_s: f64) {
        self.shortest_s = integration_s;
    }

    /// The durations of readings.
    pub(crate) fn pace(&self) -> Pace {
        Pace::of(self.stays.as_ref(), self.shortest_s)
    }

    pub(crate) fn add(&mut self, readings: &[Reading], window: Window) {
        if self.stays.is_none() {
            let unit_farad = decay::unit_farad(readings);
            self.stays = unit_farad.map(|unit| Stays::new(self.known, self.bench, unit));
        }
        let Some(stays) = &mut self.stays else { return };
        for reading in readings {
            let begins = stays.push(reading);
            if let Some(stay) = stays.all.last()
                && let Some(sample) = stay.samples.last()
            {
                let begins = begins.then_some((stay.frequency_hz, stay.since_s));
                self.trials.add(sample, begins, &stays.known);
            }
        }
        self.is_searched = false;
        if self.stays.as_ref().is_some_and(|stays| stays.all.len() >= self.openings()) {
            self.refit(false);
            self.look_for_modes(window);
        }
    }

    /// Whether to request a verdict: the target is reached, and only one circuit explains the readings.
    pub(crate) fn is_enough(&mut self, window: Window) -> bool {
        let is_enough = |decay: &Self| {
            decay.hypotheses.len() == 1 && decay.predicted_hz().is_some_and(|hz| hz <= decay.aim_hz)
        };
        if !is_enough(self) {
            return false;
        }
        if !self.is_searched {
            self.refit(true);
            self.look_for_modes(window);
        }
        is_enough(self)
    }

    /// The resonances of the best two circuits, Hz, if more than one explains the readings.
    pub(crate) fn rivals(&mut self, window: Window) -> Option<[f64; 2]> {
        if !self.is_searched {
            self.refit(true);
            self.look_for_modes(window);
        }
        let [first, other, ..] = &self.hypotheses[..] else { return None };
        Some([first, other].map(|one| one.at.resonance_hz))
    }

    /// The start circuit of a fit.
    pub(crate) fn circuit(&self) -> Option<Circuit> {
        let (stays, best) = (self.stays.as_ref()?, self.hypotheses.first()?);
        Some(best.at.circuit(stays.unit_farad))
    }

    /// Records a verdict on the readings so far and returns whether it ends the sweep.
    pub(crate) fn is_final(&mut self, verdict: &FitOutcome, target_hz: f64) -> bool {
        self.doubt = None;
        let refusal = match verdict {
            FitOutcome::Accepted(found) if found.sigma_hz <= target_hz => return true,
            FitOutcome::Accepted(found) => {
                self.tighten(target_hz / found.sigma_hz);
                return false;
            }
            FitOutcome::Refused(refusal) => refusal,
        };
        match refusal.reason {
            Reason::TooNoisy { .. } => self.tighten(NARROWER),
            Reason::SecondMode { .. } => {
                self.mode_stays += 1;
                self.doubt = Some(refusal.reason);
            }
            _ => {
                self.forced += 1;
                self.doubt = Some(refusal.reason);
            }
        }
        self.mode_stays > MODE_STAYS_MAX || self.forced > FORCED_MAX
    }

    fn tighten(&mut self, ratio: f64) {
        let now_hz = self.predicted_hz().unwrap_or(self.aim_hz);
        self.aim_hz = AIM * ratio.clamp(NARROWER, 1.0) * now_hz.min(self.aim_hz);
    }

    /// The next stay; empty if none would help, or a reason to refuse.
    pub(crate) fn next(
        &mut self,
        request: &SweepRequest,
        readings: &[Reading],
        elapsed_s: f64,
    ) -> Result<Vec<SweepPoint>, Reason> {
        self.steps += 1;
        let (stays, count) =
            self.stays.as_ref().map_or((0, 0), |stays| (stays.all.len(), stays.count()));
        if self.steps > STEPS_MAX {
            return Ok(Vec::new());
        }
        if self.steps > self.openings() && 2 * count < readings.len().max(1) {
            let overloaded = readings.len() - count;
            return Err(match readings.len() {
                0 => Reason::TooFewPoints { found: 0, needed: POINTS_MIN },
                readings => Reason::Saturated { overloaded, readings },
            });
        }
        let (Some(of), Some(best)) = (&self.stays, self.hypotheses.first()) else {
            let is_opening = stays < self.openings() || self.steps <= self.openings() + FORCED_MAX;
            return if is_opening {
                Ok(self.opening(request, self.steps - 1))
            } else {
                Err(Reason::NoResonance { found: 0.0, needed: GAIN_MIN })
            };
        };
        if stays < self.openings() {
            return Ok(self.opening(request, stays));
        }
        let is_rival = self.hypotheses.len() > 1 && best.sigma_hz() <= self.aim_hz;
        let is_doubt = !matches!(self.doubt, None | Some(Reason::SecondMode { .. }));
        if is_rival || is_doubt {
            if is_rival {
                self.forced += 1;
            }
            if self.forced > FORCED_MAX {
                let other = self.hypotheses.get(1).map(|other| other.at.resonance_hz);
                return Err(other.map_or(Reason::NotConverged, |other_hz| Reason::Ambiguous {
                    first_hz: best.at.resonance_hz,
                    other_hz,
                }));
            }
            let off = FORCED_AT[self.forced % FORCED_AT.len()];
            let frequency_hz = best.at.resonance_hz + off * best.linewidth_hz();
            if is_doubt {
                // Whether this stay resolves it, the next verdict says.
                self.doubt = None;
            }
            return Ok(points(request.window, frequency_hz, FORCED));
        }
        let ground = PlanStart {
            stays: of,
            best,
            expected: &self.expected,
            window: request.window,
            aim: self.aim(best),
            modes: self.modes.as_ref(),
            pace: self.pace(),
            spent_s: elapsed_s,
            left_s: request.time_limit_s - elapsed_s,
        };
        let (frequency_hz, cycles, count) = ground.choose();
        Ok(points(request.window, frequency_hz, (cycles, count)))
    }

    /// The aim of the next stays.
    fn aim(&self, best: &Hypothesis) -> Aim {
        let widening = self.stays.as_ref().map_or(1.0, outliers::widening);
        let relative = self.aim_hz / widening / best.at.resonance_hz;
        let variance = relative * relative;
        let likeliest = self.likeliest().filter(|mode| {
            matches!(self.doubt, Some(Reason::SecondMode { .. })) && mode.is_present()
        });
        if let Some(mode) = likeliest {
            let size_variance = Some(mode.size * mode.size / MODE_SURE);
            let (place, is_limited) = (Some(mode.place), mode.is_limited);
            return Aim { variance, place, is_limited, size_variance };
        }
        let unseen = self.seen.iter().filter(|mode| mode.variance > 0.0);
        let widest = unseen.max_by(|a, b| a.variance.total_cmp(&b.variance));
        let is_limited = widest.is_some_and(|mode| mode.is_limited);
        Aim { variance, place: widest.map(|mode| mode.place), is_limited, size_variance: None }
    }

    fn likeliest(&self) -> Option<&SecondMode> {
        self.seen.iter().max_by(|a, b| a.gain.total_cmp(&b.gain))
    }

    /// The standard deviation of a result from the present readings, Hz.
    fn predicted_hz(&self) -> Option<f64> {
        let best = self.hypotheses.first()?;
        let widest = self.seen.iter().map(|mode| mode.variance).fold(0.0, f64::max);
        let sigma_hz = best.sigma_hz().max(best.at.resonance_hz * widest.sqrt() / MODE_WIDENS);
        let stays = self.stays.as_ref().filter(|_| self.modes.is_some())?;
        Some(outliers::widening(stays) * sigma_hz)
    }

    fn look_for_modes(&mut self, window: Window) {
        self.seen.clear();
        self.modes = None;
        let (Some(stays), [best]) = (&self.stays, &self.hypotheses[..]) else { return };
        if best.sigma_hz() < CERTAIN * best.linewidth_hz() {
            let modes = Modes::new(stays, best);
            self.seen.extend(modes.all(&self.expected, window));
            self.modes = Some(modes);
        }
    }

    /// Work so far, in rows: evaluations of one reading with its derivatives.
    pub(crate) fn work(&self) -> u64 {
        self.stays.as_ref().map_or(0, |stays| stays.work.get())
    }

    /// The estimate from the readings so far.
    pub(crate) fn estimate(&self) -> Option<Estimate> {
        let (circuit, best) = (self.circuit()?, self.hypotheses.first()?);
        let sigma_hz = best.sigma_hz();
        sigma_hz.is_finite().then_some(Estimate { circuit, sigma_hz })
    }

    /// The next of the first stays, after `done` of them. They are close enough together that a
    /// resonance between two of them is visible from one.
    fn opening(&self, request: &SweepRequest, done: usize) -> Vec<SweepPoint> {
        let Window { min_hz, max_hz } = self.within;
        let places = self.openings();
        let part = (done % places) as f64 + 0.5;
        let middle_hz = min_hz * (max_hz / min_hz).powf(part / places as f64);
        let off_hz = self.last_circuit.map_or(0.0, |last| OPENING_OFF * last.linewidth_hz());
        points(request.window, middle_hz + off_hz.min(0.5 * (max_hz - min_hz)), OPENING)
    }

    fn openings(&self) -> usize {
        let ratio = (self.within.max_hz / self.within.min_hz).max(1.0);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small")]
        let places = (ratio.ln() / OPENING_RATIO.ln()).ceil() as usize;
        places.clamp(1, OPENINGS_MAX)
    }

    /// Refits the present circuits, and searches for others unless the result is certain.
    fn refit(&mut self, look_around: bool) {
        let Some(stays) = &self.stays else { return };
        let search =
            Search { stays, trials: &self.trials, expected: &self.expected, noise: self.noise };
        let is_certain = match &self.hypotheses[..] {
            [alone] => alone.sigma_hz() < CERTAIN * alone.linewidth_hz(),
            _ => false,
        };
        let last = self.last_circuit.map(|last| ModelEstimate::of(&last, stays.unit_farad));
        let effort = if look_around || !is_certain { Effort::Trials } else { Effort::Follow };
        let mut found = search.run(std::mem::take(&mut self.hypotheses), last, effort);
        let following = match &found[..] {
            [alone] if alone.sigma_hz() < CERTAIN * alone.linewidth_hz() => {
                stays.following(alone, &self.expected, (self.noise, self.within))
            }
            _ => None,
        };
        if let Some((stays, alone)) = following {
            self.stays = Some(stays);
            found = vec![alone];
        }
        let Some(stays) = &self.stays else { return };
        let search =
            Search { stays, trials: &self.trials, expected: &self.expected, noise: self.noise };
        let is_misfit = !found.is_empty() && found.iter().all(|one| search.is_misfit(one));
        if is_misfit && self.searches < SEARCHES_MAX {
            self.searches += 1;
            found = search.run(found, last, Effort::Beside);
        }
        let is_suspect = found.iter().all(|one| search.is_misfit(one) || one.has_far(self.noise));
        if is_suspect && self.searches_without < SEARCHES_WITHOUT_MAX {
            self.searches_without += 1;
            let Self { expected, noise, within, .. } = self;
            let criteria = Criteria { expected, noise: *noise, within: *within };
            let searches = outliers::searches_of_step(stays, *within, 1);
            if let Some(rest) = outliers::without(stays, &found, &criteria, searches) {
                found = rest.found;
                self.trials = Trials::new(*within);
                self.trials.add_all(&rest.stays);
                self.stays = Some(rest.stays);
            }
        }
        let Some(stays) = &self.stays else { return };
        let search =
            Search { stays, trials: &self.trials, expected: &self.expected, noise: self.noise };
        self.is_searched = look_around;
        // If the noise is poorly known, it is estimated from the readings.
        let degrees = stays.degrees();
        let variance = match &found[..] {
            [alone] if degrees > 3.0 && !search.is_misfit(alone) => {
                let cost = alone.normal.cost * stays.known.variance;
                Some(self.noise.with(cost, degrees).variance())
            }
            _ => None,
        };
        self.hypotheses = found;
        if let (Some(stays), Some(variance)) = (&mut self.stays, variance) {
            stays.known.variance = variance;
        }
    }
}

/// Consecutive readings at one frequency.
fn points(window: Window, frequency_hz: f64, (cycles, count): (u32, usize)) -> Vec<SweepPoint> {
    let frequency_hz = frequency_hz.clamp(window.min_hz, window.max_hz);
    vec![SweepPoint { frequency_hz, settle_s: 0.0, cycles }; count]
}

#[cfg(test)]
#[path = "decay/tests.rs"]
mod tests;
