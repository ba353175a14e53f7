//! Where the axes were: every move from record to record, and the rules of safe motion.
//!
//! ```text
//!             intent                     moved to the clear position or above, read back there
//!   ┌───────┐ ─────▶ ┌─────────┐ ─────────────────────────────┐
//!   │ Clear │        │ Lowered │                              ▼
//!   └───────┘        └─────────┘ ── fault, homing ──▶ Unknown ─▶ Clear
//!       ▲                 │
//!       └─────────────────┘ moved up, above everything that the sample reaches in its next turn
//! ```

mod descent;

use crate::{
    finding::{Check, Findings},
    record::{Axis, Intent, Moved},
    settings::{Rig, Settings},
};

/// Rounding of positions in records, mm or degrees.
pub(crate) const ROUNDING: f64 = 1e-6;
/// A tilt is read back within its tolerance, which moves the expected surface by less, mm.
const TILT_MM: f64 = 0.02;
/// Part by which the mean speed of a move may exceed its limit: clocks differ a little.
const SPEED_SLACK: f64 = 0.05;

/// Knowledge of the probe.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Probe {
    /// Shown clear by a read-back.
    Clear,
    /// Lowered, or about to be.
    Lowered,
    /// Not known.
    Unknown,
}

impl Probe {
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Clear => "clear",
            Self::Lowered => "lowered",
            Self::Unknown => "unknown",
        }
    }
}

/// What allows the rotary stage to move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Turn {
    /// By hand, between runs.
    Free,
    /// To this angle, degrees.
    To(f64),
    /// Not at all.
    Forbidden,
}

/// A descent that was declared.
#[derive(Debug, Clone, Default)]
pub(crate) struct Descent {
    /// The purpose: `approach`, `indent` or `by_hand`.
    pub(crate) what: String,
    /// The lowest position, mm.
    pub(crate) floor_mm: f64,
    /// The lowest read-back so far, mm.
    lowest_mm: Option<f64>,
    /// Every move, with the time of its record, µs.
    pub(crate) moves: Vec<(u64, f64)>,
    /// The probe went down with a stream of readings.
    pub(super) has_gone_down: bool,
    /// The end of the second move, if it is longer than a step of a search, as the way to a surface that is
    /// known from others may be. No reading comes before it. µs.
    pub(crate) way_down_us: Option<u64>,
}

/// The axes.
#[derive(Debug)]
pub(crate) struct Motion {
    pub(crate) probe: Probe,
    pub(crate) linear_mm: Option<f64>,
    pub(crate) rotary_deg: Option<f64>,
    pub(crate) descent: Option<Descent>,
    pub(crate) turn: Turn,
    /// The record of a fault that has not been acknowledged.
    pub(crate) fault: Option<u64>,
    /// Where the axes were when their positions were lost: a move that was under way began there.
    was_at: (Option<f64>, Option<f64>),
    /// Whether a move that was under way at the fault may still end.
    may_end: bool,
    /// Whether a person works at the bench.
    pub(crate) is_waiting: bool,
    /// Time of the last move, µs.
    pub(crate) moved_us: u64,
    /// Time of the last record that is written between two moves, µs.
    last_us: u64,
    /// The lowest surface of the run so far, mm above where the rig file expects it.
    pub(crate) lowest_surface_mm: Option<f64>,
}

impl Descent {
    fn follow(&mut self, rig_us: u64, read_back: f64) {
        self.lowest_mm = Some(self.lowest_mm.unwrap_or(f64::INFINITY).min(read_back));
        self.moves.push((rig_us, read_back));
    }
}

impl Motion {
    /// Before anything is known.
    pub(crate) const fn new() -> Self {
        Self {
            probe: Probe::Unknown,
            linear_mm: None,
            rotary_deg: None,
            descent: None,
            turn: Turn::Free,
            fault: None,
            was_at: (None, None),
            may_end: false,
            is_waiting: false,
            moved_us: 0,
            last_us: 0,
            lowest_surface_mm: None,
        }
    }

    /// A record that is written between two moves has been walked.
    pub(crate) const fn pass(&mut self, rig_us: u64) {
        self.last_us = rig_us;
    }

