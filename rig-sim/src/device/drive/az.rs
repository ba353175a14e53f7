//! A drive of Oriental Motor's AZ series as a Modbus unit.
//!
//! All values are 32 bits wide in two registers, the upper word first. A move is commanded by
//! direct data operation: its items are written and a trigger starts it. The drive ignores
//! impossible commands; only its status shows it.
//!
//! # Source
//! Oriental Motor, AZ Series Function Edition (HM-60262E), chapters on Modbus RTU control.

use std::collections::BTreeMap;

use rig_model::RigTime;

use super::{
    Unit, addresses, bits,
    motor::{Motor, Pace, counts, word},
    written,
};
use crate::{
    faults::DeviceFault,
    modbus::{Block, Exception, Reply, Request},
    world::World,
};

/// The addresses of the upper words.
mod item {
    // Direct data operation.
    pub(super) const DATA_NUMBER: u16 = 0x0058;
    pub(super) const TYPE: u16 = 0x005A;
    pub(super) const POSITION: u16 = 0x005C;
    pub(super) const SPEED: u16 = 0x005E;
    pub(super) const ACCELERATION: u16 = 0x0060;
    pub(super) const DECELERATION: u16 = 0x0062;
    pub(super) const CURRENT: u16 = 0x0064;
    pub(super) const TRIGGER: u16 = 0x0066;
    pub(super) const DESTINATION: u16 = 0x0068;

    pub(super) const INPUT_AUTO_OFF: u16 = 0x0078;
    pub(super) const INPUT: u16 = 0x007C;
    pub(super) const OUTPUT: u16 = 0x007E;

    pub(super) const ALARM: u16 = 0x0080;
    pub(super) const ALARM_HISTORY: u16 = 0x0082;
    pub(super) const ALARM_HISTORY_END: u16 = ALARM_HISTORY + 20;
    pub(super) const COMMAND_POSITION: u16 = 0x00C6;
    pub(super) const COMMAND_SPEED_RPM: u16 = 0x00C8;
    pub(super) const COMMAND_SPEED_HZ: u16 = 0x00CA;
    pub(super) const FEEDBACK_POSITION: u16 = 0x00CC;
    pub(super) const FEEDBACK_SPEED_RPM: u16 = 0x00CE;
    pub(super) const FEEDBACK_SPEED_HZ: u16 = 0x00D0;
    pub(super) const DIRECT_IO: u16 = 0x00D4;
    pub(super) const DRIVER_TEMPERATURE: u16 = 0x00F8;
    pub(super) const MOTOR_TEMPERATURE: u16 = 0x00FA;
    pub(super) const FEEDBACK_COUNTER: u16 = 0x0120;
    pub(super) const COMMAND_COUNTER: u16 = 0x0122;
    pub(super) const OUTPUT_SIGNALS: u16 = 0x0178;

    // Maintenance commands: executed when the value changes from 0 to 1.
    pub(super) const ALARM_RESET: u16 = 0x0180;
    pub(super) const CLEAR_HISTORY: u16 = 0x0184;
    pub(super) const CLEAR_COMMUNICATION_ERRORS: u16 = 0x0188;
    pub(super) const PRESET_POSITION: u16 = 0x018A;
    pub(super) const CONFIGURATION: u16 = 0x018C;

    // Parameters.
    pub(super) const HOME_SPEED: u16 = 0x02B4;
    pub(super) const GEAR_A: u16 = 0x0380;
    pub(super) const GEAR_B: u16 = 0x0382;
    pub(super) const LIMIT_ACTION: u16 = 0x0386;
    pub(super) const LIMIT_POSITIVE: u16 = 0x0388;
    pub(super) const LIMIT_NEGATIVE: u16 = 0x038A;
}

