//! The readings of a sweep as a model of circuit and free decay, and its minimum.

use std::f64::consts::{PI, TAU};

use num_complex::Complex64;

use crate::{
    fit::{
        beside::{self, Beside, Course, Place},
        is_usable,
        motion::{Branch, Mean, Passage, decay, resting},
    },
    normal::{GLOBAL, Normal, Part, Step},
    record::Reading,
};

/// Standard deviation of the time between two readings of a stay, s.
const GAP_SIGMA_S: f64 = 0.58e-3;
/// The gap between two readings where none has been seen, s.
const GAP_S: f64 = 1e-3;
/// The part of the square of a free decay that each part of its amplitude may have.
const AMPLITUDE_SHARE: f64 = 0.75;
/// Expected values and their standard deviations: ln Q, then C0, C1 and C0 tan δ in the unit of
/// capacitance.
const EXPECTED: [(f64, f64); 4] = [(3.401, 1.0), (1.0, 1.0), (0.0, 0.15), (0.0, 0.03)];
/// Unknowns of the circuit.
pub(super) const CIRCUIT: usize = 5;
/// The unknown after them: the capacitance of a possible second mode.
const MODE: usize = CIRCUIT;
/// Unknowns of what is beside the circuit.
pub(super) const BESIDE: usize = GLOBAL - CIRCUIT;
/// Places of possible second modes, in linewidths from the resonance on both sides.
const MODES_AT: [f64; 8] = [0.75, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0];
/// Steps of one descent; a sound sweep needs three to ten.
const STEPS_MAX: usize = 60;
/// A descent ends when a step lowers the sum of squares, which is in units of the variance, by less than
/// this.
const ENOUGH: f64 = 1e-6;
/// A step that saves less than this part of what the linear problem promised was too long.
const KEPT_PROMISE: f64 = 0.5;

pub(crate) fn measured(reading: &Reading) -> Complex64 {
    Complex64::new(reading.resistance_ohm.unwrap_or(0.0), reading.reactance_ohm.unwrap_or(0.0))
}

/// A reading of a stay.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// From the begin of the first integration of the stay to that of this one, s.
    start_s: f64,
    integration_s: f64,
    /// From the change of frequency to the begin of the integration, s.
    settle_s: f64,
    /// The middle of the integration, from −1 at the first reading to 1 at the last.
    when: f64,
    /// Impedance times the unit of capacitance, s.
    z: Complex64,
    /// Whether there is one.
    is_used: bool,
}

/// Readings at one frequency.
#[derive(Debug)]
pub(super) struct Stay {
    omega: f64,
    /// From the begin of the first integration of the stay before, s.
    since_s: f64,
    pub(super) samples: Vec<Sample>,
}

/// The readings of each stay. A reading that would end after the next has begun was reported late. The
/// first gap of every stay is longer than recorded by `first_gap_s`.
pub(super) fn stays(readings: &[Reading], unit: f64, first_gap_s: f64) -> Vec<Stay> {
    let mut stays: Vec<Stay> = Vec::new();
    let mut before: Option<&Reading> = None;
    let middle_s = |reading: &Reading| reading.begin_s() + 0.5 * reading.integration_s;
    let [first_s, last_s] =
        [readings.first(), readings.last()].map(|reading| reading.map_or(0.0, middle_s));
    for reading in readings {
        let after_s = before.map_or(0.0, |before| reading.begin_s() - before.begin_s());
        let mut sample = Sample {
            start_s: 0.0,
            integration_s: reading.integration_s,
            settle_s: reading.settle_s,
            when: 2.0 * (middle_s(reading) - first_s) / (last_s - first_s) - 1.0,
            z: measured(reading) * unit,
            is_used: is_usable(reading),
        };
        let is_same = before.is_some_and(|before| before.frequency_hz == reading.frequency_hz);
        before = Some(reading);
        let Some(stay) = stays.last_mut().filter(|_| is_same) else {
            // The first readings of both stays are wrong by the same time.
            let last_s = stays.last().map_or(0.0, |stay| match stay.samples.len() {
                1 => 0.0,
                count => stay.samples[count - 1].start_s - first_gap_s,
            });
            let since_s = last_s + after_s;
            let omega = TAU * reading.frequency_hz;
            stays.push(Stay { omega, since_s, samples: vec![sample] });
            continue;
        };
        let count = stay.samples.len();
        let last = stay.samples[count - 1];
        sample.start_s = last.start_s + after_s;
        let end_s = last.start_s + last.integration_s;
        if sample.start_s < end_s {
            let gap = |pair: &[Sample]| pair[1].start_s - pair[0].start_s - pair[0].integration_s;
            let gaps = stay.samples.windows(2).map(gap).filter(|gap| *gap > 0.0);
            let gaps: Vec<f64> = gaps.chain([GAP_S]).collect();
            let late_s = end_s + gaps.iter().sum::<f64>() / gaps.len() as f64 - sample.start_s;
            if count == 1 {
                sample.start_s += late_s;
            } else {
                stay.samples[count - 1].start_s -= late_s;
            }
        }
        if count == 1 {
            sample.start_s += first_gap_s;
        }
        stay.samples.push(sample);
    }
    stays
}

