//! A stage: a motor, and the load that follows it with play and with the error of its screw.

use rig_model::RigTime;

use super::motion::{Motion, Profile};
use rig_model::random::normal_at;

/// The backlash between motor and load of a stage, in units of the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drivetrain {
    /// Play between motor and load.
    pub backlash: f64,
    /// Standard deviation of the repeatable error of the screw.
    pub screw_error: f64,
    /// Distance over which that error changes.
    pub screw_length: f64,
}

/// One stage. Its drive commands the motor and reads the motor's encoder; the world sees the load.
#[derive(Debug, Clone)]
pub struct Stage {
    drivetrain: Drivetrain,
    /// Seed and name of the screw.
    screw: (u64, u64),
    motion: Motion,
    /// The load at the beginning of the motion, before the error of the screw.
    load: f64,
    /// Steps lost: distance of the load behind the counted position of the motor.
    slip: f64,
    /// The part of it since the motor was last sent to lower positions.
    slip_since_lowered: f64,
    is_jammed: bool,
}

impl Stage {
    pub(super) fn new(drivetrain: Drivetrain, screw: (u64, u64), position: f64) -> Self {
        let motion = Motion::resting_at(position);
        Self {
            drivetrain,
            screw,
            motion,
            load: position,
            slip: 0.0,
            slip_since_lowered: 0.0,
            is_jammed: false,
        }
    }

    /// Sends the motor to `target`. A jammed motor does not move.
    pub fn start(&mut self, now: RigTime, target: f64, profile: &Profile) {
        self.rebase(now);
        if !self.is_jammed {
            if target < self.motor(now) {
                self.slip_since_lowered = 0.0;
            }
            self.motion = self.motion.start(now, target, profile);
        }
    }

    /// Stops the motor.
    pub fn stop(&mut self, now: RigTime, deceleration: f64) {
        self.rebase(now);
        self.motion = self.motion.stop(now, deceleration);
    }

    /// Halts the motor where it is, as a stall does.
    pub fn halt(&mut self, now: RigTime) {
        self.rebase(now);
        self.motion = self.motion.halt(now);
    }

    /// Halts the motor and blocks it, or frees it.
    pub(crate) fn set_jammed(&mut self, now: RigTime, is_jammed: bool) {
        self.halt(now);
        self.is_jammed = is_jammed;
    }

    /// Shifts the load by `distance` without the motor's knowledge.
    pub(crate) fn lose_steps(&mut self, distance: f64) {
        self.slip += distance;
        self.slip_since_lowered += distance;
    }

    /// How far the load has sunk by lost steps alone since the motor was last sent to lower positions.
    pub(super) fn sunk(&self) -> f64 {
        (-self.slip_since_lowered).max(0.0)
    }

    /// Position of the encoder of the motor.
    pub fn motor(&self, now: RigTime) -> f64 {
        self.motion.position(now)
    }

    /// Whether the motor is blocked.
    pub(crate) fn is_jammed(&self) -> bool {
        self.is_jammed
    }

    /// Speed of the motor, in units per second.
    pub fn speed(&self, now: RigTime) -> f64 {
        self.motion.speed(now)
    }

    /// When the motor turns round, past or future, if it does.
    pub(super) fn turns(&self) -> Option<RigTime> {
        self.motion.turns()
    }

    /// Whether the motor is under way.
    pub fn is_moving(&self, now: RigTime) -> bool {
        now < self.motion.ends()
    }

    /// Time at which the motor comes to rest, past or future.
    pub fn rests_from(&self) -> RigTime {
        self.motion.ends()
    }

    /// The end of the last way of the motor, past or future. A halt ends a way, and a command that moves nothing is
    /// none.
    pub(super) fn arrived(&self) -> RigTime {
        self.motion.arrived()
    }

    /// Target of the motor, or its position after a halt.
    pub fn target(&self) -> f64 {
        self.motion.target()
    }

    /// True position of the load.
    pub fn load(&self, now: RigTime) -> f64 {
        let nut = self.follow(now) + self.slip;
        nut + self.screw_error(nut)
    }

    fn rebase(&mut self, now: RigTime) {
        self.load = self.follow(now);
    }

