//! Readings during the free decay, with an unknown phase of the drive.
//!
//! After a change of frequency, the motional branch rings at its own frequency and with its own quality
//! factor, independent of the drive. Every reading of a stay at one frequency is therefore
//!
//! ```text
//!   Y = jωC0(1 − j tan δ) + jωC1/D(ω) + a·E(s) + b·E(s*),   E(s) = ⟨e^{(s − jω)t}⟩ over the reading
//! ```
//!
//! with s the complex frequency of the free decay. The amplitude a has a random phase and is eliminated
//! from the normal equations of the circuit under its Gaussian prior. The timing error after every
//! reading, which accumulates along the stay, is eliminated in the same way. The counter-rotating
//! amplitude b is as large as a but turns by radians within a millisecond, so that it is an error of
//! known size and unknown phase.

mod drift;
pub(crate) mod judge;
pub(crate) mod learn;
pub(crate) mod mode;
pub(crate) mod model;
pub(crate) mod outliers;
mod rounding;
pub(crate) mod search;
pub(crate) mod start;
pub(crate) mod stay;
mod sums;

use std::{cell::Cell, f64::consts::TAU};

use num_complex::Complex64;
use rig_model::Reading;

use crate::{
    Bench,
    bench::dispersion,
    circuit::points::weight,
    circuit::trace::{CIRCUIT, ModelEstimate, UNKNOWNS, complex_ohm},
    fit::grid::CircuitPrior,
    numeric::dense::Cholesky,
    numeric::descent::{Descent, End, Normal},
};
use drift::Drift;
use model::{Amplitude, Model, Moving, Ring};
use stay::{State, WITH_ANALYZER};
use sums::Column;

/// Assumed gap between two readings before any is measured, s.
const GAP_S: f64 = 1e-3;
/// Standard deviation of the error of the time between two readings, s: uniform within ±1 ms.
const GAP_SIGMA_S: f64 = 0.58e-3;

/// Prior knowledge of the analyzer.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Known {
    /// Variance of each part of the relative error of a reading of ten cycles.
    pub(crate) variance: f64,
    /// Standard deviation of the time between two readings of a stay, s.
    pub(crate) gap_sigma_s: f64,
    /// The uncertainty of the time between the first two.
    pub(crate) first_gap_sigma_s: f64,
}

impl Known {
    /// Knowledge of an analyzer with this noise, whose times are known to 1 ms.
    pub(crate) const fn with(variance: f64) -> Self {
        Self { variance, gap_sigma_s: GAP_SIGMA_S, first_gap_sigma_s: GAP_SIGMA_S }
    }

    /// These uncertainties if a survey found this error of the first gap, s. It varies by as much, because not every
    /// stay begins with the same settings.
    fn with_first_gap(self, first_gap_s: f64) -> Self {
        Self { first_gap_sigma_s: self.gap_sigma_s.hypot(first_gap_s), ..self }
    }
}

/// One reading of a stay.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    /// Time from the start of the first integration of the stay to that of this one, s.
    pub(crate) start_s: f64,
    pub(crate) integration_s: f64,
    /// Measured impedance times the unit of capacitance, s.
    pub(crate) impedance: Option<Complex64>,
    /// Cycles, in units of ten; 0 for an excluded reading.
    pub(crate) length: f64,
}

/// Readings at one frequency.
#[derive(Debug, Clone)]
pub(crate) struct Stay {
    pub(crate) frequency_hz: f64,
    /// Time since the start of the first integration of the previous stay, s.
    pub(crate) since_s: f64,
    pub(crate) samples: Vec<Sample>,
}

/// All readings of a sweep.
#[derive(Debug, Clone)]
pub(crate) struct Stays {
    pub(crate) all: Vec<Stay>,
    pub(crate) unit_farad: f64,
    pub(crate) known: Known,
    pub(crate) bench: Option<Bench>,
    /// How the resonance moves; `None` if it stays.
    drift: Option<Drift>,
    /// Number of readings excluded as outliers.
    pub(crate) excluded: usize,
    last: Option<Reading>,
    /// Work so far, in rows: evaluations of one reading with its derivatives.
    pub(crate) work: Cell<u64>,
}

