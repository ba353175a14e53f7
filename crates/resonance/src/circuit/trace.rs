//! Readings in the order of measurement, and the maximum-likelihood fit of any model to them.
//!
//! [`crate::circuit::kernel`] is fast and supports one model; this module supports all: settled
//! readings, readings during the ring-up, and extra terms beyond the five parameters of a circuit.
//! Every model returns a [`Row`] for each reading, and all other code works on rows.

use std::f64::consts::TAU;

use num_complex::Complex64;
use rig_model::Reading;

use super::points::weight;
use crate::{
    Circuit, Extra,
    circuit::dual::{Dual, Value},
    circuit::residual_transient::ResidualTransient,
    circuit::ringup::{Motion, Response, Visit, with_slopes},
    numeric::descent::{Descent, End, Normal, Step},
};

/// Number of unknowns: ln resonance, ln Q, C0, C1, C0·tan δ, and up to three of an extra term.
pub(crate) const UNKNOWNS: usize = 8;
/// Number of unknowns of the circuit.
pub(crate) const CIRCUIT: usize = 5;

/// Knowledge of the times of the readings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Timing {
    /// The times are unknown: each reading may or may not have settled.
    Unknown,
    /// The settling and integration times are known. The drive between the points is unknown, so that
    /// readings must have settled.
    #[default]
    Waited,
    /// The times are exact, and the drive continues from one point to the next without phase jumps.
    /// Readings need not have settled.
    Exact(Past),
    /// The start of each reading is known to 1 ms, and the phase of the drive after a change of
    /// frequency is unknown. The free decay is fitted, and readings need not have settled.
    AnyPhase,
}

impl Timing {
    /// Whether readings are modelled as settled.
    pub(crate) const fn is_steady(self) -> bool {
        !matches!(self, Self::Exact(_))
    }
}

/// Knowledge of the sensor's motion before the first reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Past {
    /// The sensor is at rest, and the drive starts at its crest with the first point.
    Rest,
    /// The motion is unknown.
    #[default]
    Unknown,
}

/// An extra term of a model, beyond the circuit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ExtraTerm {
    Nothing,
    /// Free motion from before the first reading: two amplitudes.
    Past,
    /// Linear drift of the resonance: its relative change from the middle to the end.
    Drift,
    /// A second branch in parallel: ln frequency, ln Q, C.
    SecondMode,
    /// Resistance and inductance in series.
    Stray,
    /// Slope of C0 by the logarithm of the frequency; C0 is that at the resonance.
    Dispersion,
    /// Phase error of the analyzer, rad.
    Phase,
}

impl ExtraTerm {
    /// Number of unknowns that it adds.
    pub(crate) const fn count(self) -> usize {
        match self {
            Self::Nothing => 0,
            Self::Drift | Self::Dispersion | Self::Phase => 1,
            Self::Past | Self::Stray => 2,
            Self::SecondMode => 3,
        }
    }
}

/// A reading and its visit.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    pub(crate) visit: Visit,
    /// Measured impedance times the unit of capacitance, s.
    pub(crate) impedance: Complex64,
    /// Cycles, in units of ten.
    pub(crate) length: f64,
    /// The variance that the residual motion adds to each part of the relative error.
    pub(crate) unsettled: f64,
    /// Weight of the reading: `length` if it has settled, less if it has not, 0 if it is excluded.
    pub(crate) weight: f64,
    /// Time of the middle of the integration, from −1 for the first reading to 1 for the last.
    pub(crate) when: f64,
}

/// A model and its parameters. Capacitances are in units of the [`Trace`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ModelEstimate {
    pub(crate) resonance_hz: f64,
    pub(crate) q: f64,
    pub(crate) c0: f64,
    pub(crate) c1: f64,
    pub(crate) g: f64,
    pub(crate) extra_term: ExtraTerm,
    pub(crate) extra: [f64; 3],
}

/// The residual of one reading and its derivatives.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row {
    /// Approximately ln Z(measured)/Z(model).
    pub(crate) residual: Complex64,
    /// Its derivative with respect to each unknown.
    pub(crate) slopes: [Complex64; UNKNOWNS],
}

