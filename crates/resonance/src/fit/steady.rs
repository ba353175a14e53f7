//! The quick fit for usual sweeps. It allocates no memory once its buffers are long enough, and makes
//! about seven passes over the readings.

use rig_model::Reading;

use crate::{
    Circuit, FitOptions, ModelOrder, Resonance, Timing,
    circuit::kernel::{self, PARAMETERS, PATTERNS, Residual, ResidualStatistics, Theta, WIDE},
    circuit::points::{NotFinite, Points},
    circuit::trace::{ExtraTerm, ModelEstimate},
    diagnose::alternatives::{Alternative, Cause},
    diagnose::screen::Screen,
    diagnose::unknown_dwell,
    fit::solve::{Solution, rational_start, solve},
    noise::{self, PooledVariance},
    numeric::dense::{Cholesky, condition, sandwich},
    numeric::descent::{End, Normal, Step},
    outcome::{LOSS_GAIN_MIN, Spread},
};

/// Number of the patterns at the resonance; the next one is that of a phase error.
const AT_RESONANCE: usize = PATTERNS - 1;
/// Largest residual transient, relative to the noise, that requires no full fit.
const SURELY_SETTLED: f64 = 0.3;

/// Thresholds below which readings show nothing unusual, and below which they are clean.
mod threshold {
    /// The largest |r|² over its mean. |r|² is exponentially distributed, so that one in two hundred
    /// good sweeps of a hundred readings exceeds `USUAL_LARGEST`, and one in two thousand
    /// `CLEAN_LARGEST`. An outlier has 14 times the mean of the others.
    pub(super) const USUAL_LARGEST: f64 = 10.0;
    pub(super) const CLEAN_LARGEST: f64 = 14.0;
    /// ⟨|r|⁴⟩/⟨|r|²⟩², which is 2 for an exponential distribution. This detects several outliers, which
    /// raise the mean and so mask each other.
    pub(super) const CLEAN_FOURTH: f64 = 4.0;
    /// The same of few readings: an outlier pulls the circuit towards itself, and less of it is left.
    pub(super) const CLEAN_FOURTH_OF_FEW: f64 = 3.0;
    pub(super) const FEW: usize = 28;
    /// χ² of three patterns; one good sweep in three exceeds this. The threshold is low because a second
    /// mode one linewidth away hardly affects the patterns.
    pub(super) const USUAL_PATTERNS: f64 = 3.0;
    /// Standard deviations of χ² per degree of freedom; one good sweep in forty exceeds this.
    pub(super) const USUAL_CHI_SQUARED_SIGMAS: f64 = 2.0;
    /// The same of clean readings; one good sweep in four thousand exceeds this.
    pub(super) const CLEAN_CHI_SQUARED_SIGMAS: f64 = 3.5;
}

/// The readings of a steady fit and their residuals.
#[derive(Debug, Clone, Default)]
pub(crate) struct SteadyFit {
    pub(crate) points: Points,
    residuals: Vec<Residual>,
    screen: Screen,
}

/// A solution with its number of unknowns and the statistics of its residuals.
#[derive(Debug)]
struct Fitted {
    solution: Solution,
    statistics: ResidualStatistics,
    free: usize,
}

/// The outcome of a steady fit.
#[derive(Debug)]
pub(crate) struct Found {
    /// The result, if the readings determine one.
    pub(crate) resonance: Option<Resonance>,
    /// Twice the log-likelihood gained over a capacitor.
    pub(crate) gain: f64,
    /// Addition to the relative variance of the resonance for causes that are not excluded; `None` if
    /// the readings show something that only the full fit handles.
    pub(crate) widening: Option<f64>,
    /// The start of the full fit.
    pub(crate) start: Option<ModelEstimate>,
}

impl SteadyFit {
    /// Loads the readings.
    pub(crate) fn load(&mut self, readings: &[Reading]) -> Result<(), NotFinite> {
        self.points.load(readings)
    }

    /// Fits the readings; `None` if no start value was found.
    pub(crate) fn fit(&mut self, options: &FitOptions) -> Option<Found> {
        let start = rational_start(&self.points)?;
        let mut solution = solve(&self.points, start, PARAMETERS);
        let (mut free, mut model_order) = (PARAMETERS, ModelOrder::Loss);
        if !options.always_loss
            && let Some((gain, without)) = self.gain_by_loss(&solution)
        {
            model_order = ModelOrder::by_loss(gain, self.points.count);
            if gain < LOSS_GAIN_MIN {
                (free, solution) = (PARAMETERS - 1, without);
            }
        }
        let statistics =
            kernel::statistics(&self.points.blocks, &solution.theta, &mut self.residuals);
        let resonance = self.resonance(&solution, &statistics, free, model_order, options);
        let capacitor = self.points.total_weight - statistics.capacitor;
        let fitted = Fitted { solution, statistics, free };
        let widening = resonance.and_then(|found| self.widening(&fitted, &found, options));
        let start = self.estimate(&fitted.solution);
        let gain = self.degrees(free) * (capacitor / fitted.solution.normal.cost).ln();
        Some(Found { resonance, gain, widening, start })
    }

