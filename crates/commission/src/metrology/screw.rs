//! The error of the linear screw as a random smooth function of the height.

/// Standard deviations and lengths that are tried, mm. A ground screw has micrometres, a rolled one tens of them.
const SIGMAS_MM: [f64; 5] = [0.000_3, 0.002, 0.006, 0.012, 0.025];
const LENGTHS_MM: [f64; 3] = [0.2, 0.45, 1.0];

/// What a smooth function leaves of an error that has kinks, at each height of a map, mm: 1.9 µm of a way through one of
/// 14 µm whose direction changes each 0.3 mm (`depths_by_the_map_of_two_blocks_are_as_wrong_as_stated`).
const KINKS_MM: f64 = 0.001_3;

/// The size and the length of an error of a screw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Screw {
    pub(super) sigma_mm: f64,
    pub(super) length_mm: f64,
}

impl Screw {
    /// All that are tried, each as likely as another.
    pub(super) fn all() -> impl Iterator<Item = Self> {
        SIGMAS_MM
            .into_iter()
            .flat_map(|sigma_mm| LENGTHS_MM.map(move |length_mm| Self { sigma_mm, length_mm }))
    }

    /// Covariance of the errors at two heights, mm².
    pub(super) fn covariance(self, a_mm: f64, b_mm: f64) -> f64 {
        let lengths = (a_mm - b_mm) / self.length_mm;
        self.sigma_mm.powi(2) * (-0.5 * lengths * lengths).exp()
    }
}

/// The error of the screw at a height: the position that the drive says, less the true one. A constant and what looks
/// like geometry are not in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScrewError {
    /// The height, mm.
    pub height_mm: f64,
    /// The error, mm.
    pub error_mm: f64,
    /// Its standard deviation, mm.
    pub sigma_mm: f64,
}

/// The error of the screw at several heights.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ScrewMap {
    /// The errors, in the order of the heights that were asked for.
    pub errors: Vec<ScrewError>,
    /// Their covariance, mm²: what two heights have in common goes out of the way between them.
    pub covariance_mm2: Vec<Vec<f64>>,
}

/// What one assumption about the screw gives at the heights of a map.
pub(super) struct Assumed {
    /// Probability of the assumption.
    pub(super) share: f64,
    /// The errors, mm.
    pub(super) errors_mm: Vec<f64>,
    /// Their covariance, mm².
    pub(super) covariance_mm2: Vec<Vec<f64>>,
}

impl ScrewMap {
    /// The mean over assumptions. The covariance has the spread between them, and what none of them can follow.
    pub(super) fn mean(heights_mm: &[f64], assumed: &[Assumed]) -> Self {
        let sum = |of: &dyn Fn(&Assumed) -> f64| {
            assumed.iter().map(|one| one.share * of(one)).sum::<f64>()
        };
        let means: Vec<f64> =
            (0..heights_mm.len()).map(|i| sum(&|one: &Assumed| one.errors_mm[i])).collect();
        let entry = |i: usize, j: usize| {
            let kinks = if i == j { KINKS_MM.powi(2) } else { 0.0 };
            let of_assumed = sum(&|one: &Assumed| {
                let off = |i: usize| one.errors_mm[i] - means[i];
                one.covariance_mm2[i][j] + off(i) * off(j)
            });
            of_assumed + kinks
        };
        let rows = 0..heights_mm.len();
        let covariance_mm2: Vec<Vec<f64>> =
            rows.clone().map(|i| rows.clone().map(|j| entry(i, j)).collect()).collect();
        let error = |i: usize| ScrewError {
            height_mm: heights_mm[i],
            error_mm: means[i],
            sigma_mm: covariance_mm2[i][i].max(0.0).sqrt(),
        };
        Self { errors: rows.map(error).collect(), covariance_mm2 }
    }
}