/// Writable values with their power-on values and accepted ranges.
const SETTINGS: [(u16, i32, i32, i32); 22] = [
    (item::DATA_NUMBER, 0, 0, 255),
    (item::TYPE, 2, 0, 22),
    (item::POSITION, 0, i32::MIN, i32::MAX),
    (item::SPEED, 1000, -4_000_000, 4_000_000),
    (item::ACCELERATION, 1_000_000, 1, 1_000_000_000),
    (item::DECELERATION, 1_000_000, 1, 1_000_000_000),
    (item::CURRENT, 1000, 0, 1000),
    (item::TRIGGER, 0, -7, 1),
    (item::DESTINATION, 0, 0, 1),
    (item::INPUT_AUTO_OFF, 0, 0, 0xFFFF),
    (item::INPUT, 0, 0, 0xFFFF),
    (item::ALARM_RESET, 0, 0, 1),
    (item::CLEAR_HISTORY, 0, 0, 1),
    (item::CLEAR_COMMUNICATION_ERRORS, 0, 0, 1),
    (item::PRESET_POSITION, 0, 0, 1),
    (item::CONFIGURATION, 0, 0, 1),
    (item::HOME_SPEED, 5000, 1, 4_000_000),
    (item::GEAR_A, 1, 1, 0xFFFF),
    (item::GEAR_B, 1, 1, 0xFFFF),
    (item::LIMIT_ACTION, 3, -1, 3),
    (item::LIMIT_POSITIVE, i32::MAX, i32::MIN, i32::MAX),
    (item::LIMIT_NEGATIVE, i32::MIN, i32::MIN, i32::MAX),
];

/// Bits of the driver input.
mod input {
    pub(super) const HOME: i32 = 1 << 4;
    pub(super) const STOP: i32 = 1 << 5;
    pub(super) const FREE: i32 = 1 << 6;
    pub(super) const ALARM_RESET: i32 = 1 << 7;
    pub(super) const FORWARD: i32 = 1 << 14;
    pub(super) const REVERSE: i32 = 1 << 15;
}

/// Bits of the driver output in the assignment of the factory.
mod output {
    pub(super) const HOME_END: i32 = 1 << 4;
    pub(super) const READY: i32 = 1 << 5;
    pub(super) const ALARM: i32 = 1 << 7;
    pub(super) const MOVE: i32 = 1 << 13;
    pub(super) const IN_POSITION: i32 = 1 << 14;
}

/// Alarm codes.
pub(in crate::device) mod alarm {
    /// A limit switch was reached.
    pub(in crate::device) const HARDWARE_OVERTRAVEL: u8 = 0x66;
    /// A software limit was reached.
    pub(in crate::device) const SOFTWARE_OVERTRAVEL: u8 = 0x67;
    /// The emergency stop was pressed.
    pub(in crate::device) const EMERGENCY_STOP: u8 = 0x68;
}

/// Largest distance of the motor from its command for "in position", in steps.
const IN_POSITION_STEPS: f64 = 18.0;

/// Number of alarms in the drive's history.
const HISTORY: usize = 10;

/// One drive.
#[derive(Debug)]
pub(crate) struct Az {
    motor: Motor,
    /// Everything that can be written, by the address of its upper word.
    settings: BTreeMap<u16, i32>,
    /// Offset of the position counter from the encoder since the last preset, in steps.
    preset: f64,
    alarm: u8,
    history: [u8; HISTORY],
    /// An alarm that the present move will end in.
    alarm_at_end: Option<u8>,
    is_homed: bool,
}

