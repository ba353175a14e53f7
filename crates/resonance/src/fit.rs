//! Readings in, verdict out.
//!
//! Most sweeps are good, and nothing is gained by doubting them at length: the fit itself shows
//! whether anything is unusual. Only then everything else that could explain the readings is tried.

pub(crate) mod decay;

use rig_model::{Reading, Window};

use crate::{
    Circuit, FitOutcome, Reason, Refusal, Resonance, Side, Timing, full_fit::Model, points::Points,
    rounding, scatter, solve::End, steady_fit::SteadyFit, trace::ModelEstimate, unknown_dwell,
};

/// The inputs of a fit other than the readings.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FitOptions {
    /// The window; the span of the readings if absent.
    pub window: Option<Window>,
    /// The prior of the noise; estimated from the residuals if absent.
    pub noise: Option<NoisePrior>,
    /// Knowledge of the times of the readings.
    pub timing: Timing,
    /// Whether dielectric loss is a free parameter even where the readings do not ask for it. Few
    /// readings at the frequencies that tell most of the resonance tell hardly anything of loss,
    /// and what they cannot exclude belongs into the uncertainty.
    pub always_loss: bool,
    /// Where the most likely circuit is, when that is known: it is not searched for then, and
    /// readings that have not settled are weighed for it.
    pub near: Option<Circuit>,
}

/// Noise known from earlier readings of the same analyzer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoisePrior {
    /// Standard deviation of the real and of the imaginary part of the relative error of a reading
    /// of ten cycles.
    pub at_ten_cycles: f64,
    /// Degrees of freedom; infinite if it is certain.
    pub degrees_of_freedom: f64,
}

impl NoisePrior {
    /// Degrees of freedom of a noise given by a person.
    pub const STATED_DEGREES: f64 = 100.0;
}

/// Five parameters and two readings more, so that something is left to judge by.
pub(crate) const POINTS_MIN: usize = 7;
/// Twice the log-likelihood that a resonance must gain over a capacitor. Chance gains 40 once in a
/// million sweeps: three parameters, one of them tried at up to a few hundred places.
pub(crate) const GAIN_MIN: f64 = 40.0;
/// A tenth of the linewidth: beyond it the model is no longer linear over what noise does.
const NOISE_MAX_LINEWIDTHS: f64 = 0.1;
/// Half the linewidth: beyond it a result says no more than a glance at the peak. What is between is
/// not noise but what other causes might do, none of which the readings ask for.
pub(crate) const SIGMA_MAX_LINEWIDTHS: f64 = 0.5;

/// More than the square of the coupling factor k33 of the softest ceramics, 0.56.
const K_SQUARED_MAX: f64 = 0.6;

/// Finds the resonance in readings, in the order in which they were taken.
pub fn fit(readings: &[Reading], options: &FitOptions) -> FitOutcome {
    Fitter::default().fit(readings, options)
}

