//! Every cause at once in clean, settled readings.
//!
//! The patterns are those of [`super::alternatives`] in the units of [`crate::circuit::kernel`], four
//! readings at a time. Of second modes only one per linewidth with the quality factor of the first is
//! tried, so that a cause that might be present is left to the full fit.

mod columns;

use std::f64::consts::TAU;

use num_complex::Complex64;

use crate::{
    circuit::kernel::{PARAMETERS, Theta},
    circuit::points::{Block, Points},
    circuit::trace::UNKNOWNS,
    diagnose::alternatives::{Alternative, BEYOND, Cause, MODES_MAX, NEAR, inflation_max},
    diagnose::tangents::{FEW, ModeBlock, Products, effect, few_products},
    diagnose::unknown_dwell::DWELLS,
    fit::solve::Solution,
    noise::PooledVariance,
    numeric::dense::Cholesky,
};
use columns::{Columns, Input, PATTERNS, PatternProducts, fill, products};

/// Causes other than second modes, with their first pattern and number of patterns.
const CAUSES: [(Cause, usize, usize); 6] = [
    (Cause::Drift, 0, 1),
    (Cause::Nonlinear, 1, 1),
    (Cause::Nonlinear, 1, 2),
    (Cause::Dispersion, 3, 1),
    (Cause::Stray, 4, 2),
    (Cause::NotSettled, 6, 2),
];
/// Distance below the gain that a second mode or unsettled motion needs from which the full fit decides:
/// a mode between two places gains more, and an unknown dwell more than a lag of one reading.
const MARGIN: f64 = 6.0;
/// Places of a second mode that resembles a change of the circuit, linewidths from the resonance.
const BESIDE: [f64; 2] = [-0.5, 0.5];

/// Buffers for the columns of the readings.
#[derive(Debug, Clone, Default)]
pub(crate) struct Screen {
    columns: Vec<Columns>,
    modes: Vec<ModeBlock>,
    stays: Vec<Stay>,
}

/// A reading in a sweep whose dwells are unknown. Admittances are over jωC₀, as in the kernel.
#[derive(Debug, Clone, Copy)]
struct Stay {
    /// The settled motion.
    forced: Complex64,
    /// Its effect on the residual.
    unit: Complex64,
    /// Rotation of the drive in half a time constant, against its sense.
    turn: Complex64,
    /// For four and ten cycles: the free motion left at the end, and its mean.
    left: [(Complex64, Complex64); 2],
}

/// The scale on which the effects of causes are measured.
struct Scale {
    factor: Cholesky<PARAMETERS>,
    /// Change of the logarithm of the resonance along each whitened parameter.
    lever: [f64; UNKNOWNS],
}

impl Scale {
    fn new(Solution { theta, normal, .. }: &Solution, free: usize) -> Option<Self> {
        let factor = Cholesky::new(&normal.matrix, free, 0.0)?;
        let mut scale = Self { factor, lever: [0.0; UNKNOWNS] };
        let mut unit = [0.0; PARAMETERS];
        // From ν to the logarithm of the resonance.
        unit[0] = 0.5 / (1.0 + theta.nu);
        scale.lever = scale.whitened(unit);
        Some(scale)
    }

    fn whitened(&self, right: [f64; PARAMETERS]) -> [f64; UNKNOWNS] {
        let mut wide = [0.0; UNKNOWNS];
        wide[..PARAMETERS].copy_from_slice(&self.factor.whitened(&right));
        wide
    }

    /// The effect of these consecutive patterns.
    fn effect(&self, cause: Cause, patterns: &[PatternProducts]) -> Option<Alternative> {
        let mut products = Products::default();
        for (i, one) in patterns.iter().enumerate() {
            let [residual, slopes @ ..] = one.fitted;
            (products.residual[i], products.basis[i]) = (residual, self.whitened(slopes));
            products.among[i][i] = one.own;
            if i + 1 < patterns.len() {
                (products.among[i][i + 1], products.among[i + 1][i]) = (one.next, one.next);
            }
        }
        effect(&self.lever, cause, patterns.len(), &products)
    }
}

