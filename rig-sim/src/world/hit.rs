//! How fast the probe goes into a sample.

use rig_model::RigTime;

use super::World;

impl World {
    /// The highest speed downwards of the linear stage at which the probe has gone into a sample, mm/s; 0 if it has not.
    pub fn fastest_hit_mm_per_s(&mut self, now: RigTime) -> f64 {
        self.watch(now);
        self.hit_mm_per_s
    }

    /// The probe went into the sample between these times.
    pub(super) fn hit(&mut self, clear_at: RigTime, at: RigTime) {
        const CLOSE_US: u64 = 100;
        let (mut before, mut after) = (clear_at.as_micros(), at.as_micros());
        while CLOSE_US < after.saturating_sub(before) {
            let middle = before.midpoint(after);
            let is_in = self.indentation_mm(RigTime::from_micros(middle)) > 0.0;
            if is_in { after = middle } else { before = middle }
        }
        // Lost steps can take it in while the motor goes up.
        let downwards = -self.linear.speed(RigTime::from_micros(before));
        self.hit_mm_per_s = self.hit_mm_per_s.max(downwards);
    }
}