    /// Addition to the relative variance of the resonance for causes that are not excluded.
    fn widening(
        &mut self,
        fitted: &Fitted,
        found: &Resonance,
        options: &FitOptions,
    ) -> Option<f64> {
        if !self.is_clean(fitted, found, options) {
            return None;
        }
        let Fitted { solution, statistics, free } = fitted;
        let noise =
            options.noise.as_ref().map_or_else(PooledVariance::default, PooledVariance::known);
        let degrees = self.degrees(*free);
        let noise = noise.with(solution.normal.cost.max(degrees * noise::VARIANCE_MIN), degrees);
        let by_phase = phase_error(solution, statistics, *free)
            .map_or(0.0, |found| found.widening(noise.gain(found.saved), noise.variance()));
        let saved = patterns(solution, statistics, *free)?;
        let is_usual = self.is_usual(fitted, saved, found, options);
        let Self { points, screen, .. } = self;
        let mut widest = by_phase;
        let is_unknown = options.timing == Timing::Unknown;
        if !is_usual || is_unknown {
            screen.fill(points, &solution.theta);
        }
        if !is_usual {
            if noise.gain(saved) > Cause::Shape.gain_needed() {
                return None;
            }
            widest = widest.max(screen.widening(points, solution, *free, noise)?);
        }
        if is_unknown {
            let dwells = screen.dwells(points, solution, *free)?;
            widest = widest.max(unknown_dwell::addition(dwells, noise.variance()));
        }
        Some(widest)
    }

    /// Twice the log-likelihood that dielectric loss gains, with the best solution without loss if that
    /// gain is small: within a standard deviation all derivatives are practically constant.
    fn gain_by_loss(&self, solution: &Solution) -> Option<(f64, Solution)> {
        let Solution { theta, normal, end } = *solution;
        let mut loss = [0.0; PARAMETERS];
        loss[PARAMETERS - 1] = 1.0;
        let column = Cholesky::new(&normal.matrix, PARAMETERS, 0.0)?.solve(&loss);
        let size = theta.g / column[PARAMETERS - 1];
        let cost = normal.cost + size * theta.g;
        // Rounding is not noise and requires no loss.
        let variance = cost / self.degrees(PARAMETERS - 1) + noise::VARIANCE_MIN;
        let without = Theta { g: 0.0, ..theta.minus(&column.map(|by| by * size)) };
        let normal = Normal { cost, ..normal };
        Some((size * theta.g / variance, Solution { theta: without, normal, end }))
    }

    fn degrees(&self, free: usize) -> f64 {
        (2 * self.points.count - free) as f64
    }

    /// Whether there is nothing that only the full fit handles: outliers or a misfit.
    fn is_clean(&self, fitted: &Fitted, found: &Resonance, options: &FitOptions) -> bool {
        let Fitted { solution, statistics, free } = fitted;
        let count = self.points.count as f64;
        let mean = (solution.normal.cost / count).max(noise::VARIANCE_MIN);
        let is_few = self.points.count < threshold::FEW;
        let fourth = if is_few { threshold::CLEAN_FOURTH_OF_FEW } else { threshold::CLEAN_FOURTH };
        let sigmas = threshold::CLEAN_CHI_SQUARED_SIGMAS;
        let allowed = noise::allowed(self.degrees(*free), options.noise.as_ref(), sigmas);
        self.points.is_monotonic
            && solution.end == End::Converged
            && statistics.largest < threshold::CLEAN_LARGEST * mean
            && statistics.fourth < fourth * count * mean * mean
            && found.chi_squared_per_dof < allowed
    }

    /// Whether clean readings need no look at other causes. `saved` is what the patterns at the resonance
    /// save of the cost.
    fn is_usual(
        &self,
        Fitted { solution, statistics, free }: &Fitted,
        saved: f64,
        found: &Resonance,
        options: &FitOptions,
    ) -> bool {
        let mean = (solution.normal.cost / self.points.count as f64).max(noise::VARIANCE_MIN);
        let variance = (solution.normal.cost / self.degrees(*free)).max(noise::VARIANCE_MIN);
        let sigmas = threshold::USUAL_CHI_SQUARED_SIGMAS;
        let allowed = noise::allowed(self.degrees(*free), options.noise.as_ref(), sigmas);
        statistics.largest < threshold::USUAL_LARGEST * mean
            && found.chi_squared_per_dof < allowed
            && saved < threshold::USUAL_PATTERNS * variance
    }

    /// Whether the residual transient after the shortest settling is negligible.
    pub(crate) fn has_surely_settled(&self, found: &Resonance) -> bool {
        let Points { settle_s, lowest_hz, highest_hz, count, .. } = self.points;
        let circuit = found.circuit();
        let step = (highest_hz - lowest_hz) / (count - 1) as f64 / circuit.linewidth_hz();
        let left = (-settle_s / circuit.time_constant_s()).exp();
        // Between points the admittance changes by up to M per half linewidth; the points within the
        // linewidth share the error.
        let error =
            found.figure_of_merit * (2.0 * step).min(1.0) * left * (1.0 / step).max(1.0).sqrt();
        error < SURELY_SETTLED * found.noise_at_ten_cycles
    }