/// The unknowns.
#[derive(Debug, Clone)]
pub(super) struct Unknowns {
    /// ln f, ln Q, C0, C1, C0 tan δ.
    pub(super) circuit: [f64; CIRCUIT],
    /// Those of what is beside it.
    pub(super) beside: [f64; BESIDE],
    /// The free decay of each stay at its first reading.
    pub(super) amplitudes: Vec<Complex64>,
    /// Errors of the times between the readings of each stay, in standard deviations.
    pub(super) steps: Vec<Vec<f64>>,
}

impl Unknowns {
    pub(super) fn moved(&self, step: &Step, weights: &Weights) -> Self {
        let mut moved = self.clone();
        for (value, by) in moved.circuit.iter_mut().chain(&mut moved.beside).zip(step.global) {
            *value += by;
        }
        for (k, local) in step.local.iter().enumerate().filter(|(_, local)| !local.is_empty()) {
            moved.amplitudes[k] += Complex64::new(local[0], local[1]) * weights.sizes[k];
            for (value, by) in moved.steps[k].iter_mut().zip(&local[2..]) {
                *value += by;
            }
        }
        moved
    }
}

/// The sizes that the circuit predicts for the free decays, and the variance of each reading.
#[derive(Debug)]
pub(super) struct Weights {
    sizes: Vec<f64>,
    variances: Vec<Vec<f64>>,
}

#[derive(Debug)]
pub(super) struct Trace {
    pub(super) stays: Vec<Stay>,
    pub(super) is_ringing: bool,
    /// By how much the first gap of every stay is longer than recorded, s. It varies by as much.
    pub(super) first_gap_s: f64,
    /// What is beside the circuit.
    pub(super) beside: Option<Beside>,
}

/// A second mode with the capacitance 1 in a stay: its steady part as an admittance, and the rest at the first
/// reading.
#[derive(Clone, Copy)]
struct Mode<'a> {
    branch: &'a Branch,
    steady: Complex64,
    rest: Complex64,
}

/// The residuals of the rows of a stay.
#[derive(Debug, Clone, Copy)]
enum Row {
    /// Those of the readings.
    Measured,
    /// Those of a resonance that rises evenly.
    Moving,
}

impl Trace {
    fn steady(circuit: &[f64; CIRCUIT], branch: &Branch, omega: f64) -> Complex64 {
        let [_, _, c0, c1, g] = *circuit;
        let (response, ..) = branch.response(omega);
        Complex64::new(omega * g, omega * c0) + Complex64::new(0.0, omega * c1) * response
    }

