//! The motor of a drive, in the drive's own counts.

use rig_model::RigTime;

use crate::{
    faults::DeviceFault,
    wiring::AxisWiring,
    world::{AxisId, Profile, World},
};

/// A motor and its commanded position.
#[derive(Debug, Clone, Copy)]
pub(super) struct Motor {
    axis: AxisId,
    /// Millimetres or degrees a count; negative when the motor counts the other way.
    units_per_count: f64,
    /// Position of the axis at count zero, and where it was when the drive was wired.
    zero: f64,
    wired_zero: f64,
    steps_per_revolution: f64,
    commanded: f64,
}

/// The profile of a move, in counts and seconds.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pace {
    pub(super) speed: f64,
    pub(super) acceleration: f64,
    pub(super) deceleration: f64,
}

impl Motor {
    pub(super) fn new(axis: AxisId, wiring: &AxisWiring, world: &World) -> Self {
        let &AxisWiring { units_per_step, zero, steps_per_revolution, .. } = wiring;
        let units_per_count = units_per_step;
        let mut motor = Self {
            axis,
            units_per_count,
            zero,
            wired_zero: zero,
            steps_per_revolution,
            commanded: 0.0,
        };
        motor.commanded = motor.counts_at(world.stage(axis).target());
        motor
    }

    /// Counts for a revolution, as it is set in the drive.
    pub(super) const fn steps_per_revolution(&self) -> f64 {
        self.steps_per_revolution
    }

    /// The motor after its drive was switched off, when the brake held it, and on again.
    pub(super) fn power_cycled(self, now: RigTime, world: &mut World) -> Self {
        world.drive(now, self.axis).halt(now);
        Self { commanded: self.encoder(now, world), ..self }
    }

    /// Position of the encoder, counts.
    pub(super) fn encoder(&self, now: RigTime, world: &World) -> f64 {
        self.counts_at(world.stage(self.axis).motor(now))
    }

    /// Commanded position of the motor, counts.
    pub(super) fn command(&self, now: RigTime, world: &World) -> f64 {
        if self.is_moving(now, world) { self.encoder(now, world) } else { self.commanded }
    }

    /// Target of the motor, counts.
    pub(super) fn target(&self) -> f64 {
        self.commanded
    }

    /// Counts a second.
    pub(super) fn speed(&self, now: RigTime, world: &World) -> f64 {
        world.stage(self.axis).speed(now) / self.units_per_count
    }

    pub(super) fn is_moving(&self, now: RigTime, world: &World) -> bool {
        world.stage(self.axis).is_moving(now)
    }

    /// Positions of the limit switches: the lower and the upper count.
    pub(super) fn travel(&self, world: &World) -> (f64, f64) {
        let (low, high) = world.travel(self.axis);
        let (a, b) = (self.counts_at(low), self.counts_at(high));
        (a.min(b), a.max(b))
    }

    pub(super) fn go(&mut self, now: RigTime, target: f64, pace: Pace, world: &mut World) {
        let scale = self.units_per_count.abs();
        let profile = Profile {
            speed: pace.speed * scale,
            acceleration: pace.acceleration * scale,
            deceleration: pace.deceleration * scale,
        };
        self.commanded = target;
        let place = self.zero + target * self.units_per_count;
        world.drive(now, self.axis).start(now, place, &profile);
    }

    /// Finds the zero again, and goes there.
    pub(super) fn home(&mut self, now: RigTime, pace: Pace, world: &mut World) {
        self.zero = self.wired_zero + world.homing_error(self.axis);
        self.go(now, 0.0, pace, world);
    }

    /// Slows the motor down to rest.
    pub(super) fn stop(&mut self, now: RigTime, deceleration: f64, world: &mut World) {
        if self.is_moving(now, world) {
            let stage = world.drive(now, self.axis);
            stage.stop(now, deceleration * self.units_per_count.abs());
            let target = stage.target();
            self.commanded = self.counts_at(target);
        }
    }

    /// The effect of faults on a motor. The drive handles its own faults.
    pub(super) fn apply_fault(&mut self, now: RigTime, fault: DeviceFault, world: &mut World) {
        match fault {
            DeviceFault::Stall => world.drive(now, self.axis).halt(now),
            DeviceFault::EmergencyStop => world.press_stop(now, true),
            DeviceFault::Jam => world.drive(now, self.axis).set_jammed(now, true),
            DeviceFault::LoseSteps(distance) => world.drive(now, self.axis).lose_steps(distance),
            DeviceFault::Miscount(by) => {
                self.zero -= by;
                self.commanded += by / self.units_per_count;
            }
            DeviceFault::Reboot
            | DeviceFault::Alarm(_)
            | DeviceFault::LimitSwitch
            | DeviceFault::Overload
            | DeviceFault::BlindContact
            | DeviceFault::StuckContact
            | DeviceFault::Knock(_)
            | DeviceFault::StuckFrequency => {}
        }
    }

    fn counts_at(&self, place: f64) -> f64 {
        (place - self.zero) / self.units_per_count
    }
}

/// The value of a counter of a drive.
#[expect(clippy::cast_possible_truncation, reason = "a float cast saturates, as the counter does")]
pub(super) fn counts(value: f64) -> i32 {
    value.round() as i32
}

/// One word of a value of two, the upper one at the even address.
pub(super) fn word(value: i32, is_upper: bool) -> u16 {
    let [a, b, c, d] = value.to_be_bytes();
    u16::from_be_bytes(if is_upper { [a, b] } else { [c, d] })
}