impl Screen {
    /// The addition to the relative variance of the resonance for all causes that are not excluded;
    /// `None` if one might be present.
    pub(crate) fn widening(
        &mut self,
        points: &Points,
        solution: &Solution,
        free: usize,
        noise: PooledVariance,
    ) -> Option<f64> {
        let theta = &solution.theta;
        let scale = Scale::new(solution, free)?;
        let variance = noise.variance();
        let mut widest = 0.0_f64;
        let mut is_absent = |found: Option<Alternative>| {
            let Some(found) = found else { return true };
            let gain = noise.gain(found.saved);
            if found.variance < inflation_max(&found.cause, false) * found.variance_without {
                widest = widest.max(found.widening(gain, variance));
            }
            let margin = match found.cause {
                Cause::SecondMode { .. } | Cause::NotSettled => MARGIN,
                _ => 0.0,
            };
            gain < found.cause.gain_needed() - margin
        };
        let of_pattern: [_; PATTERNS] = std::array::from_fn(|k| products(&self.columns, k));
        for (cause, first, count) in CAUSES {
            if !is_absent(scale.effect(cause, &of_pattern[first..first + count])) {
                return None;
            }
        }
        let resonance = (1.0 + theta.nu).sqrt();
        let (width, q) = (theta.alpha, resonance / theta.alpha);
        let (low, high) =
            (points.lowest_hz / points.reference_hz, points.highest_hz / points.reference_hz);
        let beyond = BEYOND * (high - low);
        let (low, high) = (low - beyond, high + beyond);
        let places = ((high - low) / width).ceil().clamp(8.0, MODES_MAX as f64);
        let mut best: [Option<Alternative>; 2] = [None; 2];
        let step = (high - low) / places;
        let evenly = std::iter::successors(Some(low), |last| Some(last + step));
        let beside = BESIDE.map(|off| resonance + off * width);
        for frequency in evenly.take_while(|place| *place <= high).chain(beside) {
            let is_near = (frequency - resonance).abs() < NEAR * width;
            let mode = few_products(&self.modes, frequency, q);
            let mut fitted = [0.0; FEW];
            fitted.copy_from_slice(&mode.columns[..FEW]);
            let products = PatternProducts { fitted, own: mode.size, next: 0.0 };
            let frequency_hz = frequency * points.reference_hz;
            let cause = Cause::SecondMode { frequency_hz, q, is_near };
            let best = &mut best[usize::from(is_near)];
            if let Some(found) = scale.effect(cause, &[products])
                && found.size > 0.0
                && best.is_none_or(|best| best.saved < found.saved)
            {
                *best = Some(found);
            }
        }
        best.into_iter().all(is_absent).then_some(widest)
    }

    /// Fills the buffers for the other functions.
    pub(crate) fn fill(&mut self, points: &Points, theta: &Theta) {
        let input = Input { blocks: &points.blocks, theta: *theta, count: points.count };
        fill(&input, &mut self.columns, &mut self.modes);
    }

    /// The residual transient of a motion of size 1 for each trial dwell, of a drive that continues from
    /// reading to reading. The counter-rotating part is neglected. It uses the buffers of the patterns,
    /// so that [`Self::widening`] comes first.
    pub(crate) fn dwells(
        &mut self,
        points: &Points,
        solution: &Solution,
        free: usize,
    ) -> Option<Vec<Alternative>> {
        let theta = &solution.theta;
        let scale = Scale::new(solution, free)?;
        let half = 0.5 * theta.alpha;
        let ringing = (1.0 + theta.nu - half * half).max(0.0).sqrt();
        let (blocks, count) = (&points.blocks, points.count);
        let place = |i: usize| (i % blocks.len(), i / blocks.len());
        self.stays.clear();
        self.stays.extend((0..count).map(|i| {
            let (block, lane) = place(i);
            let Block { w, v, p_re, p_im, .. } = &blocks[block];
            let (w, v) = (w.0[lane], v.0[lane]);
            let j_w = Complex64::new(0.0, w);
            let forced = theta.kappa * j_w / Complex64::new(theta.nu - v, theta.alpha * w);
            let cycle = TAU / w;
            let two = (2.0 * cycle * Complex64::new(-half, ringing)).exp();
            let four = two * two;
            let ten = four * four * two;
            let over = 1.0 / (cycle * Complex64::new(-half, ringing - w));
            let left = [(four, (four - 1.0) * over / 4.0), (ten, (ten - 1.0) * over / 10.0)];
            let unit = Complex64::new(p_re.0[lane], p_im.0[lane]) / j_w;
            Stay { forced, unit, turn: Complex64::cis(-0.5 * w / half), left }
        }));
        let mut found = Vec::with_capacity(DWELLS.len());
        for (k, (dwell, cycles)) in DWELLS.into_iter().enumerate() {
            let settled = (-dwell).exp() * Complex64::cis(dwell * ringing / half);
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small")]
            let halves = (2.0 * dwell) as u32;
            let which = usize::from(cycles > 4.0);
            let mut motion = Complex64::ZERO;
            for (i, stay) in self.stays.iter().enumerate() {
                let (block, lane) = place(i);
                let mut left = motion - stay.forced;
                if halves > 0 {
                    left *= settled * stay.turn.powu(halves);
                }
                let (end, mean) = stay.left[which];
                let pattern = stay.unit * left * mean;
                let to = &mut self.columns[block].patterns[k];
                (to[0].0[lane], to[1].0[lane]) = (pattern.re, pattern.im);
                motion = stay.forced + left * end;
            }
            let of_dwell = products(&self.columns, k);
            found.extend(scale.effect(Cause::NotSettled, &[of_dwell]));
        }
        Some(found)
    }
}

