//! Drives as these tests understand their manuals: registers, and a motor that takes its time.

use std::{
    collections::BTreeMap,
    sync::{Arc, LazyLock, Mutex},
};

use rig_files::instrument::{IAI_RC, LEADSHINE_PR, ORIENTAL_AZ};
use rig_stage::RegisterMap;
use tokio::time::Instant;

use crate::peer::with_crc;

/// What differs between the makes.
#[derive(Debug)]
pub(crate) struct Make {
    pub(crate) map: &'static LazyLock<RegisterMap>,
    /// Brings the registers that are read up to date.
    show: fn(&mut State),
    /// Carries out a write to these registers.
    act: fn(&mut State, first: u16, last: u16),
    /// Carries out a change of a coil.
    switch: fn(&mut State, coil: u16, is_on: bool),
}

pub(crate) static AZ: Make =
    Make { map: &ORIENTAL_AZ, show: az::show, act: az::act, switch: |_, _, _| {} };
pub(crate) static IAI: Make =
    Make { map: &IAI_RC, show: iai::show, act: iai::act, switch: iai::switch };
pub(crate) static LEADSHINE: Make =
    Make { map: &LEADSHINE_PR, show: leadshine::show, act: leadshine::act, switch: |_, _, _| {} };

pub(crate) static MAKES: [&Make; 3] = [&AZ, &IAI, &LEADSHINE];

/// A drive and the carriage it moves. Clones are one drive.
#[derive(Debug, Clone)]
pub(crate) struct Drive {
    state: Arc<Mutex<State>>,
}

#[derive(Debug)]
pub(crate) struct State {
    make: &'static Make,
    unit: u8,
    registers: BTreeMap<u16, u16>,
    coils: BTreeMap<u16, bool>,
    motion: Motion,
    is_homed: bool,
    /// The code of an alarm; zero for one without a code.
    alarm: Option<u16>,
    /// Every request that reached the drive.
    seen: Vec<Vec<u8>>,
    /// The motor stops this far short of its target, in counts, while the drive thinks otherwise.
    lost: i32,
    ignores_moves: bool,
    is_mute: bool,
    /// As it is set in the drive.
    steps_per_revolution: u16,
}

#[derive(Debug, Clone, Copy)]
struct Motion {
    from: i32,
    to: i32,
    started: Instant,
    seconds: f64,
}

impl Motion {
    fn standing(at: i32) -> Self {
        Self { from: at, to: at, started: Instant::now(), seconds: 0.0 }
    }

    fn is_moving(&self) -> bool {
        self.started.elapsed().as_secs_f64() < self.seconds
    }

    fn position(&self) -> i32 {
        if !self.is_moving() {
            return self.to;
        }
        let share = self.started.elapsed().as_secs_f64() / self.seconds;
        self.from + ((f64::from(self.to) - f64::from(self.from)) * share) as i32
    }
}

impl Drive {
    pub(crate) fn new(make: &'static Make, unit: u8) -> Self {
        let state = State {
            make,
            unit,
            registers: BTreeMap::new(),
            coils: BTreeMap::new(),
            motion: Motion::standing(0),
            is_homed: true,
            alarm: None,
            seen: Vec::new(),
            lost: 0,
            ignores_moves: false,
            is_mute: false,
            steps_per_revolution: 10_000,
        };
        Self { state: Arc::new(Mutex::new(state)) }
    }

    pub(crate) fn position(&self) -> i32 {
        self.state.lock().unwrap().motion.position()
    }

    pub(crate) fn is_moving(&self) -> bool {
        self.state.lock().unwrap().motion.is_moving()
    }

    pub(crate) fn seen(&self) -> Vec<Vec<u8>> {
        self.state.lock().unwrap().seen.clone()
    }

    pub(crate) fn long(&self, address: u16) -> i32 {
        self.state.lock().unwrap().long(address)
    }

    pub(crate) fn raise_alarm(&self, code: u16) {
        let mut state = self.state.lock().unwrap();
        state.alarm = Some(code);
        state.halt();
    }

    pub(crate) fn set_steps_per_revolution(&self, steps: u16) {
        self.state.lock().unwrap().steps_per_revolution = steps;
    }

