//! The full fit of unusual readings: other start values, other models, outliers.

mod profile;
mod start;
mod weights;

use std::f64::consts::TAU;

use num_complex::Complex64;
use rig_model::{Reading, Window};

use crate::{
    FitOptions, Reason, Resonance,
    circuit::trace::{CIRCUIT, ExtraTerm, Minimum, ModelEstimate, Sample, Timing, Trace},
    diagnose::alternatives::{Alternative, Cause, Fitted, inflation_max},
    diagnose::any_phase::AnyPhase,
    diagnose::doubts::GAIN_MIN,
    diagnose::outliers::{self, GAIN_PER_OUTLIER, READINGS_PER_OUTLIER},
    diagnose::unknown_dwell,
    diagnose::unsettled_outliers::is_unsettled,
    fit::robust,
    noise::{self, PooledVariance},
    numeric::dense::{Cholesky, condition, sandwich},
    numeric::descent::End,
    outcome::{LOSS_GAIN_MIN, ModelOrder, Spread},
};

pub(crate) use profile::BROAD;
use start::{from_nothing, weighed};

/// The most likely model and the evidence against it.
#[derive(Debug)]
pub(crate) struct Model {
    trace: Trace,
    pub(crate) found: Minimum,
    order: ModelOrder,
    /// Smallest possible noise variance at ten cycles: that of the noise that weights rounding, and 0
    /// without rounding.
    known: f64,
    /// The multiple of the mains frequency near which readings were disturbed.
    mains_hz: Option<f64>,
    /// The refusal if readings deviate too far or too often to be excluded, although the others show a
    /// resonance.
    too_many: Option<Reason>,
    /// Addition to the relative variance of the resonance for causes that would shift it and are not
    /// excluded.
    widened: f64,
    /// Whether readings that look like outliers are residual transients.
    is_unsettled: bool,
    /// The reason to refuse this model, if there is one.
    pub(crate) reason: Option<Reason>,
}

/// What readings that may not have settled do to a fit of settled ones.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Settling {
    /// Addition to the relative variance of the resonance.
    pub(crate) widening: f64,
    /// Whether the residuals show transients of any phase. A circuit remains valid with its wider
    /// uncertainty, but they may be the reason of every other term.
    has_transients: bool,
}

impl Settling {
    fn of(any_phase: AnyPhase) -> Self {
        Self { widening: any_phase.widening(), has_transients: any_phase.is_present() }
    }
}

/// Largest capacitance of a second mode relative to the first; above it the two modes are ambiguous.
const EQUALS: f64 = 0.7;
/// Largest stray relative to the impedance. The residue of an open and short correction is small; a
/// larger term has another cause.
const STRAY_MAX: f64 = 0.05;
/// Largest relative slope of the static capacitance by the logarithm of the frequency: that of a
/// constant phase of 17°.
const DISPERSION_MAX: f64 = 0.2;
/// Largest phase error of an analyzer, rad.
const PHASE_MAX: f64 = 0.1;
/// An error of the resonance below this many of its standard deviations is negligible.
const SETTLED_SIGMAS: f64 = 0.5;

/// Number of readings on which a resonance must not rest alone.
const STRONGEST: usize = 2;

/// Gain by which an explanation must beat the others.
const CLEARLY: f64 = 10.0;

/// Part of its own gain by which a stray impedance must beat all others: the larger a disturbance, the
/// better a wrong model of two parameters seems to explain it.
const STRAY_LEAD: f64 = 0.15;

/// Margin by which a cause that can be modelled must beat one that cannot, which was tried to first
/// order only. A stray series impedance partly fits almost anything and must beat all others.
fn clearly(cause: &Cause, gain: f64) -> f64 {
    if *cause == Cause::Stray { (STRAY_LEAD * gain).max(30.0) } else { CLEARLY }
}

