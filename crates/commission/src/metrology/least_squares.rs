//! Least squares with the covariance of the screw, for any surface that is touched.

use super::{
    NoGeometry, ScrewMap,
    cholesky::Cholesky,
    screw::{Assumed, Screw},
};

pub(super) type Vector<const N: usize> = [f64; N];
pub(super) type Matrix<const N: usize> = [Vector<N>; N];

/// Largest χ² per degree of freedom: touches that scatter twice as much as stated. A touch that is a part of a
/// millimetre off, as one in the air, makes it larger with every screw that is tried.
const MISFIT: f64 = 4.0;

/// Gauss and Newton converge in three or four steps from the coarse start.
const STEPS: usize = 30;
const CONVERGED: f64 = 1e-9;

/// Fewest tilts, and how far they must reach to both sides, degrees.
const TILTS: usize = 5;
const REACH_DEG: f64 = 20.0;

/// Tilts that are nearer count as one, degrees.
const SAME_DEG: f64 = 1.0;

/// Standard deviations of a touch without the screw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TouchNoise {
    /// Of the height, mm: step of the search, noise, backlash.
    pub height_mm: f64,
    /// Of the tilt, degrees.
    pub tilt_deg: f64,
}

/// What a touch has found.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    /// Tilt of the table by its drive, degrees.
    pub(super) tilt_deg: f64,
    /// Position of the linear stage, mm.
    pub(super) height_mm: f64,
}

/// A surface that is touched, with N unknowns, in mm and rad.
pub(super) trait Surface<const N: usize> {
    /// The touches.
    fn places(&self) -> &[Place];

    /// The expected height of a touch, mm, by its index.
    fn height(&self, unknowns: &Vector<N>, touch: usize) -> f64;

    /// Its derivatives by the unknowns.
    fn derivatives(&self, unknowns: &Vector<N>, touch: usize) -> Vector<N>;

    /// Its derivative by the tilt, mm/rad.
    fn by_tilt(&self, unknowns: &Vector<N>, touch: usize) -> f64;

    /// Whether these unknowns lead to no solution.
    fn is_astray(&self, unknowns: &Vector<N>) -> bool;

    /// What is known of the unknowns without the touches.
    fn prior(&self) -> Option<&Prior<N>> {
        None
    }
}

/// What is known of unknowns beforehand.
#[derive(Debug, Clone, Copy)]
pub(super) struct Prior<const N: usize> {
    /// Their values.
    pub(super) mean: Vector<N>,
    /// The inverse of their covariance; zero in rows of which nothing is known.
    pub(super) precision: Matrix<N>,
    /// Number of unknowns of which something is known.
    pub(super) known: usize,
}

/// The mean over the assumptions about the screw.
#[derive(Debug, Clone)]
pub(super) struct Average<const N: usize> {
    pub(super) mean: Vector<N>,
    pub(super) covariance: Matrix<N>,
    /// Error of the screw at the heights that were asked for.
    pub(super) screw: ScrewMap,
}

/// Refuses touches that cannot give a geometry.
pub(super) fn enough(places: &[Place]) -> Result<(), NoGeometry> {
    let mut tilts: Vec<f64> = places.iter().map(|place| place.tilt_deg).collect();
    if !places.iter().all(|place| place.tilt_deg.abs() < 80.0 && place.height_mm.is_finite()) {
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

/// Fits the unknowns from a start, with the error of the screw at these heights.
///
/// # Errors
/// [`NoGeometry`].
pub(super) fn average<const N: usize>(
    surface: &impl Surface<N>,
    noise: &TouchNoise,
    mut start: Vector<N>,
    heights_mm: &[f64],
) -> Result<Average<N>, NoGeometry> {
    let mut all = Vec::new();
    let mut likeliest: Option<Fitted<N>> = None;
    for screw in Screw::all() {
        // Touches that are far off lead nowhere with a screw of micrometres.
        let Some(fitted) = with_screw(surface, noise, screw, start) else { continue };
        start = fitted.unknowns;
        let map = fitted.screw_errors(surface.places(), heights_mm);
        all.push((fitted.log_weight, fitted.unknowns, fitted.covariance, map));
        if likeliest.as_ref().is_none_or(|other| other.log_weight < fitted.log_weight) {
            likeliest = Some(fitted);
        }
    }
    let likeliest = likeliest.ok_or(NoGeometry::NoSolution)?;
    likeliest.check_scatter(surface)?;
    let highest = likeliest.log_weight;
    let total: f64 = all.iter().map(|(weight, ..)| (weight - highest).exp()).sum();
    let share = |weight: f64| (weight - highest).exp() / total;
    let mean: Vector<N> =
        std::array::from_fn(|i| all.iter().map(|(w, x, ..)| share(*w) * x[i]).sum());
    let covariance: Matrix<N> = std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let spread = |x: &Vector<N>| (x[i] - mean[i]) * (x[j] - mean[j]);
            all.iter().map(|(w, x, c, _)| share(*w) * (c[i][j] + spread(x))).sum()
        })
    });
    let assumed = all.into_iter().map(|(weight, _, _, (errors_mm, covariance_mm2))| Assumed {
        share: share(weight),
        errors_mm,
        covariance_mm2,
    });
    let screw = ScrewMap::mean(heights_mm, &assumed.collect::<Vec<_>>());
    Ok(Average { mean, covariance, screw })
}

/// How far a touch is off.
#[derive(Debug, Clone, Copy)]
struct Off {
    mm: f64,
    /// The same in standard deviations.
    sigmas: f64,
}

