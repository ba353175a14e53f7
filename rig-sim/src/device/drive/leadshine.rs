//! A closed-loop stepper of Leadshine (CL2C-RS, iEM-RS) in PR mode as a Modbus unit.
//!
//! Positions are pulses, high word first. Path 0 is written to 0x6200 and started by its last
//! register or by the trigger register. Drivers in the field disagree on details; where they do,
//! this is what most of them say.
//!
//! # Source
//! Leadshine, CL2C-RS Series User Manual, chapters on PR mode and the Modbus register list.

use std::collections::BTreeMap;

use rig_model::RigTime;

use super::{
    Unit, addresses, bits, long,
    motor::{Motor, Pace, counts, word},
    read_each, written,
};
use crate::{
    faults::DeviceFault,
    modbus::{Block, Exception, Reply, Request},
    world::World,
};

/// Registers.
mod register {
    pub(super) const PULSES_PER_REVOLUTION: u16 = 0x0001;
    pub(super) const ENABLE: u16 = 0x000F;
    pub(super) const STATUS: u16 = 0x1003;
    pub(super) const SPEED: u16 = 0x1046;
    pub(super) const CONTROL: u16 = 0x1801;
    pub(super) const ALARM: u16 = 0x2203;
    pub(super) const PATH_CONTROL: u16 = 0x6000;
    pub(super) const TRIGGER: u16 = 0x6002;
    pub(super) const LIMIT_POSITIVE: u16 = 0x6006;
    pub(super) const LIMIT_NEGATIVE: u16 = 0x6008;
    pub(super) const HOME_SPEED: u16 = 0x600F;
    pub(super) const STOP_TIME: u16 = 0x6016;
    pub(super) const POSITION: u16 = 0x602C;
    pub(super) const PATH_MODE: u16 = 0x6200;
    pub(super) const PATH_POSITION: u16 = 0x6201;
    pub(super) const PATH_SPEED: u16 = 0x6203;
    pub(super) const PATH_ACCELERATION: u16 = 0x6204;
    pub(super) const PATH_DECELERATION: u16 = 0x6205;
    pub(super) const PATH_TRIGGER: u16 = 0x6207;
}

/// Writable registers with their values at power-on, alone or as ranges.
const SETTINGS: [(u16, u16, u16); 15] = [
    (register::PULSES_PER_REVOLUTION, register::PULSES_PER_REVOLUTION, 10_000),
    (register::ENABLE, register::ENABLE, 1),
    (0x0191, 0x0191, 30),
    (0x01BD, 0x01BF, 0),
    (register::CONTROL, register::CONTROL, 0),
    (register::PATH_CONTROL, register::PATH_CONTROL, 0),
    (register::TRIGGER, register::TRIGGER, 0),
    (register::LIMIT_POSITIVE, 0x6009, 0),
    (0x600A, 0x600E, 0),
    (register::HOME_SPEED, 0x6010, 200),
    (0x6011, 0x6015, 100),
    (register::STOP_TIME, register::STOP_TIME, 100),
    (register::PATH_MODE, 0x6202, 0),
    (register::PATH_SPEED, register::PATH_DECELERATION, 100),
    (0x6206, register::PATH_TRIGGER, 0),
];

/// Bits of the status.
mod status {
    pub(super) const FAULT: u16 = 1;
    pub(super) const ENABLED: u16 = 1 << 1;
    pub(super) const RUNNING: u16 = 1 << 2;
    pub(super) const COMMAND_DONE: u16 = 1 << 4;
    pub(super) const PATH_DONE: u16 = 1 << 5;
    pub(super) const HOMED: u16 = 1 << 6;
}

/// Values of the trigger register.
const RUN_PATH_0: u16 = 0x0010;
const HOME: u16 = 0x0020;
const SET_ZERO: u16 = 0x0021;
const QUICK_STOP: u16 = 0x0040;

/// Values of the control word.
const RESET_ALARM: u16 = 0x1111;

/// The kinds of path, in the lower bits of its mode, and the bit of a relative one.
const MODE_POSITION: u16 = 1;
const MODE_SPEED: u16 = 2;
const MODE_BITS: u16 = 0xF;
const RELATIVE: u16 = 1 << 6;

/// The bit that switches the software limits on.
const HAS_LIMITS: u16 = 1 << 1;

