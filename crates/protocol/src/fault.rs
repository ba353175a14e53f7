//! The faults of a protocol, beyond the shape of its file.

use std::fmt;

use rig_files::{Complaint, settings::unit_hint};
use rig_model::{ContactAngle, Deg, Direction, Mm, Position, Span, SweepRequestError};

use crate::{Pose, StepId};

/// The limit of the depth of a touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum DepthLimit {
    Protocol,
    Rig,
    /// No model of a ball in contact holds once the whole ball is in the sample.
    Probe,
}

impl fmt::Display for DepthLimit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Protocol => "the protocol (limits.max_indentation_mm)",
            Self::Rig => "the rig (limits.max_indentation_mm)",
            Self::Probe => "the probe, twice its radius (geometry.probe_radius_mm of the rig)",
        })
    }
}

/// A fault of a protocol. Values and limits are in the unit of their key.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(crate) enum ProtocolFault {
    // Lists.
    #[error("\"{name}\" in samples cannot be part of a step's address")]
    SampleName { name: String },
    #[error("{item} in {key} is listed twice")]
    ListedTwice { item: String, key: &'static str },
    #[error(
        "angles_deg: {} is within {tolerance}° of {}, the accuracy of the rotary stage \
         (rotary.tolerance_deg of the rig)", angle.degrees(), other.degrees()
    )]
    SameTilt { angle: ContactAngle, other: ContactAngle, tolerance: f64 },
    #[error(
        "angle = \"unknown\" needs touches in all three directions, and \"{}\" is not among them", direction.name()
    )]
    UnknownAngleNeeds { direction: Direction },
    #[error("\"{name}\" in samples is not a sample of the simulated rig")]
    UnknownSample { name: String, known: Vec<String> },

    #[error("all poses and repeats together are {touches} touches, above the limit of {limit}")]
    TooManyTouches { touches: usize, limit: usize },
    #[error("with {trials} trials the protocol has {all} touches, above the limit of {limit}")]
    TooManyTrials { trials: u32, all: usize, limit: usize },

    // Faults of the lowering of the probe.
    #[error("indentation_mm = {found} is above the limit of {limit} mm of {whose}")]
    TooDeep { found: f64, limit: f64, whose: DepthLimit },
    #[error("fine_step_mm = {fine} is above coarse_step_mm = {coarse}")]
    FineAboveCoarse { fine: f64, coarse: f64 },
    #[error(
        "coarse_step_mm = {coarse} is above indentation_mm = {indentation}: the search could press \
         deeper than the touch itself"
    )]
    CoarseAboveIndentation { coarse: f64, indentation: f64 },
    #[error("{key} is for the method \"descent\" only")]
    OnlyDescent { key: &'static str },
    #[error(
        "slow_speed_mm_per_s = {found} is not below {limit:.2} mm/s, the speed of the other descents: touches at one \
         speed show no latency"
    )]
    SlowNotSlower { found: f64, limit: f64 },
    #[error("slow_speed_mm_per_s is that of every second touch of a pose, and repeats = {repeats}")]
    SlowNeedsRepeats { repeats: u32 },
    #[error(
        "method = \"descent\" needs a stream of readings at one frequency, and the rig states no time of a reading \
         in one (analyzer.stream_overhead_s)"
    )]
    NoStream,
    #[error(
        "method = \"descent\" would go down at {limit:.2} mm/s at most, so that two readings of {reading_ms:.0} ms \
         and a stop press no deeper than coarse_step_mm = {coarse}; below {least} mm/s it is no faster than the \
         search in steps"
    )]
    StreamTooSlow { limit: f64, reading_ms: f64, coarse: f64, least: f64 },
    #[error(
        "speed_mm_per_s = {found} is above {limit:.2} mm/s: two readings of {reading_ms:.0} ms and a stop would \
         press deeper than coarse_step_mm = {coarse}"
    )]
    DescentTooFast { found: f64, limit: f64, reading_ms: f64, coarse: f64 },
    #[error(
        "speed_mm_per_s = {found} is above {limit} mm/s, the speed in contact of the rig \
         (limits.contact_speed_mm_per_s)"
    )]
    DescentAboveContactSpeed { found: f64, limit: f64 },
    #[error(
        "{key} = {found} is below {limit} mm/s, the slowest move of the drive of the linear stage"
    )]
    DescentTooSlow { key: &'static str, found: f64, limit: f64 },
    #[error(
        "slip_mm = {slip} is below fine_step_mm = {fine}, to which the surface is known, and not 0"
    )]
    SlipBelowFine { slip: f64, fine: f64 },
    #[error(
        "slip_mm = {slip} is above indentation_mm = {indentation}: the check could press deeper than \
         the touch itself"
    )]
    SlipAboveIndentation { slip: f64, indentation: f64 },
    #[error(
        "halfway_mm = {halfway} is not less than indentation_mm = {indentation}, the full depth of a touch"
    )]
    HalfwayTooDeep { halfway: f64, indentation: f64 },
    #[error(
        "halfway_mm = {halfway} is below coarse_step_mm = {coarse}, the depth at which a descent may \
         stop: the probe would go up to it"
    )]
    HalfwayAboveStop { halfway: f64, coarse: f64 },
    #[error(
        "fine_step_mm = {found} is below {limit} mm, the accuracy of the linear stage \
         (linear.tolerance_mm of the rig)"
    )]
    FinerThanStage { found: f64, limit: f64 },
    #[error(
        "{key} = {found} is below {limit:.3} mm, the possible error of the expected surface at \
         {angle} (geometry.surface_tolerance_mm of the rig)"
    )]
    WithinSurfaceTolerance { key: &'static str, found: f64, limit: f64, angle: ContactAngle },
    #[error(
        "start_above_mm = {found} begins the search at {start} for {} {}, not below \
         the clear position {clear} of the rig",
        pose.direction, pose.angle
    )]
    StartsAboveClear { found: f64, start: Position<Mm>, pose: Pose, clear: Position<Mm> },
    #[error(
        "give_up_below_mm and indentation_mm let the probe go down to {floor} for {} {}, \
         beyond the soft limits {soft} of the linear stage",
        pose.direction, pose.angle
    )]
    BelowSoftLimits { floor: Position<Mm>, pose: Pose, soft: Span<Mm> },

    // Faults of the tilt of the sample.
    #[error(
        "{subject} puts the rotary stage at {rotary} for {direction}, outside its soft limits \
         {soft}"
    )]
    OutOfReach {
        subject: String,
        direction: Direction,
        rotary: Position<Deg>,
        soft: Span<Deg>,
        reach_deg: f64,
    },
    #[error(
        "{subject} lifts the edge of a sample to {highest}, not below the clear position {clear} \
         of \
         the rig"
    )]
    NotCleared { subject: String, highest: Position<Mm>, clear: Position<Mm> },

    // Faults of the sweeps.
    #[error("{key} is for the method \"uniform\" only")]
    OnlyUniform { key: &'static str },
    #[error("the method \"uniform\" needs the key `{key}`")]
    UniformNeeds { key: &'static str },
    #[error("{key} is for the method \"adaptive\" only")]
    OnlyAdaptive { key: &'static str },
    #[error("survey_s = {found} is outside [{min}, {max}]")]
    SurveyTime { found: u32, min: u32, max: u32 },
    #[error("level_check is part of a survey, and there is no survey_s")]
    CheckNeedsSurvey,
    #[error(transparent)]
    Sweep(#[from] SweepRequestError),
    #[error(
        "{key} = {found} is outside the range of the analyzer of the rig, {min} Hz to {max} Hz \
         (analyzer.frequency_hz)"
    )]
    BeyondAnalyzer { key: &'static str, found: f64, min: f64, max: f64 },
    #[error("level_v = {found} is above the limit of {limit} V of the rig (analyzer.max_level_v)")]
    LevelTooHigh { found: f64, limit: f64 },
    #[error("level_v = {found} is below {limit} V, the lowest level of the analyzer")]
    LevelTooLow { found: f64, limit: f64 },

    // The aim.
    #[error("an aim is stiffness_percent or seconds_per_touch, and here are both")]
    TwoAims,
    #[error("[aim] has neither stiffness_percent nor seconds_per_touch")]
    NoAim,
    #[error(
        "target_sigma_hz of [{section}] is left to the aim, and the method \"uniform\" measures its points \
         whatever the target is"
    )]
    AimNeedsAdaptive { section: &'static str },
    #[error(
        "target_sigma_hz of [{section}] is left to the aim, and time_limit_s = {found} is below {limit:.2} s, in which a \
         sweep reaches the coarsest that it may choose"
    )]
    AimNeedsTime { section: &'static str, found: f64, limit: f64 },
    #[error(
        "fine_step_mm is left to the aim, and {key} = {found}, which no fine step exceeds, is below {limit} mm, the finest \
         step of the stage"
    )]
    AimNeedsStep { key: &'static str, found: f64, limit: f64 },
    #[error("the aim needs an expected stiffness of sample \"{sample}\", which no file states")]
    AimOfUnknownSample { sample: String },
    #[error("nothing can be expected of {step}: the models of the sensor do not hold there")]
    AimOutsideModel { step: StepId },
    #[error(
        "stiffness_percent = {found} is below {limit:.2} %, the best that settings make of {step}: depth and \
         angle of the rig file (sensor.uncertainty) make {fixed_percent:.2} % of it"
    )]
    AimTooAccurate { found: f64, limit: f64, fixed_percent: f64, step: StepId },
    #[error(
        "seconds_per_touch = {found} is below {limit:.2} s, the fastest that settings make of a touch: all but \
         its sweeps and its search takes {rest_s:.2} s of it"
    )]
    AimTooFast { found: f64, limit: f64, rest_s: f64 },

    // The blind phase and the whole.
    #[error("classes = {classes} is above the number of samples, {samples}")]
    MoreClassesThanSamples { classes: u32, samples: usize },
    #[error("trials = {trials} is below classes = {classes}: some class would be empty")]
    FewerTrialsThanClasses { trials: u32, classes: u32 },
    #[error(
        "there is no angle in steps of 0.01° from min_angle_deg = {min} to max_angle_deg = \
             {max}"
    )]
    NoBlindAngle { min: f64, max: f64 },
    #[error("the protocol takes {expected:.2} h, above its own limit max_duration_h = {limit}")]
    TooLong { expected: f64, limit: f64 },
}

