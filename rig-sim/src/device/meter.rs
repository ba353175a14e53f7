//! An impedance analyzer of any make: it accepts messages, and measurements take time.
//!
//! What the makes have in common is here: one command after the other, a measurement that waits,
//! integrates and then has a result, and a drive that never stops. The commands of a make are in
//! its [`Model`].
//!
//! Several clients may be there. Each has its own messages and answers; settings, errors and status
//! are the instrument's, and there is one measurement at a time. While one client waits for a
//! measurement, the queries of another are answered at once; commands that would disturb the
//! measurement, or need one of their own, wait for its end in the order of arrival.
//!
//! ```text
//!           command that measures              delay is over            all points are there
//!   idle ───────────────────────────▶ waiting ───────────────▶ integrating ─────────────────▶ idle
//!                                        ▲                          │
//!                                        └────── next point ────────┘
//! ```

mod e4990a;
mod hioki;
mod lcr;
mod model;
mod quantity;
mod setting_store;
#[cfg(test)]
mod test_meter;

use std::{collections::BTreeMap, time::Duration};

use rig_model::RigTime;
use rig_scpi::{Call, Instrument, ScpiError, Session, Value};

pub(crate) use self::{
    e4990a::E4990a,
    hioki::Hioki,
    lcr::{E4980a, Hp4284a, Lcr, Th2832},
    model::Model,
};
use self::{
    model::{Drive, FinishedPoint, Job, Memory, Outcome, Point},
    quantity::{Quantity, round_step},
};

use crate::world::World;

/// Tells the clients of an instrument apart.
pub(crate) type ClientId = u64;

/// Residual level at the terminals when the level is zero, V.
const LEAKAGE_V: f64 = 1e-6;

/// The level at the terminals, V. A level of zero still leaves what leaks through.
const fn terminal_v(drive: Drive) -> f64 {
    drive.level_v.max(LEAKAGE_V)
}

/// Numbers of 64 bits in a block, the most significant byte first unless they are swapped.
fn binary(numbers: impl Iterator<Item = f64>, is_swapped: bool) -> Value {
    let bytes = |number: f64| if is_swapped { number.to_le_bytes() } else { number.to_be_bytes() };
    Value::Block(numbers.flat_map(bytes).collect())
}

#[derive(Debug)]
enum Phase {
    Waiting,
    Integrating { frequency_hz: f64, is_overloaded: bool, factor: f64 },
}

#[derive(Debug)]
struct RunningMeasurement<C> {
    job: Job,
    /// The client and the command that began it.
    client: ClientId,
    command: C,
    busy_bits: u16,
    phase: Phase,
    began: RigTime,
    until: RigTime,
    readings: Vec<FinishedPoint>,
}

/// A client of the instrument.
#[derive(Debug)]
struct Client<C> {
    session: Box<Session>,
    /// A command that waits for the measurement.
    held: Option<Call<C>>,
    /// Time of its last message.
    heard_at: RigTime,
    /// Its messages with their times of arrival.
    said: Vec<(RigTime, Vec<u8>)>,
}

/// A simulated analyzer with its sessions.
#[derive(Debug)]
pub(crate) struct Meter<M: Model> {
    instrument: Instrument<M::Command>,
    model: M,
    clients: BTreeMap<ClientId, Client<M::Command>>,
    running: Option<RunningMeasurement<M::Command>>,
    readings: Vec<FinishedPoint>,
    /// Time of a command in the instrument.
    per_command: Duration,
    /// End of the last command.
    free_at: RigTime,
    /// Whether nothing can happen before a client says something or the measurement continues.
    is_settled: bool,
    overloads: u32,
    /// Of the next measured points, the last one first.
    wrong: Vec<f64>,
}

impl<M: Model> Meter<M> {
    /// An instrument that is switched on with the bench and drives its terminals.
    pub(crate) fn new(per_command: Duration, world: &mut World) -> Self {
        let meter = Self::switched_on(per_command);
        world.switch_on_level(terminal_v(meter.model.drive()));
        meter
    }

