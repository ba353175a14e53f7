//! Whether a rig can find surfaces by a continuous descent, and how fast.
//!
//! Between the surface and the reading that shows the contact lie two readings at the most with a stiff sample,
//! and then the way of the stop. A descent presses no deeper in that time than a coarse step of the search does.

use rig_files::Faults;
use rig_model::RigLimits;

use crate::{
    Protocol,
    fault::ProtocolFault,
    protocol::{ApproachKeys, ApproachMethod},
};

/// Longest time from the answer of a reading to the rest of the stage, s: a reading of the drive that is under way
/// on the bus, the frame of the stop, its execution, and the deceleration.
const STOP_S: f64 = 0.03;

/// Readings between the surface and the stop.
const READINGS: f64 = 2.0;

/// A slower descent takes longer than the search in steps, mm/s.
const LEAST_MM_PER_S: f64 = 0.2;

/// Checks that need no rig.
pub(crate) fn by_itself(protocol: &Protocol, faults: &mut Faults) {
    let ApproachKeys { method, speed_mm_per_s, slow_speed_mm_per_s, .. } = &protocol.approach;
    if let (Some(slow), Some(&repeats)) = (slow_speed_mm_per_s, protocol.repeats.sound())
        && repeats < 2
    {
        faults.refuse(slow, &ProtocolFault::SlowNeedsRepeats { repeats });
    }
    if method.sound() != Some(&ApproachMethod::Stepped) {
        return;
    }
    let speeds = [("speed_mm_per_s", speed_mm_per_s), ("slow_speed_mm_per_s", slow_speed_mm_per_s)];
    for (key, speed) in speeds {
        if let Some(speed) = speed {
            faults.refuse(speed, &ProtocolFault::OnlyDescent { key });
        }
    }
}

/// Checks against the limits of a rig.
pub(crate) fn check(protocol: &Protocol, limits: &RigLimits, faults: &mut Faults) {
    let ApproachKeys { method, speed_mm_per_s, slow_speed_mm_per_s, coarse_step_mm, .. } =
        &protocol.approach;
    let (Some(ApproachMethod::Descent), Some(&coarse)) = (method.sound(), coarse_step_mm.sound())
    else {
        return;
    };
    if let Some(halfway_mm) = &protocol.touch.halfway_mm {
        halfway_mm.check(faults, |&halfway| {
            (halfway < coarse).then_some(ProtocolFault::HalfwayAboveStop { halfway, coarse })
        });
    }
    let Some(reading_s) = protocol.reading_s(limits) else {
        return faults.refuse(method, &ProtocolFault::NoStream);
    };
    let (limit, reading_ms) = (fastest(coarse, reading_s), 1e3 * reading_s);
    if limit < LEAST_MM_PER_S {
        let least = LEAST_MM_PER_S;
        let fault = ProtocolFault::StreamTooSlow { limit, reading_ms, coarse, least };
        return faults.refuse(method, &fault);
    }
    let slowest = limits.motion.slowest_mm_per_s;
    if let (Some(slow), Some(limit)) = (slow_speed_mm_per_s, protocol.descent_mm_per_s(limits)) {
        slow.check(faults, |&found| {
            if found < slowest {
                let key = "slow_speed_mm_per_s";
                return Some(ProtocolFault::DescentTooSlow { key, found, limit: slowest });
            }
            (found >= limit).then_some(ProtocolFault::SlowNotSlower { found, limit })
        });
    }
    let Some(speed) = speed_mm_per_s else { return };
    speed.check(faults, |&found| {
        let contact = limits.motion.contact_speed_mm_per_s;
        if found > contact {
            return Some(ProtocolFault::DescentAboveContactSpeed { found, limit: contact });
        }
        if found < slowest {
            let key = "speed_mm_per_s";
            return Some(ProtocolFault::DescentTooSlow { key, found, limit: slowest });
        }
        let fault = ProtocolFault::DescentTooFast { found, limit, reading_ms, coarse };
        (found > limit).then_some(fault)
    });
}

/// The fastest descent that presses no deeper than the coarse step, mm/s. A reading takes this long, s.
fn fastest(coarse_mm: f64, reading_s: f64) -> f64 {
    coarse_mm / (READINGS * reading_s + STOP_S)
}

/// The speed of a descent that was to go down at `planned_mm_per_s`, with readings that take as long as those that the
/// analyzer has made, mm/s; `None` if the search in steps is as fast.
pub fn descent_speed(planned_mm_per_s: f64, coarse_mm: f64, reading_s: f64) -> Option<f64> {
    let speed_mm_per_s = planned_mm_per_s.min(fastest(coarse_mm, reading_s));
    (LEAST_MM_PER_S.min(planned_mm_per_s) <= speed_mm_per_s).then_some(speed_mm_per_s)
}

impl Protocol {
    /// The longest time of a reading of a stream, s; `None` if the analyzer gives none.
    fn reading_s(&self, limits: &RigLimits) -> Option<f64> {
        let lowest_hz = self.no_load_sweep.sweep.request.window.min_hz;
        let integration_s = f64::from(self.approach.cycles) / lowest_hz;
        limits.analyzer.stream.overhead_s.map(|overhead_s| integration_s + overhead_s)
    }

    /// The speed of the descent, if the protocol asks for one: as it says, or as fast as the rig may.
    pub(crate) fn descent_mm_per_s(&self, limits: &RigLimits) -> Option<f64> {
        let ApproachKeys { method, speed_mm_per_s, coarse_step_mm, .. } = &self.approach;
        if method.value == ApproachMethod::Stepped {
            return None;
        }
        let fastest = fastest(coarse_step_mm.value, self.reading_s(limits)?);
        let asked = speed_mm_per_s.as_ref().map(|speed| speed.value);
        Some(asked.unwrap_or_else(|| fastest.min(limits.motion.contact_speed_mm_per_s)))
    }
}
