//! One exchange at a time on one line, and what is done before the next one when it went wrong.

use std::{collections::BTreeMap, sync::Arc};

use rig_link::Port;
use tokio::time::{Instant, sleep, timeout_at};
use tokio_modbus::{
    client::{Client, Context, rtu},
    slave::{Slave, SlaveContext},
};

use crate::{
    BusError, BusTiming, Exception, LineFault, Refusal, Reply, Request, Symptom, tap::Tap,
};

/// A register whose value is known, read after a fault before anything else is believed.
#[derive(Debug, Clone)]
pub(crate) struct Canary {
    pub(crate) request: Request,
    pub(crate) expected: Reply,
}

/// What is wrong with one exchange.
enum Trouble {
    /// The device refused; the line is fine.
    Refused(Exception),
    /// The answer cannot be used.
    Unusable(Symptom),
    /// The port failed.
    Port(LineFault),
}

/// The line and its state of trust.
///
/// ```text
///             answer agrees with request
///             ┌──────────────┐
///             ▼              │
///        ┌─────────┐  any fault   ┌─────────┐
///   ────▶│ trusted ├─────────────▶│ suspect │ library context dropped
///        └─────────┘              └────┬────┘
///             ▲   quarantine, drain,   │
///             └── canary as expected ──┘
/// ```
pub(crate) struct Line {
    tap: Tap,
    name: Arc<str>,
    timing: BusTiming,
    /// Present while the line is trusted. Dropped after any fault, because a late answer would
    /// become the answer to the next request.
    context: Option<Context>,
    canaries: BTreeMap<u8, Canary>,
}

impl Line {
    pub(crate) fn new(port: Port, timing: BusTiming) -> Self {
        let name = port.name().clone();
        let tap = Tap::new(port);
        let context = Some(rtu::attach(tap.clone()));
        Self { tap, name, timing, context, canaries: BTreeMap::new() }
    }

    pub(crate) fn set_canary(&mut self, unit: u8, canary: Canary) {
        self.canaries.insert(unit, canary);
    }

    /// Carries out one request, with as many attempts as the timing allows. Every request that
    /// comes here may be repeated: reads, and writes that say what a register shall be.
    pub(crate) async fn request(&mut self, unit: u8, request: &Request) -> Result<Reply, BusError> {
        let busy_until = Instant::now() + self.timing.busy_within;
        let mut attempts = 0;
        loop {
            attempts += 1;
            let trouble = match self.attempt(unit, request).await {
                Ok(reply) => return Ok(reply),
                Err(trouble) => trouble,
            };
            match trouble {
                Trouble::Refused(Exception::Busy | Exception::Acknowledge)
                    if Instant::now() < busy_until =>
                {
                    // Being busy is an answer, not a failed attempt.
                    attempts -= 1;
                    sleep(self.timing.busy_pause).await;
                }
                Trouble::Refused(exception) => {
                    let (port, request) = (self.name.clone(), request.clone());
                    return Err(Refusal { port, unit, request, exception }.into());
                }
                Trouble::Port(fault) => return Err(fault.into()),
                Trouble::Unusable(symptom) if self.timing.attempts <= attempts => {
                    let (port, request) = (self.name.clone(), request.clone());
                    let fault = LineFault::NoAnswer { port, unit, request, symptom, attempts };
                    return Err(fault.into());
                }
                Trouble::Unusable(symptom) => {
                    tracing::warn!(port = %self.name, unit, %request, %symptom, attempts, "retrying");
                }
            }
        }
    }

    /// Sends to all devices. None of them answers, so that nothing is waited for.
    pub(crate) async fn broadcast(&mut self, frame: &[u8]) -> Result<(), BusError> {
        let mut port = self.tap.port();
        port.settle().await.map_err(LineFault::from)?;
        port.send(frame).await.map_err(LineFault::from)?;
        Ok(())
    }

    async fn attempt(&mut self, unit: u8, request: &Request) -> Result<Reply, Trouble> {
        if self.context.is_none() {
            self.recover(unit).await?;
        }
        let outcome = self.exchange(unit, request).await;
        if matches!(outcome, Err(Trouble::Unusable(_) | Trouble::Port(_))) {
            self.context = None;
        }
        outcome
    }