impl Model {
    /// Finds the most likely model of the readings, from `start` or from a grid search.
    ///
    /// # Errors
    /// [`Reason::NoResonance`] if no resonance is found.
    pub(crate) fn find(
        readings: &[Reading],
        rounding: &[f64],
        window: Window,
        unit_farad: f64,
        start: Option<ModelEstimate>,
        options: &FitOptions,
    ) -> Result<Self, Reason> {
        let mut trace = Trace::of(readings, options.timing, unit_farad);
        trace.added.extend(rounding);
        let free = CIRCUIT + trace.extra_term().count();
        // A few wrong readings cannot mislead the robust fit; unsettled readings have no steady
        // circuit.
        let is_settled = options.timing.is_steady() && options.near.is_none();
        let robust = is_settled.then(|| robust::circuit(readings)).flatten();
        let robust = robust
            .map(|circuit| ModelEstimate::of(&circuit, unit_farad))
            .filter(|circuit| circuit.c0 > 0.0 && circuit.c1 > 0.0);
        let start = match start {
            Some(start) => start,
            None => from_nothing(&trace, window, free).or_else(|none| robust.ok_or(none))?,
        };
        let start = ModelEstimate { extra_term: trace.extra_term(), ..start };
        let (trace, found) = weighed(trace, (start, robust), free, options);
        let order = if options.timing.is_steady() { ModelOrder::Loss } else { ModelOrder::RingUp };
        let mut model = Self::with(trace, &found, order);
        if !rounding.is_empty() {
            model.weigh_rounding(options);
        }
        let all = model.trace.used().0;
        let mut model = model.without_outliers(robust, options);
        if !rounding.is_empty() && model.trace.used().0 < all {
            // The noise was found with the outliers among the readings.
            model.weigh_rounding(options);
        }
        if model.weigh_pick_up(options) {
            model = model.without_outliers(robust, options);
        }
        if options.timing.is_steady() && !options.always_loss {
            model.try_without_loss();
        }
        let settling = model.settling(options).filter(|_| !model.is_unsettled);
        model.climb(options);
        let is_circuit = model.reason.is_none() && model.order <= ModelOrder::Loss;
        match settling {
            Some(settling) if is_circuit || !settling.has_transients => {
                model.widened = model.widened.max(settling.widening);
                if model.reason.is_none() {
                    model.reason = model.too_many_outliers();
                }
            }
            // Transients resemble every other cause.
            _ => model.reason = Some(Cause::NotSettled.into()),
        }
        model.try_broader(options);
        Ok(model)
    }

    /// Addition to the relative variance of the resonance for readings that may not have settled, if the
    /// circuit at `at` with `free` unknowns describes them; `None` if they have not.
    pub(crate) fn settling_at(
        at: ModelEstimate,
        free: usize,
        readings: &[Reading],
        unit_farad: f64,
        options: &FitOptions,
    ) -> Option<Settling> {
        let trace = Trace::of(readings, options.timing, unit_farad);
        let found = Minimum { at, normal: trace.normal(&at), end: End::Converged, free };
        Self::with(trace, &found, ModelOrder::Loss).settling(options)
    }

    /// A model without evidence against it.
    fn with(trace: Trace, found: &Minimum, order: ModelOrder) -> Self {
        Self {
            trace,
            found: *found,
            order,
            known: 0.0,
            mains_hz: None,
            too_many: None,
            widened: 0.0,
            is_unsettled: false,
            reason: None,
        }
    }

    /// Residual degrees of freedom.
    pub(crate) fn degrees(&self) -> f64 {
        (2 * self.trace.used().0 - self.found.free) as f64
    }