/// Readings in the order of measurement.
#[derive(Debug, Clone, Default)]
pub(crate) struct Trace {
    pub(crate) timing: Timing,
    pub(crate) samples: Vec<Sample>,
    /// The variance that rounding and pick-up add to each part of the relative error of each sample;
    /// empty if there is neither.
    pub(crate) added: Vec<f64>,
    /// Unit of capacitance, F, in which capacitances are near 1.
    pub(crate) unit_farad: f64,
    /// The noise variance at ten cycles for which unsettled readings are down-weighted; `None` if they
    /// are not.
    pub(crate) weighed_for: Option<f64>,
    last: Option<Reading>,
}

/// Residual motion is negligible below this fraction of the noise variance.
const SETTLED_EXCESS: f64 = 0.25;
/// Largest gap due to rounding, s; the clock has a resolution of 1 µs.
const CLOCK_S: f64 = 2.5e-6;

impl Trace {
    pub(crate) fn new(timing: Timing, unit_farad: f64) -> Self {
        let (samples, added) = (Vec::new(), Vec::new());
        Self { timing, samples, added, unit_farad, weighed_for: None, last: None }
    }

    /// Creates a trace of these readings.
    pub(crate) fn of(readings: &[Reading], timing: Timing, unit_farad: f64) -> Self {
        let mut trace = Self::new(timing, unit_farad);
        for reading in readings {
            trace.push(reading);
        }
        trace.set_times(readings);
        trace
    }

    /// Adds a reading. Its visit lasts until the next one starts.
    pub(crate) fn push(&mut self, reading: &Reading) {
        if let (Some(previous), Some(last)) = (&self.last, self.samples.last_mut()) {
            let stay = reading.started.since(previous.started).as_secs_f64();
            let rest = stay - previous.settle_s - previous.integration_s;
            last.visit.rest_s = if rest > CLOCK_S { rest } else { 0.0 };
        }
        let mut settle_s = reading.settle_s;
        if let Some(previous) = self.last.filter(|previous| is_same_stay(previous, reading)) {
            // The recorded settling time starts when the frequency was set.
            settle_s -= previous.settle_s + previous.integration_s;
        }
        let impedance = complex_ohm(reading);
        let length = weight(reading);
        self.samples.push(Sample {
            visit: Visit {
                frequency_hz: reading.frequency_hz,
                settle_s: settle_s.max(0.0),
                integration_s: reading.integration_s,
                rest_s: 0.0,
            },
            impedance: impedance.map_or(Complex64::ZERO, |impedance| impedance * self.unit_farad),
            length,
            unsettled: 0.0,
            weight: if impedance.is_some() { length } else { 0.0 },
            when: 0.0,
        });
        self.last = Some(*reading);
    }

    /// Sets the times of the readings; by their order if the clock stood still.
    fn set_times(&mut self, readings: &[Reading]) {
        let (Some(first), Some(last)) = (readings.first(), readings.last()) else { return };
        let earliest_s = middle_s(first, first);
        let span_s = middle_s(last, first) - earliest_s;
        let has_times = first.started < last.started;
        let steps = (readings.len() - 1).max(1) as f64;
        for (i, (sample, reading)) in self.samples.iter_mut().zip(readings).enumerate() {
            let part = if has_times {
                (middle_s(reading, first) - earliest_s) / span_s
            } else {
                i as f64 / steps
            };
            sample.when = 2.0 * part - 1.0;
        }
    }

    /// Weights each reading by its noise, with this variance at ten cycles, its added variance, and its
    /// residual motion. Returns the logarithm of the determinant of the covariance of the readings for
    /// noise of variance 1.
    pub(crate) fn weigh(&mut self, variance: f64) -> f64 {
        let mut ln_determinant = 0.0;
        let added = self.added.iter().copied().chain(std::iter::repeat(0.0));
        for (sample, added) in self.samples.iter_mut().zip(added) {
            if sample.weight > 0.0 {
                let more = (added + sample.unsettled) / variance;
                sample.weight = 1.0 / (1.0 / sample.length + more);
                ln_determinant -= 2.0 * sample.weight.ln();
            }
        }
        ln_determinant
    }

    /// Weights every reading by how far it has settled for this circuit; otherwise like
    /// [`Self::weigh`].
    pub(crate) fn weigh_settling(&mut self, at: &ModelEstimate, variance: f64) -> f64 {
        let transients = self.transients(at, |sample| sample.visit);
        for (sample, unsettled) in self.samples.iter_mut().zip(transients) {
            sample.unsettled = unsettled;
        }
        self.weighed_for = Some(variance);
        self.weigh(variance)
    }