    fn switched_on(per_command: Duration) -> Self {
        Self {
            instrument: Instrument::new(M::commands(), M::dialect()),
            model: M::default(),
            clients: BTreeMap::new(),
            running: None,
            readings: Vec::new(),
            per_command,
            free_at: RigTime::ZERO,
            is_settled: false,
            overloads: 0,
            wrong: Vec::new(),
        }
    }

    /// Accepts bytes of a client that arrived at `now`.
    pub(crate) fn push(&mut self, now: RigTime, id: ClientId, bytes: &[u8], world: &mut World) {
        let new = || {
            let session = Box::new(Session::new(self.instrument.dialect()));
            Client { session, held: None, heard_at: now, said: Vec::new() }
        };
        self.clients.entry(id).or_insert_with(new).heard_at = now;
        self.turned_to(id, |instrument| instrument.push(bytes));
        self.is_settled = false;
        self.advance(now, world);
    }

    /// When the measurement continues.
    pub(crate) fn deadline(&self) -> Option<RigTime> {
        self.running.as_ref().map(|running| running.until)
    }

    /// The answers to a client up to now, with their times.
    pub(crate) fn take_said(&mut self, id: ClientId) -> Vec<(RigTime, Vec<u8>)> {
        self.clients.get_mut(&id).map(|client| std::mem::take(&mut client.said)).unwrap_or_default()
    }

    /// A client has closed. Its last message is discarded, and its measurement ends without an
    /// answer.
    pub(crate) fn hang_up(&mut self, id: ClientId) {
        self.clients.remove(&id);
        self.is_settled = false;
    }

    /// The input is overloaded at the next measured point.
    pub(crate) fn overload(&mut self) {
        self.overloads += 1;
    }

    /// The impedance of the next measured point is multiplied by this.
    pub(crate) fn read_wrongly(&mut self, factor: f64) {
        self.wrong.insert(0, factor);
    }

    /// Clears the faults that have not happened yet.
    pub(crate) fn clear_faults(&mut self) {
        self.overloads = 0;
        self.wrong.clear();
    }

    /// Switches the instrument off and on again.
    pub(crate) fn restart(&mut self, now: RigTime, world: &mut World) {
        let before = self.model.drive();
        *self = Self { free_at: now, ..Self::switched_on(self.per_command) };
        self.apply_drive(now, before, world);
    }

    /// Lives up to `now`.
    pub(crate) fn advance(&mut self, now: RigTime, world: &mut World) {
        loop {
            if self.running.as_ref().is_some_and(|running| running.until <= now) {
                self.is_settled = false;
                self.go_on(world);
            } else if self.is_settled {
                return;
            } else if let Some((id, call)) = self.next_call() {
                self.carry_out(id, call, world);
            } else {
                self.is_settled = true;
            }
        }
    }

    /// The next command that need not wait, of the client whose message came first.
    fn next_call(&mut self) -> Option<(ClientId, Call<M::Command>)> {
        if self.clients.len() == 1 {
            let id = *self.clients.keys().next()?;
            return Some((id, self.next_call_of(id)?));
        }
        let mut ids: Vec<ClientId> = self.clients.keys().copied().collect();
        ids.sort_by_key(|id| self.clients[id].heard_at);
        ids.into_iter().find_map(|id| Some((id, self.next_call_of(id)?)))
    }

    fn next_call_of(&mut self, id: ClientId) -> Option<Call<M::Command>> {
        if self.blocking_client() == Some(id) && !self.interrupts(id) {
            return None;
        }
        let is_measuring = self.running.is_some();
        let client = self.clients.get_mut(&id)?;
        if is_measuring && client.held.is_some() {
            return None;
        }
        if let Some(call) = client.held.take() {
            return Some(call);
        }
        let answered_at = client.heard_at.max(self.free_at);
        let call = self.turned_to(id, Instrument::poll)?;
        if call.is_none() {
            self.collect(id, answered_at);
        }
        call
    }

