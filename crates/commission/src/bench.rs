//! The bench as a step of commissioning sees it: a person who answers, and two axes that move by short steps.

use std::future::Future;

use crate::{Answer, Asked};

/// One of the two axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JogAxis {
    /// The vertical stage that carries the probe; mm.
    Linear,
    /// The stage that tilts the table; degrees.
    Rotary,
}

impl JogAxis {
    /// Its name in messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear stage",
            Self::Rotary => "rotary stage",
        }
    }

    /// Its unit.
    pub const fn unit(self) -> &'static str {
        match self {
            Self::Linear => "mm",
            Self::Rotary => "°",
        }
    }

    /// Speed of every step, units per second: slow enough to be stopped by hand.
    pub const fn speed_per_s(self) -> f64 {
        match self {
            Self::Linear => 1.0,
            Self::Rotary => 5.0,
        }
    }

    /// The longest step after the scale is shown, in its unit; the interlock admits no longer one.
    pub(crate) const fn longest_step(self) -> f64 {
        match self {
            Self::Linear => 10.0,
            Self::Rotary => 31.0,
        }
    }

    /// The question about what a step of it did.
    pub const fn seen(self) -> Asked {
        match self {
            Self::Linear => Asked::ProbeWent,
            Self::Rotary => Asked::EdgeSank,
        }
    }
}

/// A step of one axis from where it stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jog {
    /// The axis.
    pub axis: JogAxis,
    /// How far, in the unit of the axis by the rig file. A step of 0 reads the position.
    pub by: f64,
}

/// What a drive is asked to do while its bench is commissioned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Order {
    /// A step from where the axis stands.
    Step(Jog),
    /// Clear the alarm that a limit has set off. Nothing moves.
    ClearAlarm(JogAxis),
    /// Find its zero by itself, the linear stage upwards. The axis may go over its whole travel.
    Home(JogAxis),
    /// The same of a linear stage that may home downwards.
    HomeDown,
}

impl Order {
    /// The axis.
    pub const fn axis(self) -> JogAxis {
        match self {
            Self::Step(jog) => jog.axis,
            Self::ClearAlarm(axis) | Self::Home(axis) => axis,
            Self::HomeDown => JogAxis::Linear,
        }
    }

    /// Whether a drive finds its zero, over a way that nobody knows before.
    pub const fn is_homing(self) -> bool {
        matches!(self, Self::Home(_) | Self::HomeDown)
    }

    /// Whether the axis may move.
    pub const fn may_move(self) -> bool {
        match self {
            Self::Step(jog) => jog.by != 0.0,
            Self::ClearAlarm(_) => false,
            Self::Home(_) | Self::HomeDown => true,
        }
    }
}

/// The sentence for a person who lets it happen.
impl std::fmt::Display for Order {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (axis, unit) = (self.axis().name(), self.axis().unit());
        match self {
            Self::Step(jog) => write!(
                f,
                "the {axis} moves by {:+.3} {unit} at {:.0} {unit}/s. Nothing is below the probe, and a hand is at the stop.",
                jog.by,
                jog.axis.speed_per_s()
            ),
            Self::ClearAlarm(_) => write!(f, "the alarm of the {axis} is cleared. Nothing moves."),
            Self::Home(JogAxis::Linear) => write!(
                f,
                "the drive of the {axis} finds its zero upwards, at its own speed. Nothing is below the probe, and a hand is at the \
                 stop."
            ),
            Self::HomeDown => write!(
                f,
                "the drive of the {axis} finds its zero, at its own speed. Table, holder and dish are taken away: nothing is \
                 below the probe, down to the end of its travel, and a hand is at the stop."
            ),
            Self::Home(JogAxis::Rotary) => write!(
                f,
                "the drive of the {axis} finds its zero, at its own speed. Nothing is below the probe that a turn of the table \
                 could reach, and a hand is at the stop."
            ),
        }
    }
}

/// A step as the drive counts it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jogged {
    /// Read-back before it, in the unit of the axis by the rig file.
    pub from: f64,
    /// Read-back after it.
    pub at: f64,
    /// Whether the drive said before it that it knows where the axis is.
    pub is_homed: bool,
    /// The soft limits that the drive had before it, the lower one first, if it has some.
    pub soft: Option<[f64; 2]>,
}

impl Jogged {
    /// The way by the drive's own count.
    pub fn way(&self) -> f64 {
        self.at - self.from
    }
}

/// Why an order was not carried out, in words for a person.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NotDone {
    /// It was refused, and nothing was sent: this says nothing of the bench.
    #[error("{0}")]
    Refused(String),
    /// The drive did not do it, such as one that was stopped by a limit.
    #[error("{0}")]
    Failed(String),
}

/// A bench that is being commissioned. Each call waits for the person or for the drive.
pub trait Bench: Send {
    /// What ends a step without a finding: the person leaves, or the rig is gone.
    type Trouble: Send;

    /// Asks the person.
    fn ask(&mut self, asked: Asked) -> impl Future<Output = Result<Answer, Self::Trouble>> + Send;

    /// Has a drive do something; a step of 0 reads where the axis is.
    fn drive(
        &mut self,
        order: Order,
    ) -> impl Future<Output = Result<Result<Jogged, NotDone>, Self::Trouble>> + Send;

    /// A gauge has shown that the last step of an axis was about as long as its drive says: a longer one may follow.
    fn seen(&mut self, axis: JogAxis) -> impl Future<Output = Result<(), Self::Trouble>> + Send;

    /// The power of the drives is about to go for a homing: what an interruption would leave unproven is kept on the disk first.
    fn homing_begins(&mut self) -> impl Future<Output = Result<(), Self::Trouble>> + Send;

    /// Tells the person something.
    fn remark(&mut self, text: &str);
}