    /// The variance that the residual transient of a drive of any phase adds to each part of the
    /// relative error of each reading of this circuit, for these visits.
    pub(crate) fn transients(
        &self,
        at: &ModelEstimate,
        visit: impl Fn(&Sample) -> Visit,
    ) -> Vec<f64> {
        let mut residual = ResidualTransient::new(at.resonance_hz, at.q);
        let circuit = at.circuit(1.0);
        let of_sample = |sample: &Sample| {
            let admittance = circuit.admittance_siemens(sample.visit.frequency_hz).norm_sqr();
            at.c1 * at.c1 * residual.visit(&visit(sample)) / admittance
        };
        self.samples.iter().map(of_sample).collect()
    }

    /// Whether a reading has settled within its noise.
    pub(crate) fn has_settled(&self, sample: &Sample) -> bool {
        let excess = |variance| sample.length * sample.unsettled / variance;
        self.weighed_for.is_none_or(|variance| excess(variance) < SETTLED_EXCESS)
    }

    /// The extra term that a model of these readings needs.
    pub(crate) fn extra_term(&self) -> ExtraTerm {
        match self.timing {
            Timing::Exact(Past::Unknown) => ExtraTerm::Past,
            _ => ExtraTerm::Nothing,
        }
    }

    /// Number of readings in use, and the sum of their weights.
    pub(crate) fn used(&self) -> (usize, f64) {
        self.samples
            .iter()
            .filter(|sample| sample.weight > 0.0)
            .fold((0, 0.0), |(count, weight), sample| (count + 1, weight + sample.weight))
    }

    /// Passes the row of every reading to `each`, including excluded ones.
    pub(crate) fn rows(&self, at: &ModelEstimate, mut each: impl FnMut(&Sample, Row)) {
        self.walk(at, |sample, response| each(sample, row(at, sample, response)));
    }

    fn walk(&self, at: &ModelEstimate, mut each: impl FnMut(&Sample, &Response<Dual>)) {
        let mut motion = Motion::at_rest(with_slopes(at.resonance_hz, at.q));
        let mut past = Dual::constant(Complex64::ONE);
        for sample in &self.samples {
            let response = match self.timing {
                Timing::Exact(_) => motion.visit(&sample.visit, &mut past),
                Timing::Waited | Timing::Unknown | Timing::AnyPhase => steady(at, sample),
            };
            each(sample, &response);
        }
    }

    /// Passes the row of every reading to `each`, as if it agreed with the model.
    pub(crate) fn ideal_rows(&self, at: &ModelEstimate, mut each: impl FnMut(Row)) {
        self.walk(at, |sample, response| each(ideal_row(at, sample, response)));
    }

    /// The normal equations.
    pub(crate) fn normal(&self, at: &ModelEstimate) -> Normal<UNKNOWNS> {
        let mut normal = Normal::default();
        self.rows(at, |sample, row| {
            match at.extra_term {
                _ if sample.weight <= 0.0 => {}
                // Zeros would take half of the planning time.
                ExtraTerm::Nothing => {
                    normal.add_leading::<CIRCUIT>(row.residual, &row.slopes, sample.weight);
                }
                _ => normal.add(row.residual, &row.slopes, sample.weight),
            }
        });
        normal
    }

    /// The most likely model of this kind near `start`.
    pub(crate) fn minimum(&self, start: ModelEstimate, free: usize) -> Minimum {
        let (at, normal, end) = self.solve_with(start, free, |_, _| ());
        Minimum { at, normal, end, free }
    }

    /// The most likely model of this kind near `start`, with a term added to the normal equations.
    pub(crate) fn solve_with(
        &self,
        start: ModelEstimate,
        free: usize,
        add: impl Fn(&ModelEstimate, &mut Normal<UNKNOWNS>),
    ) -> (ModelEstimate, Normal<UNKNOWNS>, End) {
        let (count, weight) = self.used();
        Descent { count, weight, free }.run(start, |at| {
            let mut normal = self.normal(at);
            add(at, &mut normal);
            normal
        })
    }
}

/// A model at a minimum of the cost.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Minimum {
    pub(crate) at: ModelEstimate,
    /// The normal equations at the minimum.
    pub(crate) normal: Normal<UNKNOWNS>,
    pub(crate) end: End,
    /// Number of free unknowns.
    pub(crate) free: usize,
}

