//! Faults of readings and checks of results.

pub(crate) mod alternatives;
pub(crate) mod any_phase;
pub(crate) mod doubts;
pub(crate) mod flagged;
pub(crate) mod mains;
pub(crate) mod outliers;
pub(crate) mod rounding;
pub(crate) mod screen;
pub(crate) mod tangents;
pub(crate) mod unknown_dwell;
pub(crate) mod unsettled_outliers;
