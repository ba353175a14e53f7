//! A fit of the reciprocal conductance within the half-power points.
//!
//! 1/G = R1·(1 + Q²(u − 1/u)²) is nearly a parabola in u near 1, so that a linear fit suffices. The
//! omitted third-order term shifts the vertex by a few hundredths of the linewidth at a quality factor
//! of 10.
//!
//! # Source
//! Robinson and Clegg, IEEE Trans. Electromagnetic Compatibility 2005, on the conductance of a
//! resonator by fewer points than half-power interpolation needs.

use super::{NoEstimate, Point, at_least, peaks::peak};
use crate::{numeric::dense::Cholesky, numeric::descent::Normal};

/// Smallest number of readings: three unknowns of the parabola and one more.
const POINTS_MIN: usize = 4;

pub(super) fn resonance_hz(points: &[Point]) -> Result<f64, NoEstimate> {
    at_least(POINTS_MIN, points)?;
    let top = peak(points, |point| point.admittance.re);
    let half = 0.5 * points[top].admittance.re;
    let is_high = |point: &&Point| point.admittance.re > half;
    let below = points[..top].iter().rev().take_while(is_high).count();
    let above = points[top..].iter().take_while(is_high).count();
    let points = &points[top - below..top + above];
    let found = points.len();
    let no_peak = NoEstimate::NoPeak { found };
    if found < POINTS_MIN {
        return Err(no_peak);
    }
    let centre_hz = points[below].frequency_hz;
    let scale_hz = points[found - 1].frequency_hz - points[0].frequency_hz;
    let mut normal = Normal::<3>::default();
    for point in points {
        let x = (point.frequency_hz - centre_hz) / scale_hz;
        let g = point.admittance.re;
        // The error of 1/G is that of G, which is proportional to |Y|, divided by G².
        let weight = g.powi(4) / point.admittance.norm_sqr() / half.powi(2);
        let slopes = [1.0, x, x * x].map(Into::into);
        normal.add((half / g).into(), &slopes, weight);
    }
    let factor = Cholesky::new(&normal.matrix, 3, 0.0).ok_or(no_peak)?;
    let [_, linear, square] = factor.solve(&normal.gradient);
    if square > 0.0 { Ok(centre_hz - 0.5 * linear / square * scale_hz) } else { Err(no_peak) }
}
