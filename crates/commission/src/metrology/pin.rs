//! The radius of the ball, from touches on a cylindrical pin of known radius.
//!
//! ```text
//!            ╭───╮  ball R, p beside the rotary axis
//!            │ · │
//!            ╰─┬─╯
//!           ╭──┴──╮
//!           │  ·  │  pin ρ: its axis is (x, y) from the rotary axis when the table is level
//!           ╰─────╯
//!      ────────⊙────────
//! ```
//!
//! A flat block gives the distance of its surface from the rotary axis and the radius of the ball as a sum. The centre
//! of a ball that touches a pin is ρ + R from the axis of the pin, which goes round the rotary axis with the tilt t:
//!
//! ```text
//!   h = H + y cos t − x sin t + √((R + ρ)² − u²) + e(h),   u = x cos t + y sin t − p
//! ```
//!
//! where H is the position of the linear stage at which the centre of the ball is as high as the rotary axis, and e the error
//! of the screw. With r and q for the place of the pin this is r cos q + √((R + ρ)² − (r sin q − p)²). H is also the height s
//! of a level block less its D = d + R, so that blocks give H and p with their covariance. The zero of the rotary stage
//! turns (x, y), which is not known: it is not found, and not needed. Without H, the tilts show R by the fourth power of
//! the tilt alone.
//!
//! ρ and R occur as a sum. A pin whose radius is told wrongly makes the radius of the ball wrong by as much.

use super::{
    NoGeometry, TouchNoise,
    least_squares::{Place, Prior, Surface, Vector, average, enough},
};

/// Unknowns, all in mm: H, x, y, R + ρ, p.
const UNKNOWNS: usize = 5;
const AXIS: usize = 0;
const REACH: usize = 3;
const BESIDE: usize = 4;

/// A pin and a ball are smaller than this, mm: what is flat leads beyond it.
const LARGEST_MM: f64 = 100.0;

/// A touch on a pin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PinTouch {
    /// Tilt of the table by its drive, degrees.
    pub tilt_deg: f64,
    /// Position of the linear stage at the touch, mm.
    pub height_mm: f64,
}

/// What is known of a bench before its pin is touched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PinPrior {
    /// Position of the linear stage at which the centre of the ball is as high as the rotary axis, mm: the height of a
    /// level block, less the distance of its surface from the rotary axis and the radius of the ball.
    pub axis_mm: f64,
    /// Distance of the probe from the rotary axis, mm.
    pub probe_beside_pivot_mm: f64,
    /// Their covariance, mm².
    pub covariance_mm2: [[f64; 2]; 2],
}

/// A pin with the radius of the ball that has touched it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PinRadius {
    /// Radius of the ball, mm.
    pub probe_radius_mm: f64,
    /// Distance of the axis of the pin from the rotary axis, on the side that sinks at positive tilts, with the table at
    /// the zero of its drive, mm.
    pub pin_beside_pivot_mm: f64,
    /// Height of the axis of the pin above the rotary axis in the same place, mm.
    pub pin_above_pivot_mm: f64,
    /// Distance of the probe from the rotary axis, mm.
    pub probe_beside_pivot_mm: f64,
    /// Their covariance, in this order, mm².
    pub covariance_mm2: [[f64; 4]; 4],
}

impl PinRadius {
    /// The standard deviations, in the order of the covariance, mm.
    pub fn sigmas(&self) -> [f64; 4] {
        std::array::from_fn(|i| self.covariance_mm2[i][i].sqrt())
    }
}

/// Fits the radius of the ball to touches on a pin of this radius. The search for it begins at `expected_mm`, which is not
/// taken as known.
///
/// # Errors
/// [`NoGeometry`].
pub fn fit_pin(
    touches: &[PinTouch],
    noise: &TouchNoise,
    prior: &PinPrior,
    (pin_mm, expected_mm): (f64, f64),
) -> Result<PinRadius, NoGeometry> {
    let pin = Pin::of(touches, prior)?;
    let found = average(&pin, noise, pin.start(prior, pin_mm + expected_mm), &[])?;
    // R, x, y and p of the unknowns.
    let order = [REACH, 1, 2, BESIDE];
    let probe_radius_mm = found.mean[REACH] - pin_mm;
    if probe_radius_mm <= 0.0 {
        return Err(NoGeometry::NoSolution);
    }
    Ok(PinRadius {
        probe_radius_mm,
        pin_beside_pivot_mm: found.mean[1],
        pin_above_pivot_mm: found.mean[2],
        probe_beside_pivot_mm: found.mean[BESIDE],
        covariance_mm2: order.map(|i| order.map(|j| found.covariance[i][j])),
    })
}