    pub(crate) fn lose_counts(&self, counts: i32) {
        self.state.lock().unwrap().lost = counts;
    }

    pub(crate) fn ignore_moves(&self) {
        self.state.lock().unwrap().ignores_moves = true;
    }

    pub(crate) fn forget_home(&self) {
        self.state.lock().unwrap().is_homed = false;
    }

    /// Keeps moving for a minute, as after an unseen command.
    pub(crate) fn run_away(&self) {
        let mut state = self.state.lock().unwrap();
        let from = state.motion.position();
        state.motion = Motion { to: from + 60_000, seconds: 60.0, ..Motion::standing(from) };
    }

    /// Off and on again: all written values are lost.
    pub(crate) fn restart(&self) {
        let mut state = self.state.lock().unwrap();
        state.registers.clear();
        state.coils.clear();
        state.halt();
    }

    /// Receives the next request and does not answer it.
    pub(crate) fn swallow_an_answer(&self) {
        self.state.lock().unwrap().is_mute = true;
    }

    /// Answers as a device on the line does: nothing to another unit, nothing to a broadcast.
    pub(crate) fn reply(&self, request: &[u8]) -> Vec<u8> {
        let mut state = self.state.lock().unwrap();
        if request[0] != state.unit && request[0] != 0 {
            return vec![];
        }
        state.seen.push(request.to_vec());
        let reply = state.answer(request);
        let is_mute = std::mem::take(&mut state.is_mute) || request[0] == 0;
        if is_mute { vec![] } else { with_crc(&reply) }
    }
}

impl State {
    fn answer(&mut self, request: &[u8]) -> Vec<u8> {
        let word = |at: usize| u16::from_be_bytes([request[at], request[at + 1]]);
        let (address, value) = (word(2), word(4));
        let make = self.make;
        match request[1] {
            3 => {
                (make.show)(self);
                let mut reply = vec![self.unit, 3, 2 * value as u8];
                for register in address..address + value {
                    reply.extend(self.word(register).to_be_bytes());
                }
                return reply;
            }
            5 => {
                let is_on = value == 0xFF00;
                if self.coils.insert(address, is_on) != Some(is_on) {
                    (make.switch)(self, address, is_on);
                }
            }
            6 => {
                self.registers.insert(address, value);
                (make.act)(self, address, address);
            }
            0x10 => {
                for (register, bytes) in
                    (address..).zip(request[7..].chunks_exact(2)).take(value.into())
                {
                    self.registers.insert(register, u16::from_be_bytes([bytes[0], bytes[1]]));
                }
                (make.act)(self, address, address + value - 1);
            }
            other => return vec![self.unit, other | 0x80, 1],
        }
        request[..6].to_vec()
    }

    fn word(&self, address: u16) -> u16 {
        self.registers.get(&address).copied().unwrap_or(0)
    }

    fn long(&self, address: u16) -> i32 {
        (i32::from(self.word(address)) << 16) | i32::from(self.word(address + 1))
    }

    fn set_long(&mut self, address: u16, value: i32) {
        self.registers.insert(address, (value >> 16) as u16);
        self.registers.insert(address + 1, value as u16);
    }

    fn is_on(&self, coil: u16) -> bool {
        self.coils.get(&coil).copied().unwrap_or(false)
    }

    /// The position of the encoder.
    fn measured(&self) -> i32 {
        let lost = if self.motion.is_moving() { 0 } else { self.lost };
        self.motion.position() - lost
    }

    fn start(&mut self, to: i32, counts_per_s: f64, ramp_s: f64) {
        if self.ignores_moves || self.alarm.is_some() {
            return;
        }
        let from = self.motion.position();
        let seconds = (f64::from(to) - f64::from(from)).abs() / counts_per_s + ramp_s;
        self.motion = Motion { to, seconds, ..Motion::standing(from) };
    }

    fn home(&mut self) {
        if self.ignores_moves {
            return;
        }
        self.motion = Motion { to: 0, seconds: 1.5, ..Motion::standing(self.motion.position()) };
        self.is_homed = true;
    }

    fn halt(&mut self) {
        self.motion = Motion::standing(self.motion.position());
    }
}

mod az {
    use super::State;

