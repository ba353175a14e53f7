//! Finds the surface of the sample.
//!
//! The probe goes down in steps until the impedance differs from that of the free sensor. Then it
//! goes back above the last clear place and comes down again in finer steps, always from above, so
//! that the backlash of the stage is the same in every reading that counts.
//!
//! If the touches before say where the surface lies, the search begins close above it, with fine steps if it
//! is known well. A contact already there is no surface: the probe goes up to where the search for an unknown
//! surface begins, and that search follows.
//!
//! A drift of the free resonance changes the impedance too. Where it may have changed it by as much, or where the change
//! has come over several steps, the probe goes up to a place that was clear, the impedance is read again there, and the
//! search goes on with it.

#[cfg(test)]
mod tests;

use rig_model::{Impedance, Mm, PointResult, Position, Reading};
use rig_protocol::Approach;

use crate::{Device, Failure, FailureKind, Fault};

/// Largest ratio of the steps of consecutive passes. Another pass costs the way up and down and the decay
/// of the contact, as much as six steps; up to this ratio, the steps that it saves take less.
const REFINEMENT: f64 = 20.0;

/// The impedance of the clear probe is read again this often in a search at most.
const ANEW_MAX: u32 = 4;

/// A reading that differs from the one before it by less than this part of the threshold shows no contact of this step.
const CREEP_PART: f64 = 0.25;

/// A surface lies higher than this many standard deviations above where it is expected in 7 % of the
/// searches; a contact in a longer step above costs another pass.
const LIKELY_SIGMAS: f64 = 1.5;

/// Steps in a row after which the stage may still be no lower. A step as short as the accuracy of the stage may end
/// where it began, and one that is stuck would be asked for it without end.
const STUCK_MAX: u32 = 3;

/// The next step of a search for the surface.
#[derive(Debug, Clone, PartialEq)]
pub enum SearchStep {
    /// Go here, then call [`Search::arrived`].
    MoveTo(Position<Mm>),
    /// Read the impedance, then call [`Search::read`].
    Read {
        /// Whether the probe has just left the sample: the vibration of the contact must decay
        /// first.
        is_after_contact: bool,
    },
    /// The analyzer flagged its reading, which is not usable: read again, or give up.
    Flagged,
    /// The surface is found.
    Found(Surface),
    /// The search cannot continue.
    Fault(Fault),
}

/// A surface that was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// The position of the linear axis at which the tip touches.
    pub position: Position<Mm>,
    /// Its standard deviation, mm.
    pub sigma_mm: f64,
}

/// Where a search begins if the touches before say where the surface lies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Near {
    /// The first reading, above the surface.
    pub(crate) start: Position<Mm>,
    /// The surface as it is expected, and its standard deviation, mm.
    pub(crate) surface: Position<Mm>,
    pub(crate) sigma_mm: f64,
    /// No surface lies above, even if the learnt ones say so: the probe may travel this far.
    pub(crate) highest: Position<Mm>,
}

impl Near {
    /// Where the surface may well lie.
    fn likely(&self) -> Position<Mm> {
        self.surface.offset(LIKELY_SIGMAS * self.sigma_mm)
    }

    /// Whether fine steps through the likely places take less time than a coarse pass and a fine one.
    fn is_known_well(&self, approach: &Approach) -> bool {
        LIKELY_SIGMAS * self.sigma_mm <= 0.5 * REFINEMENT * approach.fine_step_mm
    }

    /// The step from a clear place: fine among the likely places, longer above them.
    fn step_mm(&self, here: Position<Mm>, approach: &Approach) -> f64 {
        let way_mm = here.value() - self.likely().value();
        if way_mm < 2.0 * approach.fine_step_mm {
            approach.fine_step_mm
        } else {
            way_mm.min(approach.coarse_step_mm)
        }
    }

    /// Whether the probe is clear as far below the expected surface as the search began above it.
    fn is_missed(&self, here: Position<Mm>) -> bool {
        here.value() < 2.0 * self.surface.value() - self.start.value()
    }
}

/// The impedance of the clear probe, again.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Again {
    /// What the next reading changes may be a drift.
    is_doubtful: bool,
    /// The position to go to after the impedance has been read here.
    next: Option<Position<Mm>>,
    /// How often it may still be read.
    left: u32,
    /// It has been read, and nothing was read below yet.
    is_fresh: bool,
}

/// A search for the surface, without a clock and without devices.
#[derive(Debug, Clone, PartialEq)]
pub struct Search {
    approach: Approach,
    expected: Position<Mm>,
    baseline: Impedance,
    step_mm: f64,
    /// The lowest position of this pass without contact.
    last_clear: Option<Position<Mm>>,
    /// The position to go to after the backlash has been taken up.
    after_take_up: Option<Position<Mm>>,
    is_after_contact: bool,
    again: Again,
    /// Where the search began, if that is closer than for an unknown surface.
    near: Option<Near>,
    /// No contact has been felt yet.
    is_first_pass: bool,
    /// Steps in a row that have led no lower.
    stuck: u32,
    commanded: Position<Mm>,
    here: Position<Mm>,
    trail: Vec<(Position<Mm>, Reading)>,
}

