//! The normal equations of the circuit for one stay, with the unknowns of that stay eliminated: the
//! amplitude of the free decay and the timing errors.

use num_complex::Complex64;

use super::{
    Known, Modelled, Sample, Stay,
    drift::shapes::WITH_SHAPES,
    mode::{PLACES, WITH_MODES},
    model::{Branch, Decayed, Model, Moving, Ring},
    sums::{ALONE, Column, Row, Sums, amplitude_step, determinant, eliminated},
};
use crate::{
    circuit::trace::{CIRCUIT, ModelEstimate, UNKNOWNS},
    numeric::descent::Normal,
};

/// Numbers of unknowns with one further unknown, and with a second mode at each place.
const WITH_ONE: usize = ALONE + 1;
const WITH_ALL: usize = ALONE + PLACES;
/// Number of unknowns of the circuit and a survey: a second mode, a phase error, an error of the first gap, a dispersion and a
/// drift.
pub(super) const WITH_BENCH: usize = CIRCUIT + 5;
/// Number of unknowns with them.
const ALONE_WITH_BENCH: usize = ALONE + WITH_BENCH - CIRCUIT;
/// Number of unknowns of the circuit, a phase error and a dispersion.
pub(super) const WITH_ANALYZER: usize = CIRCUIT + 2;
const ALONE_WITH_ANALYZER: usize = ALONE + WITH_ANALYZER - CIRCUIT;
const ALONE_WITH_SHAPES: usize = ALONE + WITH_SHAPES - CIRCUIT;
/// Variance of each part of the amplitude relative to its mean square: half for a random phase,
/// increased by half for the uncertainty of the circuit.
pub(super) const AMPLITUDE_SHARE: f64 = 0.75;
/// Degrees of freedom that each part of an amplitude takes from the residuals: one, less the mean cost of its prior, which is
/// wider than the actual amplitudes. The amplitude of the first stay has no prior.
pub(super) const AMPLITUDE_FREE: f64 = 1.0 - 0.5 / AMPLITUDE_SHARE;
/// Largest number of rounds to find the amplitude of a stay. A step that raises the cost is halved.
const ROUNDS: usize = 12;
/// Rounds end if they lower the cost by less than this and turn the decay by less than `TURNED`.
const SAVED: f64 = 0.01;
/// Smallest relevant rotation of the decay relative to the drive in a round, rad.
const TURNED: f64 = 0.01;
/// A stay is not recomputed for a circuit within this squared distance from the last, in units of the
/// variances from that stay alone: its equations are linear over this distance.
const LINEAR: f64 = 0.02;
/// Relative changes of the prior amplitude and of the noise above which a stay is recomputed.
const PRIOR_CHANGED: f64 = 0.1;
const VARIANCE_CHANGED: f64 = 0.02;
/// The same of the rates at which the resonance moves.
const RATE_CHANGED: f64 = 0.02;

/// The state of a stay during the search for a circuit.
#[derive(Debug, Clone, Default)]
pub(crate) struct State {
    amplitude: Complex64,
    /// Prior variance of the amplitude, and its mean square.
    prior: f64,
    square: f64,
    /// Delay of each reading after its recorded time, s.
    late_s: Vec<f64>,
    rows: Vec<Row>,
    last: Option<Computed>,
}

/// The equations of a stay as they were last computed.
#[derive(Debug, Clone, Copy)]
struct Computed {
    at: ModelEstimate,
    normal: Normal<UNKNOWNS>,
    readings: usize,
    /// The noise variance of their weights.
    variance: f64,
    moving: Moving,
    /// Twice the logarithm of the ratio of the prior volume of amplitudes to the posterior volume.
    freedom: f64,
}

impl State {
    /// The equations at this circuit, if they follow from the last computed ones.
    pub(super) fn moved(
        &self,
        (of, prior): (&Modelled<'_>, f64),
        known: &Known,
    ) -> Option<Normal<UNKNOWNS>> {
        let Modelled { stay, at, model, .. } = of;
        let Computed { at: last, normal, readings, variance, moving, .. } = self.last.as_ref()?;
        let has_changed = |ratio: f64, part: f64| (ratio - 1.0).abs() > part;
        if *readings != stay.samples.len()
            || model.moving.has_changed(moving, RATE_CHANGED)
            || has_changed(prior / self.prior, PRIOR_CHANGED)
            || has_changed(known.variance / variance, VARIANCE_CHANGED)
        {
            return None;
        }
        let away = [
            (at.resonance_hz / last.resonance_hz).ln(),
            (at.q / last.q).ln(),
            at.c0 - last.c0,
            at.c1 - last.c1,
            at.g - last.g,
        ];
        let mut moved = *normal;
        let mut distance = 0.0;
        for (i, row) in normal.matrix.iter().enumerate().take(CIRCUIT) {
            let by: f64 = row.iter().zip(&away).map(|(a, b)| a * b).sum();
            moved.cost += away[i] * (2.0 * normal.gradient[i] + by);
            moved.gradient[i] += by;
            distance += away[i] * by;
        }
        (distance < LINEAR).then_some(moved)
    }

    /// The weighted |r|² of each reading.
    pub(super) fn sizes(&self) -> impl Iterator<Item = f64> + '_ {
        self.rows.iter().map(|row| row.weight * row.residual.norm_sqr())
    }