/// The impedance of a reading, ohm, if there is one.
pub(crate) fn complex_ohm(reading: &Reading) -> Option<Complex64> {
    reading.impedance().map(|one| Complex64::new(one.resistance_ohm, one.reactance_ohm))
}

/// Middle of the integration of a reading, s after the frequency of the first one was set.
pub(crate) fn middle_s(reading: &Reading, first: &Reading) -> f64 {
    let started_s = reading.started.since(first.started).as_secs_f64();
    started_s + reading.settle_s + 0.5 * reading.integration_s
}

/// Whether the frequency stayed the same between two readings.
#[expect(clippy::float_cmp, reason = "it is the same number where the frequency stayed")]
fn is_same_stay(previous: &Reading, reading: &Reading) -> bool {
    previous.frequency_hz == reading.frequency_hz && previous.started == reading.started
}

/// The steady-state response.
fn steady(at: &ModelEstimate, sample: &Sample) -> Response<Dual> {
    let drift = if at.extra_term == ExtraTerm::Drift { at.extra[0] * sample.when } else { 0.0 };
    let resonance_hz = at.resonance_hz * (1.0 + drift);
    let zero = Dual::constant(Complex64::ZERO);
    let motional = branch(resonance_hz, at.q, sample.visit.frequency_hz);
    Response { motional, past: [zero; 2] }
}

/// jω/D of a branch, with its derivatives with respect to the logarithms of frequency and quality
/// factor.
fn branch(resonance_hz: f64, q: f64, frequency_hz: f64) -> Dual {
    let u = frequency_hz / resonance_hz;
    let response = 1.0 / Complex64::new(1.0 - u * u, u / q);
    let value = Complex64::new(0.0, TAU * frequency_hz) * response;
    let by = -value * response;
    Dual { value, by: [by * Complex64::new(2.0 * u * u, -u / q), by * Complex64::new(0.0, -u / q)] }
}

/// The row of a reading.
///
/// The residual is 2(x − 1)/(x + 1) with x = Z(measured)/Z(model), which equals ln x up to third order.
/// The plain x − 1 would carry the noise into its derivatives, so that a fit together with a noise-free
/// pattern would fit the noise.
fn row(at: &ModelEstimate, sample: &Sample, response: &Response<Dual>) -> Row {
    let Model { admittance, slopes, series, turn } = model(at, sample, response);
    let x = (sample.impedance - series) * admittance * turn;
    let more = 1.0 / (x + 1.0);
    let slope = 4.0 * x * more * more;
    Row { residual: 2.0 * (x - 1.0) * more, slopes: slopes.map(|by| by * slope) }
}

/// The row of a reading that agrees with the model.
pub(crate) fn ideal_row(at: &ModelEstimate, sample: &Sample, response: &Response<Dual>) -> Row {
    Row { residual: Complex64::ZERO, slopes: model(at, sample, response).slopes }
}

/// The prediction of a model for a reading.
struct Model {
    admittance: Complex64,
    /// Derivatives of the logarithm of Z(measured)/Z(model).
    slopes: [Complex64; UNKNOWNS],
    /// The stray impedance in series.
    series: Complex64,
    /// The rotation that corrects the phase of the measured impedance.
    turn: Complex64,
}

