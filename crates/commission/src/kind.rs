//! The kinds of calibration.

use serde::{Deserialize, Serialize};

use crate::Step;

/// What a calibration shows: that of a step of commissioning, or a measurement on a bench that is commissioned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// The emergency stop keeps both axes still.
    Stop,
    /// Each axis moves in the direction that the rig file says.
    Signs,
    /// Surface and rotary axis are where the rig file says, by a rule.
    Geometry,
    /// Each axis moves as far as the rig file says, and the table is level at zero.
    Scale,
    /// Something stops each axis at the ends of its travel, outside of the soft limits.
    Limits,
    /// Each axis is where it was after its drive was without power.
    Homing,
    /// Surface, rotary axis, probe and the zero of the rotary stage by touches on hard blocks, and the error of the
    /// linear screw.
    Blocks,
    /// Touches at one place of a hard block repeat.
    Touches,
    /// The latency between stage and analyzer.
    Latency,
    /// The radius of the ball by touches on a pin.
    Pin,
    /// The free sensor: its circuit, its drift, its linearity with the level of the drive, and no second mode.
    Sensor,
    /// The bench is as it was at the checks before: the daily check.
    Check,
}

impl Kind {
    /// All of them.
    pub const ALL: [Self; 12] = [
        Self::Stop,
        Self::Signs,
        Self::Geometry,
        Self::Scale,
        Self::Limits,
        Self::Homing,
        Self::Blocks,
        Self::Touches,
        Self::Latency,
        Self::Pin,
        Self::Sensor,
        Self::Check,
    ];

    /// Its name in commands and files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Stop => "stop",
            Self::Signs => "signs",
            Self::Geometry => "geometry",
            Self::Scale => "scale",
            Self::Limits => "limits",
            Self::Homing => "homing",
            Self::Blocks => "blocks",
            Self::Touches => "touches",
            Self::Latency => "latency",
            Self::Pin => "pin",
            Self::Sensor => "sensor",
            Self::Check => "check",
        }
    }

    /// Whether it rests on the geometry of the rig file, and not only on its axes.
    pub(crate) const fn rests_on_geometry(self) -> bool {
        matches!(self, Self::Geometry | Self::Blocks | Self::Pin)
    }

    /// Whether it rests on the soft limits of the axes too.
    pub(crate) const fn rests_on_soft_limits(self) -> bool {
        matches!(self, Self::Limits)
    }

    /// Whether it rests on no key of the rig file: what it shows is of the sensor and the analyzer.
    pub(crate) const fn rests_on_no_key(self) -> bool {
        matches!(self, Self::Sensor)
    }

    /// What a person does when it fails.
    pub const fn remedy(self) -> &'static str {
        match self {
            Self::Stop => {
                "let nothing else move; see that the stop takes the power from both motors, and that both axes move again after its release"
            }
            Self::Signs => {
                "look at the axis from close by, with a mark on its edge, and begin the step again"
            }
            Self::Geometry => {
                "measure again with a rule that reaches the axis, and begin the step again"
            }
            Self::Scale => {
                "see that the gauge stands still and square, that nothing slips, and begin the step again"
            }
            Self::Limits => {
                "let the axis go no further; see that its switches are where they should be and wired to its drive, and begin the \
                 step again"
            }
            Self::Homing => {
                "see that the indicators stand still, that no clamp or coupling slips, that the battery of an absolute encoder is \
                 good and the sensor of a home clean, and begin the step again"
            }
            Self::Blocks => "see that the block is clean and lies flat, and run its protocol again",
            Self::Touches => {
                "clean the block and the ball, see that the clamps of sensor and block are tight and the bench is warm, and run \
                 the protocol again"
            }
            Self::Latency => {
                "see that the sample is fixed and the bench is warm, and run the protocol again with more repeats"
            }
            Self::Pin => {
                "see that the pin is clean, is fixed along the rotary axis and has the stated radius, touch two blocks \
                 and evaluate them by `rigd commission blocks` before, and run the protocol of the pin again"
            }
            Self::Sensor => {
                "see that the clamp of the sensor is tight, its cable hangs free and the analyzer is warm, correct the cable again, \
                 and check again; after the sensor was clamped again or exchanged, say so by `rigd commission changed sensor`"
            }
            Self::Check => "follow the advice for each quantity, and check again",
        }
    }
}

impl From<Step> for Kind {
    fn from(step: Step) -> Self {
        match step {
            Step::Stop => Self::Stop,
            Step::Signs => Self::Signs,
            Step::Geometry => Self::Geometry,
            Step::Limits => Self::Limits,
            Step::Homing => Self::Homing,
            Step::Scale => Self::Scale,
        }
    }
}
