//! What stays the same on a bench from sweep to sweep.

use rig_model::Window;

/// The knowledge of an analyzer and its surroundings from a survey.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bench {
    /// Phase error of the analyzer, rad: it is subtracted from each impedance.
    pub phase_rad: f64,
    /// Its standard deviation, rad.
    pub phase_sigma_rad: f64,
    /// By how much the time from the begin of the first reading of a stay to that of the second is longer
    /// than recorded, s: an analyzer may begin a reading that comes with its settings later than others. It
    /// varies by as much.
    pub first_gap_s: f64,
    /// Standard deviation of the capacitance of a possible second mode, relative to that of the first.
    pub mode_sigma: f64,
    /// The frequencies at which a second mode would have been noticed.
    pub surveyed: Window,
}