    /// The model without outliers, if they are the only fault.
    fn without_outliers(mut self, robust: Option<ModelEstimate>, options: &FitOptions) -> Self {
        (self.is_unsettled, self.too_many) = (false, None);
        if robust.is_none() && outliers::count(&self.trace, &self.found) == 0 {
            return self;
        }
        let without = outliers::without(&self.trace, &self.found, robust);
        let Some((trace, found, is_enough)) = without else { return self };
        let left_out = self.trace.used().0 - trace.used().0;
        let rest = Self { trace, found, ..self };
        if !is_enough {
            // Excluding readings can make pure noise fit any model.
            let is_resonance = rest.gain_over_capacitor() > GAIN_MIN;
            let are_together = outliers::are_together(&self.trace, &rest.trace);
            let many = if are_together { Reason::Distorted } else { self.outliers(left_out) };
            self.too_many = is_resonance.then_some(many);
            return self;
        }
        let (cost, left) = (self.found.normal.cost, rest.found.normal.cost);
        // Likelihoods are compared for the same noise, and a prior is a part of it.
        let gain = match options.noise {
            Some(_) => self.gain(cost - left, options),
            None => rest.degrees() * (cost / left).ln(),
        };
        // All readings together may follow another model.
        let is_best = self.rival(options) < gain - GAIN_PER_OUTLIER * left_out as f64;
        if !is_best {
            return self;
        }
        let noise = rest.noise(options).variance();
        if !is_unsettled(&self.trace, &rest.trace, &rest.found, noise) {
            return rest;
        }
        // A second mode beside the first looks like transients too.
        self.is_unsettled = self.gain_of_second_mode(options) < gain - GAIN_PER_OUTLIER;
        self
    }

    /// The refusal if readings that no circuit describes prevent a valid model.
    pub(crate) const fn outliers_in_the_way(&self) -> Option<Reason> {
        self.too_many
    }

    fn too_many_outliers(&self) -> Option<Reason> {
        let found = outliers::count(&self.trace, &self.found);
        (found > 0).then(|| self.outliers(found))
    }

    /// The refusal for this number of outliers.
    fn outliers(&self, found: usize) -> Reason {
        let readings = self.trace.samples.len();
        Reason::Outliers { found, readings, allowed: readings / READINGS_PER_OUTLIER }
    }

    /// Omits dielectric loss if that causes less error than fitting it.
    fn try_without_loss(&mut self) {
        let lossless = ModelEstimate { g: 0.0, ..self.found.at };
        let plain = self.trace.minimum(lossless, CIRCUIT - 1);
        let gain = self.degrees() * (plain.normal.cost / self.found.normal.cost).ln();
        self.order = ModelOrder::by_loss(gain, self.trace.used().0);
        if gain < LOSS_GAIN_MIN {
            self.found = plain;
        }
    }

    /// Raises the model order if the readings require it, and records the remaining reason to refuse.
    fn climb(&mut self, options: &FitOptions) {
        let alternatives = self.doubts(options);
        let Some(strongest) = strongest(&alternatives) else { return };
        self.reason = Some(strongest.into());
        let mut higher: Vec<_> = alternatives
            .iter()
            .filter(|(found, gain)| *gain > found.cause.gain_needed())
            .filter_map(|(found, _)| Some((self.higher(&found.cause)?, found.cause)))
            .filter(|(model, _)| model.found.end != End::OutOfSteps)
            .map(|(model, cause)| {
                let saved = self.found.normal.cost - model.found.normal.cost;
                (model, cause, self.gain(saved, options))
            })
            .collect();
        higher.sort_by(|a, b| b.2.total_cmp(&a.2));
        let rivals = higher.iter().map(|(_, cause, gain)| (*cause, *gain));
        let rivals: Vec<_> =
            rivals.chain(alternatives.iter().map(|(found, gain)| (found.cause, *gain))).collect();
        let Some((mut higher, cause, gain)) = higher.into_iter().next() else { return };
        let rival = rivals
            .iter()
            .filter(|(other, _)| !other.is_like(&cause))
            .map(|(_, gain)| *gain)
            .fold(0.0, f64::max);
        if gain < rival + clearly(&cause, gain) {
            return;
        }
        higher.reason = self::strongest(&higher.doubts(options)).map(Reason::from);
        let ModelEstimate { extra_term, resonance_hz, c0, c1, extra, .. } = higher.found.at;
        let omega = TAU * resonance_hz;
        let is_absurd = match extra_term {
            ExtraTerm::SecondMode => extra[2] > EQUALS * c1,
            ExtraTerm::Stray => omega * c0 * extra[0].hypot(omega * extra[1]) > STRAY_MAX,
            ExtraTerm::Dispersion => extra[0].abs() > DISPERSION_MAX * c0,
            ExtraTerm::Phase => extra[0].abs() > PHASE_MAX,
            ExtraTerm::Nothing | ExtraTerm::Past | ExtraTerm::Drift => false,
        };
        if is_absurd {
            higher.reason = Some(cause.into());
        }
        *self = higher;
    }

