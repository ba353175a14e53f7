//! Alternative explanations of the readings.
//!
//! Each fault of a sweep leaves a characteristic pattern in the residuals. A pattern is fitted to them
//! together with the circuit, to first order. The gain in likelihood shows whether the fault is
//! present, and the shift of the resonance whether it is relevant.

use std::f64::consts::{PI, TAU};

use num_complex::Complex64;

use crate::{
    Reason,
    circuit::ringup::{Motion, Visit, plain},
    circuit::trace::{ExtraTerm, Minimum, ModelEstimate, Row, Sample, Timing, Trace},
    diagnose::tangents::{MOST, Products, Tangents, mode_unit},
    diagnose::unknown_dwell::{self, DWELLS},
};

/// A possible fault of a sweep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Cause {
    /// The resonance moves with time.
    Drift,
    /// The resonance depends on the direction of the sweep.
    Hysteresis,
    /// Resonance and damping change with the amplitude.
    Nonlinear,
    /// The residual transient of the previous point is still present.
    NotSettled,
    /// Another resonance at this frequency, with this quality factor; `is_near` if it overlaps the
    /// first.
    SecondMode { frequency_hz: f64, q: f64, is_near: bool },
    /// The peak does not look like a single resonance; the cause is unknown.
    Shape,
    /// A stray impedance in series.
    Stray,
    /// The static capacitance changes with the frequency or with time.
    Dispersion,
    /// The analyzer has a phase error.
    AnalyzerPhase,
}

impl Cause {
    /// Whether both causes are of the same kind.
    pub(crate) fn is_like(&self, other: &Self) -> bool {
        std::mem::discriminant(self) == std::mem::discriminant(other)
    }

    /// Twice the log-likelihood that a cause must gain to be accepted; chance reaches it once in ten
    /// thousand sweeps. A second mode away from the first is tried at many places.
    pub(crate) const fn gain_needed(&self) -> f64 {
        match self {
            Self::Drift | Self::Hysteresis => 16.0,
            Self::Nonlinear
            | Self::NotSettled
            | Self::Stray
            | Self::Dispersion
            | Self::AnalyzerPhase
            | Self::SecondMode { is_near: true, .. } => 19.0,
            Self::Shape => 22.0,
            Self::SecondMode { is_near: false, .. } => 24.0,
        }
    }

    /// Distance below the accepted gain at which a cause is as likely present as absent. Every analyzer and
    /// cable has some phase error and some impedance in series. A second mode of a few per cent within a
    /// linewidth resembles another circuit, so that it gains little and moves the resonance far.
    const fn even_below(&self) -> f64 {
        match self {
            Self::AnalyzerPhase | Self::Stray | Self::SecondMode { is_near: true, .. } => 12.0,
            _ => 4.0,
        }
    }
}

impl From<Cause> for Reason {
    fn from(cause: Cause) -> Self {
        match cause {
            Cause::Drift => Self::Drift,
            Cause::Hysteresis => Self::Hysteretic,
            Cause::Nonlinear => Self::Nonlinear,
            Cause::NotSettled => Self::NotSettled,
            Cause::SecondMode { frequency_hz, .. } => Self::SecondMode { near_hz: frequency_hz },
            Cause::Stray => Self::Stray,
            Cause::Dispersion => Self::Dispersion,
            Cause::AnalyzerPhase => Self::AnalyzerPhase,
            Cause::Shape => Self::Distorted,
        }
    }
}

/// The effect of a cause on a fit.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Alternative {
    pub(crate) cause: Cause,
    /// Decrease of the cost.
    pub(crate) saved: f64,
    /// Change of the logarithm of the resonance.
    pub(crate) shift: f64,
    /// Variance of the logarithm of the resonance for noise of variance 1, with the cause as an
    /// unknown.
    pub(crate) variance: f64,
    /// That variance without the cause.
    pub(crate) variance_without: f64,
    /// Size of the first pattern.
    pub(crate) size: f64,
    /// Its variance for noise of variance 1.
    pub(crate) size_variance: f64,
    /// Error of the logarithm of the resonance if a first pattern of size 1 is omitted.
    pub(crate) error: f64,
}