/// Alarm codes.
const OVER_CURRENT: u16 = 0xE0;
const POSITION_ERROR: u16 = 0x180;

/// One drive.
#[derive(Debug)]
pub(crate) struct Leadshine {
    motor: Motor,
    settings: BTreeMap<u16, u16>,
    /// Offset of the position counter from the encoder since zero was set.
    preset: f64,
    alarm: u16,
    is_homed: bool,
}

impl Unit for Leadshine {
    fn notice_end(&mut self, now: RigTime, world: &World) {
        if let Some(is_home) = self.motor.end_homing(now, world) {
            self.is_homed = is_home;
        }
    }

    fn answer(
        &mut self,
        now: RigTime,
        request: &Request,
        world: &mut World,
    ) -> Result<Reply, Exception> {
        match request {
            Request::ReadHoldingRegisters(block) => self.read(now, *block, world),
            request => {
                let (address, values) = written(request).ok_or(Exception::Function)?;
                self.write(now, address, values, world)
            }
        }
    }

    fn apply_fault(&mut self, now: RigTime, fault: DeviceFault, world: &mut World) {
        match fault {
            DeviceFault::Alarm(code) => self.raise(now, u16::from(code), world),
            // A limit switch only stops it.
            DeviceFault::LimitSwitch => self.stop(now, world),
            DeviceFault::Stall => {
                self.motor.apply_fault(now, fault, world);
                self.alarm = POSITION_ERROR;
            }
            _ => self.motor.apply_fault(now, fault, world),
        }
    }

    fn homed_by_person(&mut self) {
        self.is_homed = true;
    }

    fn power_cycle(&mut self, now: RigTime, world: &mut World) {
        *self = Self::new(self.motor.power_cycled(now, world));
    }
}

