//! A controller of IAI's RC series (PCON, ACON, SCON, ERC) as a Modbus unit.
//!
//! Positions are hundredths of a millimetre. Writing the lower word of the target starts the move;
//! most commands are coils, some of which act on an edge. The motor is off and has no home when the
//! controller is switched on.
//!
//! # Source
//! IAI, Serial Communication (Modbus version), chapters on registers, coils and positioning by
//! direct numerical specification.

#[cfg(test)]
mod tests;

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

/// Registers of the status.
mod monitor {
    pub(super) const FIRST: u16 = 0x9000;
    pub(super) const POSITION: u16 = 0x9000;
    pub(super) const ALARM: u16 = 0x9002;
    pub(super) const STATUS_1: u16 = 0x9005;
    pub(super) const STATUS_EXTENDED: u16 = 0x9007;
    pub(super) const SYSTEM_STATUS: u16 = 0x9008;
    pub(super) const SPEED: u16 = 0x900A;
    pub(super) const DEVIATION: u16 = 0x900E;
    pub(super) const LAST: u16 = 0x900F;
}

/// Registers that command a move.
mod order {
    pub(super) const POSITION: u16 = 0x9900;
    pub(super) const BAND: u16 = 0x9902;
    pub(super) const SPEED: u16 = 0x9904;
    pub(super) const ACCELERATION: u16 = 0x9906;
    pub(super) const CONTROL: u16 = 0x9908;
    pub(super) const LAST: u16 = 0x9908;
}

/// Coils.
mod coil {
    pub(super) const SERVO_ON: u16 = 0x0403;
    pub(super) const ALARM_RESET: u16 = 0x0407;
    pub(super) const BRAKE: u16 = 0x0408;
    pub(super) const PAUSE: u16 = 0x040A;
    pub(super) const HOME: u16 = 0x040B;
    pub(super) const MODBUS_COMMANDS: u16 = 0x0427;
    pub(super) const STOP: u16 = 0x042C;
}

/// Bits of the device status.
mod status {
    pub(super) const IN_POSITION: u16 = 1 << 3;
    pub(super) const HOMED: u16 = 1 << 4;
    pub(super) const PAUSED: u16 = 1 << 5;
    pub(super) const ALARM: u16 = 1 << 10;
    pub(super) const SERVO: u16 = 1 << 12;
    pub(super) const READY: u16 = 1 << 13;
    pub(super) const EMERGENCY_STOP: u16 = 1 << 15;
    /// Of the extended status.
    pub(super) const MOVING: u16 = 1 << 5;
    pub(super) const MODBUS: u16 = 1 << 8;
    pub(super) const HOMING: u16 = 1 << 11;
}

/// Bits of the system status.
const SYSTEM_POWER: i32 = 1;
const SYSTEM_SERVO_COMMAND: i32 = 1 << 1;
const SYSTEM_SERVO: i32 = 1 << 2;
const SYSTEM_HOMED: i32 = 1 << 3;

/// Bits of the control flags of a move.
const INCREMENTAL: u16 = 1 << 3;

/// Alarm codes.
mod alarm {
    /// A move was commanded before home was found.
    pub(super) const NO_HOME: u16 = 0x083;
    /// A speed beyond the actuator's.
    pub(super) const SPEED: u16 = 0x0A1;
    /// The stroke end was reached.
    pub(super) const STROKE: u16 = 0x0D9;
}

/// Largest target, hundredths of a millimetre.
const MAX_POSITION: i32 = 999_999;
/// Distance from the stroke end at which a move beyond it ends, hundredths of a millimetre.
const SHORT_OF_END: f64 = 20.0;
/// Highest speed of the actuator, hundredths of a millimetre a second.
const MAX_SPEED: i32 = 100_000;
/// A hundredth of the standard acceleration of free fall, in hundredths of a millimetre a second
/// squared.
const HUNDREDTH_G: f64 = 9806.65;
/// Speed of homing.
const HOME_SPEED: f64 = 2000.0;
/// The states of the coils.
#[derive(Debug, Clone, Copy, Default)]
#[expect(clippy::struct_excessive_bools, reason = "each is a coil of the controller")]
struct Switches {
    servo_on: bool,
    alarm_reset: bool,
    brake_released: bool,
    pause: bool,
    home: bool,
    modbus_commands: bool,
}

