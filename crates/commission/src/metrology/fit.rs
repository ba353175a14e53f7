//! The geometry of a bench by touches on flat blocks.

use super::{
    BlockTouch, NoGeometry, ScrewMap, TouchNoise,
    least_squares::{Place, Surface, Vector, average, enough},
};

/// Unknowns: s, D, p in mm, t₀ in rad.
const UNKNOWNS: usize = 4;

/// The geometry of a bench.
#[derive(Debug, Clone, PartialEq)]
pub struct BlockGeometry {
    /// Height of the level block, mm.
    pub surface_mm: f64,
    /// Distance of its surface from the rotary axis, and the radius of the ball, mm.
    pub surface_and_radius_mm: f64,
    /// Distance of the probe from the rotary axis, mm.
    pub probe_beside_pivot_mm: f64,
    /// What is to be added to a tilt of the drive, degrees.
    pub zero_deg: f64,
    /// Their covariance, in this order and these units.
    pub covariance: [[f64; 4]; 4],
    /// Error of the screw at the heights that were asked for.
    pub screw: ScrewMap,
}

impl BlockGeometry {
    /// The standard deviations, in the order of the covariance.
    pub fn sigmas(&self) -> [f64; 4] {
        std::array::from_fn(|i| self.covariance[i][i].sqrt())
    }
}

/// Fits the geometry to touches, with the error of the screw at these heights.
///
/// # Errors
/// [`NoGeometry`].
pub fn fit(
    touches: &[BlockTouch],
    noise: &TouchNoise,
    heights_mm: &[f64],
) -> Result<BlockGeometry, NoGeometry> {
    let blocks = Blocks::of(touches)?;
    let found = average(&blocks, noise, blocks.coarse(), heights_mm)?;
    let unit = |i: usize| if i == 3 { 1.0_f64.to_degrees() } else { 1.0 };
    let [surface_mm, surface_and_radius_mm, probe_beside_pivot_mm, zero] = found.mean;
    Ok(BlockGeometry {
        surface_mm,
        surface_and_radius_mm,
        probe_beside_pivot_mm,
        zero_deg: zero.to_degrees(),
        covariance: std::array::from_fn(|i| {
            std::array::from_fn(|j| found.covariance[i][j] * unit(i) * unit(j))
        }),
        screw: found.screw,
    })
}

/// Blocks that are touched.
struct Blocks {
    places: Vec<Place>,
    raised_mm: Vec<f64>,
}

impl Blocks {
    fn of(touches: &[BlockTouch]) -> Result<Self, NoGeometry> {
        let place =
            |touch: &BlockTouch| Place { tilt_deg: touch.tilt_deg, height_mm: touch.height_mm };
        let places: Vec<_> = touches.iter().map(place).collect();
        let raised_mm: Vec<_> = touches.iter().map(|touch| touch.raised_mm).collect();
        if !raised_mm.iter().all(|raised_mm| raised_mm.is_finite()) {
            return Err(NoGeometry::NoSolution);
        }
        enough(&places)?;
        Ok(Self { places, raised_mm })
    }

    /// A start: the height of the touch that is most level, and the middle of what benches have.
    fn coarse(&self) -> Vector<UNKNOWNS> {
        let all = self.places.iter().zip(&self.raised_mm);
        let level = all.min_by(|(a, _), (b, _)| a.tilt_deg.abs().total_cmp(&b.tilt_deg.abs()));
        [level.map_or(0.0, |(place, raised_mm)| place.height_mm - raised_mm), 4.0, 0.0, 0.0]
    }
}

impl Surface<UNKNOWNS> for Blocks {
    fn places(&self) -> &[Place] {
        &self.places
    }

    fn height(&self, &[surface, from_axis, beside, zero]: &Vector<UNKNOWNS>, touch: usize) -> f64 {
        let tilt = self.places[touch].tilt_deg.to_radians() + zero;
        surface - from_axis + (from_axis + self.raised_mm[touch]) / tilt.cos() - beside * tilt.tan()
    }

    fn derivatives(&self, unknowns: &Vector<UNKNOWNS>, touch: usize) -> Vector<UNKNOWNS> {
        let [_, from_axis, beside, zero] = *unknowns;
        let tilt = self.places[touch].tilt_deg.to_radians() + zero;
        let (secant, tangent) = (1.0 / tilt.cos(), tilt.tan());
        let by_tilt =
            (from_axis + self.raised_mm[touch]) * secant * tangent - beside * secant * secant;
        [1.0, secant - 1.0, -tangent, by_tilt]
    }

    fn by_tilt(&self, unknowns: &Vector<UNKNOWNS>, touch: usize) -> f64 {
        self.derivatives(unknowns, touch)[3]
    }

    /// Beyond half a right angle, the start leads to no solution.
    fn is_astray(&self, unknowns: &Vector<UNKNOWNS>) -> bool {
        unknowns[3].abs() > 0.8
    }
}
