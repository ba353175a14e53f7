//! The posterior over angle and azimuth, on cells that are split where it is high.

use std::f64::consts::{PI, TAU};

use super::{AnglePrior, AzimuthPrior, Interval, LogVariances, Problem, node::Node};

/// Rows of angles and columns of azimuths of the first grid.
const ROWS: u32 = 8;
const COLUMNS: u32 = 16;
/// Largest number of halvings.
const SPLITS: u32 = 12;
/// Halves whose logarithmic evidence differs from that of the whole by less are not split further.
/// The cells of a normal distribution are then about one standard deviation wide, and sums over
/// their middles are exact to a thousandth.
const SMOOTH: f64 = 1.0;
/// The smallest number of cells that are split in each round: the first grid is coarser than a sharp
/// posterior, and its best cell may be the wrong one.
const SPLIT_AT_LEAST: usize = 16;
/// Cells whose logarithmic evidence is this far below the best are not split.
const NEGLIGIBLE: f64 = 10.0;
/// Standard deviations to each side over which a known angle is explored.
const KNOWN_WIDTH: f64 = 5.0;

/// A cell of angles and azimuths with the best stiffness at its middle.
#[derive(Debug, Clone, Copy)]
struct Cell {
    angle: f64,
    azimuth: f64,
    half_angle: f64,
    half_azimuth: f64,
    /// Whether the last halving changed the evidence little.
    was_smooth: bool,
    node: Node,
}

impl Cell {
    /// The logarithm of the posterior's mass in the cell.
    fn log_mass(&self) -> f64 {
        // A known azimuth has no width.
        let width = if self.half_azimuth > 0.0 { self.half_azimuth } else { 1.0 };
        self.node.log_evidence + (self.half_angle * width).ln()
    }
}

/// The posterior as cells with weights that sum to one.
pub(super) struct Posterior {
    cells: Vec<(f64, Cell)>,
}

impl Posterior {
    /// The posterior of a problem; `None` when the model refuses at every node.
    pub(super) fn explore(problem: &Problem<'_>, start_log: f64) -> Option<Self> {
        let mut open = first_grid(problem, start_log);
        let mut settled = Vec::new();
        for _ in 0..SPLITS {
            open.sort_by(|a, b| b.node.log_evidence.total_cmp(&a.node.log_evidence));
            let Some(best) = best_evidence(open.iter().chain(&settled)) else { break };
            let split = open
                .iter()
                .take_while(|cell| cell.node.log_evidence > best - NEGLIGIBLE)
                .count()
                .max(SPLIT_AT_LEAST.min(open.len()));
            settled.extend(open.drain(split..));
            let mut next = Vec::with_capacity(2 * split);
            for cell in open {
                let halves = halves(problem, &cell);
                let is_smooth = halves
                    .iter()
                    .all(|half| (half.node.log_evidence - cell.node.log_evidence).abs() < SMOOTH);
                // The other direction may still be rough.
                if is_smooth && cell.was_smooth { &mut settled } else { &mut next }
                    .extend(halves.into_iter().map(|half| Cell { was_smooth: is_smooth, ..half }));
            }
            open = next;
        }
        settled.extend(open);
        Self::weighted(settled)
    }

    fn weighted(cells: Vec<Cell>) -> Option<Self> {
        let best = cells.iter().map(Cell::log_mass).max_by(f64::total_cmp)?;
        let mut cells: Vec<(f64, Cell)> =
            cells.into_iter().map(|cell| ((cell.log_mass() - best).exp(), cell)).collect();
        cells.retain(|(weight, _)| *weight > LIGHTEST);
        let sum: f64 = cells.iter().map(|(weight, _)| weight).sum();
        for (weight, _) in &mut cells {
            *weight /= sum;
        }
        Some(Self { cells })
    }

