//! Readings in, verdict out.

use std::f64::consts::LN_2;

use rig_model::{Reading, Window};

use crate::{
    Circuit, Reason, Refusal, Resonance, Rung, Side, Verdict,
    dense::Cholesky,
    kernel::{self, PARAMETERS, Residual, Spread, Theta, on_this_machine},
    lanes::LANES,
    points::Points,
    solve::{End, ROUNDING, Solution, rational_start, solve},
};

/// What is known besides the readings.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FitOptions {
    /// Where the resonance was sought; the span of the readings where this is not given.
    pub window: Option<Window>,
    /// What is known of the noise; estimated from the residuals where this is not given.
    pub noise: Option<NoisePrior>,
    /// Whether dielectric loss is a free parameter even where the readings do not ask for it. Few
    /// readings at the frequencies that tell most of the resonance tell hardly anything of loss,
    /// and what they cannot exclude belongs into the uncertainty.
    pub always_loss: bool,
}

/// Noise known from earlier readings of the same analyzer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoisePrior {
    /// Standard deviation of the real and of the imaginary part of the relative error of a reading
    /// of ten cycles.
    pub at_ten_cycles: f64,
    /// How many independent errors this comes from; infinite where it is certain.
    pub degrees_of_freedom: f64,
}

/// A fit before it is judged.
#[derive(Debug)]
struct Estimate {
    solution: Solution,
    spread: Spread,
    /// How many parameters were free.
    free: usize,
    resonance: Resonance,
}

/// Five parameters and two readings more, so that something is left to judge by.
pub(crate) const POINTS_MIN: usize = 7;
/// Twice the log-likelihood that a resonance must gain over a capacitor. Chance gains 40 once in a
/// million sweeps: three parameters, one of them tried at up to a few hundred places.
const GAIN_MIN: f64 = 40.0;
/// A tenth of the linewidth: beyond it the model is no longer linear over the uncertainty.
const SIGMA_MAX_LINEWIDTHS: f64 = 0.1;
/// |r|² of a good reading is exponentially distributed; this many means are exceeded once in a
/// million readings.
const OUTLIER_MEANS: f64 = 14.0;
/// One reading in ten may be an outlier. With more, the rest is not to be trusted either.
const READINGS_PER_OUTLIER: usize = 10;
/// χ² may exceed its mean by this many of its standard deviations.
const CHI_SQUARED_SIGMAS: f64 = 5.0;

/// Finds the resonance in readings, in whatever order they were taken.
pub fn fit(readings: &[Reading], options: &FitOptions) -> Verdict {
    Fitter::default().fit(readings, options)
}

/// A fit that keeps its memory: nothing is allocated once it has seen as many readings before.
#[derive(Debug, Clone, Default)]
pub struct Fitter {
    points: Points,
    residuals: Vec<Residual>,
}

impl Fitter {
    /// Finds the resonance in readings, in whatever order they were taken.
    pub fn fit(&mut self, readings: &[Reading], options: &FitOptions) -> Verdict {
        let estimate = match self.estimate(readings, options) {
            Ok(estimate) => estimate,
            Err(reason) => return Verdict::Refused(Refusal { reason, estimate: None }),
        };
        let found = estimate.resonance;
        match self.doubt(&estimate, options) {
            None => Verdict::Accepted(found),
            Some(reason) => Verdict::Refused(Refusal { reason, estimate: Some(found) }),
        }
    }

    /// The most likely circuit, or why there is none.
    fn estimate(&mut self, readings: &[Reading], options: &FitOptions) -> Result<Estimate, Reason> {
        on_this_machine(|| self.points.load(readings))
            .map_err(|fault| Reason::NotFinite { index: fault.index })?;
        let Points { count: found, overloaded, .. } = self.points;
        let readings = readings.len();
        if 2 * overloaded > readings || (overloaded > 0 && found < POINTS_MIN) {
            return Err(Reason::Saturated { overloaded, readings });
        }
        if found < POINTS_MIN {
            return Err(Reason::TooFewPoints { found, needed: POINTS_MIN });
        }
        let start = rational_start(&self.points)
            .ok_or(Reason::NoResonance { found: 0.0, needed: GAIN_MIN })?;
        let (solution, spread, free) = self.climb(start, options)?;
        let resonance = self.resonance(&solution, free, options);
        Ok(Estimate { solution, spread, free, resonance })
    }

