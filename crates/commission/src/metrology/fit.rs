//! Least squares with the covariance of the screw.

use super::{
    BlockTouch, NoGeometry, ScrewMap,
    cholesky::Cholesky,
    screw::{Assumed, Screw},
};

/// Unknowns: s, D, p in mm, t₀ in rad.
const UNKNOWNS: usize = 4;
type Vector = [f64; UNKNOWNS];
type Matrix = [Vector; UNKNOWNS];

/// Fewest tilts, and how far they must reach to both sides, degrees.
const TILTS: usize = 5;
const REACH_DEG: f64 = 20.0;

/// Tilts that are nearer count as one, degrees.
const SAME_DEG: f64 = 1.0;

/// Largest χ² per degree of freedom: touches that scatter twice as much as stated. A touch that is a part of a
/// millimetre off, as one in the air, makes it larger with every screw that is tried.
const MISFIT: f64 = 4.0;

/// Gauss and Newton converge in three or four steps from the coarse start.
const STEPS: usize = 30;
const CONVERGED: f64 = 1e-9;

/// Standard deviations of a touch without the screw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TouchNoise {
    /// Of the height, mm: step of the search, noise, backlash.
    pub height_mm: f64,
    /// Of the tilt, degrees.
    pub tilt_deg: f64,
}

/// The geometry of a bench.
#[derive(Debug, Clone, PartialEq)]
pub struct BlockGeometry {
    /// Height of the level block, mm.
    pub surface_mm: f64,
    /// Distance of its surface from the rotary axis, and the radius of the ball, mm.
    pub surface_and_radius_mm: f64,
    /// Distance of the probe from the rotary axis, mm.
    pub probe_beside_pivot_mm: f64,
    /// What is to be added to a tilt of the drive, degrees.
    pub zero_deg: f64,
    /// Their covariance, in this order and these units.
    pub covariance: [[f64; 4]; 4],
    /// Error of the screw at the heights that were asked for.
    pub screw: ScrewMap,
}

impl BlockGeometry {
    /// The standard deviations, in the order of the covariance.
    pub fn sigmas(&self) -> [f64; 4] {
        std::array::from_fn(|i| self.covariance[i][i].sqrt())
    }
}

/// Fits the geometry to touches, with the error of the screw at these heights.
///
/// # Errors
/// [`NoGeometry`].
pub fn fit(
    touches: &[BlockTouch],
    noise: &TouchNoise,
    heights_mm: &[f64],
) -> Result<BlockGeometry, NoGeometry> {
    enough(touches)?;
    let mut start = coarse(touches);
    let mut all = Vec::new();
    let mut likeliest: Option<Fitted> = None;
    for screw in Screw::all() {
        // Touches that are far off lead nowhere with a screw of micrometres.
        let Some(fitted) = with_screw(touches, noise, screw, start) else { continue };
        start = fitted.unknowns;
        let map = fitted.screw_errors(touches, heights_mm);
        all.push((fitted.log_weight, fitted.unknowns, fitted.covariance, map));
        if likeliest.as_ref().is_none_or(|other| other.log_weight < fitted.log_weight) {
            likeliest = Some(fitted);
        }
    }
    let likeliest = likeliest.ok_or(NoGeometry::NoSolution)?;
    likeliest.check_scatter(touches)?;
    let highest = likeliest.log_weight;
    let total: f64 = all.iter().map(|(weight, ..)| (weight - highest).exp()).sum();
    let share = |weight: f64| (weight - highest).exp() / total;
    let mean: Vector = std::array::from_fn(|i| all.iter().map(|(w, x, ..)| share(*w) * x[i]).sum());
    let covariance: Matrix = std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let spread = |x: &Vector| (x[i] - mean[i]) * (x[j] - mean[j]);
            all.iter().map(|(w, x, c, _)| share(*w) * (c[i][j] + spread(x))).sum()
        })
    });
    let assumed = all.into_iter().map(|(weight, _, _, (errors_mm, covariance_mm2))| Assumed {
        share: share(weight),
        errors_mm,
        covariance_mm2,
    });
    let screw = ScrewMap::mean(heights_mm, &assumed.collect::<Vec<_>>());
    let unit = |i: usize| if i == 3 { 1.0_f64.to_degrees() } else { 1.0 };
    Ok(BlockGeometry {
        surface_mm: mean[0],
        surface_and_radius_mm: mean[1],
        probe_beside_pivot_mm: mean[2],
        zero_deg: mean[3].to_degrees(),
        covariance: std::array::from_fn(|i| {
            std::array::from_fn(|j| covariance[i][j] * unit(i) * unit(j))
        }),
        screw,
    })
}