fn model(at: &ModelEstimate, sample: &Sample, response: &Response<Dual>) -> Model {
    let omega = TAU * sample.visit.frequency_hz;
    let mut admittance = Complex64::new(at.g, at.c0) * omega + at.c1 * response.motional.value;
    let mut by = [at.c1 * response.motional.by[0], at.c1 * response.motional.by[1]];
    let mut more = [Complex64::ZERO; UNKNOWNS - CIRCUIT];
    let mut series = Complex64::ZERO;
    let mut turn = Complex64::ONE;
    match at.extra_term {
        ExtraTerm::Nothing => {}
        ExtraTerm::Past => {
            for (i, part) in response.past.iter().enumerate() {
                admittance += at.extra[i] * part.value;
                by[0] += at.extra[i] * part.by[0];
                by[1] += at.extra[i] * part.by[1];
                more[i] = part.value;
            }
        }
        ExtraTerm::Drift => more[0] = by[0] * (sample.when / (1.0 + at.extra[0] * sample.when)),
        ExtraTerm::SecondMode => {
            let [ln_hz, ln_q, c] = at.extra;
            let second = branch(ln_hz.exp(), ln_q.exp(), sample.visit.frequency_hz);
            admittance += c * second.value;
            more = [c * second.by[0], c * second.by[1], second.value];
        }
        ExtraTerm::Stray => {
            series = Complex64::new(at.extra[0], omega * at.extra[1]);
            // Derivatives of ln (Z − Zs)Y, where Z − Zs is 1/Y.
            let squared = admittance * admittance;
            more[0] = -squared;
            more[1] = -squared * Complex64::new(0.0, omega);
        }
        ExtraTerm::Dispersion => {
            let j_omega = Complex64::new(0.0, omega);
            let logarithm = (sample.visit.frequency_hz / at.resonance_hz).ln();
            admittance += at.extra[0] * logarithm * j_omega;
            by[0] -= at.extra[0] * j_omega;
            more[0] = logarithm * j_omega;
        }
        ExtraTerm::Phase => {
            turn = Complex64::cis(-at.extra[0]);
            more[0] = -Complex64::I * admittance;
        }
    }
    let static_by = [Complex64::new(0.0, omega), response.motional.value, Complex64::from(omega)];
    let [by_c0, by_c1, by_g] = static_by;
    let inverse = 1.0 / admittance;
    let slopes = [by[0], by[1], by_c0, by_c1, by_g, more[0], more[1], more[2]];
    Model { admittance, slopes: slopes.map(|by| by * inverse), series, turn }
}

impl ModelEstimate {
    /// A circuit without an extra term.
    pub(crate) fn of(circuit: &Circuit, unit_farad: f64) -> Self {
        let c0 = circuit.c0_farad / unit_farad;
        Self {
            resonance_hz: circuit.resonance_hz,
            q: circuit.q,
            c0,
            c1: circuit.c1_farad / unit_farad,
            g: circuit.loss_tangent * c0,
            extra_term: ExtraTerm::Nothing,
            extra: [0.0; 3],
        }
    }

    /// The extra term in the units of a result; that of the motion before the first reading is none.
    pub(crate) fn extra(&self, unit_farad: f64) -> Option<Extra> {
        let [first, second, third] = self.extra;
        match self.extra_term {
            ExtraTerm::Nothing | ExtraTerm::Past => None,
            ExtraTerm::Drift => Some(Extra::Drift { change: first }),
            ExtraTerm::Stray => Some(Extra::Stray {
                resistance_ohm: first / unit_farad,
                inductance_h: second / unit_farad,
            }),
            ExtraTerm::SecondMode => Some(Extra::SecondMode {
                resonance_hz: first.exp(),
                q: second.exp(),
                capacitance_farad: third * unit_farad,
            }),
            ExtraTerm::Dispersion => Some(Extra::Dispersion { slope: first / self.c0 }),
            ExtraTerm::Phase => Some(Extra::AnalyzerPhase { phase_rad: first }),
        }
    }

    /// The circuit in farads.
    pub(crate) fn circuit(&self, unit_farad: f64) -> Circuit {
        // The impedance was multiplied by the unit, so capacitances are divided by it.
        Circuit {
            resonance_hz: self.resonance_hz,
            q: self.q,
            c0_farad: self.c0 * unit_farad,
            c1_farad: self.c1 * unit_farad,
            loss_tangent: self.g / self.c0,
        }
    }
}

impl Step<UNKNOWNS> for ModelEstimate {
    fn minus(&self, step: &[f64; UNKNOWNS]) -> Self {
        // A long step in a logarithm leaves the region in which the derivatives are valid.
        let by = |step: f64, limit: f64| (-step).clamp(-limit, limit);
        let mut extra = self.extra;
        for (extra, step) in extra.iter_mut().zip(&step[CIRCUIT..]) {
            *extra -= *step;
        }
        if self.extra_term == ExtraTerm::SecondMode {
            extra[0] = self.extra[0] + by(step[CIRCUIT], 0.05);
            extra[1] = self.extra[1] + by(step[CIRCUIT + 1], 1.0);
        }
        Self {
            resonance_hz: self.resonance_hz * by(step[0], 0.05).exp(),
            q: self.q * by(step[1], 1.0).exp(),
            c0: self.c0 - step[2],
            c1: self.c1 - step[3],
            g: self.g - step[4],
            extra_term: self.extra_term,
            extra,
        }
    }
}