    /// The start of the full fit.
    fn estimate(&self, solution: &Solution) -> Option<ModelEstimate> {
        let theta = solution.theta;
        let circuit = circuit_of(&self.points, solution)?;
        (theta.c > 0.0 && theta.kappa > 0.0).then_some(ModelEstimate {
            resonance_hz: circuit.resonance_hz,
            q: circuit.q,
            c0: theta.c,
            c1: theta.kappa / (1.0 + theta.nu),
            g: theta.g,
            extra_term: ExtraTerm::Nothing,
            extra: [0.0; 3],
        })
    }

    fn resonance(
        &self,
        solution: &Solution,
        statistics: &ResidualStatistics,
        free: usize,
        model_order: ModelOrder,
        options: &FitOptions,
    ) -> Option<Resonance> {
        let circuit = circuit_of(&self.points, solution)?;
        let inverse = Cholesky::new(&solution.normal.matrix, free, 0.0)?.inverse();
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
        let pairs = self.points.pairs();
        let spread = Spread {
            covariance: sandwich(&slope, &inverse),
            condition: condition(&solution.normal.matrix, &inverse, free),
            cost: solution.normal.cost.max(self.degrees(free) * noise::VARIANCE_MIN),
            neighbours: (statistics.differences / (2 * pairs.max(1)) as f64)
                .max(noise::VARIANCE_MIN),
            correlation: 1.0,
            count: self.points.count,
            degrees: self.degrees(free),
            settled: (solution.normal.cost, self.degrees(free)),
            widened: 0.0,
        };
        Some(Resonance::new(&circuit, &spread, model_order, options.noise.as_ref()))
    }
}

/// The circuit of a solution in farads.
pub(crate) fn circuit_of(points: &Points, solution: &Solution) -> Option<Circuit> {
    let theta = &solution.theta;
    let ratio = 1.0 + theta.nu;
    let Points { reference_hz, reference_farad, total_weight, .. } = *points;
    // For readings (1 + ε)Z the fitted admittance is too small by ⟨|ε|²⟩.
    let unbiased = 1.0 + solution.normal.cost / total_weight;
    (ratio > 0.0).then(|| Circuit {
        resonance_hz: reference_hz * ratio.sqrt(),
        q: ratio.sqrt() / theta.alpha,
        c0_farad: reference_farad * theta.c * unbiased,
        c1_farad: reference_farad * theta.kappa / ratio * unbiased,
        loss_tangent: theta.g / theta.c,
    })
}

/// Decrease of the cost when the patterns at the resonance are fitted to the residuals together with the
/// circuit.
fn patterns(solution: &Solution, statistics: &ResidualStatistics, free: usize) -> Option<f64> {
    let mut matrix = [[0.0; WIDE]; WIDE];
    let mut gradient = [0.0; WIDE];
    for (i, row) in solution.normal.matrix.iter().enumerate().take(free) {
        matrix[i][..free].copy_from_slice(&row[..free]);
    }
    for k in 0..AT_RESONANCE {
        matrix[free + k][..free].copy_from_slice(&statistics.with_circuit[k][..free]);
        matrix[free + k][free..free + PATTERNS].copy_from_slice(&statistics.among[k]);
        gradient[free + k] = statistics.gradient[k];
    }
    let step = Cholesky::new(&matrix, free + AT_RESONANCE, 0.0)?.solve(&gradient);
    Some(step.iter().zip(&gradient).map(|(a, b)| a * b).sum())
}

/// The effect of a phase error of the analyzer.
fn phase_error(
    solution: &Solution,
    statistics: &ResidualStatistics,
    free: usize,
) -> Option<Alternative> {
    let mut matrix = [[0.0; WIDE]; WIDE];
    for (i, row) in solution.normal.matrix.iter().enumerate().take(free) {
        matrix[i][..free].copy_from_slice(&row[..free]);
    }
    let with = &statistics.with_circuit[AT_RESONANCE];
    matrix[free][..free].copy_from_slice(&with[..free]);
    matrix[free][free] = statistics.among[AT_RESONANCE][AT_RESONANCE];
    let factor = Cholesky::new(&matrix, free + 1, 0.0)?;
    let unit = |k: usize| std::array::from_fn(|i| if i == k { 1.0 } else { 0.0 });
    let size_variance = factor.solve(&unit(free))[free];
    let size = size_variance * statistics.gradient[AT_RESONANCE];
    // From ν to the logarithm of the resonance.
    let slope = 0.5 / (1.0 + solution.theta.nu);
    let error = slope * factor.solve_leading(&matrix[free], free)[0];
    let variance_without = slope * slope * factor.solve_leading(&unit(0), free)[0];
    Some(Alternative {
        cause: Cause::AnalyzerPhase,
        saved: size * size / size_variance,
        shift: size * error,
        variance: slope * slope * factor.solve(&unit(0))[0],
        variance_without,
        size: -size,
        size_variance,
        error,
    })
}
