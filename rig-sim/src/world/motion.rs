//! A motor on its way: trapezoidal speed, from rest to rest.

use rig_model::RigTime;

use crate::clock::after;

/// The profile of a move, in units of the axis and seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Profile {
    /// Highest speed, per second.
    pub speed: f64,
    /// Acceleration, per second squared.
    pub acceleration: f64,
    /// Deceleration, per second squared.
    pub deceleration: f64,
}

/// A stretch of constant acceleration.
#[derive(Debug, Clone, Copy)]
struct MotionSegment {
    duration_s: f64,
    start: f64,
    speed: f64,
    acceleration: f64,
}

impl MotionSegment {
    fn position(&self, s: f64) -> f64 {
        self.start + self.speed * s + 0.5 * self.acceleration * s * s
    }
}

/// Position of a motor at any time after a command.
#[derive(Debug, Clone)]
pub(super) struct Motion {
    began: RigTime,
    segments: Vec<MotionSegment>,
    target: f64,
    /// The end of the last way before this motion.
    arrived_before: RigTime,
}

impl Motion {
    pub(super) fn resting_at(position: f64) -> Self {
        Self {
            began: RigTime::ZERO,
            segments: Vec::new(),
            target: position,
            arrived_before: RigTime::ZERO,
        }
    }

    /// From here to `target`. A motor that is under way stops first: the direction may change. Without speed or
    /// acceleration it stays there.
    pub(super) fn start(&self, now: RigTime, target: f64, profile: &Profile) -> Self {
        let mut next = self.stop(now, profile.deceleration);
        let start = next.target;
        let distance = target - start;
        let Profile { speed, acceleration, deceleration } = *profile;
        let reach = 2.0 * distance.abs() * acceleration * deceleration;
        let top = speed.min((reach / (acceleration + deceleration)).sqrt());
        if distance != 0.0 {
            if !(0.0 < top && top.is_finite()) {
                return next;
            }
            let sign = distance.signum();
            let (up_s, down_s) = (top / acceleration, top / deceleration);
            let cruise_s = (distance.abs() / top - 0.5 * (up_s + down_s)).max(0.0);
            let mut place = start;
            for (duration_s, speed, acceleration) in [
                (up_s, 0.0, sign * acceleration),
                (cruise_s, sign * top, 0.0),
                (down_s, sign * top, -sign * deceleration),
            ] {
                let segment = MotionSegment { duration_s, start: place, speed, acceleration };
                place = segment.position(duration_s);
                next.segments.push(segment);
            }
        }
        next.target = target;
        next
    }

    /// To rest, as fast as `deceleration` allows.
    pub(super) fn stop(&self, now: RigTime, deceleration: f64) -> Self {
        let (start, speed) = self.state(now);
        let arrived_before = self.arrived().min(now);
        if speed == 0.0 {
            return Self { began: now, segments: Vec::new(), target: start, arrived_before };
        }
        let duration_s = speed.abs() / deceleration;
        let acceleration = -speed.signum() * deceleration;
        let segment = MotionSegment { duration_s, start, speed, acceleration };
        let target = segment.position(duration_s);
        Self { began: now, segments: vec![segment], target, arrived_before }
    }

    /// To rest at once, as against a wall.
    pub(super) fn halt(&self, now: RigTime) -> Self {
        Self { arrived_before: self.arrived().min(now), ..Self::resting_at(self.state(now).0) }
    }

    pub(super) fn target(&self) -> f64 {
        self.target
    }

    pub(super) fn position(&self, now: RigTime) -> f64 {
        self.state(now).0
    }

    pub(super) fn speed(&self, now: RigTime) -> f64 {
        self.state(now).1
    }

    /// The moment at which the motor comes to rest, rounded up to the clock.
    pub(super) fn ends(&self) -> RigTime {
        let seconds: f64 = self.segments.iter().map(|segment| segment.duration_s).sum();
        after(self.began, seconds)
    }

    /// The end of the last way that the motor went or goes. A command that moves nothing does not change it.
    pub(super) fn arrived(&self) -> RigTime {
        if self.segments.is_empty() { self.arrived_before } else { self.ends() }
    }

    /// Turning point of the motor, if it has turned round by `now`.
    pub(super) fn turned_at(&self, now: RigTime) -> Option<f64> {
        let first = self.segments.first().filter(|segment| segment.speed != 0.0)?;
        let elapsed_s = now.since(self.began).as_secs_f64();
        (elapsed_s > first.duration_s).then(|| first.position(first.duration_s))
    }