/// A stay with what a circuit says of it.
#[derive(Debug)]
struct Modelled<'a> {
    stay: &'a Stay,
    /// The circuit during the stay.
    at: ModelEstimate,
    model: Model,
    /// The mean square of the free motion.
    square: f64,
}

/// A circuit and how well it explains the readings.
#[derive(Debug, Clone)]
pub(crate) struct Hypothesis {
    pub(crate) at: ModelEstimate,
    pub(crate) normal: Normal<UNKNOWNS>,
    pub(crate) end: End,
    states: Vec<State>,
}

impl Hypothesis {
    /// Variance of the logarithm of the resonance.
    pub(crate) fn variance(&self) -> f64 {
        variance(&self.normal, CIRCUIT)
    }

    /// Twice the negative logarithm of the likelihood averaged over the amplitudes of the free decays.
    /// Circuits are compared by this, not by the cost, which holds only for the best amplitudes.
    pub(crate) fn evidence(&self) -> f64 {
        self.normal.cost + self.states.iter().map(State::freedom).sum::<f64>()
    }

    /// Standard deviation of the resonance, Hz.
    pub(crate) fn sigma_hz(&self) -> f64 {
        self.variance().sqrt() * self.at.resonance_hz
    }

    /// Full width at half power, Hz.
    pub(crate) fn linewidth_hz(&self) -> f64 {
        self.at.resonance_hz / self.at.q
    }
}

/// The unit of capacitance: the median of the impedances. During a free decay, or by an error, any of them may be far
/// from the usual. `None` if there is none.
pub(crate) fn unit_farad(readings: &[Reading]) -> Option<f64> {
    let farad =
        |reading: &Reading| Some(1.0 / (TAU * reading.frequency_hz * complex_ohm(reading)?.norm()));
    let mut all: Vec<f64> = readings.iter().filter_map(farad).collect();
    all.sort_unstable_by(f64::total_cmp);
    all.get(all.len() / 2).copied()
}

/// Variance of the first unknown with `free` unknowns; infinite if it is not determined.
pub(crate) fn variance(normal: &Normal<UNKNOWNS>, free: usize) -> f64 {
    let mut unit = [0.0; UNKNOWNS];
    unit[0] = 1.0;
    let factor = Cholesky::new(&normal.matrix, free, 0.0);
    factor.map_or(f64::INFINITY, |factor| factor.solve(&unit)[0])
}

impl Stay {
    /// The middle of its readings, s after the start of the first one.
    fn middle_s(&self) -> f64 {
        0.5 * self.samples.last().map_or(0.0, Sample::end_s)
    }

    /// Corrects the start of a reading that was recorded late because its settings were sent with it,
    /// so that it would end after the next one starts. It is moved back until the usual gap follows it.
    fn mend_last(&mut self, next: &mut Sample) {
        let gaps = self.samples.windows(2).map(|two| two[1].start_s - two[0].end_s());
        let (sum, count) = gaps
            .filter(|gap_s| *gap_s > 0.0)
            .fold((GAP_S, 1.0), |(sum, count), gap_s| (sum + gap_s, count + 1.0));
        let is_first = self.samples.len() == 1;
        let Some(last) = self.samples.last_mut() else { return };
        let late_s = last.end_s() + sum / count - next.start_s;
        if next.start_s >= last.end_s() {
            return;
        }
        if is_first {
            // The time axis starts with the first reading.
            next.start_s += late_s;
        } else {
            last.start_s -= late_s;
        }
    }
}

impl Sample {
    fn end_s(&self) -> f64 {
        self.start_s + self.integration_s
    }

    const fn exclude(&mut self) {
        (self.impedance, self.length) = (None, 0.0);
    }
}

impl Stays {
    /// None yet, in this unit of capacitance.
    pub(crate) fn new(known: Known, bench: Option<Bench>, unit_farad: f64) -> Self {
        let known = bench.map_or(known, |bench| known.with_first_gap(bench.first_gap_s));
        let (all, last, work) = (Vec::new(), None, Cell::new(0));
        Self { all, unit_farad, known, bench, drift: None, excluded: 0, last, work }
    }

