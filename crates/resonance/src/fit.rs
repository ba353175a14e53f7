//! Fits readings and returns a verdict.
//!
//! A quick fit accepts a usual sweep. Only if that fit shows anything unusual, all alternative models
//! of the readings are fitted too.

pub(crate) mod decay;
pub(crate) mod effective_time;
mod full;
pub(crate) mod grid;
mod robust;
pub(crate) mod solve;
mod steady;

use rig_model::{Reading, Window};

use crate::{
    Bench, Circuit, FitOutcome, NoisePrior, Reason, Refusal, Resonance, Timing,
    circuit::points::Points,
    circuit::trace::{CIRCUIT, ModelEstimate},
    diagnose::doubts::{
        GAIN_MIN, POINTS_MIN, doubt_circuit, doubt_existence, doubt_loss, doubt_place,
        doubt_precision, doubt_resolution,
    },
    diagnose::rounding,
    fit::full::{BROAD, Model},
    fit::steady::SteadyFit,
    noise,
    numeric::descent::End,
};

/// The inputs of a fit other than the readings.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FitOptions {
    /// The window; the span of the readings if absent.
    pub window: Option<Window>,
    /// The prior of the noise; without it, the noise is estimated from the residuals.
    pub noise: Option<NoisePrior>,
    /// Knowledge of the times of the readings.
    pub timing: Timing,
    /// Whether dielectric loss is always a free parameter. A few readings at the best frequencies for
    /// the resonance hardly determine the loss, and the undetermined loss adds to the uncertainty.
    pub always_loss: bool,
    /// The most likely circuit, if known. It replaces the search, and unsettled readings are weighted
    /// for it.
    pub near: Option<Circuit>,
    /// The knowledge of the bench from a survey; used for readings without settling.
    pub bench: Option<Bench>,
}

/// Finds the resonance in readings, in the order in which they were taken.
pub fn fit(readings: &[Reading], options: &FitOptions) -> FitOutcome {
    Fitter::default().fit(readings, options)
}

/// A fit with reusable buffers. A good sweep allocates nothing if an earlier one was at least as long.
#[derive(Debug, Clone, Default)]
pub struct Fitter {
    quick: SteadyFit,
}

impl Fitter {
    /// Finds the resonance in readings, in the order in which they were taken.
    pub fn fit(&mut self, readings: &[Reading], options: &FitOptions) -> FitOutcome {
        let refused = |reason| FitOutcome::Refused(Refusal { reason, estimate: None });
        if options.timing == Timing::AnyPhase {
            return decay::judge::fit(readings, options);
        }
        if let Err(reason) = self.load(readings) {
            return refused(reason);
        }
        let Points { lowest_hz: min_hz, highest_hz: max_hz, count, .. } = self.quick.points;
        let span = Window { min_hz, max_hz };
        let window = options.window.unwrap_or(span);
        let rounding = rounding::variances(readings);
        let mut start = None;
        if options.timing.is_steady()
            && let Some(found) = self.quick.fit(options)
        {
            // Without a resonance there is no start value.
            start = found.start.filter(|_| found.gain > GAIN_MIN);
            if let (Some(resonance), Some(at), Some(widening)) =
                (found.resonance, start, found.widening)
                && !rounding::matters(&rounding, readings, &resonance)
                && doubt_existence(&resonance, found.gain).is_none()
                && doubt_place(&resonance, window).is_none()
                && doubt_circuit(&resonance, span).is_none()
                && doubt_loss(&at, &resonance).is_none()
                && doubt_resolution(&resonance, span, count).is_none()
                && !is_broad(&resonance, span)
                && let Some(unsettled) = self.unsettled(&resonance, at, readings, options)
                && let more = widening.max(unsettled)
                && let widened = resonance.widened(more * resonance.resonance_hz.powi(2))
                && doubt_precision(&widened, resonance.sigma_hz).is_none()
            {
                return FitOutcome::Accepted(widened);
            }
        }
        let unit_farad = self.quick.points.reference_farad;
        let near = options.near.map(|circuit| ModelEstimate::of(&circuit, unit_farad));
        let start = near.or(start);
        match Model::find(readings, &rounding, window, unit_farad, start, options) {
            Ok(model) => judge(&model, window, (span, count), options),
            Err(reason) => refused(reason),
        }
    }