/// One controller.
#[derive(Debug)]
pub(crate) struct Iai {
    motor: Motor,
    switches: Switches,
    /// The order registers from [`order::POSITION`] on.
    orders: [u16; 9],
    alarm: u16,
    is_homed: bool,
    is_homing: bool,
    /// The rest of a move that was paused.
    paused: Option<(f64, Pace)>,
}

impl Unit for Iai {
    fn notice_end(&mut self, now: RigTime, world: &World) {
        if self.paused.is_none()
            && let Some(is_home) = self.motor.end_homing(now, world)
        {
            self.is_homing = false;
            self.is_homed = is_home && !world.is_stop_pressed();
        }
    }

    fn answer(
        &mut self,
        now: RigTime,
        request: &Request,
        world: &mut World,
    ) -> Result<Reply, Exception> {
        match request {
            Request::ReadCoils(block) => {
                read_each(*block, |address| self.coil(now, address, world)).map(Reply::Bits)
            }
            Request::ReadDiscreteInputs(block) => {
                let bit = |address| self.status_bit(now, address, world);
                read_each(*block, bit).map(Reply::Bits)
            }
            Request::ReadHoldingRegisters(block) | Request::ReadInputRegisters(block) => {
                self.read(now, *block, world)
            }
            Request::WriteCoil { address, value } => self.switch(now, *address, *value, world),
            request => {
                let (address, values) = written(request).ok_or(Exception::Function)?;
                self.write(now, address, values, world)
            }
        }
    }

