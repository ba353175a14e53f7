//! The stiffness of single touches.

use rig_analysis::stiffness::Young;
use rig_contact::inverse::InverseError;

/// The stiffness under one touch or site.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TouchStiffness {
    /// Index of the sample; for a blind touch, only for the score.
    pub(crate) sample: usize,
    /// Number among the repeats, or among the blind touches.
    pub(crate) number: u32,
    /// The calibrated stiffness, without the uncertainty of calibration and model, which all share.
    pub(crate) young: Result<Young, InverseError>,
}