fn enough(touches: &[BlockTouch]) -> Result<(), NoGeometry> {
    let mut tilts: Vec<f64> = touches.iter().map(|touch| touch.tilt_deg).collect();
    if !touches.iter().all(|touch| {
        touch.tilt_deg.abs() < 80.0 && touch.height_mm.is_finite() && touch.raised_mm.is_finite()
    }) {
        return Err(NoGeometry::NoSolution);
    }
    tilts.sort_by(f64::total_cmp);
    tilts.dedup_by(|a, b| (*a - *b).abs() < SAME_DEG);
    if tilts.len() < TILTS {
        return Err(NoGeometry::TooFewTilts { found: tilts.len(), least: TILTS });
    }
    let (from_deg, to_deg) = (tilts[0], tilts[tilts.len() - 1]);
    if -REACH_DEG < from_deg || to_deg < REACH_DEG {
        return Err(NoGeometry::TooNarrow { from_deg, to_deg, least_deg: REACH_DEG });
    }
    Ok(())
}

/// A start: the height of the touch that is most level, and the middle of what benches have.
fn coarse(touches: &[BlockTouch]) -> Vector {
    let level = touches.iter().min_by(|a, b| a.tilt_deg.abs().total_cmp(&b.tilt_deg.abs()));
    [level.map_or(0.0, |touch| touch.height_mm - touch.raised_mm), 4.0, 0.0, 0.0]
}

/// How far a touch is off.
#[derive(Debug, Clone, Copy)]
struct Off {
    mm: f64,
    /// The same in standard deviations.
    sigmas: f64,
}

/// A fit with one assumption about the screw.
struct Fitted {
    unknowns: Vector,
    covariance: Matrix,
    /// The restricted likelihood of the assumption, as a logarithm.
    log_weight: f64,
    screw: Screw,
    factor: Cholesky,
    /// L⁻¹ of the residuals and of the columns of the derivatives.
    residuals: Vec<f64>,
    columns: [Vec<f64>; UNKNOWNS],
}

fn with_screw(
    touches: &[BlockTouch],
    noise: &TouchNoise,
    screw: Screw,
    start: Vector,
) -> Option<Fitted> {
    let mut unknowns = start;
    for _ in 0..STEPS {
        let slopes: Vec<f64> =
            touches.iter().map(|touch| derivatives(&unknowns, touch)[3]).collect();
        let factor = Cholesky::new(touches.len(), |i, j| {
            let shared = screw.covariance(touches[i].height_mm, touches[j].height_mm);
            let tilted = noise.tilt_deg.to_radians() * slopes[i];
            shared + if i == j { noise.height_mm.powi(2) + tilted * tilted } else { 0.0 }
        })?;
        let residuals: Vec<f64> =
            touches.iter().map(|touch| touch.height_mm - height(&unknowns, touch)).collect();
        let residuals = factor.whiten(&residuals);
        let columns: [Vec<f64>; UNKNOWNS] = std::array::from_fn(|k| {
            let column: Vec<f64> =
                touches.iter().map(|touch| derivatives(&unknowns, touch)[k]).collect();
            factor.whiten(&column)
        });
        let normal = Cholesky::new(UNKNOWNS, |i, j| dot(&columns[i], &columns[j]))?;
        let right = columns.each_ref().map(|column| dot(column, &residuals));
        let step = normal.back(&normal.whiten(&right));
        let is_converged = step.iter().all(|step| step.abs() < CONVERGED);
        if is_converged {
            let log_weight = -0.5
                * (factor.log_determinant()
                    + normal.log_determinant()
                    + dot(&residuals, &residuals));
            let covariance = std::array::from_fn(|i| {
                let unit: Vector = std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 });
                let column = normal.back(&normal.whiten(&unit));
                std::array::from_fn(|j| column[j])
            });
            return Some(Fitted {
                unknowns,
                covariance,
                log_weight,
                screw,
                factor,
                residuals,
                columns,
            });
        }
        for (unknown, step) in unknowns.iter_mut().zip(step) {
            *unknown += step;
        }
        // Beyond half a right angle, the start leads to no solution.
        if unknowns[3].abs() > 0.8 {
            return None;
        }
    }
    None
}