    /// The weighted squares of the residuals, of the amplitude and of the errors of the gaps.
    fn cost(&self, known: &Known) -> f64 {
        let gaps_s = self.late_s.windows(2).map(|pair| pair[1] - pair[0]);
        let sigmas_s =
            std::iter::once(known.first_gap_sigma_s).chain(std::iter::repeat(known.gap_sigma_s));
        let of_gaps: f64 = gaps_s.zip(sigmas_s).map(|(gap, sigma)| (gap / sigma).powi(2)).sum();
        let of_amplitude = self.amplitude.norm_sqr() / self.prior.max(f64::MIN_POSITIVE);
        self.sizes().sum::<f64>() + of_amplitude + of_gaps
    }

    /// Takes half of the last step back.
    fn return_half_way(&mut self, (amplitude, late_s): &(Complex64, Vec<f64>)) {
        self.amplitude = 0.5 * (self.amplitude + amplitude);
        for (late_s, before_s) in self.late_s.iter_mut().zip(late_s) {
            *late_s = 0.5 * (*late_s + before_s);
        }
    }

    /// The fitted amplitude of the free decay.
    pub(super) const fn amplitude(&self) -> Complex64 {
        self.amplitude
    }

    /// The penalty for the freedom of the amplitude: a circuit with a long decay or an arbitrary
    /// amplitude fits more readings by chance.
    pub(super) fn freedom(&self) -> f64 {
        self.last.as_ref().map_or(0.0, |last| last.freedom)
    }

    /// Discards the equations, so that they are recomputed.
    #[cfg(test)]
    pub(super) fn thaw(&mut self) {
        self.last = None;
    }
}

impl Model {
    /// The variance of each part of an amplitude of this mean square.
    pub(super) fn prior(&self, square: f64) -> f64 {
        AMPLITUDE_SHARE * square * self.unit * self.unit
    }

    /// The normal equations of the circuit from these readings, and how often each was computed.
    pub(super) fn normal(
        &self,
        at: &ModelEstimate,
        stay: &Stay,
        prior: f64,
        known: &Known,
        state: &mut State,
    ) -> (Normal<UNKNOWNS>, usize) {
        let has_begun = state.late_s.len() == stay.samples.len()
            && (prior / state.prior - 1.0).abs() <= PRIOR_CHANGED;
        if !has_begun {
            *state = self.first(&stay.samples, prior, known);
        }
        let (mut round, mut lowest) = (1, f64::INFINITY);
        let mut before = (state.amplitude, Vec::new());
        loop {
            let mut sums = Sums::<ALONE>::new(state.amplitude, state.prior, state.square);
            state.rows.clear();
            let mut last = None;
            for (sample, &late_s) in stay.samples.iter().zip(&state.late_s) {
                let Sample { start_s, integration_s, .. } = *sample;
                let decayed = self.decayed(start_s + late_s, integration_s, &mut last);
                sums.wait_until(late_s, known);
                let alone = std::iter::empty();
                let row = sums.add(self, sample, state.amplitude, &decayed, known, alone);
                state.rows.push(row);
            }
            let cost = state.cost(known);
            if cost > lowest && round <= ROUNDS {
                if round < ROUNDS {
                    state.return_half_way(&before);
                } else {
                    (state.amplitude, state.late_s) = before.clone();
                }
                round += 1;
                continue;
            }
            lowest = cost;
            before.0 = state.amplitude;
            before.1.clone_from(&state.late_s);
            let normal = sums.without_time();
            let (step, saved) = amplitude_step(&normal);
            state.amplitude -= step;
            for row in &mut state.rows {
                row.residual -= step * row.by_amplitude;
            }
            let moved_s = shift(&mut state.late_s, &state.rows, known);
            let is_still = saved < SAVED && moved_s * self.rate.norm() < TURNED;
            if round >= ROUNDS || is_still {
                let freedom = (determinant(&normal) * state.prior * state.prior).ln();
                let normal = eliminated(&normal);
                let (readings, variance) = (stay.samples.len(), known.variance);
                let moving = self.moving;
                state.last =
                    Some(Computed { at: *at, normal, readings, variance, moving, freedom });
                return (normal, round);
            }
            round += 1;
        }
    }

