//! Sneddon's solution for a rigid sphere of radius R pressed into a linear half space.
//!
//! With x = a/R and t = atanh x the depth is D = x t and the force F/(E* R²) = (1 + x²) t − x.
//! Solving in t instead of x keeps its digits when x comes close to one.
//!
//! # Source
//! Sneddon, Int. J. Engng Sci. 3 (1965) 47, equations (6.13) to (6.15).

/// Coefficients of a²/(R² D) in powers of D, from the inversion of D = x² + x⁴/3 + x⁶/5 + …
const SQUARE: [f64; 6] = [1.0, -1.0 / 3.0, 1.0 / 45.0, 1.0 / 189.0, 11.0 / 14_175.0, 0.0];
/// Coefficients of F/(4/3 E* R D a) in powers of D, from the integral of the same inversion.
const FORCE: [f64; 6] =
    [1.0, 1.0 / 15.0, 4.0 / 315.0, 4.0 / 4_725.0, -16.0 / 31_185.0, -17_312.0 / 70_945_875.0];

/// Numerator and denominator of a fit of t²/D for D up to two, within 8e-6: one step of Halley's
/// method, which triples the digits, makes it exact.
const FIT: ([f64; 4], [f64; 3]) =
    ([1.0, 0.0847028, 0.05379731, 0.01291043], [1.0, -0.24878291, 0.04879613]);
/// The largest depth of the fit.
const FIT_TO: f64 = 2.0;
/// Steps from the start t = D, which is within 4 % for depths beyond the fit.
const STEPS_BEYOND_FIT: u32 = 3;

/// Contact radius and force at any depth of zero or more, exact to a few units in the last place.
pub(crate) fn at(depth_rel: f64) -> (f64, f64) {
    if depth_rel == 0.0 {
        return (0.0, 0.0);
    }
    let (mut t, steps) = if depth_rel <= FIT_TO {
        let ([a0, a1, a2, a3], [b0, b1, b2]) = FIT;
        let d = depth_rel;
        let quotient = (a0 + d * (a1 + d * (a2 + d * a3))) / (b0 + d * (b1 + d * b2));
        ((d * quotient).sqrt(), 1)
    } else {
        (depth_rel, STEPS_BEYOND_FIT)
    };
    let mut x = 0.0;
    for _ in 0..steps {
        x = t.tanh();
        let fall = 1.0 - x * x;
        let residual = t * x - depth_rel;
        let slope = x + t * fall;
        let step = residual * slope / (slope * slope - residual * fall * (1.0 - t * x));
        t -= step;
        // The Taylor series of the hyperbolic tangent saves a second call.
        x -= fall * step * (1.0 + x * step);
    }
    (x, force(x, t))
}

/// Contact radius and force by the power series.
pub(crate) fn series_at(depth_rel: f64) -> (f64, f64) {
    let radius = (depth_rel * polynomial(&SQUARE, depth_rel)).sqrt();
    (radius, 4.0 / 3.0 * depth_rel * radius * polynomial(&FORCE, depth_rel))
}

fn polynomial(coefficients: &[f64; 6], x: f64) -> f64 {
    let [c0, c1, c2, c3, c4, c5] = *coefficients;
    // Short independent chains: this is the innermost loop of the simulation.
    let square = x * x;
    (c0 + c1 * x) + square * ((c2 + c3 * x) + square * (c4 + c5 * x))
}

/// (1 + x²) t − x, by its series for small x, where the difference would lose digits.
fn force(x: f64, t: f64) -> f64 {
    const SERIES_BELOW: f64 = 0.03;
    if x > SERIES_BELOW {
        return (1.0 + x * x) * t - x;
    }
    let s = x * x;
    x * s * (4.0 / 3.0 + s * (8.0 / 15.0 + s * (12.0 / 35.0 + s * (16.0 / 63.0 + s * 20.0 / 99.0))))
}