    /// A surface was found at this position, mm.
    pub(crate) fn found_surface(&mut self, at_mm: f64, settings: Option<&Settings>) {
        let Some((settings, tilt)) = settings.zip(self.rotary_deg) else { return };
        let above_mm = at_mm - settings.rig.surface_mm(tilt);
        self.lowest_surface_mm =
            Some(self.lowest_surface_mm.map_or(above_mm, |lowest| lowest.min(above_mm)));
    }

    /// The axes may have moved without a record.
    pub(crate) fn lose_positions(&mut self) {
        if self.linear_mm.is_some() {
            self.was_at = (self.linear_mm, self.rotary_deg);
        }
        (self.linear_mm, self.rotary_deg) = (None, None);
    }

    /// The rig is prepared again: nothing is known until a read-back.
    pub(crate) fn prepare(&mut self) {
        self.lose_positions();
        (self.probe, self.fault, self.descent) = (Probe::Unknown, None, None);
        (self.is_waiting, self.may_end, self.was_at) = (false, false, (None, None));
    }

    pub(crate) fn fault(&mut self, seq: u64, probe: &str, findings: &mut Findings) {
        if probe == "clear" && self.probe != Probe::Clear {
            let what = "a fault says that the probe was clear, and no read-back shows it";
            findings.add(Check::FalseClear, seq, what, self.probe.name(), probe);
        }
        if probe != "clear" && self.probe == Probe::Clear {
            self.probe = Probe::Unknown;
        }
        self.may_end |= self.fault.is_none();
        self.fault = self.fault.or(Some(seq));
        self.lose_positions();
    }

    /// The rig has changed its state.
    pub(crate) fn changed(&mut self, state: &str) {
        if state == "retracting" {
            self.lose_positions();
            self.is_waiting = false;
        }
    }

    /// A latched rig has tried to retract. A move that failed has left no position.
    pub(crate) fn tried(&mut self, seq: u64, probe: &str, findings: &mut Findings) {
        if (probe == "clear") != (self.probe == Probe::Clear) {
            let what = "the state of the probe after an attempt to retract";
            findings.add(Check::FalseClear, seq, what, self.probe.name(), probe);
        }
        self.lose_positions();
    }

    pub(crate) fn intent(
        &mut self,
        seq: u64,
        intent: &Intent,
        settings: Option<&Settings>,
        findings: &mut Findings,
    ) {
        let Intent { what, axis, from, to, limit } = intent;
        let floor_mm = limit.unwrap_or(*to);
        if *axis != Axis::LinearMm {
            let what = "an intent of an axis that does not lower the probe";
            findings.add(Check::Intent, seq, what, "the linear axis", "the rotary axis");
            return;
        }
        if let (Some(from), Some(at)) = (from, self.linear_mm) {
            findings.agree(
                Check::Intent,
                seq,
                "the position before the descent, mm",
                (at, *from),
                ROUNDING,
            );
        }
        if *to < floor_mm {
            findings.add(
                Check::Intent,
                seq,
                "the target lies below its own limit, mm",
                floor_mm,
                to,
            );
        }
        let is_allowed = match what.as_str() {
            "approach" => self.probe == Probe::Clear,
            "indent" => {
                self.probe == Probe::Lowered
                    && self.descent.as_ref().is_some_and(|descent| descent.what == "approach")
            }
            "by_hand" => self.probe != Probe::Unknown,
            _ => false,
        };
        if !is_allowed {
            let found = format!("{what} with the probe {}", self.probe.name());
            let expected =
                "approach when clear, indent after approach, by_hand from a known position";
            findings.add(Check::Intent, seq, "a descent is declared out of order", expected, found);
        }
        self.may_end = false;
        self.stays_put(seq, "a descent is declared", findings);
        if let (Some(settings), Some(tilt)) = (settings, self.rotary_deg) {
            let tilt = if let Turn::To(tilt) = self.turn { tilt } else { tilt };
            declared_depth(seq, what, floor_mm, tilt, settings, findings);
        }
        self.probe = Probe::Lowered;
        self.descent = Some(Descent { what: what.clone(), floor_mm, ..Descent::default() });
    }

