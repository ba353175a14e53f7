//! A fit of the resonance curve of the conductance.
//!
//! This is common for quartz microbalances, with an approximate curve in f. Here the curve is exact for
//! a lossy capacitor in parallel with a series circuit, G = a·f + g/(1 + Q²(u − 1/u)²). The
//! susceptance, half of the measured data, is not used.

use super::{NoEstimate, Point, at_least, peaks::peak};
use crate::numeric::descent::{Descent, End, Normal, Step};

/// Smallest number of readings: four parameters and one more.
const POINTS_MIN: usize = 5;

#[derive(Debug, Clone, Copy)]
struct Curve {
    ln_hz: f64,
    ln_q: f64,
    peak: f64,
    /// Conductance of the loss at 1 Hz, S.
    loss: f64,
}

impl Step<4> for Curve {
    fn minus(&self, step: &[f64; 4]) -> Self {
        Self {
            ln_hz: self.ln_hz - step[0].clamp(-0.05, 0.05),
            ln_q: self.ln_q - step[1].clamp(-1.0, 1.0),
            peak: self.peak - step[2],
            loss: self.loss - step[3],
        }
    }
}

impl Curve {
    /// Normal equations of the residuals relative to the error, which is proportional to |Y|.
    fn normal(&self, points: &[Point]) -> Normal<4> {
        let (resonance_hz, q) = (self.ln_hz.exp(), self.ln_q.exp());
        let mut normal = Normal::default();
        for point in points {
            let u = point.frequency_hz / resonance_hz;
            let (detuning, sum) = (u - 1.0 / u, u + 1.0 / u);
            let x = q * detuning;
            let shape = 1.0 / (1.0 + x * x);
            let by_x = -2.0 * self.peak * x * shape * shape;
            let model = self.loss * point.frequency_hz + self.peak * shape;
            let scale = 1.0 / point.admittance.norm();
            // ∂x/∂ln f0 = −Q(u + 1/u), ∂x/∂ln Q = x.
            let slopes = [-by_x * q * sum, by_x * x, shape, point.frequency_hz];
            let residual = scale * (model - point.admittance.re);
            normal.add(residual.into(), &slopes.map(|slope| (scale * slope).into()), 1.0);
        }
        normal
    }
}

pub(super) fn resonance_hz(points: &[Point]) -> Result<f64, NoEstimate> {
    at_least(POINTS_MIN, points)?;
    let count = points.len();
    let descent = Descent { count: count.div_ceil(2), weight: count as f64, free: 4 };
    let (curve, _, end) = descent.run(start(points), |curve| curve.normal(points));
    match end {
        End::Converged | End::Stalled => Ok(curve.ln_hz.exp()),
        End::OutOfSteps | End::Abandoned => Err(NoEstimate::NotConverged),
    }
}

/// Start values from the highest reading and the width of the peak at half its height.
fn start(points: &[Point]) -> Curve {
    let conductance = |point: &Point| point.admittance.re;
    let top = peak(points, conductance);
    let lowest = points.iter().map(conductance).fold(f64::INFINITY, f64::min);
    let half = 0.5 * (lowest + conductance(&points[top]));
    let high = points.iter().filter(|point| conductance(point) > half).count();
    let peak_hz = points[top].frequency_hz;
    let span_hz = points[points.len() - 1].frequency_hz - points[0].frequency_hz;
    let width_hz = span_hz * high as f64 / points.len() as f64;
    Curve {
        ln_hz: peak_hz.ln(),
        ln_q: (peak_hz / width_hz).ln(),
        peak: conductance(&points[top]) - lowest,
        loss: lowest / peak_hz,
    }
}