    /// Builds the stays of these readings; `None` if none has an impedance.
    pub(crate) fn of(known: Known, bench: Option<Bench>, readings: &[Reading]) -> Option<Self> {
        let mut stays = Self::new(known, bench, unit_farad(readings)?);
        for reading in readings {
            stays.push(reading);
        }
        Some(stays)
    }

    /// Adds a reading and returns whether it starts a new stay.
    pub(crate) fn push(&mut self, reading: &Reading) -> bool {
        let hz = reading.frequency_hz;
        let corrected = |ohm| self.bench.map_or(ohm, |bench| bench.corrected(hz, ohm));
        let impedance = complex_ohm(reading).map(|ohm| corrected(ohm) * self.unit_farad);
        let mut sample = Sample {
            start_s: 0.0,
            integration_s: reading.integration_s,
            impedance,
            length: if impedance.is_some() { weight(reading) } else { 0.0 },
        };
        let last = self.last.replace(*reading);
        let begins_s = |one: &Reading| one.started.as_seconds() + one.settle_s;
        let after_s = last.map_or(0.0, |last| begins_s(reading) - begins_s(&last));
        #[expect(clippy::float_cmp, reason = "it is the same number where the frequency stayed")]
        let goes_on = last.is_some_and(|last| last.frequency_hz == reading.frequency_hz);
        match self.all.last_mut() {
            Some(stay) if goes_on => {
                sample.start_s = stay.samples.last().map_or(0.0, |one| one.start_s) + after_s;
                stay.mend_last(&mut sample);
                if stay.samples.len() == 1 {
                    sample.start_s += self.bench.map_or(0.0, |bench| bench.first_gap_s);
                }
                stay.samples.push(sample);
            }
            stay => {
                // The first readings of both stays have the same error of their times.
                let first_gap_s = self.bench.map_or(0.0, |bench| bench.first_gap_s);
                let before_s = stay.map_or(0.0, |stay| match stay.samples[..] {
                    [.., _, last] => last.start_s - first_gap_s,
                    _ => 0.0,
                });
                self.all.push(Stay {
                    frequency_hz: reading.frequency_hz,
                    since_s: before_s + after_s,
                    samples: vec![sample],
                });
            }
        }
        !goes_on
    }

    /// Corrects all readings, which are as measured, for a phase error of the analyzer and a dispersion.
    fn correct(&mut self, bench: &Bench) {
        for stay in &mut self.all {
            let hz = stay.frequency_hz;
            for sample in &mut stay.samples {
                let ohm = sample.impedance.map(|impedance| impedance / self.unit_farad);
                let corrected = ohm.map(|ohm| bench.corrected(hz, ohm) * self.unit_farad);
                sample.impedance = corrected;
            }
        }
    }

    /// Makes the first gap of every stay longer.
    fn lengthen_first_gaps(&mut self, by_s: f64) {
        for sample in self.all.iter_mut().flat_map(|stay| stay.samples.iter_mut().skip(1)) {
            sample.start_s += by_s;
        }
        self.known = self.known.with_first_gap(by_s);
    }

    /// Excludes a reading.
    fn exclude(&mut self, stay: usize, sample: usize) {
        self.all[stay].samples[sample].exclude();
        self.excluded += 1;
    }

    /// Number of readings in use.
    pub(crate) fn count(&self) -> usize {
        let samples = self.all.iter().flat_map(|stay| &stay.samples);
        samples.filter(|sample| sample.length > 0.0).count()
    }

    /// Residual degrees of freedom after fitting a circuit.
    pub(crate) fn degrees(&self) -> f64 {
        let later = self.all.len().saturating_sub(1) as f64;
        let unknowns = CIRCUIT + 2 + self.drift.map_or(0, |drift| drift.unknowns());
        (2 * self.count()) as f64 - unknowns as f64 - 2.0 * stay::AMPLITUDE_FREE * later
    }

