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
    homing: Option<Homing>,
}

/// A homing under way.
#[derive(Debug, Clone, Copy)]
struct Homing {
    /// Position of the axis at which it ends.
    place: f64,
    /// Position of the axis at count zero from its end on, if it finds that anew.
    zero: Option<f64>,
}

/// A homed motor stands within this part of a count of its home.
const HOME_COUNTS: f64 = 1e-3;

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
            homing: None,
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
        Self { commanded: self.encoder(now, world), homing: None, ..self }
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

    /// Sends the motor to a target. It ends a homing that is under way.
    pub(super) fn go(&mut self, now: RigTime, target: f64, pace: Pace, world: &mut World) {
        self.homing = None;
        self.go_on(now, target, pace, world);
    }

    /// Sends the motor on to a target after a pause. A homing goes on.
    pub(super) fn go_on(&mut self, now: RigTime, target: f64, pace: Pace, world: &mut World) {
        self.commanded = target;
        self.send(now, self.place_of(target), pace, world);
    }

    /// Finds the zero again, and goes there. It counts from there when it has arrived.
    pub(super) fn home(&mut self, now: RigTime, pace: Pace, world: &mut World) {
        let place = self.wired_zero + world.homing_error(self.axis);
        self.homing = Some(Homing { place, zero: Some(place) });
        self.commanded = self.counts_at(place);
        self.send(now, place, pace, world);
    }

    /// Goes home to a count that the drive has kept.
    pub(super) fn home_at(&mut self, now: RigTime, target: f64, pace: Pace, world: &mut World) {
        self.homing = Some(Homing { place: self.place_of(target), zero: None });
        self.go_on(now, target, pace, world);
    }

    fn send(&self, now: RigTime, place: f64, pace: Pace, world: &mut World) {
        let scale = self.units_per_count.abs();
        let profile = Profile {
            speed: pace.speed * scale,
            acceleration: pace.acceleration * scale,
            deceleration: pace.deceleration * scale,
        };
        world.drive(now, self.axis).start(now, place, &profile);
    }

    /// Whether a homing has ended at home, once the motor is at rest. `None` while it is under way, and if there
    /// is none.
    pub(super) fn end_homing(&mut self, now: RigTime, world: &World) -> Option<bool> {
        if self.is_moving(now, world) {
            return None;
        }
        let Homing { place, zero } = self.homing.take()?;
        let off = (self.encoder(now, world) - self.counts_at(place)).abs();
        let is_home = off <= HOME_COUNTS;
        if let Some(zero) = zero.filter(|_| is_home) {
            self.commanded += (self.zero - zero) / self.units_per_count;
            self.zero = zero;
        }
        Some(is_home)
    }

    /// Slows the motor down to rest. It ends a homing that is under way.
    pub(super) fn stop(&mut self, now: RigTime, deceleration: f64, world: &mut World) {
        self.homing = None;
        self.pause(now, deceleration, world);
    }

    /// Slows the motor down to rest, from where it may [go on](Self::go_on).
    pub(super) fn pause(&mut self, now: RigTime, deceleration: f64, world: &mut World) {
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
            | DeviceFault::WrongReading(_)
            | DeviceFault::BlindContact
            | DeviceFault::StuckContact
            | DeviceFault::Knock(_)
            | DeviceFault::StuckFrequency => {}
        }
    }

    fn place_of(&self, counts: f64) -> f64 {
        self.zero + counts * self.units_per_count
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

#[cfg(test)]
mod tests {
    use rig_model::DriveMake;

    use super::*;
    use crate::{device::drive::test_drive::TestDrive, world::Nuisances};

    const MAKES: [DriveMake; 3] = [DriveMake::OrientalAz, DriveMake::IaiRc, DriveMake::LeadshinePr];

    /// A drive that was just sent home, 40 mm away.
    fn homing(make: DriveMake, nuisances: Nuisances) -> TestDrive {
        let mut test_drive = TestDrive::on(make, nuisances);
        match make {
            DriveMake::OrientalAz => test_drive.set(0x007D, 1 << 4),
            DriveMake::IaiRc => [0x0427, 0x0403, 0x040B].map(|it| test_drive.coil(it, true))[0],
            DriveMake::LeadshinePr => test_drive.set(0x6002, 0x0020),
        }
        test_drive
    }

    fn is_homed(test_drive: &mut TestDrive, make: DriveMake) -> bool {
        let (address, bit) = match make {
            DriveMake::OrientalAz => (0x007F, 1 << 4),
            DriveMake::IaiRc => (0x9005, 1 << 4),
            DriveMake::LeadshinePr => (0x1003, 1 << 6),
        };
        test_drive.read(address, 1)[0] & bit != 0
    }

    #[test]
    fn a_homing_that_does_not_arrive_is_not_done() {
        for make in MAKES {
            let faults = [
                None,
                Some(DeviceFault::Stall),
                Some(DeviceFault::Jam),
                Some(DeviceFault::LimitSwitch),
            ];
            for fault in faults {
                let mut test_drive = homing(make, Nuisances::NONE);
                test_drive.wait(0.3);
                assert!(!is_homed(&mut test_drive, make), "{make:?} is on its way");
                if let Some(fault) = fault {
                    test_drive.drive.apply_fault(test_drive.now, fault, &mut test_drive.world);
                }
                test_drive.wait(30.0);
                assert_eq!(is_homed(&mut test_drive, make), fault.is_none(), "{make:?} {fault:?}");
            }
        }
    }

    #[test]
    fn a_drive_counts_from_a_new_zero_when_it_has_arrived_there() {
        let nuisances = Nuisances { homing_mm: 0.5, ..Nuisances::NONE };
        for (make, address) in [(DriveMake::IaiRc, 0x9000), (DriveMake::LeadshinePr, 0x602C)] {
            let mut test_drive = homing(make, nuisances);
            assert_eq!(test_drive.read_long(address), 4000, "{make:?} is on its way");
            let mut stalled = homing(make, nuisances);
            for (it, stalls) in [(&mut test_drive, false), (&mut stalled, true)] {
                it.wait(0.3);
                if stalls {
                    it.drive.apply_fault(it.now, DeviceFault::Stall, &mut it.world);
                }
                it.wait(30.0);
                let counted_mm = f64::from(it.read_long(address)) * 0.01;
                let off_mm = it.world.stage(AxisId::Linear).motor(it.now) - counted_mm;
                assert_eq!(off_mm.abs() > 0.02, !stalls, "{make:?}: {off_mm} mm");
                assert_eq!(counted_mm == 0.0, !stalls, "{make:?}: {counted_mm} mm");
            }
        }
    }

    #[test]
    fn a_move_takes_the_place_of_a_homing() {
        let mut test_drive = homing(DriveMake::OrientalAz, Nuisances::NONE);
        test_drive.wait(0.3);
        // All of 2000 steps at 5000 a second.
        let data = [0, 0, 0, 1, 0, 2000, 0, 5000, 0x000F, 0x4240, 0x000F, 0x4240, 0, 1000, 0, 1];
        test_drive.write(0x0058, &data);
        test_drive.wait(30.0);
        assert_eq!(test_drive.read_long(0x00C6), 2000);
        assert!(!is_homed(&mut test_drive, DriveMake::OrientalAz));
    }
}
