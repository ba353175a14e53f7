//! Points that are each left to settle, for analyzers whose drive between the points is not known.
//!
//! A coarse look over the window with short settling shows where the resonance is and roughly how
//! sharp: even far from it the motional branch changes the capacitance by per cents, at a noise of
//! parts in a thousand. What was read before the quality was known may not have settled, and takes
//! no part in the result.

use rig_model::{Reading, SweepPoint, SweepRequest, Window};

use super::{Prior, design::Information, elapsed_s, evenly};
use crate::{Circuit, FitOptions, Fitter, Reason, Refusal, Resonance, Verdict};

/// Points of the coarse look over a window that nothing is known about.
const COARSE: u32 = 9;
/// Settling of the coarse look, s.
const COARSE_SETTLE_S: f64 = 0.08;
const COARSE_CYCLES: u32 = 4;
/// Looks before the circuit is believed.
const LOOKS_MAX: u32 = 4;
/// Time constants after which a motional current has gone down to 0.25 % of its jump.
const SETTLED: f64 = 6.0;
/// Longest time constant believed, s: a quality of 150 at 140 Hz.
const TIME_CONSTANT_MAX_S: f64 = 0.35;
/// Points asked for at a time once the circuit is known.
const BATCH: usize = 2;
/// How often readings that fit no circuit are taken again.
const RESTARTS: u32 = 2;
/// Points of the plain sweep that is made when every look was misleading.
const LAST_RESORT: u32 = 41;

#[derive(Debug, Clone)]
pub(super) struct Settled {
    fitter: Fitter,
    /// Where the resonance may be.
    whole: Window,
    /// Where it is sought now.
    window: Window,
    settle_s: f64,
    looks: u32,
    /// Readings that took part in looking, and not in measuring.
    coarse: usize,
    stage: Stage,
    /// How often readings that fit no circuit may still be taken again, settled for longer.
    restarts_left: u32,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Stage {
    Looking,
    Measuring,
}

impl Settled {
    pub(super) fn new(request: &SweepRequest, prior: Option<&Prior>) -> Self {
        let (window, settle_s) = match prior {
            None => (request.window, COARSE_SETTLE_S),
            Some(prior) => {
                let settle_s = prior.circuit.map_or(COARSE_SETTLE_S, |circuit| {
                    2.0 * circuit.time_constant_s().min(TIME_CONSTANT_MAX_S)
                });
                (common(request.window, prior.within), settle_s)
            }
        };
        let fitter = Fitter::default();
        Self {
            fitter,
            whole: window,
            window,
            settle_s,
            looks: 0,
            coarse: 0,
            stage: Stage::Looking,
            restarts_left: RESTARTS,
        }
    }

    pub(super) fn add(&mut self, readings: usize) {
        if self.stage == Stage::Looking {
            self.coarse += readings;
        }
    }