impl Fitted {
    /// Refuses touches that scatter too much about the geometry, and names the one that fits worst with the others.
    fn check_scatter(&self, touches: &[BlockTouch]) -> Result<(), NoGeometry> {
        let found = dot(&self.residuals, &self.residuals) / (touches.len() - UNKNOWNS) as f64;
        if found <= MISFIT {
            return Ok(());
        }
        let offs = (0..touches.len()).map(|index| (index, self.off_the_others(index)));
        let worst = offs.max_by(|(_, a), (_, b)| a.sigmas.abs().total_cmp(&b.sigmas.abs()));
        let (index, Off { mm, .. }) = worst.ok_or(NoGeometry::NoSolution)?;
        let BlockTouch { tilt_deg, height_mm, .. } = touches[index];
        Err(NoGeometry::Scattered { found, limit: MISFIT, tilt_deg, height_mm, off_mm: mm })
    }

    /// How far a touch lies off what the others say of it, which a fit without it would find.
    ///
    /// # Source
    /// Cook and Weisberg, Residuals and Influence in Regression (1982), section 2.2.
    fn off_the_others(&self, index: usize) -> Off {
        let count = self.residuals.len();
        let unit: Vec<f64> = (0..count).map(|other| f64::from(u8::from(other == index))).collect();
        let whitened = self.factor.whiten(&unit);
        let slopes = self.columns.each_ref().map(|column| dot(column, &whitened));
        let weight = dot(&whitened, &whitened) - self.quadratic(&slopes);
        let pull = dot(&whitened, &self.residuals);
        Off { mm: pull / weight, sigmas: pull / weight.max(f64::MIN_POSITIVE).sqrt() }
    }

    /// xᵀ C x with the covariance C.
    fn quadratic(&self, x: &Vector) -> f64 {
        self.covariance.iter().zip(x).map(|(row, x_i)| x_i * dot(row, x)).sum()
    }

    /// The error of the screw at heights, mm, and its covariance, mm².
    fn screw_errors(
        &self,
        touches: &[BlockTouch],
        heights_mm: &[f64],
    ) -> (Vec<f64>, Vec<Vec<f64>>) {
        // What the error at a height has in common with those of the touches, and what of it the geometry takes.
        let seen = |height_mm: &f64| {
            let shared: Vec<f64> = touches
                .iter()
                .map(|touch| self.screw.covariance(touch.height_mm, *height_mm))
                .collect();
            let shared = self.factor.whiten(&shared);
            let lost: Vector = self.columns.each_ref().map(|column| dot(column, &shared));
            (shared, lost)
        };
        let seen: Vec<(Vec<f64>, Vector)> = heights_mm.iter().map(seen).collect();
        let entry = |i: usize, j: usize| {
            let ((shared, lost), (other, other_lost)) = (&seen[i], &seen[j]);
            let from_geometry: f64 = self
                .covariance
                .iter()
                .zip(lost)
                .map(|(row, lost)| lost * dot(row, other_lost))
                .sum();
            let prior = self.screw.covariance(heights_mm[i], heights_mm[j]);
            prior - dot(shared, other) + from_geometry
        };
        let rows = 0..heights_mm.len();
        let covariance =
            rows.clone().map(|i| rows.clone().map(|j| entry(i, j)).collect()).collect();
        (seen.iter().map(|(shared, _)| dot(shared, &self.residuals)).collect(), covariance)
    }
}

fn height(&[surface, from_axis, beside, zero]: &Vector, touch: &BlockTouch) -> f64 {
    let tilt = touch.tilt_deg.to_radians() + zero;
    surface - from_axis + (from_axis + touch.raised_mm) / tilt.cos() - beside * tilt.tan()
}

fn derivatives(&[_, from_axis, beside, zero]: &Vector, touch: &BlockTouch) -> Vector {
    let tilt = touch.tilt_deg.to_radians() + zero;
    let (secant, tangent) = (1.0 / tilt.cos(), tilt.tan());
    let by_tilt = (from_axis + touch.raised_mm) * secant * tangent - beside * secant * secant;
    [1.0, secant - 1.0, -tangent, by_tilt]
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
