//! Extremes and zeros of readings, with interpolation.

use super::{NoEstimate, Point, at_least};

/// Smallest number of readings: an extreme with a neighbour on each side.
const POINTS_MIN: usize = 3;

/// The frequency of the reading with the highest value.
pub(super) fn highest(points: &[Point], value: impl Fn(&Point) -> f64) -> Result<f64, NoEstimate> {
    inner_peak(points, value).map(|index| points[index].frequency_hz)
}

/// The vertex of the parabola through the highest reading and its neighbours.
pub(super) fn parabola(points: &[Point], value: impl Fn(&Point) -> f64) -> Result<f64, NoEstimate> {
    let index = inner_peak(points, &value)?;
    let [left, middle, right] = [&points[index - 1], &points[index], &points[index + 1]];
    let (below, above) =
        (middle.frequency_hz - left.frequency_hz, right.frequency_hz - middle.frequency_hz);
    let (rise, fall) = (value(middle) - value(left), value(middle) - value(right));
    // Slopes half-way to the neighbours; the line through them is zero at the vertex. Equal heights
    // define no parabola, and the middle reading is used.
    let (up, down) = (rise / below, fall / above);
    let shift = 0.5 * (up * above - down * below) / (up + down);
    Ok(middle.frequency_hz + if shift.is_finite() { shift } else { 0.0 })
}

/// The first zero of the rising phase.
pub(super) fn zero_phase(points: &[Point]) -> Result<f64, NoEstimate> {
    at_least(2, points)?;
    let rises = |pair: &&[Point]| {
        // A positive resistance excludes a jump from 180° to −180°.
        let is_resistive = pair.iter().all(|point| point.impedance.re > 0.0);
        is_resistive && pair[0].impedance.im < 0.0 && pair[1].impedance.im >= 0.0
    };
    let pair = points.windows(2).find(rises).ok_or(NoEstimate::NoCrossing)?;
    let (below, above) = (pair[0].impedance.arg(), pair[1].impedance.arg());
    let part = below / (below - above);
    Ok(pair[0].frequency_hz + part * (pair[1].frequency_hz - pair[0].frequency_hz))
}

/// The index of the highest value.
///
/// # Errors
/// If it is the first or the last.
fn inner_peak(points: &[Point], value: impl Fn(&Point) -> f64) -> Result<usize, NoEstimate> {
    at_least(POINTS_MIN, points)?;
    let index = peak(points, value);
    if index == 0 || index == points.len() - 1 {
        return Err(NoEstimate::AtEdge { frequency_hz: points[index].frequency_hz });
    }
    Ok(index)
}

/// The index of the highest value, possibly at the edge; the first of equal values.
pub(super) fn peak(points: &[Point], value: impl Fn(&Point) -> f64) -> usize {
    let mut best = (0, f64::NEG_INFINITY);
    for (index, point) in points.iter().enumerate() {
        let value = value(point);
        if value > best.1 {
            best = (index, value);
        }
    }
    best.0
}