    /// Every alternative with its gain; the model is widened by them.
    fn doubts(&mut self, options: &FitOptions) -> Vec<(Alternative, f64)> {
        let fitted = Fitted::new(&self.trace, &self.found);
        let (alternatives, widened) = self.alternatives(&fitted, options);
        self.widened = widened;
        alternatives
    }

    /// Every alternative with its gain, and the addition to the relative variance. Each alternative
    /// widens the uncertainty in proportion to its probability, which follows from its gain and its prior
    /// probability.
    fn alternatives(
        &self,
        fitted: &Fitted<'_>,
        options: &FitOptions,
    ) -> (Vec<(Alternative, f64)>, f64) {
        let alternatives: Vec<_> = fitted
            .alternatives()
            .into_iter()
            .map(|found| (found, self.gain(found.saved, options)))
            .collect();
        let variance = self.noise(options).variance();
        let widened = alternatives
            .iter()
            .filter(|(found, _)| {
                found.variance
                    < inflation_max(&found.cause, options.near.is_some()) * found.variance_without
            })
            .map(|(found, gain)| found.widening(*gain, variance))
            .fold(self.unsettled(fitted, variance), f64::max);
        (alternatives, widened)
    }

    /// Relative variance of the resonance added by unknown times.
    fn unsettled(&self, fitted: &Fitted<'_>, variance: f64) -> f64 {
        if self.trace.timing == Timing::Unknown {
            unknown_dwell::addition(fitted.dwells(), variance)
        } else {
            0.0
        }
    }

    /// Gain of the best cause other than a second mode, which would fit any single reading.
    fn rival(&self, options: &FitOptions) -> f64 {
        Fitted::new(&self.trace, &self.found)
            .alternatives()
            .into_iter()
            .filter(|found| !matches!(found.cause, Cause::SecondMode { .. } | Cause::Stray))
            .map(|found| {
                let cost = self.found.normal.cost;
                let refit = self.higher(&found.cause);
                let saved = refit.map_or(0.0, |model| cost - model.found.normal.cost);
                self.gain(saved.max(found.saved), options)
            })
            .fold(0.0, f64::max)
    }

    /// Gain of the best second mode.
    fn gain_of_second_mode(&self, options: &FitOptions) -> f64 {
        Fitted::new(&self.trace, &self.found)
            .alternatives()
            .into_iter()
            .filter(|found| matches!(found.cause, Cause::SecondMode { .. }))
            .filter_map(|found| self.higher(&found.cause))
            .map(|model| self.gain(self.found.normal.cost - model.found.normal.cost, options))
            .fold(0.0, f64::max)
    }

