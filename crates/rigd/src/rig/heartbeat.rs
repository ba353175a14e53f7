//! Notices that the program or the computer was held up, and that the wall clock was set.
//!
//! The rig thread wakes at least ten times a second. What passes beyond that between two wakes, it
//! was held up: by a signal, by a debugger, by swapping, by the sleep of the computer, or by itself.

use std::time::{Duration, SystemTime};

use rig_system::clocks;

/// Interval at which the rig thread wakes at least.
pub(super) const BEAT: Duration = Duration::from_millis(100);

/// A longer time between two wakes is a hold-up. A loaded computer misses some tenths of a second.
const HELD_UP: Duration = Duration::from_secs(1);

/// A larger difference of the two clocks between two wakes is a jump of the wall clock, s. A clock that
/// is disciplined by the network moves by less than a millisecond in a second.
const JUMP_S: f64 = 0.5;

/// The two clocks at one moment.
#[derive(Debug, Clone, Copy)]
pub(super) struct Heartbeat {
    /// Since the computer was started, with its sleep.
    running: Duration,
    wall: SystemTime,
}

/// What a wake has shown.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Noticed {
    /// The program did nothing for this long.
    pub(super) stalled: Option<Duration>,
    /// The wall clock was set by this much, s.
    pub(super) jump_s: Option<f64>,
}

impl Heartbeat {
    pub(super) fn now() -> Self {
        Self { running: clocks::running(), wall: SystemTime::now() }
    }

    /// The next wake.
    pub(super) fn beat(&mut self) -> Noticed {
        let last = std::mem::replace(self, Self::now());
        last.until(self)
    }

    fn until(&self, now: &Self) -> Noticed {
        let passed = now.running.saturating_sub(self.running);
        let by_wall_s = match now.wall.duration_since(self.wall) {
            Ok(forward) => forward.as_secs_f64(),
            Err(back) => -back.duration().as_secs_f64(),
        };
        let jump_s = by_wall_s - passed.as_secs_f64();
        Noticed {
            stalled: (passed > HELD_UP).then_some(passed),
            jump_s: (jump_s.abs() > JUMP_S).then_some(jump_s),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hold_up_and_a_jump_of_the_wall_clock_are_told_apart() {
        let begin = Heartbeat { running: Duration::from_secs(100), wall: SystemTime::UNIX_EPOCH };
        let after = |running_s: f64, wall_s: f64| {
            let wall = begin.wall + Duration::from_secs(1000);
            let from = Heartbeat { wall, ..begin };
            let now = Heartbeat {
                running: begin.running + Duration::from_secs_f64(running_s),
                wall: SystemTime::UNIX_EPOCH + Duration::from_secs_f64(1000.0 + wall_s),
            };
            from.until(&now)
        };
        assert_eq!(after(0.1, 0.1), Noticed::default());
        assert_eq!(after(0.9, 1.0), Noticed::default());
        let held_up = after(10.0, 10.0);
        assert_eq!((held_up.stalled, held_up.jump_s), (Some(Duration::from_secs(10)), None));
        for jump_s in [3600.0, -999.0, 0.6, -0.6] {
            let jumped = after(0.1, 0.1 + jump_s);
            assert_eq!(jumped.stalled, None, "{jump_s}");
            assert!((jumped.jump_s.unwrap() - jump_s).abs() < 1e-6, "{jumped:?}");
        }
    }
}