    /// The normal equations with a second mode at each place as additional unknowns after the circuit.
    pub(super) fn normal_with_modes(
        &self,
        stay: &Stay,
        known: &Known,
        state: &State,
        modes: &[Branch; PLACES],
    ) -> Normal<WITH_MODES> {
        self.normal_beside::<WITH_ALL, _, _>(stay, known, state, |start_s, integration_s| {
            modes.iter().map(move |mode| Column::Admittance(mode.mean(start_s, integration_s)))
        })
    }

    /// The normal equations with the size of a drift as the unknown after the circuit.
    pub(super) fn normal_with_drift(
        &self,
        stay: &Stay,
        known: &Known,
        state: &State,
        drift: Column,
    ) -> Normal<UNKNOWNS> {
        let columns = |_, _| std::iter::once(drift);
        self.normal_beside::<WITH_ONE, _, _>(stay, known, state, columns)
    }

    /// The same with the sizes of several drifts.
    pub(super) fn normal_with_drifts(
        &self,
        stay: &Stay,
        known: &Known,
        state: &State,
        drifts: &[Column],
    ) -> Normal<WITH_SHAPES> {
        let columns = |_, _| drifts.iter().copied();
        self.normal_beside::<ALONE_WITH_SHAPES, _, _>(stay, known, state, columns)
    }

    /// The normal equations with further unknowns after the circuit: a second mode, the phase error of
    /// the analyzer, the error of the first gap, a dispersion with this admittance, and a drift.
    pub(super) fn normal_for_bench(
        &self,
        stay: &Stay,
        known: &Known,
        state: &State,
        (mode, dispersion, drift): (&Branch, Complex64, Column),
    ) -> Normal<WITH_BENCH> {
        self.normal_beside::<ALONE_WITH_BENCH, _, _>(
            stay,
            known,
            state,
            |start_s, integration_s| {
                let mean = Column::Admittance(mode.mean(start_s, integration_s));
                let dispersion = Column::Admittance(dispersion);
                [mean, Column::Phase, Column::FirstGap, dispersion, drift].into_iter()
            },
        )
    }

    /// The same with the phase error of the analyzer, and a dispersion with this admittance.
    pub(super) fn normal_for_analyzer(
        &self,
        stay: &Stay,
        known: &Known,
        state: &State,
        dispersion: Complex64,
    ) -> Normal<WITH_ANALYZER> {
        self.normal_beside::<ALONE_WITH_ANALYZER, _, _>(stay, known, state, |_, _| {
            [Column::Phase, Column::Admittance(dispersion)].into_iter()
        })
    }

    /// The normal equations with further unknowns after the circuit. `columns` gives those of a reading that starts at
    /// this time and takes this long, s.
    fn normal_beside<const N: usize, const K: usize, I: Iterator<Item = Column>>(
        &self,
        stay: &Stay,
        known: &Known,
        state: &State,
        columns: impl Fn(f64, f64) -> I,
    ) -> Normal<K> {
        let mut sums = Sums::<N>::new(state.amplitude, state.prior, state.square);
        let mut last = None;
        for (sample, &late_s) in stay.samples.iter().zip(&state.late_s) {
            let (start_s, integration_s) = (sample.start_s + late_s, sample.integration_s);
            let decayed = self.decayed(start_s, integration_s, &mut last);
            sums.wait_until(late_s, known);
            let columns = columns(start_s, integration_s);
            sums.add(self, sample, state.amplitude, &decayed, known, columns);
        }
        eliminated(&sums.without_time())
    }

    /// A start value of the amplitude a: the plain relative error is linear in it.
    fn first(&self, samples: &[Sample], prior: f64, known: &Known) -> State {
        let (mut top, mut bottom) = (Complex64::ZERO, known.variance / prior);
        let mut last = None;
        for sample in samples {
            let Some(impedance) = sample.impedance else { continue };
            let e = self.decayed(sample.start_s, sample.integration_s, &mut last).value;
            let column = impedance * e;
            let rest = 1.0 - impedance * self.steady;
            top += sample.length * column.conj() * rest;
            bottom += sample.length * column.norm_sqr();
        }
        let amplitude = top / bottom;
        let (square, rows) = (amplitude.norm_sqr(), Vec::with_capacity(samples.len()));
        State { amplitude, prior, square, late_s: vec![0.0; samples.len()], rows, last: None }
    }
}