    /// Whether the client of a blocking measurement has sent a command since that ends it.
    fn interrupts(&self, id: ClientId) -> bool {
        let Some(running) = self.running.as_ref().filter(|running| !running.job.is_answered) else {
            return false;
        };
        let heard_since = |client: &&Client<_>| running.began < client.heard_at;
        let Some(client) = self.clients.get(&id).filter(heard_since) else { return false };
        // Only a reader of the message knows its next command: a copy of the instrument reads ahead.
        let mut copy = self.instrument.clone();
        copy.turn_to(&mut client.session.clone());
        copy.poll().is_some_and(|call| M::may_interrupt(call.command))
    }

    /// The client that does nothing else until the measurement is over.
    fn blocking_client(&self) -> Option<ClientId> {
        self.running.as_ref().and_then(|running| running.job.is_blocking.then_some(running.client))
    }

    /// Carries a command out, unless it has to wait.
    fn carry_out(&mut self, id: ClientId, call: Call<M::Command>, world: &mut World) {
        // A waiting command takes effect at the time at which the instrument becomes free, even if
        // it is processed later. Within a message the instrument is ahead of the wire by the little
        // time that its commands take.
        let Some(client) = self.clients.get_mut(&id) else { return };
        let at = self.free_at.max(client.heard_at) + self.per_command;
        let is_measuring = self.running.is_some();
        let would_disturb = self.blocking_client().is_some();
        if would_disturb && !(call.is_query || M::may_interrupt(call.command)) {
            self.hold(id, call);
            return;
        }
        let before = self.model.drive();
        let memory = Memory { readings: &self.readings, is_measuring };
        let outcome = self.model.carry_out(&call, memory);
        let must_wait = match outcome {
            Ok(Outcome::Wait) => is_measuring,
            Ok(Outcome::Measure(_)) => would_disturb,
            _ => false,
        };
        if must_wait {
            self.hold(id, call);
            return;
        }
        self.free_at = at;
        self.apply_drive(at, before, world);
        match outcome {
            // A trigger does not interrupt a running measurement.
            Ok(Outcome::Measure(_)) if is_measuring => {
                self.reply(id, at, Err(ScpiError::new(-211)));
            }
            Ok(Outcome::Measure(job)) => self.begin(id, at, call.command, job, world),
            Ok(Outcome::Done(values)) => self.reply(id, at, Ok(values)),
            Ok(outcome @ (Outcome::Abort | Outcome::Reset)) => {
                self.abort(at);
                if matches!(outcome, Outcome::Reset) {
                    self.readings.clear();
                }
                self.reply(id, at, Ok(Vec::new()));
            }
            // There is nothing to wait for: the data are stale.
            Ok(Outcome::Wait) => self.reply(id, at, Err(ScpiError::new(-230))),
            Err(error) => self.reply(id, at, Err(error)),
        }
    }

    fn hold(&mut self, id: ClientId, call: Call<M::Command>) {
        if let Some(client) = self.clients.get_mut(&id) {
            client.held = Some(call);
        }
    }

    fn apply_drive(&self, at: RigTime, before: Drive, world: &mut World) {
        let drive = self.model.drive();
        if drive.frequency_hz != before.frequency_hz {
            world.set_frequency(at, drive.frequency_hz);
        }
        if drive.level_v != before.level_v {
            world.set_level(at, terminal_v(drive));
        }
    }

    fn begin(
        &mut self,
        client: ClientId,
        at: RigTime,
        command: M::Command,
        job: Job,
        world: &mut World,
    ) {
        if !job.is_answered {
            self.reply(client, at, Ok(Vec::new()));
        }
        let busy_bits = self.model.busy_bits();
        self.set_busy(busy_bits, true);
        self.running = Some(RunningMeasurement {
            job,
            client,
            command,
            busy_bits,
            phase: Phase::Waiting,
            began: at,
            until: at,
            readings: Vec::new(),
        });
        self.next_point(at, world);
    }