impl Unit for Az {
    fn notice_end(&mut self, now: RigTime, world: &World) {
        if self.motor.is_moving(now, world) {
            return;
        }
        if let Some(code) = self.alarm_at_end.take() {
            self.set_alarm(code);
        }
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
            Request::ReadWrite { read, address, values } => {
                self.write(now, *address, values, world).and_then(|_| self.read(now, *read, world))
            }
            Request::Diagnose { function: 0, .. } => Ok(Reply::Done),
            Request::Diagnose { .. } => Err(Exception::Value),
            request => {
                let (address, values) = written(request).ok_or(Exception::Function)?;
                self.write(now, address, values, world)
            }
        }
    }

    fn apply_fault(&mut self, now: RigTime, fault: DeviceFault, world: &mut World) {
        match fault {
            DeviceFault::Alarm(code) => self.raise_alarm(now, code, world),
            DeviceFault::LimitSwitch => {
                self.raise_alarm(now, alarm::HARDWARE_OVERTRAVEL, world);
            }
            DeviceFault::EmergencyStop => {
                self.raise_alarm(now, alarm::EMERGENCY_STOP, world);
                self.motor.apply_fault(now, fault, world);
            }
            _ => self.motor.apply_fault(now, fault, world),
        }
    }

    /// The encoder keeps the position; settings that were not saved are lost.
    fn homed_by_person(&mut self) {
        self.is_homed = true;
    }

    fn power_cycle(&mut self, now: RigTime, world: &mut World) {
        *self = Self { history: self.history, ..Self::new(self.motor.power_cycled(now, world)) };
    }
}

impl Az {
    /// A drive that has just been switched on.
    pub(super) fn new(motor: Motor) -> Self {
        let mut settings: BTreeMap<_, _> =
            SETTINGS.iter().map(|&(address, initial, ..)| (address, initial)).collect();
        // A step is a thousandth of a revolution, times A / B.
        #[expect(clippy::cast_possible_truncation, reason = "a drive has fewer steps")]
        let steps = motor.steps_per_revolution() as i32;
        let [a, b] = if steps % 1000 == 0 { [1, steps / 1000] } else { [1000, steps] };
        settings.extend([(item::GEAR_A, a), (item::GEAR_B, b)]);
        Self {
            motor,
            settings,
            preset: 0.0,
            alarm: 0,
            history: [0; HISTORY],
            alarm_at_end: None,
            // The absolute encoder keeps its home without power.
            is_homed: true,
        }
    }

    /// An alarm as a fault of the hardware raises it. The motor stops.
    fn raise_alarm(&mut self, now: RigTime, code: u8, world: &mut World) {
        self.stop(now, world);
        self.set_alarm(code);
    }

    /// An emergency stop that is still pressed keeps its alarm.
    const fn reset_alarm(&mut self, world: &World) {
        if self.alarm != alarm::EMERGENCY_STOP || !world.is_stop_pressed() {
            self.alarm = 0;
        }
    }

    fn set_alarm(&mut self, code: u8) {
        self.alarm = code;
        self.history.rotate_right(1);
        self.history[0] = code;
    }

    fn read(&self, now: RigTime, block: Block, world: &mut World) -> Result<Reply, Exception> {
        let mut registers = Vec::with_capacity(usize::from(block.count));
        // Both words of a value are of the same moment.
        let mut last = None;
        for offset in 0..block.count {
            let address = block.address.checked_add(offset).ok_or(Exception::Address)?;
            let upper = address & !1;
            let value = match last {
                Some((known, value)) if known == upper => value,
                _ => self.value(now, upper, world).ok_or(Exception::Address)?,
            };
            last = Some((upper, value));
            registers.push(word(value, address == upper));
        }
        Ok(Reply::Registers(registers))
    }

    /// The value whose upper word is at this address.
    fn value(&self, now: RigTime, address: u16, world: &mut World) -> Option<i32> {
        let speed_hz = self.motor.speed(now, world);
        let history = item::ALARM_HISTORY..item::ALARM_HISTORY_END;
        Some(match address {
            item::OUTPUT => self.output(now, world),
            item::ALARM => i32::from(self.alarm),
            _ if history.contains(&address) => {
                i32::from(self.history[usize::from(address - item::ALARM_HISTORY) / 2])
            }
            item::COMMAND_POSITION | item::COMMAND_COUNTER => {
                counts(self.motor.command(now, world) + self.preset)
            }
            item::FEEDBACK_POSITION | item::FEEDBACK_COUNTER => {
                let jitter = world.encoder_jitter();
                let seen_at = world.position_seen_at(now);
                counts(self.motor.encoder(seen_at, world) + self.preset + jitter)
            }
            item::COMMAND_SPEED_HZ | item::FEEDBACK_SPEED_HZ => counts(speed_hz),
            item::COMMAND_SPEED_RPM | item::FEEDBACK_SPEED_RPM => {
                counts(speed_hz * 60.0 / self.motor.steps_per_revolution())
            }
            // The outputs of the connector are in the upper word; HOME-END is the first of them.
            item::DIRECT_IO => i32::from(self.is_homed) << 16,
            item::OUTPUT_SIGNALS => i32::from(self.is_homed),
            // In tenths of a degree: a drive at work in a warm room.
            item::DRIVER_TEMPERATURE => 412,
            item::MOTOR_TEMPERATURE => 365,
            0x017A | 0x017C | 0x017E => 0,
            // Warnings, communication errors, selected data, torque and the like.
            0x0096..=0x011E => 0,
            _ => return self.settings.get(&address).copied(),
        })
    }

