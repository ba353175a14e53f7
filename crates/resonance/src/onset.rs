//! The onset of a contact in a stream of readings at one frequency, while the probe goes down.
//!
//! [`ContactWatch`] decides reading by reading whether the probe touches. [`Onset::fit`] then finds where the
//! surface lies: the depth grows with the way below it, the resonance rises with a power of the depth, and the
//! vibration follows with the time constant of the sensor. Power, strength and loss of the contact are fitted
//! along and are of no interest.

mod fit;
mod model;
mod watch;

use rig_model::Reading;

pub use self::{
    fit::OnsetRefusal,
    watch::{ContactWatch, Watched},
};
use crate::Resonance;

/// The time by which the analyzer integrates later than its readings say, beside the clock of the stage: a
/// constant of the bench.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Latency {
    /// Its mean, s.
    pub mean_s: f64,
    /// Its standard deviation, s.
    pub sigma_s: f64,
}

/// The way of a probe that goes down evenly and then rests.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EvenWay {
    /// A time on the clock of the readings, s.
    pub time_s: f64,
    /// The position at that time, mm.
    pub at_mm: f64,
    /// Standard deviation of that position, mm.
    pub sigma_mm: f64,
    /// Speed downwards, mm/s.
    pub speed_mm_per_s: f64,
    /// Where the probe comes to rest, mm.
    pub rest_mm: f64,
}

impl EvenWay {
    /// The position at a time on the clock of the readings, s, in mm.
    pub fn position_mm(&self, time_s: f64) -> f64 {
        (self.at_mm - self.speed_mm_per_s * (time_s - self.time_s)).max(self.rest_mm)
    }
}

/// The surface as the onset of a contact shows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Onset {
    /// Position of the stage at which the probe touches, mm.
    pub surface_mm: f64,
    /// Its standard deviation, mm: of readings, latency and way. A no-load resonance that is wrong by 30 mHz moves the surface by
    /// less than half of it, which is left out.
    pub sigma_mm: f64,
    /// The exponent with which the resonance rises with the depth.
    pub exponent: f64,
    /// The latency, from what was known of it and from these readings.
    pub latency: Latency,
    /// Change of the surface for each second of latency beyond that one, mm/s.
    pub mm_per_latency_s: f64,
    /// χ² per degree of freedom.
    pub chi_squared_per_dof: f64,
}

impl Onset {
    /// Fits the surface to readings of one frequency, in order of time: on the way down, and at rest after it.
    ///
    /// # Errors
    /// [`OnsetRefusal`], if the readings do not determine the surface to `sigma_max_mm`.
    pub fn fit(
        free: &Resonance,
        readings: &[Reading],
        way: &EvenWay,
        latency: Latency,
        sigma_max_mm: f64,
    ) -> Result<Self, OnsetRefusal> {
        fit::fit(free, readings, way, latency, sigma_max_mm)
    }
}