    /// The model extended by this cause, if there is one.
    fn higher(&self, cause: &Cause) -> Option<Self> {
        if !self.trace.timing.is_steady() {
            return None;
        }
        let (extra_term, extra, order) = match *cause {
            Cause::Drift => (ExtraTerm::Drift, [0.0; 3], ModelOrder::Drift),
            Cause::Stray => (ExtraTerm::Stray, [0.0; 3], ModelOrder::Stray),
            Cause::Dispersion => (ExtraTerm::Dispersion, [0.0; 3], ModelOrder::Dispersion),
            Cause::AnalyzerPhase => (ExtraTerm::Phase, [0.0; 3], ModelOrder::AnalyzerPhase),
            Cause::SecondMode { frequency_hz, q, .. } => {
                let start = [frequency_hz.ln(), q.ln(), 0.01 * self.found.at.c1];
                (ExtraTerm::SecondMode, start, ModelOrder::SecondMode)
            }
            Cause::Hysteresis | Cause::Nonlinear | Cause::NotSettled | Cause::Shape => return None,
        };
        let trace = self.trace.clone();
        let start = ModelEstimate { extra_term, extra, ..self.found.at };
        let found = trace.minimum(start, CIRCUIT + extra_term.count());
        let Self { known, mains_hz, too_many, is_unsettled, .. } = *self;
        let (widened, reason) = (0.0, None);
        Some(Self { trace, found, order, known, mains_hz, too_many, widened, is_unsettled, reason })
    }

    /// The effect of residual motion, which the settling times make negligible or the readings do not
    /// contain; `None` if they do.
    fn settling(&self, options: &FitOptions) -> Option<Settling> {
        let Some(left) = Fitted::new(&self.trace, &self.found).left_over() else {
            return Some(Settling::default());
        };
        let noise = self.noise(options).deviation();
        let is_negligible =
            left.error.abs() < SETTLED_SIGMAS * noise * left.variance_without.sqrt();
        let sigma = noise * left.size_variance.sqrt();
        let is_absent = left.size.abs() < 3.0 * sigma && 1.0 - left.size > 4.0 * sigma;
        // The drive may not have continued from point to point.
        let any_phase = AnyPhase::of(&self.trace, &self.found, noise * noise);
        (is_negligible || is_absent).then(|| any_phase.map_or_else(Settling::default, Settling::of))
    }

    /// The weighted sum of |r|², bounded below by rounding.
    fn cost(&self) -> f64 {
        self.found.normal.cost.max(self.degrees() * self.known.max(noise::VARIANCE_MIN))
    }

    /// The prior of the noise, updated by the residuals.
    fn noise(&self, options: &FitOptions) -> PooledVariance {
        let (cost, degrees) = self.settled();
        options
            .noise
            .as_ref()
            .map_or_else(PooledVariance::default, PooledVariance::known)
            .with(cost, degrees)
    }

    /// Cost and degrees of freedom of the settled readings; the others have errors in addition to
    /// noise.
    fn settled(&self) -> (f64, f64) {
        if self.trace.weighed_for.is_none() {
            return (self.cost(), self.degrees());
        }
        let (mut cost, mut count) = (0.0, 0_usize);
        self.trace.rows(&self.found.at, |sample, row| {
            if sample.weight > 0.0 && self.trace.has_settled(sample) {
                cost += sample.weight * row.residual.norm_sqr();
                count += 1;
            }
        });
        let degrees = (2 * count).saturating_sub(self.found.free) as f64;
        (if degrees > 0.0 { cost } else { 0.0 }, degrees)
    }

    /// Twice the log-likelihood gained when the cost falls by `saved`.
    fn gain(&self, saved: f64, options: &FitOptions) -> f64 {
        self.noise(options).gain(saved) / self.correlation()
    }