    /// The smallest chi-squared of any cell, at least zero.
    pub(super) fn chi_squared(&self) -> f64 {
        let all = self.cells.iter().map(|(_, cell)| cell.node.chi_squared);
        all.fold(f64::INFINITY, f64::min).max(0.0)
    }

    /// The posterior of ln E: a sum of normal distributions.
    pub(super) fn log_young(&self) -> Interval {
        let value = self.mean(|cell| cell.node.log_young);
        let variance = self.mean(|cell| cell.node.variance + (cell.node.log_young - value).powi(2));
        let below = |log: f64| {
            self.mean(|cell| normal_below((log - cell.node.log_young) / cell.node.variance.sqrt()))
        };
        let reach = REACH * variance.sqrt();
        interval(value, variance, (value - reach, value + reach), below)
    }

    /// The variance of ln E by cause.
    pub(super) fn log_variances(&self) -> LogVariances {
        let value = self.mean(|cell| cell.node.log_young);
        let of = |part: fn(&LogVariances) -> f64| self.mean(|cell| part(&cell.node.variances));
        LogVariances {
            resonance: of(|all| all.resonance),
            reference: of(|all| all.reference),
            sample: of(|all| all.sample),
            own_depth: of(|all| all.own_depth),
            shared_depth: of(|all| all.shared_depth),
            tilt: self.mean(|cell| (cell.node.log_young - value).powi(2)),
        }
    }

    /// The posterior of the angle.
    pub(super) fn angle(&self) -> Interval {
        self.even(|cell| (cell.angle, cell.half_angle))
    }

    /// The posterior of the azimuth, unrolled about its circular mean.
    pub(super) fn azimuth(&self) -> Interval {
        let sine = self.mean(|cell| cell.azimuth.sin());
        let cosine = self.mean(|cell| cell.azimuth.cos());
        let middle = sine.atan2(cosine);
        let unrolled = |azimuth: f64| middle + (azimuth - middle + PI).rem_euclid(TAU) - PI;
        self.even(|cell| (unrolled(cell.azimuth), cell.half_azimuth))
    }

    /// The correlation of ln E and the angle.
    pub(super) fn correlation(&self) -> f64 {
        let log = self.mean(|cell| cell.node.log_young);
        let angle = self.mean(|cell| cell.angle);
        let together = self.mean(|cell| (cell.node.log_young - log) * (cell.angle - angle));
        let of_log = self.mean(|cell| cell.node.variance + (cell.node.log_young - log).powi(2));
        let of_angle = self.mean(|cell| (cell.angle - angle).powi(2));
        together / (of_log * of_angle).sqrt()
    }

    fn mean(&self, of: impl Fn(&Cell) -> f64) -> f64 {
        self.cells.iter().map(|(weight, cell)| weight * of(cell)).sum()
    }

    /// The interval of a quantity that is spread evenly over each cell; `of` gives the middle and the
    /// half width.
    fn even(&self, of: impl Fn(&Cell) -> (f64, f64)) -> Interval {
        let value = self.mean(|cell| of(cell).0);
        let variance = self.mean(|cell| (of(cell).0 - value).powi(2));
        let below = |x: f64| {
            self.mean(|cell| {
                let (middle, half) = of(cell);
                if half > 0.0 {
                    (0.5 + 0.5 * (x - middle) / half).clamp(0.0, 1.0)
                } else {
                    f64::from(u8::from(middle <= x))
                }
            })
        };
        let ends = |sign: f64| {
            let end = |(_, cell): &(f64, Cell)| sign * of(cell).0 + of(cell).1;
            sign * self.cells.iter().map(end).fold(f64::NEG_INFINITY, f64::max)
        };
        interval(value, variance, (ends(-1.0), ends(1.0)), below)
    }
}

/// Standard deviations to each side in which the quantiles of a stiffness are sought.
const REACH: f64 = 8.0;
/// Bisections of a quantile, to a ten-millionth of the range.
const BISECTIONS: u32 = 24;
/// Cells lighter than this share of the heaviest are dropped. Their sum is below the error of the
/// splitting.
const LIGHTEST: f64 = 1e-6;