    /// Ends the measurement that is under way without a result.
    fn abort(&mut self, at: RigTime) {
        let Some(RunningMeasurement { job, client, busy_bits, .. }) = self.running.take() else {
            return;
        };
        if M::ENDS_ARE_EVENTS {
            self.instrument.status_mut().operation.negative_transition &= !busy_bits;
        }
        self.set_busy(busy_bits, false);
        self.free_at = at;
        if job.is_answered {
            self.reply(client, at, Err(ScpiError::new(-230)));
        }
    }

    fn set_busy(&mut self, busy_bits: u16, is_busy: bool) {
        self.instrument.set_operation_pending(is_busy);
        let operation = &mut self.instrument.status_mut().operation;
        if M::ENDS_ARE_EVENTS && is_busy {
            operation.positive_transition &= !busy_bits;
            operation.negative_transition |= busy_bits;
        }
        operation.set(busy_bits, is_busy);
    }

    /// Begins the next point of the measurement, or ends it.
    fn next_point(&mut self, at: RigTime, world: &mut World) {
        let Some(running) = &mut self.running else { return };
        if let Some(point) = running.job.points.front() {
            world.set_frequency(at, point.frequency_hz);
            running.phase = Phase::Waiting;
            running.until = at + Duration::from_secs_f64(point.delay_s);
            if point.delay_s == 0.0 {
                self.go_on(world);
            }
            return;
        }
        let Some(ended) = self.running.take() else { return };
        self.readings = ended.readings;
        self.set_busy(ended.busy_bits, false);
        self.free_at = self.free_at.max(at);
        if ended.job.is_answered {
            let values = self.model.answer(ended.command, &self.readings);
            self.reply(ended.client, at, Ok(values));
        }
    }

    /// Advances to the next phase when the present one is over.
    fn go_on(&mut self, world: &mut World) {
        let Some(running) = &mut self.running else { return };
        let at = running.until;
        match running.phase {
            Phase::Waiting => {
                let Some(point) = running.job.points.pop_front() else { return };
                let until = world.begin_reading(at, point.cycles);
                let is_overloaded = self.overloads > 0;
                self.overloads = self.overloads.saturating_sub(1);
                let factor = self.wrong.pop().unwrap_or(1.0);
                let frequency_hz = point.frequency_hz;
                running.phase = Phase::Integrating { frequency_hz, is_overloaded, factor };
                running.until = until;
            }
            Phase::Integrating { frequency_hz, is_overloaded, factor } => {
                let measured_ohm = world.end_reading().filter(|_| !is_overloaded);
                let impedance_ohm = measured_ohm.map(|ohm| factor * ohm);
                running.readings.push(FinishedPoint { frequency_hz, impedance_ohm });
                self.next_point(at, world);
            }
        }
    }

    /// Answers the command of a client, unless it has closed.
    fn reply(&mut self, id: ClientId, at: RigTime, answer: Result<Vec<Value>, ScpiError>) {
        self.turned_to(id, |instrument| instrument.answer(answer));
        self.collect(id, at);
    }

    /// Stores the finished output for a client.
    fn collect(&mut self, id: ClientId, at: RigTime) {
        let bytes = self.turned_to(id, Instrument::take_output).unwrap_or_default();
        if let Some(client) = self.clients.get_mut(&id)
            && !bytes.is_empty()
        {
            client.said.push((at, bytes));
        }
    }

    /// Acts on the instrument in the session of a client; `None` if the client has closed.
    fn turned_to<T>(
        &mut self,
        id: ClientId,
        act: impl FnOnce(&mut Instrument<M::Command>) -> T,
    ) -> Option<T> {
        let session = &mut self.clients.get_mut(&id)?.session;
        self.instrument.turn_to(session);
        let done = act(&mut self.instrument);
        self.instrument.turn_to(session);
        Some(done)
    }
}