impl Search {
    /// Begins a search. `baseline` is the impedance of the clear probe at the frequency that all
    /// readings of the search use.
    pub fn begin(
        approach: Approach,
        expected: Position<Mm>,
        baseline: Impedance,
    ) -> (Self, SearchStep) {
        let start = expected.offset(approach.start_above_mm);
        let search = Self {
            approach,
            expected,
            baseline,
            step_mm: approach.coarse_step_mm,
            last_clear: None,
            after_take_up: None,
            is_after_contact: false,
            again: Again { is_doubtful: false, next: None, left: ANEW_MAX, is_fresh: false },
            near: None,
            is_first_pass: true,
            stuck: 0,
            commanded: start,
            here: start,
            trail: Vec::new(),
        };
        (search, SearchStep::MoveTo(start))
    }

    /// Begins a search after a descent, which may have ended in the sample.
    pub(crate) fn begin_after_contact(
        approach: Approach,
        expected: Position<Mm>,
        baseline: Impedance,
        near: Option<Near>,
    ) -> (Self, SearchStep) {
        let (search, step) = match near {
            Some(near) => Self::begin_near(approach, expected, baseline, near),
            None => Self::begin(approach, expected, baseline),
        };
        (Self { is_after_contact: true, ..search }, step)
    }

    /// Begins a search just above the surface that the touches before predict.
    pub(crate) fn begin_near(
        approach: Approach,
        expected: Position<Mm>,
        baseline: Impedance,
        near: Near,
    ) -> (Self, SearchStep) {
        let (search, step) = Self::begin(approach, expected, baseline);
        if near.start >= search.commanded {
            return (search, step);
        }
        let first = if near.highest < search.commanded { near.highest } else { search.commanded };
        let first = if near.start < first { first } else { near.start };
        let after_take_up = (near.start < first).then_some(near.start);
        let near = Some(near);
        let search = Self { after_take_up, near, commanded: first, ..search };
        (search, SearchStep::MoveTo(first))
    }

    /// The lowest position that the search may ask for.
    pub fn floor(approach: &Approach, expected: Position<Mm>) -> Position<Mm> {
        expected.offset(-approach.give_up_below_mm)
    }

    /// The impedance of the clear probe.
    pub(crate) const fn baseline(&self) -> Impedance {
        self.baseline
    }

    /// Every position tried, with its reading.
    pub fn trail(&self) -> &[(Position<Mm>, Reading)] {
        &self.trail
    }

    /// The probe has moved; `read_back` is where it is.
    pub fn arrived(&mut self, read_back: Position<Mm>) -> SearchStep {
        self.here = read_back;
        match self.after_take_up.take() {
            Some(next) => self.go(next),
            None => {
                SearchStep::Read { is_after_contact: std::mem::take(&mut self.is_after_contact) }
            }
        }
    }

    /// Whether a reading shows a contact here, as far as it can be compared.
    pub(crate) fn seems_to_touch(&self, readings: &[Reading]) -> bool {
        readings.last().is_some_and(|last| match last.measured {
            PointResult::Value(now) => {
                self.approach.contact_threshold < relative_change(self.baseline, now)
            }
            _ => false,
        })
    }

    /// Whether what a reading changes has come over several steps, as by a drift. It may be one until the impedance of
    /// the clear probe has been read again.
    pub(crate) fn has_crept(&self, readings: &[Reading]) -> bool {
        let before = self.trail.last().filter(|(at, _)| self.last_clear == Some(*at));
        let before = before.map(|(_, reading)| reading.measured);
        let (Some(PointResult::Value(before)), Some(PointResult::Value(now))) =
            (before, readings.last().map(|last| last.measured))
        else {
            return false;
        };
        let limit = CREEP_PART * self.approach.contact_threshold;
        self.again.left == ANEW_MAX && relative_change(before, now) < limit
    }

    /// What the next reading changes may be a drift since the impedance of the clear probe was read.
    pub(crate) const fn doubt(&mut self) {
        self.again.is_doubtful = 0 < self.again.left;
    }

    /// Whether the next reading is that of the clear probe, again.
    pub(crate) const fn is_anew(&self) -> bool {
        self.again.next.is_some()
    }

    /// Goes up to read the impedance of the clear probe again, and then to the next position.
    fn read_anew(&mut self, at: Position<Mm>, next: Position<Mm>) -> SearchStep {
        (self.again.next, self.is_after_contact) = (Some(next), true);
        self.again.left -= 1;
        self.go(at)
    }

    /// The impedance of the probe above a place where it seemed to touch. It is that of the clear probe if the
    /// contact has gone, or if the way up has changed nothing, as it would in a contact.
    fn clear_anew(&mut self, impedance: Impedance, next: Position<Mm>) -> SearchStep {
        let below = self.trail.iter().rev().nth(1).map(|(_, reading)| reading.measured);
        let threshold = self.approach.contact_threshold;
        let is_same = |other: Impedance| relative_change(other, impedance) <= threshold;
        let is_below = matches!(below, Some(PointResult::Value(below)) if is_same(below));
        if self.last_clear.is_none() && !is_below && !is_same(self.baseline) {
            let change_percent = 100.0 * relative_change(self.baseline, impedance);
            let (at, expected) = (self.here, self.expected);
            return SearchStep::Fault(Fault::ContactTooEarly { at, expected, change_percent });
        }
        (self.baseline, self.last_clear, self.again.is_fresh) = (impedance, Some(self.here), true);
        self.go(next)
    }

