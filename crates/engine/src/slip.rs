//! Whether the probe kept its place during a touch: after the sweep the surface is looked for again.
//!
//! ```text
//! drive ─▶ up, out of the sample ─▶ down to above ─▶ read ─▶ down to below ─▶ read ─▶ finished
//! (at the  (takes up the backlash)        ▲           │ clear               contact
//! no-load                                 │           ▼ seems to touch, once
//! resonance)                              └── read ◀─ up: the baseline again, as it drifts
//! ```
//!
//! A drive that has lost steps says that it is where it is not. The sample is the only reference that
//! does not depend on the drive.

use rig_model::{Impedance, Mm, PointResult, Position, Reading};
use rig_protocol::Approach;
use rig_resonance::Resonance;

use crate::{
    contact_sense::check_free,
    search::{Surface, relative_change},
};

/// The next step of a check.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum SlipStep {
    /// Drive the sensor at the no-load resonance, then call [`SlipCheck::driven`].
    Drive,
    /// Go here, then call [`SlipCheck::arrived`].
    MoveTo(Position<Mm>),
    /// Read the impedance, then call [`SlipCheck::read`].
    Read {
        /// Whether the probe has just left the sample.
        is_after_contact: bool,
    },
    /// The analyzer flagged its reading.
    Flagged,
    /// The check is finished.
    Finished(Result<(), Slip>),
}

/// The surface is not where the search found it.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Slip {
    /// The probe touches above it.
    #[error(
        "after the sweep the probe touches at {at}, {by_mm:.3} mm above the surface that the search found"
    )]
    Higher {
        /// The linear stage as read back.
        at: Position<Mm>,
        /// Its height above the surface found, mm.
        by_mm: f64,
    },
    /// The probe is free below it.
    #[error(
        "after the sweep the probe is free at {at}, {by_mm:.3} mm below the surface that the search found"
    )]
    Lower {
        /// The linear stage as read back.
        at: Position<Mm>,
        /// Its depth below the surface found, mm.
        by_mm: f64,
    },
}

/// A check of the surface after a sweep.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SlipCheck {
    surface: Surface,
    approach: Approach,
    /// Depth of the touch, mm.
    depth_mm: f64,
    /// The impedance of the clear probe, before the search or in the check.
    baseline: Impedance,
    /// Whether the baseline was read again.
    is_fresh: bool,
    /// The free resonance may have drifted since the baseline was read.
    is_doubtful: bool,
    place: Place,
    here: Position<Mm>,
    trail: Vec<(Position<Mm>, Reading)>,
}

/// The position that the check goes to, or is at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    /// In the sample, where the sweep was.
    In,
    /// Out of the sample, to take up the backlash.
    Out,
    /// As far out of the sample as the touch was deep in it, to read the baseline again. A probe whose drive
    /// has lost steps downwards may touch at [`Place::Out`], so lightly that it seems to have drifted.
    Again,
    Above,
    Below,
}

impl SlipCheck {
    pub(crate) fn begin(
        surface: Surface,
        approach: Approach,
        depth_mm: f64,
        baseline: Impedance,
    ) -> (Self, SlipStep) {
        let here = surface.position;
        let (place, trail, is_fresh, is_doubtful) = (Place::In, Vec::new(), false, false);
        (
            Self {
                surface,
                approach,
                depth_mm,
                baseline,
                is_fresh,
                is_doubtful,
                place,
                here,
                trail,
            },
            SlipStep::Drive,
        )
    }

    /// The sensor is driven at the no-load resonance; `None` if that was done before.
    pub(crate) fn driven(&mut self) -> Option<SlipStep> {
        (self.place == Place::In).then(|| self.up_to(Place::Out, 0.0))
    }

    /// Whether a reading may come before the contact has decayed: one of a probe that is still said to be clear,
    /// but none that becomes the baseline.
    pub(crate) const fn may_be_early(&self) -> bool {
        matches!(self.place, Place::Above)
    }

    /// Whether an early reading shows a contact, or the rest of its decay.
    pub(crate) fn seems_to_touch(&self, readings: &[Reading]) -> bool {
        readings.last().is_some_and(|last| match last.measured {
            PointResult::Value(now) => {
                self.approach.contact_threshold < relative_change(self.baseline, now)
            }
            _ => false,
        })
    }

    /// The free resonance may have drifted since the baseline was read, by as much as a contact changes the impedance.
    /// The probe below the surface is then compared with that above it.
    pub(crate) const fn doubt(&mut self) {
        self.is_doubtful = true;
    }

    /// The positions with their readings.
    pub(crate) fn trail(&self) -> &[(Position<Mm>, Reading)] {
        &self.trail
    }

    /// The probe has moved; `read_back` is where it is.
    pub(crate) fn arrived(&mut self, read_back: Position<Mm>) -> SlipStep {
        self.here = read_back;
        match self.place {
            Place::In | Place::Out => self.down_to(Place::Above, self.approach.slip_mm),
            Place::Again => SlipStep::Read { is_after_contact: true },
            Place::Above => SlipStep::Read { is_after_contact: !self.is_fresh },
            Place::Below => SlipStep::Read { is_after_contact: false },
        }
    }

    /// The impedance here has been read. `no_load` is the last reference.
    pub(crate) fn read(&mut self, reading: Reading, no_load: &Resonance) -> SlipStep {
        self.trail.push((self.here, reading));
        let PointResult::Value(impedance) = reading.measured else { return SlipStep::Flagged };
        let above = self.trail.iter().rev().nth(1).map(|(_, reading)| reading.measured);
        let clear = match above {
            Some(PointResult::Value(above)) if self.is_doubtful && self.place == Place::Below => {
                above
            }
            _ => self.baseline,
        };
        let change = relative_change(clear, impedance);
        // An impedance that cannot be compared counts as contact, as in the search.
        let is_clear = change <= self.approach.contact_threshold;
        let (at, by_mm) = (self.here, self.here.value() - self.surface.position.value());
        match self.place {
            Place::Again if check_free(no_load, &[reading]).is_ok() => {
                (self.baseline, self.is_fresh) = (impedance, true);
                self.down_to(Place::Above, self.approach.slip_mm)
            }
            Place::Above if is_clear => self.down_to(Place::Below, -self.approach.slip_mm),
            Place::Above if !self.is_fresh => self.up_to(Place::Again, self.depth_mm),
            Place::In | Place::Out | Place::Again | Place::Above => {
                SlipStep::Finished(Err(Slip::Higher { at, by_mm }))
            }
            Place::Below if is_clear => SlipStep::Finished(Err(Slip::Lower { at, by_mm: -by_mm })),
            Place::Below => SlipStep::Finished(Ok(())),
        }
    }

    fn up_to(&mut self, place: Place, further_mm: f64) -> SlipStep {
        self.place = place;
        let above_mm = self.approach.slip_mm + self.approach.coarse_step_mm + further_mm;
        SlipStep::MoveTo(self.surface.position.offset(above_mm))
    }

    fn down_to(&mut self, place: Place, above_mm: f64) -> SlipStep {
        self.place = place;
        SlipStep::MoveTo(self.surface.position.offset(above_mm))
    }
}