    /// The load is dragged along by whichever flank of the play touches it.
    fn follow(&self, now: RigTime) -> f64 {
        let half = 0.5 * self.drivetrain.backlash;
        let drag = |load: f64, motor: f64| load.clamp(motor - half, motor + half);
        let load = self.motion.turned_at(now).map_or(self.load, |turn| drag(self.load, turn));
        drag(load, self.motion.position(now))
    }

    /// A smooth random function of place: independent at points one length apart.
    fn screw_error(&self, place: f64) -> f64 {
        let Drivetrain { screw_error, screw_length, .. } = self.drivetrain;
        if screw_error == 0.0 {
            return 0.0;
        }
        let cell = (place / screw_length).floor();
        let part = place / screw_length - cell;
        let (seed, name) = self.screw;
        #[expect(clippy::cast_possible_truncation, reason = "a float cast saturates")]
        let node = |cell: f64| normal_at(seed, [name, (cell as i64).cast_unsigned(), 0]);
        let weight = part * part * (3.0 - 2.0 * part);
        screw_error * ((1.0 - weight) * node(cell) + weight * node(cell + 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FAST: Profile = Profile { speed: 10.0, acceleration: 1000.0, deceleration: 1000.0 };

    fn at(seconds: u64) -> RigTime {
        RigTime::from_micros(seconds * 1_000_000)
    }

    #[test]
    fn the_load_follows_with_play_and_the_encoder_does_not_see_it() {
        let drivetrain = Drivetrain { backlash: 0.02, screw_error: 0.0, screw_length: 1.0 };
        let mut stage = Stage::new(drivetrain, (1, 1), 10.0);
        // Play is centred at first; each reversal crosses it all.
        for (second, target, load) in
            [(0, 11.0, 10.99), (10, 10.0, 10.01), (20, 9.995, 10.005), (30, 10.0, 10.005)]
        {
            stage.start(at(second), target, &FAST);
            assert_eq!(stage.motor(at(second + 9)), target);
            let found = stage.load(at(second + 9));
            assert!((found - load).abs() < 1e-12, "to {target}: {found}");
        }
    }

    #[test]
    fn a_reversal_on_the_way_drags_the_load_to_where_the_motor_turned() {
        let drivetrain = Drivetrain { backlash: 4.0, screw_error: 0.0, screw_length: 1.0 };
        let mut stage = Stage::new(drivetrain, (1, 1), 0.0);
        stage.start(RigTime::ZERO, 100.0, &FAST);
        stage.start(at(5), 49.0, &FAST);
        // The motor overshot to 50 and turned; the load was left two below that.
        let load = stage.load(at(20));
        assert!((load - 48.0).abs() < 1e-9, "{load}");
    }

    #[test]
    fn lost_steps_and_a_stall_are_unknown_to_the_command() {
        let drivetrain = Drivetrain { backlash: 0.0, screw_error: 0.0, screw_length: 1.0 };
        let mut stage = Stage::new(drivetrain, (1, 1), 0.0);
        stage.lose_steps(-0.5);
        assert_eq!((stage.motor(at(1)), stage.load(at(1))), (0.0, -0.5));
        stage.start(at(1), 10.0, &FAST);
        stage.set_jammed(at(1) + std::time::Duration::from_millis(500), true);
        assert!((4.0..6.0).contains(&stage.motor(at(9))), "{}", stage.motor(at(9)));
        stage.start(at(10), 0.0, &FAST);
        assert!(stage.motor(at(19)) > 4.0);
    }

    #[test]
    fn the_error_of_the_screw_is_the_same_at_the_same_place_and_never_runs_backwards() {
        let drivetrain = Drivetrain { backlash: 0.0, screw_error: 0.02, screw_length: 0.5 };
        let stage = Stage::new(drivetrain, (1, 1), 0.0);
        let mut square = 0.0;
        for step in 0..20_000 {
            let place = f64::from(step) * 0.001;
            let error = stage.screw_error(place);
            assert_eq!(error, stage.screw_error(place));
            assert!((stage.screw_error(place + 0.001) - error).abs() < 0.0005, "at {place}");
            square += error * error;
        }
        let sigma = (square / 20_000.0).sqrt();
        assert!((0.01..0.025).contains(&sigma), "{sigma}");
    }
}