    /// The readings that have settled.
    pub(super) fn usable<'a>(&self, readings: &'a [Reading]) -> &'a [Reading] {
        &readings[self.coarse.min(readings.len())..]
    }

    /// The points to measure next; none when the end is reached.
    pub(super) fn next(
        &mut self,
        request: &SweepRequest,
        readings: &[Reading],
        options: &FitOptions,
    ) -> Vec<SweepPoint> {
        if elapsed_s(readings) >= request.time_limit_s {
            return Vec::new();
        }
        if self.stage == Stage::Looking {
            if self.looks == 0 {
                self.looks = 1;
                return self.look();
            }
            // Transients are no noise: they must neither count as misfit nor as outliers.
            let loose = FitOptions::default();
            let last_look = &readings[readings.len().saturating_sub(COARSE as usize)..];
            let seen = self.circuit(last_look, &loose);
            // A transient can look like a resonance, and the next look then misses the real one.
            let Some(circuit) = seen.filter(|seen| self.window.contains(seen.resonance_hz)) else {
                self.window = self.whole;
                return self.look_again(request, readings);
            };
            let time_constant_s = circuit.time_constant_s().min(TIME_CONSTANT_MAX_S);
            if self.settle_s < 1.5 * time_constant_s && self.looks < LOOKS_MAX {
                let half = 4.0 * circuit.linewidth_hz();
                let (low, high) = (circuit.resonance_hz - half, circuit.resonance_hz + half);
                self.window = common(request.window, Window { min_hz: low, max_hz: high });
                self.settle_s = 2.0 * time_constant_s;
                return self.look_again(request, readings);
            }
            self.settle_s = SETTLED * time_constant_s;
            self.stage = Stage::Measuring;
            return spread_around(&circuit, request, self.settle_s);
        }
        self.measure(request, readings, options)
    }

    fn look(&self) -> Vec<SweepPoint> {
        evenly(self.window, COARSE, self.settle_s, COARSE_CYCLES)
    }

    fn look_again(&mut self, request: &SweepRequest, readings: &[Reading]) -> Vec<SweepPoint> {
        if self.looks >= LOOKS_MAX {
            return self.plain_sweep(request, readings);
        }
        self.looks += 1;
        self.settle_s *= 1.5;
        self.look()
    }

    /// Looking has led nowhere: a plain sweep over the whole window, settled for the longest time
    /// constant as far as the time that is left allows, and the fit decides.
    fn plain_sweep(&mut self, request: &SweepRequest, readings: &[Reading]) -> Vec<SweepPoint> {
        self.stage = Stage::Measuring;
        let integration_s = f64::from(request.cycles) / self.whole.min_hz;
        let left_s = request.time_limit_s - elapsed_s(readings);
        let settle_s = left_s / f64::from(LAST_RESORT) - integration_s;
        self.settle_s = settle_s.clamp(COARSE_SETTLE_S, SETTLED * TIME_CONSTANT_MAX_S);
        evenly(self.whole, LAST_RESORT, self.settle_s, request.cycles)
    }

    fn measure(
        &mut self,
        request: &SweepRequest,
        readings: &[Reading],
        options: &FitOptions,
    ) -> Vec<SweepPoint> {
        let usable = self.usable(readings);
        let verdict = self.fitter.fit(usable, options);
        let is_misfit = matches!(
            &verdict,
            Verdict::Refused(Refusal {
                reason: Reason::Outliers { .. } | Reason::Misfit { .. } | Reason::NotConverged,
                ..
            })
        );
        let best = match &verdict {
            Verdict::Accepted(found) if found.sigma_hz <= request.target_sigma_hz => {
                return Vec::new();
            }
            Verdict::Accepted(found) => Some(found),
            Verdict::Refused(refusal) => refusal.estimate.as_ref(),
        };
        let circuit = best.map(Resonance::circuit);
        let is_outside = |circuit: &Circuit| !request.window.contains(circuit.resonance_hz);
        if is_misfit && self.restarts_left > 0 {
            // The first estimate of the quality may have been too low, and the readings unsettled.
            self.restarts_left -= 1;
            self.coarse = readings.len();
            self.settle_s *= 1.5;
            return match circuit.filter(|circuit| !is_outside(circuit)) {
                Some(circuit) => spread_around(&circuit, request, self.settle_s),
                None => self.plain_sweep(request, readings),
            };
        }
        let (Some(best), Some(circuit)) = (best, circuit) else { return Vec::new() };
        if is_outside(&circuit) {
            return Vec::new();
        }
        let time_constant_s = circuit.time_constant_s().min(TIME_CONSTANT_MAX_S);
        self.settle_s = self.settle_s.max(SETTLED * time_constant_s);
        let noise = best.noise_at_ten_cycles;
        let mut information = Information::default();
        for reading in usable {
            let cycles = reading.integration_s * reading.frequency_hz;
            information.add(&circuit, reading.frequency_hz, cycles);
        }
        // Integrating as long as settling costs at most twice the best time.
        let cycles = cycles_for(self.settle_s, &circuit, request);
        let mut points = Vec::new();
        let wanted = (request.target_sigma_hz / noise).powi(2);
        while points.len() < BATCH && information.variance(&circuit) > wanted {
            let frequency_hz = information.best(&circuit, f64::from(cycles), request.window);
            information.add(&circuit, frequency_hz, f64::from(cycles));
            points.push(SweepPoint { frequency_hz, settle_s: self.settle_s, cycles });
        }
        if points.is_empty() {
            // The model says that the aim is reached; the fit does not yet: one point more.
            let frequency_hz = information.best(&circuit, f64::from(cycles), request.window);
            points.push(SweepPoint { frequency_hz, settle_s: self.settle_s, cycles });
        }
        points
    }

    fn circuit(&mut self, readings: &[Reading], options: &FitOptions) -> Option<Circuit> {
        let best = match self.fitter.fit(readings, options) {
            Verdict::Accepted(found) => found,
            Verdict::Refused(refusal) => refusal.estimate?,
        };
        let circuit = best.circuit();
        (circuit.q > 1.0 && circuit.c1_farad > 0.0 && circuit.c0_farad > 0.0).then_some(circuit)
    }
}

/// Points that tell every parameter, for the first fit of settled readings.
fn spread_around(circuit: &Circuit, request: &SweepRequest, settle_s: f64) -> Vec<SweepPoint> {
    let half = 0.5 * circuit.linewidth_hz();
    let Window { min_hz, max_hz } = request.window;
    let cycles = request.cycles;
    [-3.0, -1.0, -0.4, 0.0, 0.4, 1.0, 3.0]
        .into_iter()
        .map(|widths| {
            let frequency_hz = (circuit.resonance_hz + widths * half).clamp(min_hz, max_hz);
            SweepPoint { frequency_hz, settle_s, cycles }
        })
        .collect()
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a positive number of seconds times hertz, bounded by the clamp"
)]
fn cycles_for(settle_s: f64, circuit: &Circuit, request: &SweepRequest) -> u32 {
    (settle_s * circuit.resonance_hz).clamp(f64::from(request.cycles), 1000.0) as u32
}

/// What two windows have in common; the first where that is nothing.
fn common(outer: Window, inner: Window) -> Window {
    let (min_hz, max_hz) = (outer.min_hz.max(inner.min_hz), outer.max_hz.min(inner.max_hz));
    if min_hz < max_hz { Window { min_hz, max_hz } } else { outer }
}
