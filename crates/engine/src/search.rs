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

#[cfg(test)]
mod tests {
    use rig_model::RigTime;

    use super::*;

    const APPROACH: Approach = Approach {
        start_above_mm: 0.4,
        give_up_below_mm: 0.6,
        coarse_step_mm: 0.1,
        fine_step_mm: 0.005,
        contact_threshold: 0.1,
        settle_s: 0.1,
        cycles: 10,
        slip_mm: 0.05,
        descent_mm_per_s: None,
        slow_descent_mm_per_s: None,
    };

    fn impedance(resistance_ohm: f64) -> Impedance {
        Impedance { resistance_ohm, reactance_ohm: -1000.0 }
    }

    fn reading(resistance_ohm: f64) -> Reading {
        Reading {
            frequency_hz: 140.0,
            measured: PointResult::Value(impedance(resistance_ohm)),
            started: RigTime::ZERO,
            settle_s: 0.1,
            integration_s: 0.07,
        }
    }

    /// Plays a search against a surface; the stage stops `backlash_mm` short when it comes down
    /// directly after going up.
    fn search(surface_mm: f64, backlash_mm: f64) -> (SearchStep, usize) {
        let begun = Search::begin(APPROACH, Position::new(20.0), impedance(1000.0));
        play(begun, surface_mm, backlash_mm)
    }

    /// The same, begun this far above where the surface is expected from the touches before.
    fn search_near(surface_mm: f64, way_mm: f64, expected_mm: f64) -> (SearchStep, usize) {
        let near = near(expected_mm, way_mm);
        let begun = Search::begin_near(APPROACH, Position::new(20.0), impedance(1000.0), near);
        play(begun, surface_mm, 0.02)
    }

    fn near(expected_mm: f64, way_mm: f64) -> Near {
        let surface = Position::new(expected_mm);
        let sigma_mm = 0.25 * way_mm;
        Near { start: surface.offset(way_mm), surface, sigma_mm, highest: Position::new(20.4) }
    }

    fn play(
        (mut search, mut step): (Search, SearchStep),
        surface_mm: f64,
        backlash_mm: f64,
    ) -> (SearchStep, usize) {
        let (mut there, mut slack) = (f64::MAX, 0.0);
        for _ in 0..200 {
            step = match step {
                SearchStep::MoveTo(target) => {
                    assert!(Search::floor(&search.approach, search.expected) <= target, "{target}");
                    slack = if target.value() > there { backlash_mm } else { slack };
                    let moved_down = (there - target.value()).max(0.0);
                    slack = f64::max(0.0, slack - moved_down);
                    there = target.value();
                    search.arrived(target)
                }
                SearchStep::Read { .. } => {
                    let is_touching = there + slack <= surface_mm;
                    search.read(reading(if is_touching { 1500.0 } else { 1010.0 }))
                }
                end => return (end, search.trail.len()),
            };
        }
        panic!("the search did not end");
    }

    #[test]
    fn the_surface_is_bracketed_to_the_finest_step_wherever_it_is() {
        for tenth_of_micron in (-5900..3900).step_by(37) {
            let surface = 20.0 + f64::from(tenth_of_micron) * 1e-4;
            let (end, readings) = search(surface, 0.02);
            let SearchStep::Found(found) = end else { panic!("{surface}: {end:?}") };
            let error = found.position.value() - surface;
            assert!(error.abs() <= 0.0025 + 1e-9, "{surface}: {error}");
            assert!((found.sigma_mm - 0.005 / 12.0_f64.sqrt()).abs() < 1e-9);
            assert!(readings <= 32, "{surface}: {readings} readings");
        }
    }

    /// The floor is no multiple of the steps.
    #[test]
    fn a_surface_just_above_the_floor_is_found_and_nothing_goes_below() {
        let approach = Approach { give_up_below_mm: 0.6034, ..APPROACH };
        for tenth_of_micron in (-6033..-5900).step_by(3) {
            let surface = 20.0 + f64::from(tenth_of_micron) * 1e-4;
            let begun = Search::begin(approach, Position::new(20.0), impedance(1000.0));
            let (end, _) = play(begun, surface, 0.02);
            let SearchStep::Found(found) = end else { panic!("{surface}: {end:?}") };
            let error = found.position.value() - surface;
            assert!(error.abs() <= 0.0025 + 1e-9, "{surface}: {error}");
        }
    }

    #[test]
    fn a_search_close_above_the_surface_finds_it_wherever_it_is() {
        for (way_mm, most) in [(0.05, 14), (0.3, 26)] {
            for tenth_of_micron in (-5800..3900).step_by(37) {
                let surface = 20.0 + f64::from(tenth_of_micron) * 1e-4;
                for expected in [surface, 20.0] {
                    let (end, readings) = search_near(surface, way_mm, expected);
                    let SearchStep::Found(found) = end else { panic!("{surface}: {end:?}") };
                    let error = found.position.value() - surface;
                    assert!(error.abs() <= 0.0025 + 1e-9, "{surface}, {expected}: {error}");
                    let most = if expected == surface { most } else { 60 };
                    assert!(readings <= most, "{surface}, {expected}: {readings} readings");
                }
            }
        }
    }