    /// Nothing but a retract follows a fault, except for the end of the move that was under way, and
    /// nothing moves while a person works at the bench.
    fn stays_put(&self, seq: u64, what: &str, findings: &mut Findings) {
        if let Some(fault) = self.fault.filter(|_| !self.may_end) {
            let found = format!("{what} after the fault of record {fault}");
            findings.add(Check::Stopped, seq, "only a retract follows a fault", "no motion", found);
        }
        if self.is_waiting {
            let why = "a person works at the bench";
            findings.add(Check::Stopped, seq, why, "no motion before the answer", what);
        }
    }

    pub(crate) fn moved(
        &mut self,
        seq: u64,
        rig_us: u64,
        moved: &Moved,
        rig: Option<&Settings>,
        findings: &mut Findings,
    ) {
        match moved.axis {
            Axis::LinearMm => self.moved_linear(seq, rig_us, moved, rig, findings),
            Axis::RotaryDeg => {
                self.moved_rotary(seq, rig_us, moved, rig.map(|all| &all.rig), findings);
            }
        }
        (self.moved_us, self.may_end, self.was_at) = (rig_us, false, (None, None));
    }

    fn moved_linear(
        &mut self,
        seq: u64,
        rig_us: u64,
        moved: &Moved,
        settings: Option<&Settings>,
        findings: &mut Findings,
    ) {
        let &Moved { target, read_back, is_clear, .. } = moved;
        let before = self.linear_mm.replace(read_back);
        let Some(settings) = settings else {
            // Without the rig file only the word of the record is known. A descent of another run ends with it.
            self.probe = if is_clear { Probe::Clear } else { Probe::Lowered };
            self.descent = self.descent.take().filter(|_| !is_clear);
            return;
        };
        let Rig { linear, limits, .. } = &settings.rig;
        within(
            seq,
            "the linear stage, mm",
            moved,
            linear.soft_limits_mm,
            linear.tolerance_mm,
            findings,
        );
        let is_there = (read_back - target).abs() <= linear.tolerance_mm + ROUNDING;
        // Before 2026-11-25 a read-back above the clear position was not said to show the probe clear.
        let is_retract =
            (target - linear.clear_mm).abs() <= ROUNDING || is_clear && linear.clear_mm <= target;
        let limit = if is_retract {
            limits.travel_speed_mm_per_s
        } else {
            self.speed_limit(target, before, settings)
        };
        let distance = before.map(|before| (read_back - before).abs() - 2.0 * linear.tolerance_mm);
        self.speed(seq, rig_us, distance, limit, findings);
        let is_low_retract = !is_retract && self.is_low_retract(moved, before, settings);
        if is_clear && !((is_retract || is_low_retract) && is_there) {
            let what = "a read-back elsewhere is said to show the probe clear, mm";
            let expected = linear.clear_mm;
            let tolerance = Some(linear.tolerance_mm.to_string());
            findings.within(Check::FalseClear, seq, what, expected, read_back, tolerance);
        }
        if is_retract {
            self.probe = if is_clear && is_there { Probe::Clear } else { Probe::Unknown };
            self.descent = None;
            return;
        }
        if !is_there {
            let tolerance = Some(linear.tolerance_mm.to_string());
            let what = "the linear stage is not at its target, mm";
            findings.within(Check::AtTarget, seq, what, target, read_back, tolerance);
        }
        self.stays_put(seq, "the linear stage moved", findings);
        if target < linear.clear_mm {
            self.descended(seq, rig_us, moved, settings, findings);
        }
        self.probe = Probe::Lowered;
        if is_low_retract && is_there {
            (self.probe, self.descent) = (Probe::Clear, None);
        }
    }

    /// The largest speed of a move that is no retract, mm/s: that of travel upwards, on the first way of an approach, and
    /// on the way down to the first search of a run, which is made in steps.
    fn speed_limit(&self, target: f64, before: Option<f64>, settings: &Settings) -> f64 {
        let limits = &settings.rig.limits;
        let approach = self.descent.as_ref().filter(|descent| descent.what == "approach");
        let is_first = approach.is_some_and(|descent| descent.moves.is_empty());
        let is_up = before.is_some_and(|before| target > before);
        let begin_mm = self.search_begins_mm(settings).filter(|_| approach.is_some());
        if is_first || is_up || begin_mm.is_some_and(|begin| begin <= target) {
            limits.travel_speed_mm_per_s
        } else {
            limits.contact_speed_mm_per_s
        }
    }