impl Complaint for ProtocolFault {
    fn suggestion(&self) -> Option<String> {
        let suggestion = match self {
            Self::SampleName { .. } => "use no \"/\", and no blank at the ends".into(),
            Self::ListedTwice { .. } | Self::SameTilt { .. } => "remove one".into(),
            Self::UnknownAngleNeeds { .. } => "add it, or write angle = \"known\"".into(),
            Self::TooManyTrials { .. } => "use fewer trials, or fewer touches before them".into(),
            Self::TooManyTouches { .. } => "use fewer repeats, angles or samples".into(),
            Self::UnknownSample { known, .. } => format!("it has {}", known.join(", ")),
            Self::TooDeep { limit, .. }
            | Self::FineAboveCoarse { coarse: limit, .. }
            | Self::SlipAboveIndentation { indentation: limit, .. }
            | Self::CoarseAboveIndentation { indentation: limit, .. }
            | Self::DescentAboveContactSpeed { limit, .. }
            | Self::LevelTooHigh { limit, .. } => format!("use at most {limit}"),
            Self::SlipBelowFine { fine, .. } => {
                format!("use at least {fine}, or 0 for no check of slip")
            }
            Self::OnlyDescent { .. } => "remove it, or write method = \"descent\"".into(),
            Self::SlowNeedsRepeats { .. } => "write repeats = 2 or more, or remove it".into(),
            Self::SlowNotSlower { limit, .. } => format!("use {:.2} or less", 0.5 * limit),
            Self::NoStream => "write method = \"stepped\"".into(),
            Self::StreamTooSlow { .. } => "write method = \"stepped\", or fewer cycles".into(),
            Self::DescentTooFast { limit, .. } => {
                format!("use at most {:.2}", (limit * 100.0).floor() / 100.0)
            }
            Self::HalfwayAboveStop { coarse: limit, .. }
            | Self::AimNeedsStep { limit, .. }
            | Self::DescentTooSlow { limit, .. }
            | Self::LevelTooLow { limit, .. }
            | Self::FinerThanStage { limit, .. } => format!("use at least {limit}"),
            Self::HalfwayTooDeep { indentation, .. } => {
                format!("use less than {indentation}, such as {}", 0.5 * indentation)
            }
            Self::WithinSurfaceTolerance { limit, .. } => {
                // Rounded up, so that the advice holds.
                format!("use at least {:.3}", (limit * 1000.0).ceil() / 1000.0)
            }
            Self::StartsAboveClear { .. } => "begin lower or use smaller angles".into(),
            Self::BelowSoftLimits { .. } => "give up earlier or use smaller angles".into(),
            Self::OutOfReach { reach_deg, .. } if *reach_deg >= 0.0 => {
                format!("use at most {reach_deg}")
            }
            Self::OutOfReach { direction, .. } => format!("leave out {direction}"),
            Self::NotCleared { .. } => {
                "use smaller angles, or raise linear.clear_mm of the rig".into()
            }
            Self::OnlyUniform { .. } => "remove it, or write method = \"uniform\"".into(),
            Self::OnlyAdaptive { .. } => "remove it, or write method = \"adaptive\"".into(),
            Self::CheckNeedsSurvey => "remove it, or write for example survey_s = 60".into(),
            Self::SurveyTime { .. } => "write for example survey_s = 60".into(),
            Self::UniformNeeds { key: "points" } => "write for example points = 101".into(),
            Self::UniformNeeds { .. } => "write for example settle_s = 0.5".into(),
            Self::Sweep(error) => return sweep_suggestion(error),
            Self::BeyondAnalyzer { key, found, min, max } => stay_within(key, *found, *min, *max),
            Self::MoreClassesThanSamples { samples, .. } => format!("use at most {samples}"),
            Self::FewerTrialsThanClasses { classes, .. } => format!("use at least {classes}"),
            Self::NoBlindAngle { min, .. } => format!("use at least {min}"),
            Self::TooLong { .. } => "raise the limit, or take fewer touches".into(),
            of_aim => return of_aim.suggestion_of_aim(),
        };
        Some(suggestion)
    }
}