    #[test]
    fn a_change_that_comes_over_several_steps_is_doubted_once() {
        for (step_ohm, has_crept) in [(21.0, true), (120.0, false)] {
            let (mut search, _) = Search::begin(APPROACH, Position::new(20.0), impedance(1000.0));
            let mut next = Position::new(20.4);
            for step in 0..10 {
                search.arrived(next);
                let now = reading(1000.0 + step_ohm * f64::from(step));
                if search.seems_to_touch(&[now]) {
                    assert_eq!(search.has_crept(&[now]), has_crept, "{step_ohm} ohm a step");
                    search.doubt();
                }
                let SearchStep::MoveTo(to) = search.read(now) else { panic!("{step_ohm}") };
                if search.is_anew() {
                    assert!(search.here < to, "{to}");
                    search.arrived(to);
                    search.read(now);
                    assert!(!search.has_crept(&[now]), "a second time");
                    break;
                }
                next = to;
            }
            assert!(search.again.left < ANEW_MAX, "{step_ohm} ohm a step: no doubt");
        }
    }

    #[test]
    fn a_search_that_begins_in_contact_goes_up_at_once_and_begins_where_no_surface_can_be() {
        let near = near(19.9, 0.05);
        let (mut search, step) =
            Search::begin_near(APPROACH, Position::new(20.0), impedance(1000.0), near);
        assert_eq!(step, SearchStep::MoveTo(near.highest));
        assert_eq!(search.arrived(near.highest), SearchStep::MoveTo(near.start));
        assert_eq!(search.arrived(near.start), SearchStep::Read { is_after_contact: false });
        let up = Position::new(20.4);
        assert_eq!(search.read(reading(1500.0)), SearchStep::MoveTo(up));
        assert_eq!(search.arrived(up), SearchStep::Read { is_after_contact: true });
        // A contact there too does not show a surface.
        let end = search.read(reading(1500.0));
        assert!(matches!(end, SearchStep::Fault(Fault::ContactTooEarly { .. })), "{end:?}");
    }

    #[test]
    fn a_reading_that_is_flagged_or_cannot_be_compared_never_lets_the_probe_go_on() {
        let begin = |baseline| {
            let (mut search, _) = Search::begin(APPROACH, Position::new(20.0), baseline);
            search.arrived(Position::new(20.4));
            search
        };
        let mut search = begin(impedance(1000.0));
        for measured in [PointResult::Overload, PointResult::LowSignal(impedance(1000.0))] {
            let flagged = Reading { measured, ..reading(1000.0) };
            assert_eq!(search.read(flagged), SearchStep::Flagged);
        }
        assert!(matches!(search.read(reading(1000.0)), SearchStep::MoveTo(_)));
        assert_eq!(search.trail().len(), 3);
        let nothing = Impedance { resistance_ohm: 0.0, reactance_ohm: 0.0 };
        let shorted = Reading { measured: PointResult::Value(nothing), ..reading(1000.0) };
        let step = begin(nothing).read(shorted);
        assert!(matches!(step, SearchStep::Fault(Fault::ContactTooEarly { .. })), "{step:?}");
    }

    /// Its steps are as short as its accuracy, so that its drive says each time that it has arrived.
    #[test]
    fn a_stage_that_goes_no_lower_ends_the_search() {
        let (mut search, mut step) =
            Search::begin(APPROACH, Position::new(20.0), impedance(1000.0));
        for _ in 0..5 {
            assert!(matches!(step, SearchStep::MoveTo(_)), "{step:?}");
            search.arrived(Position::new(20.4));
            step = search.read(reading(1010.0));
        }
        let SearchStep::Fault(fault) = step else { panic!("{step:?}") };
        assert_eq!(
            fault.to_string(),
            "linear stage: it was asked 4 times in a row to go down by 0.1 mm and stays at 20.400 mm"
        );
    }

    #[test]
    fn a_surface_beyond_the_range_is_a_fault_and_the_depth_stays_limited() {
        let (end, _) = search(20.41, 0.0);
        assert!(matches!(end, SearchStep::Fault(Fault::ContactTooEarly { .. })), "{end:?}");
        let (end, _) = search(19.39, 0.0);
        let SearchStep::Fault(fault) = end else { panic!("{end:?}") };
        assert_eq!(
            fault.to_string(),
            "no contact down to 19.400 mm; the surface was expected at 20.000 mm"
        );
    }
}
