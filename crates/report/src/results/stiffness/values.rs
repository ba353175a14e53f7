//! The stiffness of samples and touches.

use rig_analysis::stiffness::Young;
use rig_contact::inverse::InverseError;

/// The stiffness of a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SampleStiffness {
    /// Index of the sample.
    pub(crate) sample: usize,
    /// Young's modulus, MPa.
    pub(crate) young_mpa: f64,
    /// Its standard deviation, that of the calibration included, MPa.
    pub(crate) sigma_mpa: f64,
    /// Standard deviation of the touches about it, MPa, when there are several.
    pub(crate) spread_mpa: Option<f64>,
    /// Known Young's modulus, MPa.
    pub(crate) known_mpa: Option<f64>,
    /// Number of touches or sites with a stiffness.
    pub(crate) touches: usize,
}

/// The stiffness under one touch or site.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TouchStiffness {
    /// Index of the sample; for a blind touch, only for the score.
    pub(crate) sample: usize,
    /// Number among the repeats, or among the blind touches.
    pub(crate) number: u32,
    /// The calibrated stiffness, without the uncertainty of the calibration, which all share.
    pub(crate) young: Result<Young, InverseError>,
}
