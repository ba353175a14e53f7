//! The form of a single sweep, with the same keys and defaults on the command line and over HTTP.

use rig_model::{AnalyzerRange, DriveLevel, SweepMethod, SweepRequest, Window};
use schemars::JsonSchema;
use serde::Deserialize;

/// Only the window has to be given.
#[derive(Debug, Clone, clap::Args, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct SweepForm {
    /// Lower end of the window in which the resonance is looked for
    #[arg(long, value_name = "HZ")]
    min_hz: f64,
    /// Upper end of that window
    #[arg(long, value_name = "HZ")]
    max_hz: f64,
    /// Measure this many evenly spaced points instead of letting the planner choose
    #[arg(long, value_name = "N")]
    points: Option<u32>,
    /// Survey the bench for this long around the resonance: the phase error of the analyzer, the dispersion
    /// of the dielectric, and second modes of the sensor, which is refused with one
    #[arg(long, value_name = "S", conflicts_with = "points")]
    survey_s: Option<u32>,
    /// The standard deviation to be reached
    #[arg(long, value_name = "HZ", default_value_t = default_target_sigma_hz())]
    #[serde(default = "default_target_sigma_hz")]
    target_sigma_hz: f64,
    /// The time that may be spent, by the clock of the rig
    #[arg(long, value_name = "S", default_value_t = default_time_limit_s())]
    #[serde(default = "default_time_limit_s")]
    time_limit_s: f64,
    /// Whole cycles that are integrated at each point
    #[arg(long, value_name = "N", default_value_t = default_cycles())]
    #[serde(default = "default_cycles")]
    cycles: u32,
    /// Settling at each of the evenly spaced points
    #[arg(long, value_name = "S", default_value_t = default_settle_s())]
    #[serde(default = "default_settle_s")]
    settle_s: f64,
    /// Level of the drive
    #[arg(long, value_name = "V", default_value_t = default_level_v())]
    #[serde(default = "default_level_v")]
    level_v: f64,
}

const fn default_target_sigma_hz() -> f64 {
    0.05
}

const fn default_time_limit_s() -> f64 {
    60.0
}

const fn default_cycles() -> u32 {
    10
}

const fn default_settle_s() -> f64 {
    0.5
}

const fn default_level_v() -> f64 {
    1.0
}

/// Every reason for which a sweep cannot be made.
#[derive(Debug, Clone, thiserror::Error)]
#[error("{}", self.0.join("; "))]
pub(crate) struct SweepFaults(Vec<String>);

/// A sweep, for a bench with this analyzer.
///
/// # Errors
/// [`SweepFaults`].
pub(crate) fn checked(
    request: SweepRequest,
    analyzer: &AnalyzerRange,
) -> Result<SweepRequest, SweepFaults> {
    let faults = faults_of(&request, analyzer);
    if faults.is_empty() { Ok(request) } else { Err(SweepFaults(faults)) }
}

fn faults_of(request: &SweepRequest, analyzer: &AnalyzerRange) -> Vec<String> {
    let of_request = request.faults().into_iter().chain(analyzer.faults(request));
    of_request.map(|fault| fault.to_string()).collect()
}

impl SweepForm {
    /// The sweep, for a bench with this analyzer.
    ///
    /// # Errors
    /// [`SweepFaults`].
    pub(crate) fn request(&self, analyzer: &AnalyzerRange) -> Result<SweepRequest, SweepFaults> {
        let request = SweepRequest {
            window: Window { min_hz: self.min_hz, max_hz: self.max_hz },
            method: match (self.points, self.survey_s) {
                (Some(points), _) => SweepMethod::Uniform { points },
                (None, Some(seconds)) => SweepMethod::Survey { seconds },
                (None, None) => SweepMethod::Adaptive,
            },
            target_sigma_hz: self.target_sigma_hz,
            time_limit_s: self.time_limit_s,
            cycles: self.cycles,
            settle_s: self.settle_s,
            level: DriveLevel { volt: self.level_v },
        };
        let mut faults = faults_of(&request, analyzer);
        if self.points.is_some() && self.survey_s.is_some() {
            faults.push("points and survey_s exclude each other: give one of them".to_owned());
        }
        if faults.is_empty() { Ok(request) } else { Err(SweepFaults(faults)) }
    }
}