    /// Why an estimate is not to be relied on.
    fn doubt(&self, estimate: &Estimate, options: &FitOptions) -> Option<Reason> {
        let Estimate { solution, spread, free, resonance: found } = estimate;
        if solution.end == End::OutOfSteps {
            return Some(Reason::NotConverged);
        }
        let gain =
            self.degrees(*free) * (self.points.capacitor_cost(spread) / solution.normal.cost).ln();
        // What is not a number must be refused as well, here and below.
        let is_resonance = gain > GAIN_MIN && solution.theta.kappa > 0.0;
        if !is_resonance {
            return Some(Reason::NoResonance { found: gain, needed: GAIN_MIN });
        }
        let Points { lowest_hz: min_hz, highest_hz: max_hz, .. } = self.points;
        let window = options.window.unwrap_or(Window { min_hz, max_hz });
        if let Some(side) = beyond(window, found.resonance_hz) {
            return Some(Reason::OutsideWindow { side, estimate_hz: found.resonance_hz, window });
        }
        let limit_hz = SIGMA_MAX_LINEWIDTHS * found.circuit().linewidth_hz();
        let is_precise = found.sigma_hz < limit_hz;
        if !is_precise {
            return Some(Reason::TooNoisy { sigma_hz: found.sigma_hz, limit_hz });
        }
        let allowed = self.chi_squared_allowed(*free, options);
        let is_described = found.chi_squared_per_dof < allowed;
        (!is_described).then_some(Reason::Misfit { found: found.chi_squared_per_dof, allowed })
    }

    /// The most likely circuit with as much model as the readings ask for, outliers left out.
    fn climb(
        &mut self,
        start: Theta,
        options: &FitOptions,
    ) -> Result<(Solution, Spread, usize), Reason> {
        let mut free = if options.always_loss { PARAMETERS } else { PARAMETERS - 1 };
        let mut solution = solve(&self.points, start, free);
        let mut spread = self.look(&solution);
        let readings = self.points.count;
        let mut left_out = 0;
        loop {
            let limit = OUTLIER_MEANS * self.usual_size(&solution, &spread);
            if spread.largest <= limit {
                break;
            }
            left_out += self.leave_out(limit);
            let allowed = readings / READINGS_PER_OUTLIER;
            if left_out > allowed || self.points.count < POINTS_MIN {
                return Err(Reason::Outliers { found: left_out, readings, allowed });
            }
            solution = solve(&self.points, solution.theta, free);
            spread = self.look(&solution);
        }
        if free < PARAMETERS && self.asks_for_loss(&solution) {
            free = PARAMETERS;
            solution = solve(&self.points, solution.theta, free);
            spread = self.look(&solution);
        }
        Ok((solution, spread, free))
    }

    /// Whether a fifth parameter would lower the Bayesian information criterion.
    fn asks_for_loss(&self, solution: &Solution) -> bool {
        let gradient = &solution.normal.gradient;
        let Some(factor) = Cholesky::new(&solution.normal.matrix, PARAMETERS, 0.0) else {
            return false;
        };
        let step = factor.solve(gradient);
        let saved: f64 = step.iter().zip(gradient).map(|(a, b)| a * b).sum();
        let degrees = self.degrees(PARAMETERS - 1);
        // Rounding is not noise, and asks for nothing.
        let variance = solution.normal.cost / degrees + ROUNDING * ROUNDING;
        saved / variance > (2.0 * self.points.count as f64).ln()
    }

    fn look(&mut self, solution: &Solution) -> Spread {
        let Self { points, residuals } = self;
        on_this_machine(|| kernel::residuals(&points.blocks, &solution.theta, residuals))
    }

