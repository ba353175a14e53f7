//! The stiffness that a clamped beam of equal elements shows at its free end, at one complex ω².

use num_complex::Complex64;

use super::{
    DOUBLINGS,
    matrix::{Matrix2, difference, inverse, product, sum, transpose},
};

/// A piece of the beam between two ends: its stiffness less ω² mass, in blocks.
struct Piece {
    near: Matrix2,
    across: Matrix2,
    far: Matrix2,
}

impl Piece {
    /// One cubic element with consistent mass and a pull along it, N.
    fn element(rigidity: Complex64, inertia: Complex64, pull_n: f64, length: f64) -> Self {
        let (l, k, m) = (length, rigidity / length.powi(3), inertia * length / 420.0);
        let entry = |stiffness: f64, mass: f64, straight: f64, power: i32| {
            (k * stiffness - m * mass + pull_n / (30.0 * l) * straight) * l.powi(power)
        };
        let (a, b, d) =
            (entry(12.0, 156.0, 36.0, 0), entry(6.0, 22.0, 3.0, 1), entry(4.0, 4.0, 4.0, 2));
        let (e, f, g) =
            (entry(-12.0, 54.0, -36.0, 0), entry(6.0, -13.0, 3.0, 1), entry(2.0, -3.0, -1.0, 2));
        Self { near: [[a, b], [b, d]], across: [[e, f], [-f, g]], far: [[a, -b], [-b, d]] }
    }

    /// Two such pieces end to end, the middle eliminated.
    fn doubled(&self) -> Self {
        let middle = inverse(&sum(&self.far, &self.near));
        let back = transpose(&self.across);
        let into = product(&self.across, &middle);
        let [[a, b], [c, d]] = product(&into, &self.across);
        Self {
            near: difference(&self.near, &product(&into, &back)),
            across: [[-a, -b], [-c, -d]],
            far: difference(&self.far, &product(&product(&back, &middle), &self.across)),
        }
    }
}

/// Over (deflection, slope) at the end. `inertia` is ω² times the mass per length, `pull_n` the force
/// along the beam.
pub(super) fn bending_at_tip(
    rigidity: Complex64,
    inertia: Complex64,
    pull_n: f64,
    length: f64,
) -> Matrix2 {
    let parts = f64::from(1_u32 << DOUBLINGS);
    let mut piece = Piece::element(rigidity, inertia, pull_n, length / parts);
    for _ in 0..DOUBLINGS {
        piece = piece.doubled();
    }
    piece.far
}

/// Over the twist at the end, with linear elements. `inertia` is ω² times the polar inertia.
pub(super) fn twist_at_tip(rigidity: Complex64, inertia: Complex64, length: f64) -> Complex64 {
    let part = length / f64::from(1_u32 << DOUBLINGS);
    let (mut end, mut across) =
        (rigidity / part - inertia * part / 3.0, -rigidity / part - inertia * part / 6.0);
    for _ in 0..DOUBLINGS {
        let middle = (2.0 * end).inv();
        (end, across) = (end - across * across * middle, -across * across * middle);
    }
    end
}