/// The information of a stay if its readings agree with the model: the readings it already has, and
/// further ones at equal distances. The unknowns are the circuit and a second mode.
#[derive(Debug)]
pub(crate) struct Forecast<'a> {
    model: &'a Model,
    known: &'a Known,
    amplitude: Complex64,
    mode: Branch,
    sums: Sums<WITH_ONE>,
    next: &'a Course,
    taken: usize,
}

/// Possible further readings of a stay, equally spaced.
#[derive(Debug)]
pub(crate) struct Course {
    decays: Vec<Decayed>,
    reading: Sample,
    step_s: f64,
}

impl Course {
    /// `count` readings of this integration time, s, each `step_s` after the previous one; the first
    /// follows `there`.
    pub(crate) fn new(
        model: &Model,
        there: &[Sample],
        (step_s, integration_s): (f64, f64),
        count: usize,
    ) -> Self {
        let start_s = there.last().map_or(0.0, |last| last.start_s + step_s);
        let length = model.tens_of_cycles(integration_s);
        let reading = Sample { start_s, integration_s, impedance: None, length };
        let decays = model.decays(start_s, (step_s, integration_s), count);
        Self { decays, reading, step_s }
    }
}

impl<'a> Forecast<'a> {
    /// A forecast after these readings, with this free motion.
    pub(crate) fn new(
        (model, known): (&'a Model, &'a Known),
        ring: &Ring,
        mode: Branch,
        there: &[Sample],
        next: &'a Course,
    ) -> Self {
        let square = ring.amplitude.norm_sqr();
        let mut sums = Sums::new(Complex64::ZERO, model.prior(ring.square), square);
        let mut last = None;
        for sample in there {
            let ideal = Sample { impedance: None, ..*sample };
            let decayed = model.decayed(sample.start_s, sample.integration_s, &mut last);
            let mean = mode.mean(sample.start_s, sample.integration_s);
            sums.wait_until(0.0, known);
            let columns = std::iter::once(Column::Admittance(mean));
            sums.add(model, &ideal, ring.amplitude, &decayed, known, columns);
        }
        Self { model, known, amplitude: ring.amplitude, mode, sums, next, taken: 0 }
    }

    /// The equations with this many further readings, no fewer than in the previous call.
    pub(crate) fn with(&mut self, count: usize) -> Normal<UNKNOWNS> {
        let Course { decays, reading, step_s } = self.next;
        let from_s = reading.start_s + self.taken as f64 * step_s;
        let means = self.mode.means(from_s, *step_s, reading.integration_s);
        for (decayed, mean) in decays[..count].iter().skip(self.taken).zip(means) {
            self.sums.wait_until(0.0, self.known);
            let one = std::iter::once(Column::Admittance(mean));
            self.sums.add(self.model, reading, self.amplitude, decayed, self.known, one);
        }
        self.taken = count;
        eliminated(&self.sums.without_time())
    }
}

/// Moves the times of the readings to their most likely values for these amplitudes. The steps between
/// them are independent, which gives a tridiagonal system. Returns the largest shift, s.
fn shift(late_s: &mut [f64], rows: &[Row], times: &Known) -> f64 {
    let precision = times.gap_sigma_s.powi(-2);
    let count = rows.len();
    let (mut upper, mut right) = (vec![0.0; count], vec![0.0; count]);
    // Forward elimination; the first reading stays fixed.
    for i in 1..count {
        let row = &rows[i];
        let known = row.weight * row.in_time.norm_sqr();
        let pull = row.weight * (row.in_time.conj() * row.residual).re;
        let before = if i == 1 { times.first_gap_sigma_s.powi(-2) } else { precision };
        let after = if i + 1 < count { precision } else { 0.0 };
        let pivot = known + before + after - before * upper[i - 1];
        upper[i] = after / pivot;
        right[i] = (known * late_s[i] - pull + before * right[i - 1]) / pivot;
    }
    let (mut next, mut moved_s) = (0.0, 0.0_f64);
    for i in (1..count).rev() {
        next = right[i] + upper[i] * next;
        moved_s = moved_s.max((next - late_s[i]).abs());
        late_s[i] = next;
    }
    moved_s
}
