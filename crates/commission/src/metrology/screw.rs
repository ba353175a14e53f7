//! The error of the linear screw as a random smooth function of the height.

/// Standard deviations and lengths that are tried, mm. A ground screw has micrometres, a rolled one tens of them.
const SIGMAS_MM: [f64; 5] = [0.000_3, 0.002, 0.006, 0.012, 0.025];
const LENGTHS_MM: [f64; 3] = [0.2, 0.45, 1.0];

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