    fn apply_fault(&mut self, now: RigTime, fault: DeviceFault, world: &mut World) {
        match fault {
            DeviceFault::Alarm(code) => self.raise(now, u16::from(code), world),
            DeviceFault::LimitSwitch => self.raise(now, alarm::STROKE, world),
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

impl Iai {
    /// A controller that has just been switched on.
    pub(super) fn new(motor: Motor) -> Self {
        let mut orders = [0; 9];
        orders[usize::from(order::BAND - order::POSITION) + 1] = 10;
        orders[usize::from(order::SPEED - order::POSITION) + 1] = 1000;
        orders[usize::from(order::ACCELERATION - order::POSITION)] = 30;
        Self {
            motor,
            // A controller with its switch at AUTO follows its terminals until Modbus takes
            // control.
            switches: Switches::default(),
            orders,
            alarm: 0,
            is_homed: false,
            is_homing: false,
            paused: None,
        }
    }

    fn raise(&mut self, now: RigTime, code: u16, world: &mut World) {
        self.stop(now, world);
        self.alarm = code;
    }

    /// Coils can be read back; the status is among the coils too.
    fn coil(&self, now: RigTime, address: u16, world: &World) -> Option<bool> {
        let s = &self.switches;
        Some(match address {
            coil::SERVO_ON => s.servo_on,
            coil::ALARM_RESET => s.alarm_reset,
            coil::BRAKE => s.brake_released,
            coil::PAUSE => s.pause,
            coil::HOME => s.home,
            coil::MODBUS_COMMANDS => s.modbus_commands,
            0x0400..=0x042F => false,
            _ => return self.status_bit(now, address, world),
        })
    }

    /// The status registers bit by bit, the highest bit at the lowest address.
    fn status_bit(&self, now: RigTime, address: u16, world: &World) -> Option<bool> {
        let register = match address {
            0x0100..=0x010F => self.status_1(now, world),
            0x0110..=0x011F => 0,
            0x0120..=0x012F => self.status_extended(now, world),
            _ => return None,
        };
        Some(register >> (0xF - (address & 0xF)) & 1 == 1)
    }

    fn status_1(&self, now: RigTime, world: &World) -> u16 {
        let is_moving = self.motor.is_moving(now, world);
        let band = f64::from(self.long(order::BAND));
        let deviation = self.motor.target() - self.motor.encoder(now, world);
        let is_there = self.is_homed && !is_moving && deviation.abs() <= band;
        bits([
            (status::IN_POSITION, is_there && self.paused.is_none()),
            (status::HOMED, self.is_homed),
            (status::PAUSED, self.switches.pause),
            (status::ALARM, self.alarm != 0),
            (status::SERVO, self.has_servo(world)),
            (status::READY, self.alarm == 0 && !world.is_stop_pressed()),
            (status::EMERGENCY_STOP, world.is_stop_pressed()),
        ])
    }

    fn status_extended(&self, now: RigTime, world: &World) -> u16 {
        bits([
            (status::MOVING, self.motor.is_moving(now, world)),
            (status::MODBUS, self.switches.modbus_commands),
            (status::HOMING, self.is_homing),
        ])
    }

    fn system_status(&self, world: &World) -> i32 {
        bits([
            (SYSTEM_POWER, true),
            (SYSTEM_SERVO_COMMAND, self.switches.servo_on),
            (SYSTEM_SERVO, self.has_servo(world)),
            (SYSTEM_HOMED, self.is_homed),
        ])
    }

    fn has_servo(&self, world: &World) -> bool {
        self.switches.servo_on && self.alarm == 0 && !world.is_stop_pressed()
    }

    fn read(&self, now: RigTime, block: Block, world: &World) -> Result<Reply, Exception> {
        let long = |value: f64, at: u16, address: u16| word(counts(value), address == at);
        let position = self.motor.encoder(world.position_seen_at(now), world);
        let register = |address| {
            Some(match address {
                monitor::POSITION | 0x9001 => long(position, monitor::POSITION, address),
                monitor::ALARM => self.alarm,
                monitor::STATUS_1 => self.status_1(now, world),
                monitor::STATUS_EXTENDED => self.status_extended(now, world),
                monitor::SYSTEM_STATUS | 0x9009 => {
                    word(self.system_status(world), address == monitor::SYSTEM_STATUS)
                }
                monitor::SPEED | 0x900B => {
                    long(self.motor.speed(now, world), monitor::SPEED, address)
                }
                monitor::DEVIATION | 0x900F => {
                    let deviation = self.motor.command(now, world) - position;
                    long(deviation, monitor::DEVIATION, address)
                }
                monitor::FIRST..=monitor::LAST => 0,
                // The details of the last alarm: its code, and registers for the manufacturer.
                0x0500 => self.alarm,
                0x0501..=0x0505 => 0,
                order::POSITION..=order::LAST => {
                    self.orders[usize::from(address - order::POSITION)]
                }
                _ => return None,
            })
        };
        read_each(block, register).map(Reply::Registers)
    }

    /// An order of two words.
    fn long(&self, address: u16) -> i32 {
        let at = usize::from(address - order::POSITION);
        long([self.orders[at], self.orders[at + 1]])
    }

    fn switch(
        &mut self,
        now: RigTime,
        address: u16,
        value: bool,
        world: &mut World,
    ) -> Result<Reply, Exception> {
        let before = self.switches;
        let s = &mut self.switches;
        match address {
            coil::MODBUS_COMMANDS => s.modbus_commands = value,
            // Until Modbus has control, commands come from the terminals.
            0x0400..=0x042F if !s.modbus_commands => return Ok(Reply::Done),
            coil::SERVO_ON => {
                s.servo_on = value;
                if !value {
                    self.stop(now, world);
                }
            }
            coil::ALARM_RESET => {
                s.alarm_reset = value;
                // On the falling edge.
                if before.alarm_reset && !value {
                    self.alarm = 0;
                    self.paused = None;
                }
            }
            coil::BRAKE => s.brake_released = value,
            coil::HOME => {
                s.home = value;
                // On the rising edge.
                if !before.home && value && self.has_servo(world) {
                    self.is_homed = false;
                    self.is_homing = true;
                    let pace = self.pace(HOME_SPEED);
                    self.motor.home(now, pace, world);
                }
            }
            coil::PAUSE => {
                s.pause = value;
                self.pause_or_go_on(now, before.pause, value, world);
            }
            coil::STOP if value => self.stop(now, world),
            coil::STOP => {}
            0x0400..=0x042F => {}
            _ => return Err(Exception::Address),
        }
        Ok(Reply::Done)
    }

    fn pause_or_go_on(&mut self, now: RigTime, was: bool, is: bool, world: &mut World) {
        if !was && is && self.motor.is_moving(now, world) {
            let (target, pace) =
                (self.motor.target(), self.pace(f64::from(self.long(order::SPEED))));
            self.motor.pause(now, pace.deceleration, world);
            self.paused = Some((target, pace));
        } else if was
            && !is
            && let Some((target, pace)) = self.paused.take()
        {
            self.motor.go_on(now, target, pace, world);
        }
    }

    fn stop(&mut self, now: RigTime, world: &mut World) {
        let deceleration = self.pace(1.0).deceleration;
        self.motor.stop(now, deceleration, world);
        self.paused = None;
        self.is_homing = false;
    }

    fn write(
        &mut self,
        now: RigTime,
        address: u16,
        values: &[u16],
        world: &mut World,
    ) -> Result<Reply, Exception> {
        let addresses = addresses(address, values)?;
        if address < order::POSITION || order::LAST + 1 < addresses.end {
            return Err(Exception::Address);
        }
        let before = self.orders;
        for (address, value) in addresses.clone().zip(values) {
            self.orders[usize::from(address - order::POSITION)] = *value;
        }
        let is_valid = self.long(order::POSITION).abs() <= MAX_POSITION
            && self.long(order::SPEED) > 0
            && self.orders[usize::from(order::ACCELERATION - order::POSITION)] > 0;
        if !is_valid {
            self.orders = before;
            return Err(Exception::Value);
        }
        let is_written = |wanted: u16| addresses.contains(&wanted);
        // A new speed or acceleration alone acts on the present target.
        let starts = [order::POSITION + 1, order::SPEED + 1, order::ACCELERATION];
        if starts.into_iter().any(is_written) {
            self.start(now, world);
        }
        Ok(Reply::Done)
    }

    fn start(&mut self, now: RigTime, world: &mut World) {
        // Without servo, under an alarm or while the terminals command, it is ignored.
        if !(self.has_servo(world) && self.switches.modbus_commands) || self.switches.pause {
            return;
        }
        if !self.is_homed {
            return self.raise(now, alarm::NO_HOME, world);
        }
        let speed = self.long(order::SPEED);
        if speed > MAX_SPEED {
            return self.raise(now, alarm::SPEED, world);
        }
        let control = usize::from(order::CONTROL - order::POSITION);
        let position = f64::from(self.long(order::POSITION));
        let is_incremental = self.orders[control] & INCREMENTAL != 0;
        let from = if is_incremental { self.motor.command(now, world) } else { 0.0 };
        self.orders[control] = 0;
        let (low, high) = self.motor.travel(world);
        let target = (from + position).clamp(low, high);
        let is_beyond = target != from + position;
        let target =
            if is_beyond { target.clamp(low + SHORT_OF_END, high - SHORT_OF_END) } else { target };
        let pace = self.pace(f64::from(speed));
        self.motor.go(now, target, pace, world);
    }

    fn pace(&self, speed: f64) -> Pace {
        let at = usize::from(order::ACCELERATION - order::POSITION);
        let acceleration = f64::from(self.orders[at]) * HUNDREDTH_G;
        Pace { speed, acceleration, deceleration: acceleration }
    }
}