    /// Each stay with its model for the circuit at `at`.
    fn models(&self, at: &ModelEstimate) -> impl Iterator<Item = Modelled<'_>> {
        let mut amplitude = Amplitude::new(at);
        let at = *at;
        self.all.iter().zip(self.middles_s()).map(move |(stay, middle_s)| {
            let square = amplitude.change(stay.frequency_hz, stay.since_s);
            let at = self.moved(&at, middle_s);
            let moving = self.moving(middle_s, stay.middle_s());
            let model = Model::new(&at, stay.frequency_hz).moving(moving);
            Modelled { stay, at, model, square }
        })
    }

    /// The circuit at this time, s after the begin of the first reading.
    fn moved(&self, at: &ModelEstimate, s: f64) -> ModelEstimate {
        let Some(drift) = &self.drift else { return *at };
        ModelEstimate { resonance_hz: at.resonance_hz * drift.ln_shift(s).exp(), ..*at }
    }

    /// The normal equations of the readings for the circuit at `at`, without the prior and with all
    /// other unknowns eliminated. `states` are those of the stays at a nearby circuit, initially empty.
    fn normal(&self, at: &ModelEstimate, states: &mut Vec<State>) -> Normal<UNKNOWNS> {
        let mut normal = Normal::default();
        states.resize_with(self.all.len(), State::default);
        for (of, state) in self.models(at).zip(states) {
            let prior = of.model.prior(of.square);
            let of_stay = state
                .moved((&of, prior), &self.known)
                .unwrap_or_else(|| self.computed(&of, prior, state));
            normal.sum(&of_stay);
        }
        normal
    }

    /// The normal equations of a stay, computed.
    fn computed(&self, of: &Modelled<'_>, prior: f64, state: &mut State) -> Normal<UNKNOWNS> {
        let (normal, rounds) = of.model.normal(&of.at, of.stay, prior, &self.known, state);
        self.work.update(|work| work + (rounds * of.stay.samples.len()) as u64);
        normal
    }

    /// Time to which the fitted constant resonance refers, s after the start of the first reading: that at which an
    /// even drift has its value. Each stay is weighted by its information on the resonance.
    ///
    /// With few readings on one side of the resonance the weights are large and of both signs. They need
    /// the equations of the very same stays: those of the descent may be extrapolated from a nearby
    /// circuit, which once moved the time by eighteen durations of the sweep.
    pub(crate) fn effective_time_s(
        &self,
        best: &Hypothesis,
        expected: &CircuitPrior,
    ) -> Option<f64> {
        if let Some(drift) = &self.drift {
            return Some(drift.effective_s());
        }
        let (mut all, mut sum) = (Normal::<UNKNOWNS>::default(), [0.0; UNKNOWNS]);
        let mut states = best.states.clone();
        for ((of, state), middle_s) in self.models(&best.at).zip(&mut states).zip(self.middles_s())
        {
            let Modelled { stay, model, square, .. } = of;
            model.normal(&best.at, stay, model.prior(square), &self.known, state);
            let moving = Moving { per_s: 1.0, ..model.moving };
            let even = Column::Drift { size: middle_s, moving };
            let normal = model.normal_with_drift(stay, &self.known, state, even);
            for (sum, row) in sum.iter_mut().zip(&normal.matrix).take(CIRCUIT) {
                *sum += row[CIRCUIT];
            }
            all.sum(&normal);
        }
        expected.add_to(&mut all, &best.at, 1.0);
        Some(Cholesky::new(&all.matrix, CIRCUIT, 0.0)?.solve(&sum)[0])
    }

    /// The model and the free motion of the last stay, and the initial amplitude of the next.
    pub(crate) fn last(&self, best: &Hypothesis) -> Option<(Model, Ring, Amplitude)> {
        let mut amplitude = Amplitude::new(&best.at);
        let mut square = 0.0;
        for stay in &self.all {
            square = amplitude.change(stay.frequency_hz, stay.since_s);
        }
        let at = self.moved(&best.at, self.middles_s().last()?);
        let model = Model::new(&at, self.all.last()?.frequency_hz);
        let ring = Ring { square, amplitude: best.states.last()?.amplitude() };
        Some((model, ring, amplitude))
    }

    /// The most likely circuit near `start`.
    pub(crate) fn minimum(&self, start: ModelEstimate, expected: &CircuitPrior) -> Hypothesis {
        self.descend(start, Vec::new(), expected, |_, _| (), |_, _, _| true)
    }

    /// The most likely circuit near `start`, from these states of the stays; `None` once `is_wanted`
    /// rejects a circuit, given its cost and the cost saved by the last step.
    pub(crate) fn minimum_while(
        &self,
        start: ModelEstimate,
        states: Vec<State>,
        expected: &CircuitPrior,
        is_wanted: impl Fn(&ModelEstimate, f64, f64) -> bool,
    ) -> Option<Hypothesis> {
        let found = self.descend(start, states, expected, |_, _| (), is_wanted);
        (found.end != End::Abandoned).then_some(found)
    }

    fn descend(
        &self,
        start: ModelEstimate,
        mut states: Vec<State>,
        expected: &CircuitPrior,
        more: impl Fn(&ModelEstimate, &mut Normal<UNKNOWNS>),
        is_wanted: impl Fn(&ModelEstimate, f64, f64) -> bool,
    ) -> Hypothesis {
        let count = self.count();
        let descent = Descent { count, weight: 0.0, free: CIRCUIT };
        let normal_at = |at: &ModelEstimate| {
            let mut normal = self.normal(at, &mut states);
            expected.add_to(&mut normal, at, 1.0);
            more(at, &mut normal);
            normal
        };
        let (at, normal, end) = descent.run_while(start, normal_at, is_wanted);
        Hypothesis { at, normal, end, states }
    }

    /// Change of the resonance, Hz, by one standard deviation of what the survey says of the analyzer and the dielectric. The two
    /// are taken as independent. Where the resonance lies far from the middle of the window they are not, and a sweep on one side
    /// of it can change by up to 1.16 times this.
    pub(crate) fn shift_by_bench_hz(
        &self,
        best: &Hypothesis,
        expected: &CircuitPrior,
    ) -> Option<f64> {
        let Some(bench) = self.bench else { return Some(0.0) };
        let mut sum = Normal::<WITH_ANALYZER>::default();
        for (of, state) in self.models(&best.at).zip(&best.states) {
            let Modelled { stay, model, .. } = of;
            let disperses = dispersion(bench.surveyed, stay.frequency_hz);
            sum.sum(&model.normal_for_analyzer(stay, &self.known, state, disperses));
        }
        self.work.update(|work| work + self.count() as u64);
        expected.add_to(&mut sum, &best.at, 1.0);
        let factor = Cholesky::new(&sum.matrix, CIRCUIT, 0.0)?;
        let sigmas = [bench.phase_sigma_rad, bench.dispersion_sigma_farad / self.unit_farad];
        let shift = |column: usize| {
            let by = std::array::from_fn(|i| sum.matrix[i][CIRCUIT + column]);
            factor.solve(&by)[0] * sigmas[column]
        };
        Some(best.at.resonance_hz * shift(0).hypot(shift(1)))
    }

    /// Standard deviation of the resonance, Hz, from the points where the profile likelihood has fallen
    /// by the amount for two standard deviations. It is the largest of both sides and of the curvature.
    pub(crate) fn profile_sigma_hz(&self, best: &Hypothesis, expected: &CircuitPrior) -> f64 {
        const SIGMAS: f64 = 2.0;
        let sigma = best.variance().sqrt();
        let side = |sign: f64| {
            let wanted = best.at.resonance_hz.ln() + sign * SIGMAS * sigma;
            let hard = 1e8 / (sigma * sigma);
            let start = ModelEstimate { resonance_hz: wanted.exp(), ..best.at };
            let held = |at: &ModelEstimate, normal: &mut Normal<UNKNOWNS>| {
                let away = at.resonance_hz.ln() - wanted;
                normal.matrix[0][0] += hard;
                normal.gradient[0] += hard * away;
                normal.cost += hard * away * away;
            };
            let found = self.descend(start, best.states.clone(), expected, held, |_, _, _| true);
            let rise = (found.normal.cost - best.normal.cost).max(1e-3);
            SIGMAS * sigma / rise.sqrt()
        };
        best.at.resonance_hz * sigma.max(side(1.0)).max(side(-1.0))
    }
}

#[cfg(test)]
mod tests;