    /// The present result, or `None` if the readings do not determine it.
    pub(crate) fn resonance(&self, options: &FitOptions) -> Option<Resonance> {
        let Minimum { at, normal, free, .. } = &self.found;
        let inverse = Cholesky::new(&normal.matrix, *free, 0.0)?.inverse();
        let farad = self.trace.unit_farad;
        // Rows: (resonance, Q, C0, C1, tan δ) by (ln resonance, ln Q, C0, C1, C0·tan δ).
        let slope = [
            [at.resonance_hz, 0.0, 0.0, 0.0, 0.0],
            [0.0, at.q, 0.0, 0.0, 0.0],
            [0.0, 0.0, farad, 0.0, 0.0],
            [0.0, 0.0, 0.0, farad, 0.0],
            [0.0, 0.0, -at.g / (at.c0 * at.c0), 0.0, 1.0 / at.c0],
        ];
        let leading = std::array::from_fn(|i| std::array::from_fn(|j| inverse[i][j]));
        let spread = Spread {
            covariance: sandwich(&slope, &leading),
            condition: condition(&normal.matrix, &inverse, *free),
            cost: self.cost(),
            neighbours: self.neighbours().max(self.known.max(noise::VARIANCE_MIN)),
            correlation: self.correlation(),
            count: self.trace.used().0,
            degrees: self.degrees(),
            settled: self.settled(),
            widened: self.widened * at.resonance_hz.powi(2),
        };
        let found = Resonance::new(&at.circuit(farad), &spread, self.order, options.noise.as_ref());
        Some(Resonance { mains_hz: self.mains_hz, extra: at.extra(farad), ..found })
    }

    /// Standard deviation of the result from noise alone, Hz.
    pub(crate) fn sigma_by_noise_hz(&self, found: &Resonance) -> f64 {
        found.widened(-self.widened * found.resonance_hz.powi(2)).sigma_hz
    }

    /// Variance of the real or imaginary part of a ten-cycle reading, from the differences of
    /// neighbours: in frequency if all readings have settled, otherwise in time.
    fn neighbours(&self) -> f64 {
        let mut residuals = Vec::new();
        self.trace.rows(&self.found.at, |sample, row| {
            if sample.weight > 0.0 {
                residuals.push((sample.visit.frequency_hz, row.residual, 1.0 / sample.weight));
            }
        });
        if self.trace.timing.is_steady() {
            residuals.sort_by(|a, b| a.0.total_cmp(&b.0));
        }
        let pairs = residuals.len().saturating_sub(1).max(1);
        let sum: f64 =
            residuals.windows(2).map(|r| (r[1].1 - r[0].1).norm_sqr() / (r[0].2 + r[1].2)).sum();
        sum / (2 * pairs) as f64
    }

    /// Twice the log-likelihood gained over the best capacitor with loss. The readings that speak most for
    /// a resonance do not count, because a few wrong readings side by side resemble one.
    pub(crate) fn gain_over_capacitor(&self) -> f64 {
        let p = |sample: &Sample| sample.impedance * sample.visit.frequency_hz;
        let (mut p_sum, mut squares) = (Complex64::ZERO, 0.0);
        for sample in self.trace.samples.iter().filter(|sample| sample.weight > 0.0) {
            p_sum += sample.weight * p(sample);
            squares += sample.weight * p(sample).norm_sqr();
        }
        let capacitor = p_sum.conj() / squares;
        let mut costs = Vec::with_capacity(self.trace.samples.len());
        self.trace.rows(&self.found.at, |sample, row| {
            let with = sample.weight * row.residual.norm_sqr();
            let without = sample.weight * (1.0 - capacitor * p(sample)).norm_sqr();
            costs.push((with, without));
        });
        costs.sort_unstable_by(|a, b| (b.1 - b.0).total_cmp(&(a.1 - a.0)));
        let rest = costs.iter().skip(STRONGEST);
        let [with, without] = rest.fold([0.0; 2], |sum, cost| [sum[0] + cost.0, sum[1] + cost.1]);
        self.degrees() * (without / with).ln()
    }
}

/// The accepted cause, if there is one; a wrong shape only if no other cause explains it.
fn strongest(alternatives: &[(Alternative, f64)]) -> Option<Cause> {
    alternatives
        .iter()
        .map(|(found, gain)| (found.cause, gain - found.cause.gain_needed()))
        .filter(|(_, more)| *more > 0.0)
        .max_by(|a, b| {
            let is_known = |cause| cause != Cause::Shape;
            is_known(a.0).cmp(&is_known(b.0)).then(a.1.total_cmp(&b.1))
        })
        .map(|(cause, _)| cause)
}