/// An interval whose quantiles are sought between two ends of a distribution function.
fn interval(value: f64, variance: f64, ends: (f64, f64), below: impl Fn(f64) -> f64) -> Interval {
    let quantile = |share: f64| {
        let (mut low, mut high) = ends;
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (low + high);
            if below(middle) < share { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    };
    Interval { value, sigma: variance.sqrt(), low: quantile(0.025), high: quantile(0.975) }
}

fn first_grid(problem: &Problem<'_>, start_log: f64) -> Vec<Cell> {
    let (low, high) = match problem.angle {
        AnglePrior::Within { max_rad } => (0.0, max_rad),
        AnglePrior::Known { angle_rad, sigma_rad } => {
            let reach = KNOWN_WIDTH * sigma_rad;
            ((angle_rad - reach).max(0.0), (angle_rad + reach).min(0.5 * PI))
        }
    };
    let half_angle = 0.5 * (high - low) / f64::from(ROWS);
    let (columns, start, half_azimuth) = match problem.azimuth {
        AzimuthPrior::Known(azimuth) => (1, azimuth, 0.0),
        AzimuthPrior::Unknown => (COLUMNS, 0.0, PI / f64::from(COLUMNS)),
    };
    let mut cells = Vec::new();
    for row in 0..ROWS {
        let angle = low + half_angle * f64::from(2 * row + 1);
        for column in 0..columns {
            let azimuth = start + half_azimuth * f64::from(2 * column);
            if let Some(node) = Node::at(problem, angle, azimuth, start_log) {
                let was_smooth = false;
                cells.push(Cell { angle, azimuth, half_angle, half_azimuth, was_smooth, node });
            }
        }
    }
    cells
}

fn best_evidence<'a>(cells: impl Iterator<Item = &'a Cell>) -> Option<f64> {
    cells.map(|cell| cell.node.log_evidence).max_by(f64::total_cmp)
}

/// The two halves of a cell across its longer side.
///
/// An azimuth turns the surface's normal in proportion to the sine of the angle. Cells near the
/// upright pose are therefore halved in angle until they are no longer than wide.
fn halves(problem: &Problem<'_>, cell: &Cell) -> Vec<Cell> {
    let is_wide = cell.half_azimuth * cell.angle.sin() > cell.half_angle;
    let (half_angle, half_azimuth) = if is_wide {
        (cell.half_angle, 0.5 * cell.half_azimuth)
    } else {
        (0.5 * cell.half_angle, cell.half_azimuth)
    };
    [-1.0, 1.0]
        .into_iter()
        .filter_map(|side| {
            let (angle, azimuth) = if is_wide {
                (cell.angle, cell.azimuth + side * half_azimuth)
            } else {
                (cell.angle + side * half_angle, cell.azimuth)
            };
            let node = Node::at(problem, angle, azimuth, cell.node.log_young)?;
            Some(Cell { angle, azimuth, half_angle, half_azimuth, was_smooth: false, node })
        })
        .collect()
}

/// The cumulative standard normal distribution at `x`, within 1e-7.
///
/// # Source
/// Abramowitz and Stegun, Handbook of Mathematical Functions, 26.2.17.
fn normal_below(x: f64) -> f64 {
    const COEFFICIENTS: [f64; 5] =
        [0.319_381_530, -0.356_563_782, 1.781_477_937, -1.821_255_978, 1.330_274_429];
    let t = (1.0 + 0.231_641_9 * x.abs()).recip();
    let tail = COEFFICIENTS.iter().rev().fold(0.0, |sum, coefficient| (sum + coefficient) * t)
        * (-0.5 * x * x).exp()
        / TAU.sqrt();
    if x > 0.0 { 1.0 - tail } else { tail }
}