    /// Whether a move leads up to where the probe is clear at this tilt, below the position of rest.
    fn is_low_retract(&self, moved: &Moved, before: Option<f64>, settings: &Settings) -> bool {
        let &Moved { target, is_clear, .. } = moved;
        let may_end = self.fault.is_none() || self.may_end;
        let (was_at, was_tilted) = if may_end { self.was_at } else { (None, None) };
        let (from, tilt) = (before.or(was_at), self.rotary_deg.or(was_tilted));
        let is_up = from.is_some_and(|from| target > from);
        let is_known = is_clear && self.probe == Probe::Lowered;
        tilt.filter(|_| is_known && is_up)
            .is_some_and(|tilt| settings.rig.clear_mm(tilt) - ROUNDING <= target)
    }

    /// Where a search begins if nothing is known of the surface, at the last read tilt. A descent begins above the
    /// highest surface.
    fn search_begins_mm(&self, settings: &Settings) -> Option<f64> {
        let Settings { rig, protocol } = settings;
        let is_before_descent = protocol.approach.is_by_descent()
            && self.descent.as_ref().is_some_and(|descent| !descent.has_gone_down);
        let above_mm = protocol.approach.start_above_mm.map(|above| {
            if is_before_descent { above.min(rig.surface_tolerance_mm()) } else { above }
        });
        // A step of the way may still end after a stop.
        let tilt = self.rotary_deg.or(self.was_at.1);
        let begin = tilt.zip(above_mm);
        begin.map(|(tilt, above)| rig.surface_mm(tilt) + above - TILT_MM)
    }

    /// A move below the clear position.
    fn descended(
        &mut self,
        seq: u64,
        rig_us: u64,
        &Moved { target, read_back, .. }: &Moved,
        settings: &Settings,
        findings: &mut Findings,
    ) {
        let tolerance = settings.rig.linear.tolerance_mm;
        let begin_mm = self.search_begins_mm(settings);
        let Some(descent) = self.descent.as_mut().filter(|_| self.probe != Probe::Unknown) else {
            let what = "the probe was lowered without an intent, mm";
            findings.add(Check::Intent, seq, what, "an intent before it", target);
            return;
        };
        let floor = descent.floor_mm;
        if target < floor - ROUNDING || read_back < floor - tolerance - ROUNDING {
            let what = format!("the probe went deeper than declared for {}, mm", descent.what);
            let found = target.min(read_back);
            findings.within(Check::Depth, seq, what, floor, found, Some(tolerance.to_string()));
        }
        if descent.what == "approach" {
            let step = settings.protocol.approach.coarse_step_mm;
            let known = self.lowest_surface_mm.zip(self.rotary_deg);
            let start_mm = known.map(|(above, tilt)| settings.rig.surface_mm(tilt) + above - step);
            let is_way_down = descent.moves.len() == 1 && start_mm.is_some_and(|mm| mm <= target);
            // A search in steps after a descent begins where no surface is expected, as any other does.
            let is_below = begin_mm.is_none_or(|begin| target < begin);
            let lowest = descent.lowest_mm.filter(|low| target < low - step - ROUNDING);
            if let Some(lowest) = lowest.filter(|_| is_below) {
                if is_way_down {
                    descent.way_down_us = Some(rig_us);
                    descent.follow(rig_us, read_back);
                    return;
                }
                let what = "a step of the search, mm";
                let found = lowest - target;
                findings.within(Check::SearchStep, seq, what, step, found, Some(step.to_string()));
            }
        }
        descent.follow(rig_us, read_back);
    }