    pub(super) fn show(state: &mut State) {
        let is_moving = state.motion.is_moving();
        let outputs = u16::from(is_moving) << 13
            | u16::from(state.alarm.is_some()) << 7
            | u16::from(!is_moving && state.alarm.is_none()) << 5
            | u16::from(state.is_homed) << 4;
        state.registers.insert(0x7F, outputs);
        state.registers.insert(0x81, state.alarm.unwrap_or_default());
        state.set_long(0x380, 1000);
        state.set_long(0x382, state.steps_per_revolution.into());
        state.set_long(0x120, state.measured());
        state.set_long(0x122, state.motion.position());
    }

    pub(super) fn act(state: &mut State, first: u16, last: u16) {
        let touches = |address: u16| first <= address && address <= last;
        let is_stopped = state.word(0x7D) & 1 << 5 != 0;
        if touches(0x7D) {
            if is_stopped {
                state.halt();
            } else if state.word(0x7D) & 1 << 4 != 0 {
                state.home();
            }
        }
        if touches(0x67) && state.long(0x66) == 1 && !is_stopped && !state.motion.is_moving() {
            let (speed, acceleration) = (f64::from(state.long(0x5E)), f64::from(state.long(0x60)));
            state.start(state.long(0x5C), speed, speed / acceleration);
        }
        if touches(0x181) && state.long(0x180) == 1 {
            state.alarm = None;
        }
    }
}

mod iai {
    use super::State;

    const SERVO: u16 = 0x0403;
    const MODBUS: u16 = 0x0427;

    pub(super) fn show(state: &mut State) {
        let is_moving = state.motion.is_moving();
        state.set_long(0x9000, state.measured());
        state.registers.insert(0x9002, state.alarm.unwrap_or_default());
        let status = u16::from(!is_moving) << 3
            | u16::from(state.is_homed) << 4
            | u16::from(state.is_on(SERVO) && state.alarm.is_none()) << 12
            | 1 << 13;
        state.registers.insert(0x9005, status);
        state.registers.insert(0x9007, u16::from(is_moving) << 5);
    }

    pub(super) fn act(state: &mut State, first: u16, last: u16) {
        let is_started = first <= 0x9901 && 0x9901 <= last;
        if !(is_started && state.is_on(SERVO) && state.is_on(MODBUS)) {
            return;
        }
        if state.is_homed {
            let speed = f64::from(state.long(0x9904));
            // Hundredths of free fall, in hundredths of a millimetre.
            let acceleration = f64::from(state.word(0x9906)) * 9806.65;
            state.start(state.long(0x9900), speed, speed / acceleration);
        } else {
            state.alarm = Some(0x83);
        }
    }

    pub(super) fn switch(state: &mut State, coil: u16, is_on: bool) {
        match (coil, is_on) {
            (0x040B, true) => state.home(),
            (0x0407, false) => state.alarm = None,
            (0x042C, true) => state.halt(),
            _ => {}
        }
    }
}

mod leadshine {
    use super::State;

    pub(super) fn show(state: &mut State) {
        let is_moving = state.motion.is_moving();
        let status = u16::from(state.alarm.is_some())
            | state.word(0x000F) << 1
            | u16::from(is_moving) << 2
            | if is_moving { 0 } else { 0x30 }
            | u16::from(state.is_homed) << 6;
        state.registers.insert(0x0001, state.steps_per_revolution);
        state.registers.insert(0x1003, status);
        state.registers.insert(0x2203, state.alarm.unwrap_or_default());
        state.set_long(0x602C, state.measured());
    }

    pub(super) fn act(state: &mut State, first: u16, last: u16) {
        let touches = |address: u16| first <= address && address <= last;
        if touches(0x6207) && state.word(0x6207) == 0x10 && state.word(0x000F) == 1 {
            // 10 000 pulses a revolution.
            let rpm = f64::from(state.word(0x6203));
            let ramp_s = rpm * f64::from(state.word(0x6204)) * 1e-6;
            state.start(state.long(0x6201), rpm * 10_000.0 / 60.0, ramp_s);
        }
        if touches(0x6002) {
            match state.word(0x6002) {
                0x20 => state.home(),
                0x40 => state.halt(),
                _ => {}
            }
        }
        if touches(0x1801) && state.word(0x1801) == 0x1111 {
            state.alarm = None;
        }
    }
}