impl Leadshine {
    /// A drive that has just been switched on. Its encoder is not absolute.
    pub(super) fn new(motor: Motor) -> Self {
        let expand = |&(first, last, initial): &(u16, u16, u16)| {
            (first..=last).map(move |address| (address, initial))
        };
        let mut settings: BTreeMap<_, _> = SETTINGS.iter().flat_map(expand).collect();
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "it is saturated"
        )]
        let pulses = motor.steps_per_revolution() as u16;
        settings.insert(register::PULSES_PER_REVOLUTION, pulses);
        Self { motor, settings, preset: 0.0, alarm: 0, is_homed: false }
    }

    fn raise(&mut self, now: RigTime, code: u16, world: &mut World) {
        self.stop(now, world);
        self.alarm = if code == 0 { OVER_CURRENT } else { code };
    }

    fn read(&self, now: RigTime, block: Block, world: &World) -> Result<Reply, Exception> {
        let seen_at = world.position_seen_at(now);
        let position = counts(self.motor.encoder(seen_at, world) + self.preset);
        let rpm = self.motor.speed(now, world) * 60.0 / self.pulses_per_revolution();
        let register = |address| {
            Some(match address {
                register::STATUS => self.status(now, world),
                register::ALARM => self.alarm,
                register::SPEED => word(counts(rpm), false),
                register::POSITION => word(position, true),
                0x602D => word(position, false),
                _ => *self.settings.get(&address)?,
            })
        };
        read_each(block, register).map(Reply::Registers)
    }

    fn status(&self, now: RigTime, world: &World) -> u16 {
        let is_moving = self.motor.is_moving(now, world);
        bits([
            (status::FAULT, self.alarm != 0),
            (status::ENABLED, self.is_enabled()),
            (status::RUNNING, is_moving),
            (status::COMMAND_DONE, !is_moving),
            (status::PATH_DONE, !is_moving),
            (status::HOMED, self.is_homed),
        ])
    }

    fn is_enabled(&self) -> bool {
        self.settings[&register::ENABLE] == 1 && self.alarm == 0
    }

    fn pulses_per_revolution(&self) -> f64 {
        f64::from(self.settings[&register::PULSES_PER_REVOLUTION].max(1))
    }

    fn long(&self, address: u16) -> i32 {
        long([self.settings[&address], self.settings[&(address + 1)]])
    }

    fn write(
        &mut self,
        now: RigTime,
        address: u16,
        values: &[u16],
        world: &mut World,
    ) -> Result<Reply, Exception> {
        let addresses = addresses(address, values)?;
        if !addresses.clone().all(|address| self.settings.contains_key(&address)) {
            return Err(Exception::Address);
        }
        for (address, value) in addresses.clone().zip(values) {
            self.settings.insert(address, *value);
        }
        for (address, value) in addresses.zip(values) {
            match address {
                register::CONTROL if *value == RESET_ALARM => self.alarm = 0,
                register::TRIGGER | register::PATH_TRIGGER => self.trigger(now, *value, world),
                register::ENABLE if *value != 1 => self.stop(now, world),
                _ => continue,
            }
            // Commands read back as zero once they are taken.
            if address != register::ENABLE {
                self.settings.insert(address, 0);
            }
        }
        Ok(Reply::Done)
    }

    fn trigger(&mut self, now: RigTime, value: u16, world: &mut World) {
        match value {
            QUICK_STOP => self.stop(now, world),
            SET_ZERO => self.preset = -self.motor.command(now, world),
            // Without its motor a drive ignores commands.
            _ if !self.is_enabled() => {}
            // Without speed it goes nowhere.
            HOME if self.settings[&register::HOME_SPEED] == 0 => {}
            HOME => {
                self.is_homed = false;
                self.preset = 0.0;
                let rpm = self.settings[&register::HOME_SPEED];
                let pace = self.pace(rpm, 100, 100);
                self.motor.home(now, pace, world);
            }
            RUN_PATH_0 => self.run_path(now, world),
            _ => {}
        }
    }

    fn run_path(&mut self, now: RigTime, world: &mut World) {
        let s = &self.settings;
        let mode = s[&register::PATH_MODE];
        let rpm = s[&register::PATH_SPEED];
        let pace = self.pace(rpm, s[&register::PATH_ACCELERATION], s[&register::PATH_DECELERATION]);
        let position = f64::from(self.long(register::PATH_POSITION));
        let target = match mode & MODE_BITS {
            MODE_POSITION if mode & RELATIVE != 0 => self.motor.command(now, world) + position,
            MODE_POSITION => position - self.preset,
            MODE_SPEED if rpm.cast_signed() < 0 => f64::NEG_INFINITY,
            MODE_SPEED => f64::INFINITY,
            _ => return,
        };
        if rpm == 0 {
            return;
        }
        let (mut low, mut high) = self.motor.travel(world);
        if s[&register::PATH_CONTROL] & HAS_LIMITS != 0 {
            low = low.max(f64::from(self.long(register::LIMIT_NEGATIVE)) - self.preset);
            high = high.min(f64::from(self.long(register::LIMIT_POSITIVE)) - self.preset);
        }
        if low <= high {
            self.motor.go(now, target.clamp(low, high), pace, world);
        }
    }

    fn stop(&mut self, now: RigTime, world: &mut World) {
        let ms = self.settings[&register::STOP_TIME];
        let deceleration = self.pace(1, ms, ms).deceleration;
        self.motor.stop(now, deceleration, world);
    }

    /// Speed in revolutions a minute, and the milliseconds for a change of 1000 of them.
    fn pace(&self, rpm: u16, up_ms: u16, down_ms: u16) -> Pace {
        let per_rpm = self.pulses_per_revolution() / 60.0;
        let rate = |ms: u16| 1000.0 * per_rpm / (f64::from(ms.max(1)) * 1e-3);
        let speed = f64::from(rpm.cast_signed()).abs() * per_rpm;
        Pace { speed, acceleration: rate(up_ms), deceleration: rate(down_ms) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rig_model::DriveMake;

    use crate::device::drive::test_drive::TestDrive;

    fn ready() -> TestDrive {
        let mut test_drive = TestDrive::new(DriveMake::LeadshinePr);
        test_drive.set(register::PULSES_PER_REVOLUTION, 1000);
        test_drive.set(register::TRIGGER, HOME);
        assert_eq!(test_drive.read(register::STATUS, 1)[0], status::ENABLED | status::RUNNING);
        test_drive.wait(5.0);
        test_drive
    }

    /// Path 0 to `position` at 300 revolutions a minute, started by its last register.
    fn path(test_drive: &mut TestDrive, mode: u16, position: i32) {
        let (high, low) = (word(position, true), word(position, false));
        test_drive.write(register::PATH_MODE, &[mode, high, low, 300, 100, 100, 0, RUN_PATH_0]);
    }

    const DONE: u16 = status::ENABLED | status::COMMAND_DONE | status::PATH_DONE | status::HOMED;

    #[test]
    fn a_path_runs_from_one_request_and_takes_its_time() {
        let mut test_drive = ready();
        assert_eq!(test_drive.read(register::STATUS, 1)[0], DONE);
        path(&mut test_drive, MODE_POSITION, 2000);
        assert_eq!(
            test_drive.read(register::STATUS, 1)[0],
            status::ENABLED | status::RUNNING | status::HOMED
        );
        // 5000 pulses a second, reached after 30 ms.
        test_drive.wait(0.2);
        let half = test_drive.read_long(register::POSITION);
        assert!((900..950).contains(&half), "{half}");
        assert_eq!(test_drive.read(register::SPEED, 1), [300]);
        test_drive.wait(1.0);
        assert_eq!(test_drive.read_long(register::POSITION), 2000);
        path(&mut test_drive, MODE_POSITION | RELATIVE, -500);
        test_drive.wait(1.0);
        assert_eq!(test_drive.read_long(register::POSITION), 1500);
        assert_eq!(test_drive.read(register::PATH_TRIGGER, 1), [0]);
    }

    #[test]
    fn a_homing_without_speed_goes_nowhere() {
        let mut test_drive = TestDrive::new(DriveMake::LeadshinePr);
        test_drive.set(register::HOME_SPEED, 0);
        test_drive.set(register::TRIGGER, HOME);
        for seconds in [0.0, 5.0] {
            test_drive.wait(seconds);
            assert_eq!(test_drive.read_long(register::POSITION), 4000);
            assert_eq!(test_drive.read(register::STATUS, 1)[0] & status::HOMED, 0);
        }
    }

    #[test]
    fn limits_stops_and_zero() {
        let mut test_drive = ready();
        test_drive.write(register::LIMIT_POSITIVE, &[0, 1000, 0xFFFF, 0xFFF6]);
        test_drive.set(register::PATH_CONTROL, HAS_LIMITS);
        path(&mut test_drive, MODE_POSITION, 2000);
        test_drive.wait(2.0);
        assert_eq!(test_drive.read_long(register::POSITION), 1000);
        test_drive.set(register::PATH_CONTROL, 0);
        path(&mut test_drive, MODE_POSITION, 4000);
        test_drive.wait(0.3);
        test_drive.set(register::TRIGGER, QUICK_STOP);
        test_drive.wait(2.0);
        let stopped = test_drive.read_long(register::POSITION);
        assert!((2300..2700).contains(&stopped), "{stopped}");
        test_drive.set(register::TRIGGER, SET_ZERO);
        assert_eq!(test_drive.read_long(register::POSITION), 0);
        path(&mut test_drive, MODE_POSITION, 100);
        test_drive.wait(1.0);
        assert_eq!(test_drive.read_long(register::POSITION), 100);
    }

    #[test]
    fn a_fault_refuses_moves_until_it_is_reset_and_unknown_registers_are_refused() {
        let mut test_drive = ready();
        let now = test_drive.now;
        test_drive.drive.apply_fault(now, DeviceFault::Alarm(0xA1), &mut test_drive.world);
        assert_eq!(test_drive.read(register::ALARM, 1), [0xA1]);
        assert_eq!(test_drive.read(register::STATUS, 1)[0] & (status::FAULT | status::ENABLED), 1);
        path(&mut test_drive, MODE_POSITION, 2000);
        test_drive.wait(2.0);
        assert_eq!(test_drive.read_long(register::POSITION), 0);
        test_drive.set(register::CONTROL, RESET_ALARM);
        path(&mut test_drive, MODE_POSITION, 2000);
        test_drive.wait(2.0);
        assert_eq!(test_drive.read_long(register::POSITION), 2000);
        let read = |address| Request::ReadHoldingRegisters(Block { address, count: 1 });
        test_drive.refused(&read(0x7000), Exception::Address);
        let write = Request::WriteRegister { address: register::STATUS, value: 0 };
        test_drive.refused(&write, Exception::Address);
    }
}