    /// The mean of |r|² that readings without outliers would have: the plain mean where nothing
    /// sticks out, else from the median.
    fn usual_size(&self, solution: &Solution, spread: &Spread) -> f64 {
        let count = self.points.count as f64;
        let mean = solution.normal.cost / count;
        // An exponential distribution has ⟨x²⟩ = 2⟨x⟩².
        if spread.largest < OUTLIER_MEANS * mean && spread.fourth < 6.0 * count * mean * mean {
            return mean;
        }
        let mut sizes: Vec<f64> = self.used().map(|(_, _, size)| size).collect();
        let middle = sizes.len() / 2;
        let (_, median, _) = sizes.select_nth_unstable_by(middle, f64::total_cmp);
        *median / LN_2
    }

    /// (block, lane, weighted |r|²) of every reading in use.
    fn used(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        self.points.blocks.iter().zip(&self.residuals).enumerate().flat_map(|(i, (block, r))| {
            (0..LANES)
                .filter(|&lane| block.weight.0[lane] > 0.0)
                .map(move |lane| (i, lane, r.size.0[lane]))
        })
    }

    fn leave_out(&mut self, limit: f64) -> usize {
        let far: Vec<_> = self.used().filter(|&(_, _, size)| size > limit).collect();
        for &(block, lane, _) in &far {
            let weight = &mut self.points.blocks[block].weight.0[lane];
            self.points.total_weight -= *weight;
            *weight = 0.0;
        }
        self.points.count -= far.len();
        far.len()
    }

    fn degrees(&self, free: usize) -> f64 {
        (2 * self.points.count - free) as f64
    }

    /// What χ² per degree of freedom hardly ever exceeds when the model holds.
    fn chi_squared_allowed(&self, free: usize, options: &FitOptions) -> f64 {
        if let Some(prior) = options.noise {
            let variance = 2.0 / self.degrees(free) + 2.0 / prior.degrees_of_freedom;
            return 1.0 + CHI_SQUARED_SIGMAS * variance.sqrt();
        }
        // It is the inverse that is normally distributed, being a mean over many readings.
        let inverse = 1.0 - CHI_SQUARED_SIGMAS / self.degrees(free).sqrt();
        if inverse > 0.0 { 1.0 / inverse } else { f64::INFINITY }
    }

    /// The mean of r² per part from differences of readings that were taken one after the other: a
    /// slow misfit does not show in it.
    fn successive_variance(&self) -> f64 {
        let (mut sum, mut count) = (0.0, 0);
        let mut last: Option<(f64, f64, f64)> = None;
        for (i, lane, _) in self.used() {
            let (r, weight) = (&self.residuals[i], self.points.blocks[i].weight.0[lane]);
            let here = (r.re.0[lane], r.im.0[lane], 1.0 / weight);
            if let Some(last) = last {
                let squared = (here.0 - last.0).powi(2) + (here.1 - last.1).powi(2);
                sum += squared / (here.2 + last.2);
                count += 2;
            }
            last = Some(here);
        }
        sum / f64::from(count.max(1))
    }

    fn resonance(&self, solution: &Solution, free: usize, options: &FitOptions) -> Resonance {
        let Points { reference_hz, reference_farad, count, .. } = self.points;
        let theta = solution.theta;
        let degrees = self.degrees(free);
        let found = solution.normal.cost / degrees;
        let (variance, against, all) = match options.noise {
            None => (found, self.successive_variance(), degrees),
            Some(prior) => {
                let (known, weight) = (prior.at_ten_cycles.powi(2), prior.degrees_of_freedom);
                let pooled = if weight.is_finite() {
                    (weight * known + degrees * found) / (weight + degrees)
                } else {
                    known
                };
                (pooled, known, weight + degrees)
            }
        };
        let ratio = (1.0 + theta.nu).max(f64::MIN_POSITIVE);
        let circuit = Circuit {
            resonance_hz: reference_hz * ratio.sqrt(),
            q: ratio.sqrt() / theta.alpha,
            c0_farad: reference_farad * theta.c,
            c1_farad: reference_farad * theta.kappa / ratio,
            loss_tangent: theta.g / theta.c,
        };
        let (covariance, condition) =
            self.covariance(solution, free).unwrap_or(([[f64::INFINITY; 5]; 5], f64::INFINITY));
        let covariance = covariance.map(|row| row.map(|x| x * variance));
        Resonance {
            resonance_hz: circuit.resonance_hz,
            sigma_hz: covariance[0][0].sqrt() * student_factor(all),
            q: circuit.q,
            c0_farad: circuit.c0_farad,
            k_eff_squared: circuit.k_eff_squared(),
            loss_tangent: circuit.loss_tangent,
            figure_of_merit: circuit.figure_of_merit(),
            chi_squared_per_dof: found / against,
            noise_at_ten_cycles: variance.sqrt(),
            rung: if free == PARAMETERS { Rung::Loss } else { Rung::Circuit },
            points: count,
            covariance,
            condition,
        }
    }