    /// The root mean square of the free decay of each stay: each change of frequency sets off one as
    /// large as the motion before and after it, in a random phase.
    fn sizes(&self, circuit: &[f64; CIRCUIT]) -> Vec<f64> {
        let branch = Branch::new(circuit[0], circuit[1]);
        let (mut square, mut forced) = (0.0, branch.q * branch.q);
        let size = |stay: &Stay| {
            let now = branch.response(stay.omega).0.norm_sqr();
            square = now + forced + square * (2.0 * branch.s.re * stay.since_s).exp();
            forced = now;
            f64::sqrt(square) * circuit[3].abs() * branch.omega
        };
        self.stays.iter().map(size).collect()
    }

    /// The most likely free decays beside a circuit, by linear least squares.
    pub(super) fn first_amplitudes(
        &self,
        circuit: &[f64; CIRCUIT],
        variance: f64,
    ) -> Vec<Complex64> {
        let branch = Branch::new(circuit[0], circuit[1]);
        let first = |(stay, size): (&Stay, f64)| {
            let steady = Self::steady(circuit, &branch, stay.omega);
            let (mut top, mut bottom) = (Complex64::ZERO, size.powi(-2));
            for sample in &stay.samples {
                let weight = noise(stay, sample, variance).recip();
                let lambda = branch.s - Complex64::new(0.0, stay.omega);
                let column = sample.z * decay(lambda, sample.start_s, sample.integration_s).0;
                top += column.conj() * (1.0 - sample.z * steady) * weight;
                bottom += column.norm_sqr() * weight;
            }
            top / bottom
        };
        if !self.is_ringing {
            return vec![Complex64::ZERO; self.stays.len()];
        }
        self.stays.iter().zip(self.sizes(circuit)).map(first).collect()
    }

    pub(super) fn weights(&self, at: &Unknowns, variance: f64) -> Weights {
        let branch = Branch::new(at.circuit[0], at.circuit[1]);
        let sizes = self.sizes(&at.circuit);
        let of_stay = |(k, stay): (usize, &Stay)| {
            let steady = Self::steady(&at.circuit, &branch, stay.omega);
            let (amplitude, times) = (at.amplitudes[k], self.times(at, k));
            let of_sample = |(sample, t): (&Sample, f64)| {
                let of_noise = noise(stay, sample, variance);
                let drive = Complex64::new(0.0, stay.omega);
                if !self.is_ringing {
                    // The rest of the free decay after settling has an unknown phase.
                    let lambda = branch.s - drive;
                    let rest = decay(lambda, sample.settle_s, sample.integration_s).0;
                    return of_noise + 0.5 * (sizes[k] * rest / steady).norm_sqr();
                }
                let model = steady + amplitude * decay(branch.s - drive, t, sample.integration_s).0;
                let counter = decay(branch.s.conj() - drive, t, sample.integration_s).0;
                of_noise + 0.5 * (amplitude * counter / model).norm_sqr()
            };
            stay.samples.iter().zip(times).map(of_sample).collect()
        };
        let variances = self.stays.iter().enumerate().map(of_stay).collect();
        Weights { sizes, variances }
    }

    /// When each reading of a stay began, s after the first.
    fn times(&self, at: &Unknowns, stay: usize) -> Vec<f64> {
        let mut late = 0.0;
        let steps = at.steps[stay].iter().enumerate().map(|(i, step)| step * self.gap_sigma_s(i));
        let time = |(sample, step_s): (&Sample, f64)| {
            late += step_s;
            sample.start_s + late
        };
        self.stays[stay].samples.iter().zip([0.0].into_iter().chain(steps)).map(time).collect()
    }

    /// Standard deviation of a gap of a stay, s.
    fn gap_sigma_s(&self, gap: usize) -> f64 {
        if gap == 0 { GAP_SIGMA_S.hypot(self.first_gap_s) } else { GAP_SIGMA_S }
    }

