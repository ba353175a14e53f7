//! An AZ drive as these tests understand its manual: registers, and a motor that takes its time.

use std::sync::{Arc, Mutex};

use tokio::time::Instant;

use crate::peer::with_crc;

/// The drive and the carriage it moves. Clones are one drive.
#[derive(Debug, Clone)]
pub(crate) struct Az {
    state: Arc<Mutex<State>>,
}

#[derive(Debug)]
struct State {
    unit: u8,
    registers: Vec<u16>,
    motion: Motion,
    is_homed: bool,
    alarm: u16,
    /// Every request that reached the drive.
    seen: Vec<Vec<u8>>,
    /// The motor stops this far short of its target, in counts, while the drive thinks otherwise.
    lost: i32,
    ignores_moves: bool,
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

impl Az {
    pub(crate) fn new(unit: u8) -> Self {
        let state = State {
            unit,
            registers: vec![0; 0x0400],
            motion: Motion::standing(0),
            is_homed: true,
            alarm: 0,
            seen: Vec::new(),
            lost: 0,
            ignores_moves: false,
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

    pub(crate) fn register(&self, address: u16) -> u16 {
        self.state.lock().unwrap().registers[usize::from(address)]
    }

    pub(crate) fn raise_alarm(&self, code: u16) {
        let mut state = self.state.lock().unwrap();
        state.alarm = code;
        state.halt();
    }

    pub(crate) fn lose_steps(&self, counts: i32) {
        self.state.lock().unwrap().lost = counts;
    }

    pub(crate) fn ignore_moves(&self) {
        self.state.lock().unwrap().ignores_moves = true;
    }

    pub(crate) fn forget_home(&self) {
        self.state.lock().unwrap().is_homed = false;
    }

    /// Answers as a device on the line does: nothing to another unit, nothing to a broadcast.
    pub(crate) fn reply(&self, request: &[u8]) -> Vec<u8> {
        let mut state = self.state.lock().unwrap();
        if request[0] != state.unit && request[0] != 0 {
            return vec![];
        }
        state.seen.push(request.to_vec());
        let reply = state.answer(request);
        if request[0] == 0 { vec![] } else { with_crc(&reply) }
    }
}

impl State {
    fn answer(&mut self, request: &[u8]) -> Vec<u8> {
        let word = |at: usize| u16::from_be_bytes([request[at], request[at + 1]]);
        let (address, count) = (word(2), word(4));
        match request[1] {
            3 => {
                self.show();
                let mut reply = vec![self.unit, 3, 2 * count as u8];
                for register in address..address + count {
                    reply.extend(self.registers[usize::from(register)].to_be_bytes());
                }
                reply
            }
            6 => {
                self.registers[usize::from(address)] = count;
                self.act(address, address);
                request[..6].to_vec()
            }
            0x10 => {
                for (n, bytes) in request[7..request.len() - 2].chunks(2).enumerate() {
                    self.registers[usize::from(address) + n] =
                        u16::from_be_bytes([bytes[0], bytes[1]]);
                }
                self.act(address, address + count - 1);
                request[..6].to_vec()
            }
            other => vec![self.unit, other | 0x80, 1],
        }
    }

    fn long(&self, address: usize) -> i32 {
        (i32::from(self.registers[address]) << 16) | i32::from(self.registers[address + 1])
    }

    fn show(&mut self) {
        let is_moving = self.motion.is_moving();
        let command = self.motion.position();
        let measured = if is_moving { command } else { command - self.lost };
        let is_ready = !is_moving && self.alarm == 0;
        self.registers[0x7F] = u16::from(is_moving) << 13
            | u16::from(self.alarm != 0) << 7
            | u16::from(is_ready) << 5
            | u16::from(self.is_homed) << 4;
        self.registers[0x81] = self.alarm;
        for (address, value) in [(0x122, command), (0x120, measured)] {
            self.registers[address] = (value >> 16) as u16;
            self.registers[address + 1] = value as u16;
        }
    }

    fn act(&mut self, first: u16, last: u16) {
        let touches = |address: u16| first <= address && address <= last;
        if touches(0x7D) {
            if self.registers[0x7D] & 1 << 5 != 0 {
                self.halt();
            } else if self.registers[0x7D] & 1 << 4 != 0 {
                self.motion = Motion { to: 0, seconds: 1.5, ..self.motion_from_here() };
                self.is_homed = true;
            }
        }
        if touches(0x67) && self.long(0x66) == 1 {
            let is_stopped = self.registers[0x7D] & 1 << 5 != 0;
            if self.ignores_moves || is_stopped || self.alarm != 0 || self.motion.is_moving() {
                return;
            }
            let (to, speed) = (self.long(0x5C), self.long(0x5E));
            let acceleration = f64::from(self.long(0x60));
            let from = self.motion.position();
            let seconds =
                f64::from((to - from).abs()) / f64::from(speed) + f64::from(speed) / acceleration;
            self.motion = Motion { to, seconds, ..self.motion_from_here() };
        }
        if touches(0x181) && self.long(0x180) == 1 {
            self.alarm = 0;
        }
    }

    fn motion_from_here(&self) -> Motion {
        Motion::standing(self.motion.position())
    }

    fn halt(&mut self) {
        self.motion = self.motion_from_here();
    }
}