impl Alternative {
    /// Addition to the relative variance of the resonance: the effect of the cause times its
    /// probability, for this gain and this variance of the noise.
    pub(crate) fn widening(&self, gain: f64, variance: f64) -> f64 {
        let even = self.cause.gain_needed() - self.cause.even_below();
        let probability = 1.0 / (1.0 + (0.5 * (even - gain)).exp());
        let more = variance * (self.variance - self.variance_without);
        probability * (self.shift * self.shift + more)
    }
}

/// Largest factor by which a possible cause may raise the variance and still be considered. Above it
/// these readings hardly distinguish the cause from the circuit.
pub(crate) fn inflation_max(cause: &Cause, is_planned: bool) -> f64 {
    match cause {
        // A plan repeats few frequencies and would never end if causes that these cannot distinguish
        // widened its uncertainty.
        _ if is_planned => 4.0,
        // In a sweep in one direction nearly every cause resembles drift, and any value that the
        // resonance had is valid.
        Cause::Drift | Cause::Hysteresis => 4.0,
        _ => 100.0,
    }
}

/// A fit to be compared with alternatives.
#[derive(Debug)]
pub(crate) struct Fitted<'a> {
    pub(crate) trace: &'a Trace,
    pub(crate) at: ModelEstimate,
    rows: Vec<(usize, Row)>,
    /// The steady-state motional admittance of each sample; `admittance` is the total.
    motional: Vec<Complex64>,
    admittance: Vec<Complex64>,
    /// `None` if the unknowns cannot be distinguished.
    tangents: Option<Tangents>,
}

/// Time constants after which less than 1/20 000 of any motion is left.
const SETTLED_TIME_CONSTANTS: f64 = 10.0;
/// Number of trial frequencies of a second mode per linewidth of the first.
const MODES_PER_WIDTH: f64 = 2.0;
/// Linewidths from the first within which a second mode overlaps it.
pub(super) const NEAR: f64 = 1.5;
pub(super) const MODES_MAX: usize = 240;
/// Range of a second mode beyond the readings, in spans; its tail still affects them.
pub(super) const BEYOND: f64 = 0.4;

impl<'a> Fitted<'a> {
    pub(crate) fn new(trace: &'a Trace, found: &Minimum) -> Self {
        Self::at(trace, found.at, found.free)
    }

    /// The fit with this result and `free` unknowns.
    pub(crate) fn at(trace: &'a Trace, at: ModelEstimate, free: usize) -> Self {
        let mut rows = Vec::with_capacity(trace.samples.len());
        let mut motional = Vec::with_capacity(trace.samples.len());
        let mut admittance = Vec::with_capacity(trace.samples.len());
        let mut index = 0;
        trace.rows(&at, |sample, row| {
            // Residual motion can resemble any pattern.
            if sample.weight > 0.0 && trace.has_settled(sample) {
                rows.push((index, row));
            }
            let circuit = at.circuit(1.0);
            let all = circuit.admittance_siemens(sample.visit.frequency_hz);
            let fixed = crate::Circuit { c1_farad: 0.0, ..circuit };
            motional.push(all - fixed.admittance_siemens(sample.visit.frequency_hz));
            admittance.push(all);
            index += 1;
        });
        let weighted = rows.iter().map(|(index, row)| (trace.samples[*index].weight, *row));
        let tangents = Tangents::new(weighted, free);
        Self { trace, at, rows, motional, admittance, tangents }
    }