impl ProtocolFault {
    fn suggestion_of_aim(&self) -> Option<String> {
        let suggestion = match self {
            Self::TwoAims => "remove one".into(),
            Self::NoAim => "write for example stiffness_percent = 2".into(),
            Self::AimNeedsAdaptive { .. } => {
                "write method = \"adaptive\", or state target_sigma_hz".into()
            }
            Self::AimNeedsTime { limit, .. } => at_least(*limit, "state target_sigma_hz"),
            Self::AimOfUnknownSample { .. } => {
                "write that of the softest sample there, such as softest_mpa = 0.05".into()
            }
            Self::AimOutsideModel { .. } => {
                "use smaller angles, or state the settings and remove [aim]".into()
            }
            Self::AimTooAccurate { limit, .. } => {
                at_least(*limit, "state smaller uncertainties if the bench is known better")
            }
            Self::AimTooFast { limit, .. } => at_least(*limit, "shorten dwell_s and the ways"),
            _ => return None,
        };
        Some(suggestion)
    }
}

/// The suggestion for an aim out of reach. The limit is rounded up, so that the advice holds.
fn at_least(limit: f64, or: &str) -> String {
    format!("use at least {:.2}, or {or}", (limit * 100.0).ceil() / 100.0)
}

/// The suggestion for a number outside its limits.
fn stay_within(key: &str, found: f64, min: f64, max: f64) -> String {
    let (side, limit) = if found < min { ("at least", min) } else { ("at most", max) };
    let hint = unit_hint(key, found, |meant| min <= meant && meant <= max);
    format!("use {side} {limit}{}", hint.map(|hint| format!("; {hint}")).unwrap_or_default())
}

fn sweep_suggestion(error: &SweepRequestError) -> Option<String> {
    match *error {
        SweepRequestError::Window { .. } => None,
        SweepRequestError::OutOfRange { what: "target_sigma_hz", found, min, .. }
            if found < min =>
        {
            Some(format!("no analyzer keeps its own frequency more accurately; use at least {min}"))
        }
        SweepRequestError::OutOfRange { what, found, min, max } => {
            Some(stay_within(what, found, min, max))
        }
        SweepRequestError::TooLong { takes_s, .. } => {
            Some(format!("allow {:.0} s, or take fewer points or shorter ones", takes_s.ceil()))
        }
    }
}