    /// When the motor turns round, if it does.
    pub(super) fn turns(&self) -> Option<RigTime> {
        let first = self.segments.first().filter(|segment| segment.speed != 0.0)?;
        (self.segments.len() > 1).then(|| after(self.began, first.duration_s))
    }

    fn state(&self, now: RigTime) -> (f64, f64) {
        let mut left_s = now.since(self.began).as_secs_f64();
        for segment in &self.segments {
            if left_s < segment.duration_s {
                return (segment.position(left_s), segment.speed + segment.acceleration * left_s);
            }
            left_s -= segment.duration_s;
        }
        (self.target, 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PROFILE: Profile = Profile { speed: 10.0, acceleration: 100.0, deceleration: 50.0 };

    fn at(seconds: f64) -> RigTime {
        RigTime::ZERO + std::time::Duration::from_secs_f64(seconds)
    }

    /// Position from the speed alone, by the trapezoid rule, and the steepest change of speed.
    fn integrate(motion: &Motion, start: f64, seconds: f64) -> (f64, f64) {
        let (mut place, mut steepest, dt) = (start, 0.0_f64, 1e-4);
        let mut t = 0.0;
        while t < seconds {
            let (before, after) = (motion.speed(at(t)), motion.speed(at(t + dt)));
            place += 0.5 * dt * (before + after);
            steepest = steepest.max((after - before).abs() / dt);
            t += dt;
        }
        (place, steepest)
    }

    #[test]
    fn long_and_short_moves_keep_speed_and_acceleration_and_arrive() {
        for (target, seconds) in [(5.0, 0.65), (-5.0, 0.65), (0.3, 0.134_164), (0.0, 0.0)] {
            let motion = Motion::resting_at(0.0).start(RigTime::ZERO, target, &PROFILE);
            let took = motion.ends().as_seconds();
            assert!((took - seconds).abs() < 2e-6, "{target}: {took}");
            let (place, steepest) = integrate(&motion, 0.0, seconds + 0.01);
            assert!((place - target).abs() < 2e-3, "{target}: {place}");
            assert!(steepest <= 100.1, "{target}: {steepest}");
            assert_eq!(motion.position(motion.ends()), target);
        }
    }

    #[test]
    fn a_move_without_speed_or_acceleration_stays_where_it_is() {
        let still = [
            Profile { speed: 0.0, ..PROFILE },
            Profile { acceleration: 0.0, ..PROFILE },
            Profile { deceleration: 0.0, ..PROFILE },
            Profile { speed: f64::NAN, acceleration: f64::NAN, ..PROFILE },
        ];
        for profile in still {
            let motion = Motion::resting_at(1.0).start(at(1.0), 5.0, &profile);
            let found = (motion.position(at(9.0)), motion.target(), motion.ends());
            assert_eq!(found, (1.0, 1.0, at(1.0)), "{profile:?}");
        }
    }

    #[test]
    fn a_command_that_moves_nothing_is_no_way_and_a_halt_ends_one() {
        let motion = Motion::resting_at(0.0).start(at(1.0), 5.0, &PROFILE);
        let arrived = motion.ends();
        assert_eq!(motion.arrived(), arrived);
        assert_eq!(motion.start(at(9.0), 5.0, &PROFILE).arrived(), arrived);
        assert_eq!(motion.stop(at(9.0), 50.0).stop(at(10.0), 50.0).arrived(), arrived);
        assert_eq!(motion.halt(at(9.0)).arrived(), arrived);
        assert_eq!(motion.halt(at(1.2)).arrived(), at(1.2));
        assert_eq!(motion.halt(at(1.2)).halt(at(2.0)).arrived(), at(1.2));
        let stopped = motion.stop(at(1.2), 50.0);
        assert_eq!(stopped.arrived(), stopped.ends());
    }

    #[test]
    fn a_stop_takes_its_way_and_a_new_command_turns_round_after_it() {
        let going = Motion::resting_at(0.0).start(RigTime::ZERO, 50.0, &PROFILE);
        let now = at(1.0);
        let stopped = going.stop(now, 50.0);
        assert!((stopped.target() - (going.position(now) + 1.0)).abs() < 1e-9);
        assert!((stopped.ends().as_seconds() - 1.2).abs() < 2e-6);
        let back = going.start(now, 0.0, &PROFILE);
        assert_eq!(back.turned_at(at(1.1)), None);
        let turn = back.turned_at(at(1.3)).unwrap();
        assert!((turn - stopped.target()).abs() < 1e-9);
        assert_eq!(back.position(back.ends()), 0.0);
        assert_eq!(going.halt(now).position(at(9.0)), going.position(now));
    }
}