    /// Addition to the relative variance of the resonance for readings that may not have settled; `None`
    /// if they have not.
    fn unsettled(
        &self,
        found: &Resonance,
        at: ModelEstimate,
        readings: &[Reading],
        options: &FitOptions,
    ) -> Option<f64> {
        if options.timing != Timing::Waited || self.quick.has_surely_settled(found) {
            return Some(0.0);
        }
        let unit_farad = self.quick.points.reference_farad;
        let free = if found.loss_tangent_sigma().is_some() { CIRCUIT } else { CIRCUIT - 1 };
        Some(Model::settling_at(at, free, readings, unit_farad, options)?.widening)
    }

    fn load(&mut self, readings: &[Reading]) -> Result<(), Reason> {
        self.quick.load(readings).map_err(|fault| Reason::NotFinite { index: fault.index })?;
        let Points { count: found, overloaded, .. } = self.quick.points;
        let readings = readings.len();
        if 2 * overloaded > readings || (overloaded > 0 && found < POINTS_MIN) {
            return Err(Reason::Saturated { overloaded, readings });
        }
        if found < POINTS_MIN {
            return Err(Reason::TooFewPoints { found, needed: POINTS_MIN });
        }
        Ok(())
    }
}

/// Whether a resonance is so broad that its likelihood has another shape than its curvature indicates.
fn is_broad(found: &Resonance, span: Window) -> bool {
    let is_narrow = found.circuit().linewidth_hz() < BROAD * (span.max_hz - span.min_hz);
    !is_narrow
}

/// The verdict on a model that was compared with all alternatives.
fn judge(
    model: &Model,
    window: Window,
    (span, count): (Window, usize),
    options: &FitOptions,
) -> FitOutcome {
    let gain = model.gain_over_capacitor();
    let Some(found) = model.resonance(options) else {
        let is_nothing = gain < GAIN_MIN;
        let nothing = Reason::NoResonance { found: gain, needed: GAIN_MIN };
        let reason = if is_nothing { nothing } else { Reason::NotConverged };
        let reason = model.outliers_in_the_way().unwrap_or(reason);
        return FitOutcome::Refused(Refusal { reason, estimate: None });
    };
    let reason = doubt_existence(&found, gain)
        .or_else(|| (model.found.end == End::OutOfSteps).then_some(Reason::NotConverged))
        // Outside of the window a place is stated if it is known.
        .or_else(|| {
            let place = doubt_place(&found, window)?;
            Some(doubt_precision(&found, model.sigma_by_noise_hz(&found)).unwrap_or(place))
        })
        .or_else(|| doubt_circuit(&found, span))
        .or_else(|| doubt_resolution(&found, span, count))
        // A fit to many outliers does not determine the resonance.
        .map(|reason| model.outliers_in_the_way().unwrap_or(reason))
        // A stray series impedance partly fits almost any misfit, and much of pure noise.
        .or(model.reason.filter(|reason| *reason != Reason::Stray))
        .or_else(|| {
            let reason = doubt_precision(&found, model.sigma_by_noise_hz(&found))?;
            Some(model.outliers_in_the_way().unwrap_or(reason))
        })
        .or(model.reason)
        .or_else(|| doubt_loss(&model.found.at, &found))
        .or_else(|| {
            let sigmas = noise::CHI_SQUARED_SIGMAS;
            let allowed = noise::allowed(model.degrees(), options.noise.as_ref(), sigmas);
            let found = found.chi_squared_per_dof;
            let is_described = found < allowed;
            (!is_described).then_some(Reason::Misfit { found, allowed })
        });
    match reason {
        None => FitOutcome::Accepted(found),
        Some(reason) => FitOutcome::Refused(Refusal { reason, estimate: Some(found) }),
    }
}
