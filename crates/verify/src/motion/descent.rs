//! The motion of a descent with a stream of readings.

use super::{Axis, Check, Findings, Motion, Moved, Probe, ROUNDING};
use crate::{record::Descended, settings::Settings};

/// Positions on the way are read between two others by the clock; a read takes some milliseconds.
const READ_S: f64 = 0.02;
/// Part by which the speed between two positions may deviate from that of the descent.
const SPEED_PART: f64 = 0.1;

impl Motion {
    /// The probe went down evenly, to its target or to where it was stopped.
    pub(crate) fn went_down(
        &mut self,
        seq: u64,
        rig_us: u64,
        descended: &Descended,
        settings: Option<&Settings>,
        findings: &mut Findings,
    ) {
        let Descended { ref step, target_mm, read_back_mm, speed_mm_per_s, .. } = *descended;
        let before = self.linear_mm;
        let Some(settings) = settings else {
            let (target, read_back, is_clear) = (target_mm, read_back_mm, false);
            let moved = Moved { axis: Axis::LinearMm, target, read_back, is_clear };
            return self.moved(seq, rig_us, &moved, None, findings);
        };
        let tolerance = settings.rig.linear.tolerance_mm;
        let limit = settings.rig.limits.contact_speed_mm_per_s;
        let asked = settings.protocol.approach.speed_of(step);
        if speed_mm_per_s > limit * (1.0 + ROUNDING) {
            let what = "the speed of a descent, mm/s";
            let most = Some(limit.to_string());
            findings.within(Check::Speed, seq, what, "at most", speed_mm_per_s, most);
        }
        if let Some(asked) = asked.filter(|asked| asked + ROUNDING < speed_mm_per_s) {
            let what = "the speed of a descent that the protocol asks for, mm/s";
            findings.within(Check::Speed, seq, what, asked, speed_mm_per_s, None);
        }
        // Two readings, and whatever else takes time, between a contact and the stop.
        let longest_s = descended.readings.iter().map(|one| one.integration_s).fold(0.0, f64::max);
        let most = settings.protocol.approach.coarse_step_mm / (2.0 * longest_s);
        if most * (1.0 + ROUNDING) < speed_mm_per_s {
            let what = "the speed of a descent that presses by a coarse step in two readings, mm/s";
            findings.within(Check::Speed, seq, what, most, speed_mm_per_s, None);
        }
        if !settings.protocol.approach.is_by_descent() {
            let what = "a descent that the protocol does not ask for";
            findings.add(Check::Intent, seq, what, "a search in steps", "a descent");
        }
        self.stays_put(seq, "the probe went down", findings);
        let is_lowered = self.probe == Probe::Lowered;
        let declared = self.descent.as_mut().filter(|one| is_lowered && one.what == "approach");
        if let Some(declared) = declared {
            let floor = declared.floor_mm;
            if target_mm < floor - ROUNDING || read_back_mm < floor - tolerance - ROUNDING {
                let what = "the descent went deeper than declared, mm";
                let found = target_mm.min(read_back_mm);
                findings.within(Check::Depth, seq, what, floor, found, Some(tolerance.to_string()));
            }
            declared.follow(rig_us, read_back_mm);
            declared.has_gone_down = true;
        } else {
            let what = "a descent without an intent to find a surface, mm";
            findings.add(Check::Intent, seq, what, "an intent before it", target_mm);
        }
        if read_back_mm < target_mm - tolerance - ROUNDING {
            let what = "a descent went beyond its target, mm";
            findings.within(Check::AtTarget, seq, what, target_mm, read_back_mm, None);
        }
        self.check_way(seq, rig_us, descended, before, tolerance, findings);
        self.linear_mm = Some(read_back_mm);
        (self.moved_us, self.may_end, self.was_at) = (rig_us, false, (None, None));
    }

    /// The positions on the way lie between both ends, in order, and no two of them were passed faster than the
    /// descent was.
    fn check_way(
        &self,
        seq: u64,
        rig_us: u64,
        descended: &Descended,
        before: Option<f64>,
        tolerance: f64,
        findings: &mut Findings,
    ) {
        let (begin_s, end_s) = (self.last_us as f64 / 1e6, rig_us as f64 / 1e6);
        let mut last = (begin_s, before.unwrap_or(f64::INFINITY));
        for point in &descended.way {
            let (at_s, at_mm) = (point.at_s, point.position_mm);
            let most_mm = descended.speed_mm_per_s * (1.0 + SPEED_PART) * (at_s - last.0 + READ_S);
            let is_in_order = last.0 <= at_s && at_s <= end_s;
            let is_on_way = descended.read_back_mm - tolerance <= at_mm
                && at_mm <= last.1 + tolerance
                && (last.1.is_infinite() || last.1 - at_mm <= most_mm + 2.0 * tolerance);
            if !(is_in_order && is_on_way) {
                let what = "a position on the way of a descent, mm";
                let expected = format!("up to {most_mm:.4} below {} at {:.3} s", last.1, last.0);
                findings.add(Check::Speed, seq, what, expected, format!("{at_mm} at {at_s:.3} s"));
            }
            last = (at_s, at_mm);
        }
    }
}
