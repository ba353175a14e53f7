//! The circle of the motional admittance, and the phase around its centre.
//!
//! Y − jωC0 = (1/R1)/(1 + jQ(u − 1/u)) lies on a circle through the origin. The static capacitance is
//! fitted with the circle, without loss. Around the centre the phase is −2·arctan(Q(u − 1/u)).
//!
//! # Source
//! Probst, Song, Bushev, Ustinov and Weides, Rev. Sci. Instrum. 86 (2015) 024706, for the two steps.
//! They assume a constant feed-through, which holds for a static capacitance only in a narrow band.

use num_complex::Complex64;

use super::{NoEstimate, Point, at_least};
use crate::{
    numeric::dense::Cholesky,
    numeric::descent::{Descent, End, Normal, Step},
};

/// Smallest number of readings: two unknowns of the circle, three of the phase, and one more.
const POINTS_MIN: usize = 6;

pub(super) fn resonance_hz(points: &[Point]) -> Result<f64, NoEstimate> {
    at_least(POINTS_MIN, points)?;
    let count = points.len();
    let descent = |free| Descent { count: count.div_ceil(2), weight: count as f64, free };
    let start = Circle::algebraic(points).ok_or(NoEstimate::NotConverged)?;
    let (circle, _, end) = descent(2).run(start, |circle| circle.normal(points));
    if end == End::OutOfSteps || circle.diameter <= 0.0 {
        return Err(NoEstimate::NotConverged);
    }
    let start = Phase::start(points, &circle);
    let (phase, _, end) = descent(3).run(start, |phase| phase.normal(points, &circle));
    match end {
        End::Converged | End::Stalled => Ok(phase.ln_hz.exp()),
        End::OutOfSteps | End::Abandoned => Err(NoEstimate::NotConverged),
    }
}

/// The circle and the static susceptance that is subtracted from the admittance.
#[derive(Debug, Clone, Copy)]
struct Circle {
    /// Susceptance of the static capacitance at 1 Hz, S.
    fixed: f64,
    /// Diameter 1/R1, S.
    diameter: f64,
}

impl Step<2> for Circle {
    fn minus(&self, step: &[f64; 2]) -> Self {
        Self { fixed: self.fixed - step[0], diameter: self.diameter - step[1] }
    }
}

impl Circle {
    /// Solves |Y − jfb|² = G·d with d, 2b and −b² as independent unknowns.
    fn algebraic(points: &[Point]) -> Option<Self> {
        let mut normal = Normal::<3>::default();
        for point in points {
            let (y, f) = (point.admittance, point.frequency_hz);
            let size = y.norm_sqr();
            let slopes = [y.re, f * y.im, f * f].map(|slope| (slope / size).into());
            normal.add(1.0.into(), &slopes, 1.0);
        }
        let [diameter, twice, _] = Cholesky::new(&normal.matrix, 3, 0.0)?.solve(&normal.gradient);
        Some(Self { fixed: 0.5 * twice, diameter })
    }

    /// Vector from the centre to a reading, S.
    fn spoke(&self, point: &Point) -> Complex64 {
        point.admittance - Complex64::new(0.5 * self.diameter, self.fixed * point.frequency_hz)
    }

    /// Normal equations of the distances from the circle, relative to the error, which is proportional
    /// to |Y|.
    fn normal(&self, points: &[Point]) -> Normal<2> {
        let mut normal = Normal::default();
        for point in points {
            let spoke = self.spoke(point);
            let (length, scale) = (spoke.norm(), 1.0 / point.admittance.norm());
            let residual = scale * (length - 0.5 * self.diameter);
            let by_fixed = -scale * point.frequency_hz * spoke.im / length;
            let by_diameter = -0.5 * scale * (spoke.re / length + 1.0);
            normal.add(residual.into(), &[by_fixed.into(), by_diameter.into()], 1.0);
        }
        normal
    }
}

/// The phase around the centre of the circle.
#[derive(Debug, Clone, Copy)]
struct Phase {
    ln_hz: f64,
    ln_q: f64,
    /// Phase at the resonance, rad; zero for an exact circle.
    offset: f64,
}

impl Step<3> for Phase {
    fn minus(&self, step: &[f64; 3]) -> Self {
        Self {
            ln_hz: self.ln_hz - step[0].clamp(-0.05, 0.05),
            ln_q: self.ln_q - step[1].clamp(-1.0, 1.0),
            offset: self.offset - step[2].clamp(-1.0, 1.0),
        }
    }
}

impl Phase {
    /// Fits a straight line to the tangents of half the angles, which are −Q(u − 1/u), for the readings
    /// on the half of the circle around the resonance.
    fn start(points: &[Point], circle: &Circle) -> Self {
        let nearest = points
            .iter()
            .map(|point| (circle.spoke(point).arg().abs(), point.frequency_hz))
            .fold((f64::INFINITY, 1.0), |best, next| if next.0 < best.0 { next } else { best });
        let mut sums = (0.0, 0.0);
        for point in points {
            let u = point.frequency_hz / nearest.1;
            let (detuning, angle) = (u - 1.0 / u, circle.spoke(point).arg());
            if angle.abs() < std::f64::consts::FRAC_PI_2 {
                sums.0 -= detuning * (0.5 * angle).tan();
                sums.1 += detuning * detuning;
            }
        }
        let slope = sums.0 / sums.1;
        // Too few readings there determine no slope.
        let q: f64 = if slope.is_finite() && slope > 0.0 { slope } else { 30.0 };
        Self { ln_hz: nearest.1.ln(), ln_q: q.ln(), offset: 0.0 }
    }

    fn normal(&self, points: &[Point], circle: &Circle) -> Normal<3> {
        let (resonance_hz, q) = (self.ln_hz.exp(), self.ln_q.exp());
        let mut normal = Normal::default();
        for point in points {
            let u = point.frequency_hz / resonance_hz;
            let (detuning, sum) = (u - 1.0 / u, u + 1.0 / u);
            let x = q * detuning;
            let model = Complex64::cis(self.offset - 2.0 * x.atan());
            // The difference of two angles, without the jump at ±π.
            let difference = -(circle.spoke(point) / model).arg();
            let scale = 0.5 * circle.diameter / point.admittance.norm();
            let by_x = -2.0 / (1.0 + x * x);
            let slopes = [-by_x * q * sum, by_x * x, 1.0].map(|slope| (scale * slope).into());
            normal.add((scale * difference).into(), &slopes, 1.0);
        }
        normal
    }
}