    /// The largest variance of the logarithm of the resonance if a second mode of any size is at one of
    /// the places, and the largest variance of its size.
    pub(super) fn widest(&self, at: &Unknowns, weights: &Weights) -> (f64, f64) {
        let places = MODES_AT.into_iter().flat_map(|place| [-place, place]);
        let at_place = |place: f64| {
            let [ln_f, ln_q, ..] = at.circuit;
            let ln_f = ln_f + (1.0 + place * (-ln_q).exp()).max(0.1).ln();
            let mode = Branch::new(ln_f, ln_q);
            let normal = self.normal(at, weights, Some(&mode));
            Some((normal.variance(0)?, normal.variance(MODE)?))
        };
        let larger = |a: (f64, f64), b: (f64, f64)| (a.0.max(b.0), a.1.max(b.1));
        places.filter_map(at_place).fold((0.0, 0.0), larger)
    }

    /// The time for which the resonance holds, s after the begin of the first reading: where a resonance
    /// that changes evenly has the value of the fit. It is what the normal equations say of residuals
    /// that grow with the time, so that it can be outside the sweep.
    /// A resonance that is followed may be stated for any time of the sweep.
    pub(super) fn effective_s(&self, at: &Unknowns, weights: &Weights) -> Option<f64> {
        if let Some(Course { stated_s, span_s, .. }) = self.course() {
            // The span of a forged sweep may be negative.
            return Some(stated_s.max(0.0).min(span_s));
        }
        let branch = Branch::new(at.circuit[0], at.circuit[1]);
        let mut normal = Normal::default();
        for k in 0..self.stays.len() {
            self.add_stay(k, at, weights, (&branch, None, Row::Moving), &mut normal);
        }
        for unknown in MODE..GLOBAL {
            normal.expect(unknown, 0.0, 1.0);
        }
        for (i, (_, sigma)) in EXPECTED.into_iter().enumerate() {
            normal.expect(i + 1, 0.0, sigma);
        }
        Some(normal.step(0.0)?.global[0])
    }

    const fn course(&self) -> Option<Course> {
        match self.beside {
            Some(Beside::Moving(course)) => Some(course),
            _ => None,
        }
    }

    /// Duration of the readings, s.
    pub(super) fn span_s(&self) -> f64 {
        let last = self.stays.last().and_then(|stay| stay.samples.last());
        let last_s = last.map_or(0.0, |last| last.start_s + last.integration_s);
        self.begin_s(self.stays.len().saturating_sub(1)) + last_s
    }

    /// The begin of a stay, s after that of the first one.
    fn begin_s(&self, stay: usize) -> f64 {
        self.stays[..=stay].iter().skip(1).map(|stay| stay.since_s).sum()
    }

    /// The motion of a mode with the capacitance 1 in each stay, as an admittance: its steady part, and
    /// the rest at the first reading. At a change of frequency the drive jumps in phase by the same angle
    /// for all modes.
    fn motions(
        &self,
        at: &Unknowns,
        branch: &Branch,
        mode: &Branch,
    ) -> Vec<(Complex64, Complex64)> {
        let [.., c1, _] = at.circuit;
        let mut before: Option<(Complex64, Complex64)> = None;
        let of_stay = |(k, stay): (usize, &Stay)| {
            let drive = Complex64::new(0.0, stay.omega);
            let steady = |of: &Branch| drive * of.response(stay.omega).0;
            let (own, other) = (c1 * steady(branch), steady(mode));
            let begins = own + at.amplitudes[k];
            let kept = before.map_or(Complex64::ZERO, |(end, other)| {
                let turn = begins / end;
                if turn.is_normal() { other * turn / turn.norm() } else { Complex64::ZERO }
            });
            let rest = kept - other;
            let next_s = self.stays.get(k + 1).map_or(0.0, |next| next.since_s);
            let left = |of: &Branch| ((of.s - drive) * next_s).exp();
            let ends = own + at.amplitudes[k] * left(branch);
            before = Some((ends, other + rest * left(mode)));
            (other, rest)
        };
        self.stays.iter().enumerate().map(of_stay).collect()
    }