    /// Every cause that can be distinguished from the circuit.
    pub(crate) fn alternatives(&self) -> Vec<Alternative> {
        let mut found = Vec::new();
        let mut consider = |alternative: Option<Alternative>| found.extend(alternative);
        if self.at.extra_term != ExtraTerm::Drift {
            let pattern =
                |i: usize, row: &Row| [row.slopes[0] * self.sample(i).when, NOTHING, NOTHING];
            consider(self.alternative(Cause::Drift, 1, pattern));
        }
        if let Some(directions) = self.directions() {
            let pattern = |i: usize, row: &Row| [row.slopes[0] * directions[i], NOTHING, NOTHING];
            consider(self.alternative(Cause::Hysteresis, 1, pattern));
        }
        let largest = self.motional.iter().map(|m| m.norm()).fold(f64::MIN_POSITIVE, f64::max);
        let size = |i: usize| self.motional[i].norm() / largest;
        let cubic = |i: usize, row: &Row| [row.slopes[0] * size(i).powi(2), NOTHING, NOTHING];
        consider(self.alternative(Cause::Nonlinear, 1, cubic));
        let ferroelastic =
            |i: usize, row: &Row| [row.slopes[0] * size(i), row.slopes[1] * size(i), NOTHING];
        consider(self.alternative(Cause::Nonlinear, 2, ferroelastic));
        if self.trace.timing.is_steady() {
            if self.trace.weighed_for.is_none() && self.may_not_have_settled() {
                consider(self.not_settled());
            }
            if self.at.extra_term != ExtraTerm::SecondMode {
                for mode in self.second_modes() {
                    consider(mode);
                }
            }
            consider(self.alternative(Cause::Shape, 3, |i, row| self.shape(i, row)));
        }
        if self.at.extra_term != ExtraTerm::Stray {
            let pattern = |i: usize, _: &Row| {
                let omega = TAU * self.sample(i).visit.frequency_hz;
                [self.admittance[i], self.admittance[i] * Complex64::new(0.0, omega), NOTHING]
            };
            consider(self.alternative(Cause::Stray, 2, pattern));
        }
        if self.at.extra_term != ExtraTerm::Dispersion {
            let pattern = |i: usize, _: &Row| {
                let frequency_hz = self.sample(i).visit.frequency_hz;
                let logarithm = (frequency_hz / self.at.resonance_hz).ln();
                [logarithm * mode_unit(frequency_hz, self.admittance[i]), NOTHING, NOTHING]
            };
            consider(self.alternative(Cause::Dispersion, 1, pattern));
        }
        if self.at.extra_term != ExtraTerm::Phase {
            let turned = |_, _: &Row| [Complex64::I, NOTHING, NOTHING];
            consider(self.alternative(Cause::AnalyzerPhase, 1, turned));
        }
        found
    }

    /// The residual motion at each point after the settling time, with the drive continuing from point
    /// to point. `None` if the settling is unknown.
    pub(crate) fn left_over(&self) -> Option<Alternative> {
        let may_matter = self.trace.timing == Timing::Waited && self.trace.weighed_for.is_none();
        may_matter.then(|| self.after(|sample| sample.visit)).flatten()
    }

    fn may_not_have_settled(&self) -> bool {
        let settle_s = self.trace.samples.iter().map(|sample| sample.visit.settle_s);
        let shortest_s = settle_s.fold(f64::INFINITY, f64::min);
        self.trace.timing == Timing::Unknown
            || shortest_s < SETTLED_TIME_CONSTANTS * self.time_constant_s()
    }

    pub(super) fn time_constant_s(&self) -> f64 {
        self.at.q / (PI * self.at.resonance_hz)
    }

    /// The most likely unsettled motion if the dwell at each point is unknown.
    fn not_settled(&self) -> Option<Alternative> {
        let pattern = |i: usize, _: &Row| {
            let before = if i == 0 { NOTHING } else { self.motional[i - 1] };
            let left = (before - self.motional[i]) / self.admittance[i];
            [left, left * Complex64::I, NOTHING]
        };
        let mut best = self.alternative(Cause::NotSettled, 2, pattern);
        for trial in self.dwells() {
            let is_better = best.is_none_or(|best| best.saved < trial.saved);
            if trial.size > 0.0 && is_better {
                best = Some(trial);
            }
        }
        best
    }