    fn output(&self, now: RigTime, world: &World) -> i32 {
        let is_moving = self.motor.is_moving(now, world);
        let deviation = self.motor.command(now, world) - self.motor.encoder(now, world);
        let is_ready = !is_moving && self.can_move();
        let is_in_position = !is_moving && deviation.abs() <= IN_POSITION_STEPS;
        bits([
            (output::HOME_END, self.is_homed),
            (output::READY, is_ready),
            (output::ALARM, self.alarm != 0),
            (output::MOVE, is_moving),
            (output::IN_POSITION, is_in_position),
        ])
    }

    fn can_move(&self) -> bool {
        let input = self.settings[&item::INPUT];
        self.alarm == 0 && input & (input::STOP | input::FREE) == 0
    }

    fn write(
        &mut self,
        now: RigTime,
        address: u16,
        values: &[u16],
        world: &mut World,
    ) -> Result<Reply, Exception> {
        let addresses = addresses(address, values)?;
        // Nothing is written unless all of it can be.
        let mut written: Vec<(u16, i32)> = Vec::new();
        for (address, &word) in addresses.zip(values) {
            let upper = address & !1;
            if written.last().is_none_or(|last| last.0 != upper) {
                written.push((upper, *self.settings.get(&upper).ok_or(Exception::Address)?));
            }
            let value = &mut written.last_mut().expect("one was just pushed").1;
            *value = if address == upper {
                *value & 0xFFFF | i32::from(word) << 16
            } else {
                *value & !0xFFFF | i32::from(word)
            };
        }
        for &(address, value) in &written {
            let &(_, _, min, max) =
                SETTINGS.iter().find(|row| row.0 == address).expect("it is a setting");
            if !(min..=max).contains(&value) {
                return Err(Exception::Value);
            }
        }
        for &(address, value) in &written {
            let before = self.settings.insert(address, value).expect("it is a setting");
            self.obey(now, address, before, value, world);
        }
        if self.is_triggered(&written) {
            self.start_direct(now, world);
        }
        Ok(Reply::Done)
    }

    /// Applies the immediate effect of writing one value.
    fn obey(&mut self, now: RigTime, address: u16, before: i32, value: i32, world: &mut World) {
        let is_executed = before == 0 && value == 1;
        match address {
            item::INPUT => self.obey_input(now, value & !before, before & !value, world),
            item::INPUT_AUTO_OFF => {
                self.obey_input(now, value, 0, world);
                self.settings.insert(address, 0);
            }
            item::ALARM_RESET if is_executed => self.reset_alarm(world),
            item::CLEAR_HISTORY if is_executed => self.history = [0; HISTORY],
            item::PRESET_POSITION if is_executed => {
                self.preset = -self.motor.command(now, world);
            }
            _ => {}
        }
    }