    pub(super) fn normal(&self, at: &Unknowns, weights: &Weights, mode: Option<&Branch>) -> Normal {
        let branch = Branch::new(at.circuit[0], at.circuit[1]);
        let mut normal = Normal::default();
        let motions = mode.map(|mode| (mode, self.motions(at, &branch, mode)));
        for k in 0..self.stays.len() {
            let mode = motions.as_ref().map(|(branch, motions)| {
                let (steady, rest) = motions[k];
                Mode { branch, steady, rest }
            });
            self.add_stay(k, at, weights, (&branch, mode, Row::Measured), &mut normal);
        }
        let free = mode.map_or_else(|| self.beside.map_or(0, Beside::count), |_| 1);
        for unknown in MODE + free..GLOBAL {
            normal.expect(unknown, 0.0, 1.0);
        }
        for (i, (expected, sigma)) in EXPECTED.into_iter().enumerate() {
            normal.expect(i + 1, at.circuit[i + 1] - expected, sigma);
        }
        normal
    }

    fn add_stay(
        &self,
        k: usize,
        at: &Unknowns,
        weights: &Weights,
        (branch, mode, kind): (&Branch, Option<Mode<'_>>, Row),
        normal: &mut Normal,
    ) {
        let (stay, size, amplitude) = (&self.stays[k], weights.sizes[k], at.amplitudes[k]);
        let unknowns = if self.is_ringing { 1 + stay.samples.len() } else { 0 };
        let mut part = Part::new(unknowns);
        let [_, _, c0, c1, g] = at.circuit;
        let drive = Complex64::new(0.0, stay.omega);
        let times = self.times(at, k);
        let moving = self.moving(k, at, &times, kind);
        for (i, (sample, t)) in stay.samples.iter().zip(times).enumerate() {
            let (mean, [by_f, by_q, by_change, in_time]) = moving.as_ref().map_or_else(
                || {
                    let shift =
                        self.beside.map_or(0.0, |kind| kind.ln_shift(&at.beside, sample.when));
                    let when = (t, sample.integration_s);
                    resting(&branch.moved(shift), stay.omega, when, (c1, amplitude))
                },
                |moving| moving[i],
            );
            let (omega, resonance) = (stay.omega, branch.omega);
            let place = Place { omega, when: sample.when, z: sample.z, resonance, by_f, by_change };
            let beside = beside::seen(self.beside, &at.beside, &place);
            let of_capacitor = Complex64::new(stay.omega * g, stay.omega * c0);
            let model = of_capacitor + beside.y + mean.motion(c1, amplitude);
            let scale = weights.variances[k][i].sqrt().recip();
            let sum = beside.z * model + 1.0;
            let r = 2.0 * (beside.z * model - 1.0) / sum * scale;
            let slope = 4.0 * beside.z / (sum * sum) * scale;
            let slope_of_z = 4.0 * model / (sum * sum) * scale;
            let mut global = [Complex64::ZERO; GLOBAL];
            global[..CIRCUIT].copy_from_slice(&[
                slope * (by_f + beside.by_f),
                slope * by_q,
                slope * drive,
                slope * mean.forced,
                slope * stay.omega,
            ]);
            for (unknown, by) in global[CIRCUIT..].iter_mut().enumerate() {
                *by = slope * beside.y_by[unknown] + slope_of_z * beside.z_by[unknown];
            }
            if let Some(Mode { branch: mode, steady, rest }) = mode {
                let rest = if self.is_ringing { rest } else { Complex64::ZERO };
                let of_mode = steady + rest * decay(mode.s - drive, t, sample.integration_s).0;
                global[MODE] = slope * of_mode;
            }
            let local = self.local(slope * mean.free * size, slope * in_time, (i, unknowns));
            let re: Vec<f64> = local.iter().map(|x| x.re).collect();
            let im: Vec<f64> = local.iter().map(|x| x.im).collect();
            let r = match kind {
                Row::Measured => r,
                Row::Moving => -slope * by_change,
            };
            normal.add(&mut part, r.re, &global.map(|x| x.re), &re);
            normal.add(&mut part, r.im, &global.map(|x| x.im), &im);
        }
        let cost = self.expect_decay(amplitude / size, &at.steps[k], kind, &mut part);
        normal.finish(part, cost);
    }

    /// The motion in the readings of a stay with its slopes, if the resonance moves or is asked for by how much it would.
    fn moving(
        &self,
        k: usize,
        at: &Unknowns,
        times: &[f64],
        kind: Row,
    ) -> Option<Vec<(Mean, [Complex64; 4])>> {
        let (course, change) = match (self.course(), kind) {
            (Some(course), _) => (course, at.beside[0]),
            (None, Row::Moving) => (Course::EVEN, 0.0),
            (None, Row::Measured) => return None,
        };
        let stay = &self.stays[k];
        let integrations = stay.samples.iter().map(|sample| sample.integration_s);
        let readings = times.iter().copied().zip(integrations).collect();
        let passage = Passage { course, omega: stay.omega, begin_s: self.begin_s(k), readings };
        let [ln_f, ln_q, _, c1, _] = at.circuit;
        Some(passage.slopes([ln_f, ln_q, change], c1, at.amplitudes[k]))
    }

    /// What is expected of the free decay and the gaps of a stay, and what that costs.
    fn expect_decay(&self, amplitude: Complex64, steps: &[f64], kind: Row, part: &mut Part) -> f64 {
        if !self.is_ringing {
            return 0.0;
        }
        let sigma = AMPLITUDE_SHARE.sqrt();
        let found = |value: f64| if matches!(kind, Row::Measured) { value } else { 0.0 };
        let of_amplitude =
            part.expect(0, found(amplitude.re), sigma) + part.expect(1, found(amplitude.im), sigma);
        steps
            .iter()
            .enumerate()
            .fold(of_amplitude, |cost, (i, step)| cost + part.expect(2 + i, found(*step), 1.0))
    }

    /// The derivatives of reading `i` with respect to the unknowns of its stay: both parts of the amplitude,
    /// and the errors of the gaps before it.
    fn local(
        &self,
        by_amplitude: Complex64,
        in_time: Complex64,
        (i, unknowns): (usize, usize),
    ) -> Vec<Complex64> {
        let mut local = vec![Complex64::ZERO; unknowns];
        if self.is_ringing {
            (local[0], local[1]) = (by_amplitude, by_amplitude * Complex64::I);
            for (gap, late) in local[2..2 + i].iter_mut().enumerate() {
                *late = in_time * self.gap_sigma_s(gap);
            }
        }
        local
    }

    /// Levenberg and Marquardt. Where the steps end before the minimum, the comparison with the stated
    /// circuit tells.
    pub(super) fn descend(&self, at: &mut Unknowns, weights: &Weights) -> Normal {
        let mut normal = self.normal(at, weights, None);
        let mut damping = 1e-3;
        for _ in 0..STEPS_MAX {
            let Some(step) = normal.step(damping) else {
                damping = f64::max(damping, 1e-6) * 10.0;
                continue;
            };
            let next = at.moved(&step, weights);
            let lower = self.normal(&next, weights, None);
            if lower.cost <= normal.cost {
                let saved = normal.cost - lower.cost;
                let is_too_long = saved < KEPT_PROMISE * normal.promise(&step);
                damping = if is_too_long { damping.max(1e-6) * 10.0 } else { damping * 0.1 };
                (*at, normal) = (next, lower);
                if saved < ENOUGH {
                    return normal;
                }
            } else if damping > 1e8 {
                // Rounding is all that is left.
                return normal;
            } else {
                damping = f64::max(damping, 1e-9) * 10.0;
            }
        }
        normal
    }
}

/// The variance of each part of a reading by the noise; infinite for one that is not used.
fn noise(stay: &Stay, sample: &Sample, variance: f64) -> f64 {
    let variance = if sample.is_used { variance } else { f64::INFINITY };
    variance * 10.0 * 2.0 * PI / (sample.integration_s * stay.omega)
}