    /// The impedance here has been read.
    pub fn read(&mut self, reading: Reading) -> SearchStep {
        self.trail.push((self.here, reading));
        let PointResult::Value(impedance) = reading.measured else { return SearchStep::Flagged };
        if let Some(next) = self.again.next.take() {
            return self.clear_anew(impedance, next);
        }
        let is_doubtful = std::mem::take(&mut self.again.is_doubtful);
        let is_fresh = std::mem::take(&mut self.again.is_fresh);
        let change = relative_change(self.baseline, impedance);
        // An impedance that cannot be compared counts as contact, so that the probe goes no
        // further.
        let is_clear = change <= self.approach.contact_threshold;
        match (!is_clear, self.last_clear) {
            (true, None) if self.near.take().is_some() => {
                (self.step_mm, self.is_after_contact) = (self.approach.coarse_step_mm, true);
                let start = self.expected.offset(self.approach.start_above_mm);
                if is_doubtful {
                    return self.read_anew(start, start.offset(-self.step_mm));
                }
                self.go(start)
            }
            (true, None) if is_doubtful => {
                self.read_anew(self.here.offset(self.approach.coarse_step_mm), self.here)
            }
            (true, None) => SearchStep::Fault(Fault::ContactTooEarly {
                at: self.here,
                expected: self.expected,
                change_percent: 100.0 * change,
            }),
            (true, Some(clear)) if is_doubtful => {
                if self.near.take().is_some() {
                    (self.is_first_pass, self.step_mm) = (false, self.approach.fine_step_mm);
                }
                self.read_anew(clear.offset(self.approach.coarse_step_mm), clear)
            }
            (true, Some(clear)) => self.bracketed(clear, is_fresh),
            (false, last) => {
                let is_stuck = last.is_some_and(|last| last <= self.here);
                self.stuck = if is_stuck { self.stuck + 1 } else { 0 };
                if STUCK_MAX < self.stuck {
                    return SearchStep::Fault(self.is_stuck());
                }
                self.last_clear = Some(self.here);
                let floor = Self::floor(&self.approach, self.expected);
                if self.commanded <= floor {
                    return SearchStep::Fault(Fault::NoContact {
                        at: self.here,
                        expected: self.expected,
                    });
                }
                self.near = self.near.filter(|near| !near.is_missed(self.here));
                let known = self.near.filter(|near| near.is_known_well(&self.approach));
                if let Some(near) = known {
                    self.step_mm = near.step_mm(self.here, &self.approach);
                } else if self.is_first_pass {
                    self.step_mm = self.approach.coarse_step_mm;
                }
                let next = self.here.offset(-self.step_mm);
                self.go(if next < floor { floor } else { next })
            }
        }
    }

    /// The surface lies between `clear` and here, which is a coarse step below if the impedance was read again there.
    fn bracketed(&mut self, clear: Position<Mm>, is_fresh: bool) -> SearchStep {
        if self.step_mm <= self.approach.fine_step_mm && !is_fresh {
            let width_mm = clear.value() - self.here.value();
            let position = clear.offset(-0.5 * width_mm);
            // A uniform error of this width.
            let sigma_mm = width_mm / 12.0_f64.sqrt();
            return SearchStep::Found(Surface { position, sigma_mm });
        }
        (self.near, self.is_first_pass) = (None, false);
        self.step_mm = (self.step_mm / REFINEMENT).max(self.approach.fine_step_mm);
        let (next, floor) =
            (clear.offset(-self.step_mm), Self::floor(&self.approach, self.expected));
        self.after_take_up = Some(if next < floor { floor } else { next });
        self.is_after_contact = true;
        // A position far enough above to take up the backlash, even if it is above the start.
        self.go(clear.offset(self.approach.coarse_step_mm))
    }

    /// The fault of a stage that goes no lower.
    fn is_stuck(&self) -> Fault {
        let detail = format!(
            "it was asked {} times in a row to go down by {} mm and stays at {}",
            self.stuck, self.step_mm, self.here
        );
        Fault::Device(Failure { device: Device::LinearStage, kind: FailureKind::Blocked, detail })
    }

    fn go(&mut self, to: Position<Mm>) -> SearchStep {
        self.commanded = to;
        SearchStep::MoveTo(to)
    }
}

/// Change of the impedance relative to the baseline.
pub(crate) fn relative_change(baseline: Impedance, now: Impedance) -> f64 {
    let change = Impedance {
        resistance_ohm: now.resistance_ohm - baseline.resistance_ohm,
        reactance_ohm: now.reactance_ohm - baseline.reactance_ohm,
    };
    change.magnitude_ohm() / baseline.magnitude_ohm()
}