/// A fit that keeps its memory: nothing is allocated for a good sweep once it has seen as many
/// readings before.
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
        let Points { lowest_hz: min_hz, highest_hz: max_hz, .. } = self.quick.points;
        let span = Window { min_hz, max_hz };
        let window = options.window.unwrap_or(span);
        let rounding = rounding::variances(readings);
        let mut start = None;
        if options.timing.is_steady()
            && let Some(found) = self.quick.fit(options)
        {
            // A place without a resonance is none to start from.
            start = found.start.filter(|_| found.gain > GAIN_MIN);
            if let (Some(resonance), Some(at), true) = (found.resonance, start, found.is_usual)
                && !rounding::matters(&rounding, readings, &resonance)
                && doubt_existence(&resonance, found.gain).is_none()
                && doubt_place(&resonance, window).is_none()
                && doubt_circuit(&resonance, span).is_none()
                && let told = self.told(&resonance, at, readings, options.timing)
                && doubt_precision(&told, resonance.sigma_hz).is_none()
            {
                return FitOutcome::Accepted(told);
            }
        }
        let unit_farad = self.quick.points.reference_farad;
        let near = options.near.map(|circuit| ModelEstimate::of(&circuit, unit_farad));
        let start = near.or(start);
        match Model::find(readings, &rounding, window, unit_farad, start, options) {
            Ok(model) => judge(&model, window, span, options),
            Err(reason) => refused(reason),
        }
    }

    /// A quick result, with the uncertainty that comes of not knowing the times.
    fn told(
        &self,
        found: &Resonance,
        at: ModelEstimate,
        readings: &[Reading],
        timing: Timing,
    ) -> Resonance {
        let unit_farad = self.quick.points.reference_farad;
        match timing {
            Timing::Unknown => unknown_dwell::widened(found, at, readings, unit_farad),
            Timing::Waited | Timing::Exact(_) | Timing::AnyPhase => *found,
        }
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

/// The verdict on a model that was found with all doubts.
fn judge(model: &Model, window: Window, span: Window, options: &FitOptions) -> FitOutcome {
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
        .or_else(|| doubt_place(&found, window))
        .or_else(|| doubt_circuit(&found, span))
        // A fit to many outliers says nothing of the resonance.
        .map(|reason| model.outliers_in_the_way().unwrap_or(reason))
        // Something in series explains a little of nearly everything, and much of mere noise.
        .or(model.reason.filter(|reason| *reason != Reason::Stray))
        .or_else(|| {
            let reason = doubt_precision(&found, model.sigma_by_noise_hz(&found))?;
            Some(model.outliers_in_the_way().unwrap_or(reason))
        })
        .or(model.reason)
        .or_else(|| {
            let sigmas = scatter::CHI_SQUARED_SIGMAS;
            let allowed = scatter::allowed(model.degrees(), options.noise.as_ref(), sigmas);
            let found = found.chi_squared_per_dof;
            let is_described = found < allowed;
            (!is_described).then_some(Reason::Misfit { found, allowed })
        });
    match reason {
        None => FitOutcome::Accepted(found),
        Some(reason) => FitOutcome::Refused(Refusal { reason, estimate: Some(found) }),
    }
}

/// Whether there is a resonance at all.
pub(crate) fn doubt_existence(found: &Resonance, gain: f64) -> Option<Reason> {
    // What is not a number must be refused as well, here and below.
    let exists = gain > GAIN_MIN && found.figure_of_merit > 0.0;
    (!exists).then_some(Reason::NoResonance { found: gain, needed: GAIN_MIN })
}

/// Whether it lies inside the window.
pub(crate) fn doubt_place(found: &Resonance, window: Window) -> Option<Reason> {
    let estimate_hz = found.resonance_hz;
    let side = if estimate_hz < window.min_hz {
        Side::Below
    } else if estimate_hz > window.max_hz {
        Side::Above
    } else {
        return None;
    };
    Some(Reason::OutsideWindow { side, estimate_hz, window })
}

/// Whether it can be a sensor at all: something else may look a little like a resonance.
pub(crate) fn doubt_circuit(found: &Resonance, window: Window) -> Option<Reason> {
    let circuit = found.circuit();
    let span_hz = window.max_hz - window.min_hz;
    [
        ("linewidth in Hz", circuit.linewidth_hz(), span_hz),
        ("coupling factor squared", circuit.k_eff_squared(), K_SQUARED_MAX),
    ]
    .into_iter()
    .find(|(_, found, limit)| {
        // What is not a number is no sensor either.
        let is_possible = found < limit;
        !is_possible
    })
    .map(|(quantity, found, limit)| Reason::NotASensor { quantity, found, limit })
}

/// Whether it is known well enough to be told, with so much of its uncertainty by noise alone.
pub(crate) fn doubt_precision(found: &Resonance, sigma_by_noise_hz: f64) -> Option<Reason> {
    let linewidth_hz = found.circuit().linewidth_hz();
    let [by_noise, by_all] = [
        (sigma_by_noise_hz, NOISE_MAX_LINEWIDTHS * linewidth_hz),
        (found.sigma_hz, SIGMA_MAX_LINEWIDTHS * linewidth_hz),
    ]
    .map(|(sigma_hz, limit_hz)| {
        let is_precise = sigma_hz < limit_hz;
        (!is_precise).then_some(Reason::TooNoisy { sigma_hz, limit_hz })
    });
    by_noise.or(by_all)
}