#[cfg(test)]
mod tests {
    use rig_model::{Impedance, PointResult, Reading, RigTime};

    use super::*;
    use crate::{
        Circuit, Timing,
        circuit::trace::{CIRCUIT, ModelEstimate, Trace},
        diagnose::alternatives::Fitted,
        fit::solve::{rational_start, solve},
    };

    /// Readings with a smooth disturbance of a few standard deviations of 0.1 % of noise.
    fn readings(circuit: &Circuit) -> Vec<Reading> {
        (0..101)
            .map(|i| {
                let frequency_hz = 120.0 + 0.4 * f64::from(i);
                let error = Complex64::new((5.7 * f64::from(i)).sin(), (3.1 * f64::from(i)).cos());
                let slow = Complex64::new(f64::from(i) / 101.0, 0.3);
                let ohm = circuit.impedance_ohm(frequency_hz) * (1.0 + 1e-3 * (error + slow));
                Reading {
                    frequency_hz,
                    measured: PointResult::Value(Impedance {
                        resistance_ohm: ohm.re,
                        reactance_ohm: ohm.im,
                    }),
                    started: RigTime::ZERO,
                    settle_s: 0.5,
                    integration_s: 10.0 / frequency_hz,
                }
            })
            .collect()
    }

    /// The full fit computes them in another way, one reading at a time.
    #[test]
    fn the_effects_are_those_of_the_full_fit() {
        let circuit = Circuit {
            resonance_hz: 140.0,
            q: 30.0,
            c0_farad: 27e-9,
            c1_farad: 2e-9,
            loss_tangent: 0.02,
        };
        let readings = readings(&circuit);
        let mut points = Points::default();
        points.load(&readings).unwrap();
        let solution = solve(&points, rational_start(&points).unwrap(), PARAMETERS);
        let theta = solution.theta;
        let at = ModelEstimate {
            resonance_hz: points.reference_hz * (1.0 + theta.nu).sqrt(),
            q: (1.0 + theta.nu).sqrt() / theta.alpha,
            c0: theta.c,
            c1: theta.kappa / (1.0 + theta.nu),
            g: theta.g,
            ..ModelEstimate::of(&circuit, points.reference_farad)
        };
        let trace = Trace::of(&readings, Timing::Unknown, points.reference_farad);
        let full = Fitted::at(&trace, at, CIRCUIT);
        let mut screen = Screen::default();
        screen.fill(&points, &theta);
        let scale = Scale::new(&solution, PARAMETERS).unwrap();
        let of_pattern: [_; PATTERNS] = std::array::from_fn(|k| products(&screen.columns, k));
        let near = |a: f64, b: f64, part: f64| (a - b).abs() < part * b.abs();
        let all = full.alternatives();
        for (cause, first, count) in CAUSES {
            if cause == Cause::NotSettled || (cause == Cause::Nonlinear && count > 1) {
                continue;
            }
            let here = scale.effect(cause, &of_pattern[first..first + count]).unwrap();
            let there = all.iter().find(|found| found.cause == cause).unwrap();
            assert!(near(here.saved, there.saved, 0.03), "{here:?} {there:?}");
            assert!(near(here.shift, there.shift, 0.03), "{here:?} {there:?}");
            assert!(near(here.variance, there.variance, 0.03), "{here:?} {there:?}");
        }
        let dwells = screen.dwells(&points, &solution, PARAMETERS).unwrap();
        assert_eq!(dwells.len(), DWELLS.len());
        for (here, there) in dwells.iter().zip(full.dwells()) {
            assert!(near(here.error, there.error, 0.1), "{here:?} {there:?}");
            assert!(near(here.size_variance, there.size_variance, 0.2), "{here:?} {there:?}");
        }
    }
}