/// A fit with one assumption about the screw.
struct Fitted<const N: usize> {
    unknowns: Vector<N>,
    covariance: Matrix<N>,
    /// The restricted likelihood of the assumption, as a logarithm.
    log_weight: f64,
    screw: Screw,
    factor: Cholesky,
    /// L⁻¹ of the residuals and of the columns of the derivatives.
    residuals: Vec<f64>,
    columns: [Vec<f64>; N],
    /// χ² of the unknowns against what is known of them beforehand.
    of_prior: f64,
}

fn with_screw<const N: usize>(
    surface: &impl Surface<N>,
    noise: &TouchNoise,
    screw: Screw,
    start: Vector<N>,
) -> Option<Fitted<N>> {
    let places = surface.places();
    let mut unknowns = start;
    for _ in 0..STEPS {
        let slopes: Vec<f64> =
            (0..places.len()).map(|touch| surface.by_tilt(&unknowns, touch)).collect();
        let factor = Cholesky::new(places.len(), |i, j| {
            let shared = screw.covariance(places[i].height_mm, places[j].height_mm);
            let tilted = noise.tilt_deg.to_radians() * slopes[i];
            shared + if i == j { noise.height_mm.powi(2) + tilted * tilted } else { 0.0 }
        })?;
        let heights = places.iter().enumerate();
        let residuals: Vec<f64> = heights
            .map(|(touch, place)| place.height_mm - surface.height(&unknowns, touch))
            .collect();
        let residuals = factor.whiten(&residuals);
        let derivatives: Vec<Vector<N>> =
            (0..places.len()).map(|touch| surface.derivatives(&unknowns, touch)).collect();
        let columns: [Vec<f64>; N] = std::array::from_fn(|k| {
            let column: Vec<f64> = derivatives.iter().map(|row| row[k]).collect();
            factor.whiten(&column)
        });
        let known = Known::of(surface.prior(), &unknowns);
        let normal =
            Cholesky::new(N, |i, j| dot(&columns[i], &columns[j]) + known.precision[i][j])?;
        let right: Vector<N> =
            std::array::from_fn(|k| dot(&columns[k], &residuals) + known.pull[k]);
        let step = normal.back(&normal.whiten(&right));
        let is_converged = step.iter().all(|step| step.abs() < CONVERGED);
        if is_converged {
            let log_weight = -0.5
                * (factor.log_determinant()
                    + normal.log_determinant()
                    + dot(&residuals, &residuals)
                    + known.chi_squared);
            let covariance = std::array::from_fn(|i| {
                let unit: Vector<N> = std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 });
                let column = normal.back(&normal.whiten(&unit));
                std::array::from_fn(|j| column[j])
            });
            let of_prior = known.chi_squared;
            return Some(Fitted {
                unknowns,
                covariance,
                log_weight,
                screw,
                factor,
                residuals,
                columns,
                of_prior,
            });
        }
        for (unknown, step) in unknowns.iter_mut().zip(step) {
            *unknown += step;
        }
        if surface.is_astray(&unknowns) {
            return None;
        }
    }
    None
}

/// What a prior adds to the normal equations.
struct Known<const N: usize> {
    precision: Matrix<N>,
    pull: Vector<N>,
    chi_squared: f64,
}

impl<const N: usize> Known<N> {
    fn of(prior: Option<&Prior<N>>, unknowns: &Vector<N>) -> Self {
        let Some(Prior { mean, precision, .. }) = prior else {
            return Self { precision: [[0.0; N]; N], pull: [0.0; N], chi_squared: 0.0 };
        };
        let off: Vector<N> = std::array::from_fn(|i| mean[i] - unknowns[i]);
        let pull = precision.map(|row| dot(&row, &off));
        Self { precision: *precision, pull, chi_squared: dot(&pull, &off) }
    }
}

impl<const N: usize> Fitted<N> {
    /// Refuses touches that scatter too much about the geometry, and names the one that fits worst with the others.
    fn check_scatter(&self, surface: &impl Surface<N>) -> Result<(), NoGeometry> {
        let places = surface.places();
        let known = surface.prior().map_or(0, |prior| prior.known);
        let squares = dot(&self.residuals, &self.residuals) + self.of_prior;
        let found = squares / (places.len() + known - N) as f64;
        if found <= MISFIT {
            return Ok(());
        }
        let offs = (0..places.len()).map(|index| (index, self.off_the_others(index)));
        let worst = offs.max_by(|(_, a), (_, b)| a.sigmas.abs().total_cmp(&b.sigmas.abs()));
        let (index, Off { mm, .. }) = worst.ok_or(NoGeometry::NoSolution)?;
        let Place { tilt_deg, height_mm } = places[index];
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
    fn quadratic(&self, x: &Vector<N>) -> f64 {
        self.covariance.iter().zip(x).map(|(row, x_i)| x_i * dot(row, x)).sum()
    }

    /// The error of the screw at heights, mm, and its covariance, mm².
    fn screw_errors(&self, places: &[Place], heights_mm: &[f64]) -> (Vec<f64>, Vec<Vec<f64>>) {
        // What the error at a height has in common with those of the touches, and what of it the geometry takes.
        let seen = |height_mm: &f64| {
            let shared: Vec<f64> = places
                .iter()
                .map(|place| self.screw.covariance(place.height_mm, *height_mm))
                .collect();
            let shared = self.factor.whiten(&shared);
            let lost: Vector<N> = self.columns.each_ref().map(|column| dot(column, &shared));
            (shared, lost)
        };
        let seen: Vec<(Vec<f64>, Vector<N>)> = heights_mm.iter().map(seen).collect();
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

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