    /// The residual transient of a motion of size 1 after each possible dwell.
    pub(crate) fn dwells(&self) -> impl Iterator<Item = Alternative> + '_ {
        let time_constant_s = self.time_constant_s();
        let visit =
            move |dwell, sample: &Sample| unknown_dwell::visit(dwell, time_constant_s, sample);
        DWELLS.into_iter().filter_map(move |dwell| self.after(|sample| visit(dwell, sample)))
    }

    /// The pattern of a drive that continues from visit to visit.
    fn after(&self, visit: impl Fn(&Sample) -> Visit) -> Option<Alternative> {
        let left = self.left_after(visit);
        self.alternative(Cause::NotSettled, 1, |i, _| [left[i], NOTHING, NOTHING])
    }

    /// The residual transient of each reading, relative to the reading, if the drive continues from
    /// visit to visit.
    pub(super) fn left_after(&self, visit: impl Fn(&Sample) -> Visit) -> Vec<Complex64> {
        let mut motion = Motion::at_rest(plain(self.at.resonance_hz, self.at.q));
        let mut past = NOTHING;
        let mut left = |sample: &Sample, motional: &Complex64, admittance: &Complex64| {
            let response = self.at.c1 * motion.visit(&visit(sample), &mut past).motional;
            (response - motional) / admittance
        };
        let steady = self.motional.iter().zip(&self.admittance);
        let samples = self.trace.samples.iter().zip(steady);
        samples.map(|(sample, (motional, admittance))| left(sample, motional, admittance)).collect()
    }

    fn sample(&self, index: usize) -> &Sample {
        &self.trace.samples[index]
    }

    /// Whether the frequency rose (1) or fell (−1) before each sample; `None` unless there are long
    /// runs in both directions.
    fn directions(&self) -> Option<Vec<f64>> {
        let mut directions = vec![0.0; self.trace.samples.len()];
        let (mut up, mut down, mut turns) = (0_usize, 0_usize, 0_usize);
        for i in 1..directions.len() {
            let step = self.sample(i).visit.frequency_hz - self.sample(i - 1).visit.frequency_hz;
            directions[i] = if step == 0.0 { directions[i - 1] } else { step.signum() };
            up += usize::from(directions[i] > 0.0);
            down += usize::from(directions[i] < 0.0);
            turns += usize::from(directions[i] * directions[i - 1] < 0.0);
        }
        let is_sweep = 8 * turns < directions.len() && 4 * up.min(down) >= directions.len() - 1;
        is_sweep.then_some(directions)
    }

    /// The first-order deviations of a peak from a single resonance, apart from changes of the circuit:
    /// it is rotated, or narrower and wider at once.
    fn shape(&self, index: usize, row: &Row) -> [Complex64; MOST] {
        let omega = TAU * self.sample(index).visit.frequency_hz;
        let height = Complex64::new(0.0, omega * self.at.c1 * self.at.q);
        let response = self.motional[index] / height;
        let narrow = row.slopes[3] * response * response;
        [row.slopes[3] * Complex64::I, narrow, narrow * Complex64::I]
    }

    /// The second modes with the largest gain, one near the first and one elsewhere, from a grid of
    /// frequencies and quality factors.
    fn second_modes(&self) -> [Option<Alternative>; 2] {
        let frequencies = self.rows.iter().map(|&(i, _)| self.sample(i).visit.frequency_hz);
        let (low, high) =
            frequencies.fold((f64::INFINITY, 0.0_f64), |(a, b), f| (a.min(f), b.max(f)));
        let Some(tangents) = self.tangents.as_ref().filter(|_| low < high) else {
            return [None; 2];
        };
        let blocks = tangents.mode_blocks(|n| {
            let index = self.rows[n].0;
            let frequency_hz = self.sample(index).visit.frequency_hz;
            (frequency_hz, mode_unit(frequency_hz, self.admittance[index]))
        });
        let beyond = BEYOND * (high - low);
        let (low, high) = (low - beyond, high + beyond);
        let width = self.at.resonance_hz / self.at.q;
        let places = ((high - low) / width * MODES_PER_WIDTH).ceil().clamp(8.0, MODES_MAX as f64);
        let mut best: [Option<Alternative>; 2] = [None; 2];
        for q in [0.5 * self.at.q, self.at.q, 3.0 * self.at.q] {
            let mut frequency_hz = low;
            while frequency_hz <= high {
                let is_near = (frequency_hz - self.at.resonance_hz).abs() < NEAR * width;
                let best = &mut best[usize::from(is_near)];
                let cause = Cause::SecondMode { frequency_hz, q, is_near };
                if let Some(found) = tangents.second_mode(&blocks, cause)
                    && found.size > 0.0
                    && best.is_none_or(|best| best.saved < found.saved)
                {
                    *best = Some(found);
                }
                frequency_hz += (high - low) / places;
            }
        }
        best
    }

    /// Fits `count` patterns together with the circuit.
    fn alternative(
        &self,
        cause: Cause,
        count: usize,
        pattern: impl Fn(usize, &Row) -> [Complex64; MOST],
    ) -> Option<Alternative> {
        let tangents = self.tangents.as_ref()?;
        let mut products = Products::default();
        for (n, (index, row)) in self.rows.iter().enumerate() {
            tangents.add(n, &pattern(*index, row)[..count], &mut products);
        }
        tangents.alternative(cause, count, &products)
    }
}

const NOTHING: Complex64 = Complex64::ZERO;
