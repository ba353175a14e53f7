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

impl Jog {
    /// Speed of every step, units per second: slow enough to be stopped by hand.
    pub const fn speed_per_s(self) -> f64 {
        match self.axis {
            JogAxis::Linear => 1.0,
            JogAxis::Rotary => 5.0,
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
}

impl Jogged {
    /// The way by the drive's own count.
    pub fn way(&self) -> f64 {
        self.at - self.from
    }
}

/// A bench that is being commissioned. Each call waits for the person or for the drive.
pub trait Bench: Send {
    /// What ends a step without a finding: the person leaves, or the rig is gone.
    type Trouble: Send;

    /// Asks the person.
    fn ask(&mut self, asked: Asked) -> impl Future<Output = Result<Answer, Self::Trouble>> + Send;

    /// Moves one axis by a step, or reads where it is. A drive that does not make the step has a reason, in its own
    /// words.
    fn jog(
        &mut self,
        jog: Jog,
    ) -> impl Future<Output = Result<Result<Jogged, String>, Self::Trouble>> + Send;

    /// A gauge has shown that the last step of an axis was about as long as its drive says: a longer one may follow.
    fn seen(&mut self, axis: JogAxis) -> impl Future<Output = Result<(), Self::Trouble>> + Send;

    /// Tells the person something.
    fn remark(&mut self, text: &str);
}