    fn moved_rotary(
        &mut self,
        seq: u64,
        rig_us: u64,
        moved: &Moved,
        rig: Option<&Rig>,
        findings: &mut Findings,
    ) {
        let &Moved { target, read_back, is_clear, .. } = moved;
        let before = self.rotary_deg.replace(read_back);
        if self.probe != Probe::Clear {
            let what = "the rotary stage moved while the probe was not shown clear";
            findings.add(Check::TurnedClear, seq, what, "clear", self.probe.name());
        }
        let lowest = rig.map(|rig| {
            let clear = before.map_or(rig.linear.clear_mm, |before| rig.turn_mm(before, target));
            clear - rig.linear.tolerance_mm - ROUNDING
        });
        if let Some((lowest, at)) = lowest.zip(self.linear_mm).filter(|(lowest, at)| at < lowest) {
            let what = "the sample turned below a probe that its edge may reach, mm";
            findings.within(Check::TurnedClear, seq, what, lowest, at, None);
        }
        if is_clear {
            let what = "a move of the rotary stage shows nothing of the probe";
            findings.add(Check::FalseClear, seq, what, "no word", "clear");
        }
        self.stays_put(seq, "the rotary stage moved", findings);
        match self.turn {
            Turn::To(angle) => {
                findings.agree(
                    Check::Pose,
                    seq,
                    "the tilt of the step, °",
                    (angle, target),
                    ROUNDING,
                );
            }
            Turn::Forbidden => {
                findings.add(Check::Pose, seq, "this step turns nothing", "no move", target);
            }
            Turn::Free => {}
        }
        let Some(Rig { rotary, limits, .. }) = rig else { return };
        let tolerance = rotary.tolerance_deg;
        within(seq, "the rotary stage, °", moved, rotary.soft_limits_deg, tolerance, findings);
        let what = "the rotary stage is not at its target, °";
        findings.agree(Check::AtTarget, seq, what, (target, read_back), tolerance + ROUNDING);
        let distance = before.map(|before| (read_back - before).abs() - 2.0 * tolerance);
        self.speed(seq, rig_us, distance, limits.rotary_speed_deg_per_s, findings);
    }

    /// The mean speed of a move, which began after the last record that is written between moves.
    fn speed(
        &self,
        seq: u64,
        rig_us: u64,
        distance: Option<f64>,
        limit: f64,
        findings: &mut Findings,
    ) {
        let seconds = rig_us.saturating_sub(self.last_us) as f64 / 1e6;
        let Some(distance) = distance.filter(|way| *way > limit * (1.0 + SPEED_SLACK) * seconds)
        else {
            return;
        };
        let expected = format!("{distance:.6} in at least {:.3} s", distance / limit);
        let found = format!("{seconds:.3} s");
        let limit = Some(format!("{limit} per second"));
        findings.within(Check::Speed, seq, "a move was too fast", expected, found, limit);
    }
}

/// The declared depth against geometry and limits.
fn declared_depth(
    seq: u64,
    what: &str,
    floor_mm: f64,
    tilt_deg: f64,
    settings: &Settings,
    findings: &mut Findings,
) {
    let Settings { rig, protocol } = settings;
    let lowest = match what {
        "approach" => {
            let asked = rig.surface_mm(tilt_deg) - protocol.approach.give_up_below_mm;
            asked.max(rig.floor_mm(tilt_deg))
        }
        _ => rig.floor_mm(tilt_deg),
    };
    if floor_mm < lowest - ROUNDING {
        let what = format!("deeper than any {what} may go at {tilt_deg}°, mm");
        findings.within(Check::Depth, seq, what, lowest, floor_mm, Some(lowest.to_string()));
    }
}

fn within(
    seq: u64,
    name: &str,
    &Moved { target, read_back, .. }: &Moved,
    [min, max]: [f64; 2],
    tolerance: f64,
    findings: &mut Findings,
) {
    let limits = Some(format!("[{min}, {max}]"));
    if !(min..=max).contains(&target) {
        let what = format!("a target beyond the soft limits of {name}");
        findings.within(Check::Limits, seq, what, "within", target, limits);
    } else if !(min - tolerance..=max + tolerance).contains(&read_back) {
        let what = format!("a read-back beyond the soft limits of {name}");
        findings.within(Check::Limits, seq, what, "within", read_back, limits);
    }
}