    fn obey_input(&mut self, now: RigTime, rising: i32, falling: i32, world: &mut World) {
        if rising & input::ALARM_RESET != 0 {
            self.reset_alarm(world);
        }
        let was_going = falling & (input::FORWARD | input::REVERSE) != 0;
        if rising & (input::STOP | input::FREE) != 0 || was_going {
            self.stop(now, world);
        }
        let speed = f64::from(self.settings[&item::HOME_SPEED]);
        if rising & input::HOME != 0 && self.can_move() {
            self.is_homed = false;
            self.go_home(now, speed, world);
        } else if rising & input::FORWARD != 0 {
            self.start(now, f64::INFINITY, speed, world);
        } else if rising & input::REVERSE != 0 {
            self.start(now, f64::NEG_INFINITY, speed, world);
        }
    }

    fn stop(&mut self, now: RigTime, world: &mut World) {
        let deceleration = f64::from(self.settings[&item::DECELERATION]);
        self.motor.stop(now, deceleration, world);
        self.alarm_at_end = None;
    }

    fn is_triggered(&self, written: &[(u16, i32)]) -> bool {
        let item = match self.settings[&item::TRIGGER] {
            1 => item::TRIGGER,
            -1 => item::CURRENT,
            -2 => item::DECELERATION,
            -3 => item::ACCELERATION,
            -4 => item::SPEED,
            -5 => item::POSITION,
            -6 => item::TYPE,
            -7 => item::DATA_NUMBER,
            _ => return false,
        };
        written.iter().any(|&(address, _)| address == item)
    }

    fn start_direct(&mut self, now: RigTime, world: &mut World) {
        let position = f64::from(self.settings[&item::POSITION]);
        let speed = f64::from(self.settings[&item::SPEED]);
        let target = match self.settings[&item::TYPE] {
            // Absolute; wrapping types are the same on an axis that does not wrap.
            1 | 8..=11 => position - self.preset,
            2 => self.motor.command(now, world) + position,
            3 => self.motor.encoder(now, world) + position,
            7 => speed.signum() * f64::INFINITY,
            // Push-motion and speed control are not simulated.
            _ => return,
        };
        self.start(now, target, speed.abs(), world);
    }

    /// Sends the motor to `target` in steps of the encoder, or as far as the limits allow.
    fn start(&mut self, now: RigTime, target: f64, speed: f64, world: &mut World) {
        if !self.can_move() || speed == 0.0 {
            return;
        }
        let (target, alarm) = self.within_limits(target, world);
        self.alarm_at_end = alarm;
        self.motor.go(now, target, self.pace(speed), world);
    }

    /// Sends the motor to zero of the position counter.
    fn go_home(&mut self, now: RigTime, speed: f64, world: &mut World) {
        let (target, alarm) = self.within_limits(-self.preset, world);
        self.alarm_at_end = alarm;
        match alarm {
            None => self.motor.home_at(now, target, self.pace(speed), world),
            // It ends at a limit, which is not its home.
            Some(_) => self.motor.go(now, target, self.pace(speed), world),
        }
    }

    fn pace(&self, speed: f64) -> Pace {
        let rate = |item| f64::from(self.settings[&item]);
        let (acceleration, deceleration) = (rate(item::ACCELERATION), rate(item::DECELERATION));
        Pace { speed, acceleration, deceleration }
    }

    /// The target that will be reached, and the alarm that then comes.
    fn within_limits(&self, target: f64, world: &World) -> (f64, Option<u8>) {
        let action = self.settings[&item::LIMIT_ACTION];
        let low = f64::from(self.settings[&item::LIMIT_NEGATIVE]) - self.preset;
        let high = f64::from(self.settings[&item::LIMIT_POSITIVE]) - self.preset;
        // Limits that are the wrong way round are off, as the drive's manual says.
        let has_limits = action >= 0 && low < high;
        let allowed = if has_limits { target.clamp(low, high) } else { target };
        // Wrong limits may send the motor beyond its travel, but the switches stop it.
        let (low, high) = self.motor.travel(world);
        let reached = allowed.clamp(low, high);
        let alarm = if reached == allowed {
            (allowed != target && action >= 2).then_some(alarm::SOFTWARE_OVERTRAVEL)
        } else {
            Some(alarm::HARDWARE_OVERTRAVEL)
        };
        (reached, alarm)
    }
}