/// A pin that is touched.
struct Pin {
    places: Vec<Place>,
    prior: Prior<UNKNOWNS>,
}

impl Pin {
    fn of(touches: &[PinTouch], prior: &PinPrior) -> Result<Self, NoGeometry> {
        let place =
            |touch: &PinTouch| Place { tilt_deg: touch.tilt_deg, height_mm: touch.height_mm };
        let places: Vec<_> = touches.iter().map(place).collect();
        enough(&places)?;
        let [[a, b], [_, c]] = prior.covariance_mm2;
        let determinant = a * c - b * b;
        if !(determinant > 0.0 && determinant.is_finite()) {
            return Err(NoGeometry::NoSolution);
        }
        let mut precision = [[0.0; UNKNOWNS]; UNKNOWNS];
        precision[AXIS][AXIS] = c / determinant;
        precision[AXIS][BESIDE] = -b / determinant;
        precision[BESIDE][AXIS] = -b / determinant;
        precision[BESIDE][BESIDE] = a / determinant;
        let mean = [prior.axis_mm, 0.0, 0.0, 0.0, prior.probe_beside_pivot_mm];
        Ok(Self { places, prior: Prior { mean, precision, known: 2 } })
    }

    /// A start: a pin whose top is below the probe at the height of the touch that is most level.
    fn start(&self, prior: &PinPrior, reach_mm: f64) -> Vector<UNKNOWNS> {
        let by_tilt = |a: &&Place, b: &&Place| a.tilt_deg.abs().total_cmp(&b.tilt_deg.abs());
        let level_mm = self.places.iter().min_by(by_tilt).map_or(0.0, |place| place.height_mm);
        let beside_mm = prior.probe_beside_pivot_mm;
        [prior.axis_mm, beside_mm, level_mm - prior.axis_mm - reach_mm, reach_mm, beside_mm]
    }

    /// The axis of the pin at a touch: beside the probe, and above the rotary axis, mm.
    fn axis(&self, &[_, x, y, _, beside]: &Vector<UNKNOWNS>, touch: usize) -> (f64, f64) {
        let (sin, cos) = self.places[touch].tilt_deg.to_radians().sin_cos();
        (x * cos + y * sin - beside, y * cos - x * sin)
    }
}

impl Surface<UNKNOWNS> for Pin {
    fn places(&self) -> &[Place] {
        &self.places
    }

    fn height(&self, unknowns: &Vector<UNKNOWNS>, touch: usize) -> f64 {
        let (beside, above) = self.axis(unknowns, touch);
        unknowns[AXIS] + above + (unknowns[REACH].powi(2) - beside.powi(2)).sqrt()
    }

    fn derivatives(&self, unknowns: &Vector<UNKNOWNS>, touch: usize) -> Vector<UNKNOWNS> {
        let (sin, cos) = self.places[touch].tilt_deg.to_radians().sin_cos();
        let (beside, _) = self.axis(unknowns, touch);
        let up = (unknowns[REACH].powi(2) - beside.powi(2)).sqrt();
        let slope = beside / up;
        [1.0, -sin - slope * cos, cos - slope * sin, unknowns[REACH] / up, slope]
    }

    fn by_tilt(&self, unknowns: &Vector<UNKNOWNS>, touch: usize) -> f64 {
        let (beside, above) = self.axis(unknowns, touch);
        let up = (unknowns[REACH].powi(2) - beside.powi(2)).sqrt();
        -(beside + unknowns[BESIDE]) - beside / up * above
    }

    /// A ball that passes beside the pin, and a pin that is as good as flat.
    fn is_astray(&self, unknowns: &Vector<UNKNOWNS>) -> bool {
        let reach = unknowns[REACH];
        let is_beside = |touch: usize| self.axis(unknowns, touch).0.abs() >= reach;
        !(0.0 < reach && reach < LARGEST_MM) || (0..self.places.len()).any(is_beside)
    }

    fn prior(&self) -> Option<&Prior<UNKNOWNS>> {
        Some(&self.prior)
    }
}