    /// The covariance of the physical parameters for noise of variance 1, and the condition number.
    fn covariance(&self, solution: &Solution, free: usize) -> Option<([[f64; 5]; 5], f64)> {
        let inverse = Cholesky::new(&solution.normal.matrix, free, 0.0)?.inverse();
        let condition = condition(&solution.normal.matrix, &inverse, free);
        let Theta { nu, alpha, c, kappa, g } = solution.theta;
        let (ratio, root) = (1.0 + nu, (1.0 + nu).sqrt());
        let farad = self.points.reference_farad;
        // Rows: (resonance, Q, C0, C1, tan δ) by (ν, α, c, κ, g).
        let slope = [
            [0.5 * self.points.reference_hz / root, 0.0, 0.0, 0.0, 0.0],
            [0.5 / (root * alpha), -root / (alpha * alpha), 0.0, 0.0, 0.0],
            [0.0, 0.0, farad, 0.0, 0.0],
            [-farad * kappa / (ratio * ratio), 0.0, 0.0, farad / ratio, 0.0],
            [0.0, 0.0, -g / (c * c), 0.0, 1.0 / c],
        ];
        Some((sandwich(&slope, &inverse), condition))
    }
}

fn beyond(window: Window, frequency_hz: f64) -> Option<Side> {
    if frequency_hz < window.min_hz {
        Some(Side::Below)
    } else if frequency_hz > window.max_hz {
        Some(Side::Above)
    } else {
        None
    }
}

/// By how much the 97.5 % point of Student's distribution exceeds that of the normal one.
///
/// # Source
/// Abramowitz and Stegun 26.7.5, two terms; within 0.5 % from 8 degrees of freedom upwards.
fn student_factor(degrees: f64) -> f64 {
    const Z2: f64 = 1.96 * 1.96;
    1.0 + (Z2 + 1.0) / (4.0 * degrees) + ((5.0 * Z2 + 16.0) * Z2 + 3.0) / (96.0 * degrees * degrees)
}

/// The condition number, in the maximum norm, of a matrix that is scaled to ones on its diagonal.
fn condition(matrix: &[[f64; 5]; 5], inverse: &[[f64; 5]; 5], n: usize) -> f64 {
    let norm = |element: &dyn Fn(usize, usize) -> f64| {
        (0..n).map(|i| (0..n).map(|j| element(i, j).abs()).sum()).fold(0.0, f64::max)
    };
    let scale = |i: usize, j: usize| (matrix[i][i] * matrix[j][j]).sqrt();
    norm(&|i, j| matrix[i][j] / scale(i, j)) * norm(&|i, j| inverse[i][j] * scale(i, j))
}

/// S M Sᵀ.
fn sandwich(s: &[[f64; 5]; 5], m: &[[f64; 5]; 5]) -> [[f64; 5]; 5] {
    let product = |a: &[[f64; 5]; 5], b: &dyn Fn(usize, usize) -> f64| {
        std::array::from_fn::<[f64; 5], 5, _>(|i| {
            std::array::from_fn(|j| (0..5).map(|k| a[i][k] * b(k, j)).sum())
        })
    };
    let left = product(s, &|k, j| m[k][j]);
    product(&left, &|k, j| s[j][k])
}