    /// Waits until no late answer can arrive any more, and then asks for what is known.
    async fn recover(&mut self, unit: u8) -> Result<(), Trouble> {
        let discarded = self
            .tap
            .port()
            .quarantine(self.timing.quarantine)
            .await
            .map_err(|error| Trouble::Port(error.into()))?;
        tracing::info!(port = %self.name, discarded, "the line is quiet again");
        self.context = Some(rtu::attach(self.tap.clone()));
        let Some(canary) = self.canaries.get(&unit).cloned() else {
            return Ok(());
        };
        match self.exchange(unit, &canary.request).await {
            Ok(reply) if reply == canary.expected => Ok(()),
            Ok(_) => {
                self.context = None;
                let (port, request) = (self.name.clone(), canary.request);
                Err(Trouble::Port(LineFault::Changed { port, unit, request }))
            }
            Err(trouble) => {
                self.context = None;
                Err(trouble)
            }
        }
    }

    async fn exchange(&mut self, unit: u8, request: &Request) -> Result<Reply, Trouble> {
        let port_fault = |error: rig_link::LineError| Trouble::Port(error.into());
        let deadline = {
            let mut port = self.tap.port();
            port.settle().await.map_err(port_fault)?;
            let on_the_wire = port.duration_of(request.wire_len() + request.reply_wire_len());
            Instant::now() + on_the_wire + self.timing.reply_within
        };
        let context = self.context.as_mut().expect("recovered before the exchange");
        context.set_slave(Slave(unit));
        let Ok(result) = timeout_at(deadline, context.call(request.to_wire())).await else {
            return Err(Trouble::Unusable(self.diagnose(unit, request)));
        };
        match result {
            Ok(Ok(response)) => {
                request.accept(response).ok_or(Trouble::Unusable(Symptom::OtherAnswer))
            }
            Ok(Err(exception)) => Err(Trouble::Refused(Exception::from_code(exception.into()))),
            Err(tokio_modbus::Error::Protocol(_)) => {
                Err(Trouble::Unusable(self.diagnose(unit, request)))
            }
            Err(tokio_modbus::Error::Transport(error))
                if error.kind() == std::io::ErrorKind::InvalidData =>
            {
                Err(Trouble::Unusable(self.diagnose(unit, request)))
            }
            Err(tokio_modbus::Error::Transport(error)) => {
                Err(port_fault(self.tap.port().explain(error)))
            }
        }
    }

    /// Says what came in place of an answer, from the last frames of the black box.
    fn diagnose(&self, unit: u8, request: &Request) -> Symptom {
        let frames = self.tap.port().transcript().frames();
        let start = frames.iter().rposition(|frame| frame.flow == rig_link::Flow::Sent);
        let Some(start) = start else { return Symptom::Silence };
        let received: Vec<u8> =
            frames[start + 1..].iter().flat_map(|frame| frame.bytes.iter().copied()).collect();
        symptom_of(&frames[start].bytes, &received, unit, request)
    }
}

/// Says what is wrong with the bytes that came after a request on a serial line.
fn symptom_of(sent: &[u8], received: &[u8], unit: u8, request: &Request) -> Symptom {
    if received.is_empty() {
        return Symptom::Silence;
    }
    // The answer to a single write is the request itself, so it never comes here.
    if received.starts_with(sent) {
        return Symptom::Echo;
    }
    let is_sound = |frame: &[u8]| crc(frame) == 0;
    let has_function = received.get(1).is_some_and(|&function| function & 0x7F == sent[1]);
    let length = if received.get(1).is_some_and(|&function| function & 0x80 != 0) {
        5
    } else {
        request.reply_wire_len()
    };
    if is_sound(received) || received.get(..length).is_some_and(is_sound) {
        return if received[0] == unit {
            Symptom::OtherAnswer
        } else {
            Symptom::ForeignUnit(received[0])
        };
    }
    match (received[0] == unit && has_function, received.len() < length) {
        (true, true) => Symptom::Truncated,
        (true, false) => Symptom::Corrupted,
        (false, _) => Symptom::Garbage,
    }
}

/// The checksum of Modbus RTU; zero over a frame that includes its own.
///
/// # Source
/// Modbus over Serial Line V1.02, appendix B.
pub(crate) fn crc(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, &byte| {
        (0..8).fold(crc ^ u16::from(byte), |crc, _| {
            if crc & 1 == 1 { (crc >> 1) ^ 0xA001 } else { crc >> 1 }
        })
    })
}
