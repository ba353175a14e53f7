//! One exchange at a time on one line, and the recovery after a failed one.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::{Arc, Mutex, PoisonError},
    time::Duration,
};

use rig_link::{Flow, Health, HealthMeter, LineError, Port};
use tokio::time::{Instant, sleep, sleep_until, timeout};
use tokio_modbus::{
    client::{Client, Context, rtu, tcp},
    slave::{Slave, SlaveContext},
};

use crate::{
    BusError, BusSettings, DeviceRefusal, Exception, Framing, LineFault, Reply, Request, Symptom,
    halt::{HaltOrder, Halts},
    port_loan::PortLoan,
};

/// This number of bytes between two exchanges is an unexpected frame; fewer are a glitch of a
/// transceiver.
const STRAY_FRAME_BYTES: usize = 4;

/// Longest delay of an answer that the host does not wait for. Drives begin within some
/// milliseconds, and two frames at once would destroy each other.
const UNHEARD_ANSWER: Duration = Duration::from_millis(15);

/// The silence before an urgent frame is waited for at most this long.
const SILENT_WITHIN: Duration = Duration::from_millis(20);

/// Stops without an answer in a row, after which the request before which they were sent counts as not answered.
const UNANSWERED_STOPS: u32 = 2;

/// Registers with known values. They are read after a fault, before other answers of their device
/// count again.
///
/// No other request to the device may have an answer of this length. A device answers in the order
/// in which it is asked, so that this answer comes after all earlier ones.
#[derive(Debug, Clone)]
pub struct CheckRegisters {
    /// Request that reads the registers.
    pub request: Request,
    /// Expected contents; `None` while they are unknown: then any answer of their length is
    /// accepted.
    pub expected: Option<Reply>,
}

/// The fault of one exchange.
enum ExchangeFault {
    /// The device refused this request; the line is fine.
    Refused(Request, Exception),
    /// The answer to this request cannot be used; these bytes arrived.
    Unusable(Request, Symptom, Vec<u8>),
    /// It makes no sense to try again.
    Fatal(LineFault),
    /// A stop was requested before the write was sent.
    Halted,
}

/// The line and its state of trust.
///
/// ```text
///              answer agrees with request
///              ┌──────────────┐
///              ▼              │
///        ┌──────────┐  any fault   ┌─────────┐
///   ────▶│ in order ├─────────────▶│ suspect │ state of the library dropped
///        └──────────┘              └────┬────┘
///              ▲   reopened when lost,  │
///              │   quarantine, silence  │
///              └────────────────────────┘
///   In order again, the check registers of each device are read before it is trusted.
/// ```
pub(crate) struct Line {
    port_loan: PortLoan,
    name: Arc<str>,
    settings: BusSettings,
    /// Between two frames.
    silence: Duration,
    /// Present while the line is in order. Dropped after any fault, because a late answer would
    /// become the answer to the next request.
    context: Option<Context>,
    check_registers: BTreeMap<u8, CheckRegisters>,
    /// The devices that have not been recognised since the last fault.
    doubtful: BTreeSet<u8>,
    meters: Meters,
    halts: Halts,
}

/// The counts of the devices on a line, by their addresses.
#[derive(Debug, Clone, Default)]
pub(crate) struct Meters {
    by_unit: Arc<Mutex<BTreeMap<u8, HealthMeter>>>,
}

impl Meters {
    pub(crate) fn of(&self, unit: u8) -> HealthMeter {
        let mut by_unit = self.by_unit.lock().unwrap_or_else(PoisonError::into_inner);
        by_unit.entry(unit).or_default().clone()
    }
}

impl Line {
    pub(crate) fn new(port: Port, settings: BusSettings, halts: Halts, meters: Meters) -> Self {
        let name = port.name().clone();
        let silence = settings.silence.unwrap_or_else(|| port.frame_silence());
        let port_loan = PortLoan::new(port, settings.framing == Framing::Rtu);
        let context = Some(attach(&port_loan, settings.framing));
        Self {
            port_loan,
            name,
            settings,
            silence,
            context,
            check_registers: BTreeMap::new(),
            doubtful: BTreeSet::new(),
            meters,
            halts,
        }
    }

    /// Waits for a stop. May be dropped at any time.
    pub(crate) async fn halt_come(&mut self) {
        self.halts.come().await;
    }

    /// Sends the requested stops: as exchanges on a line in order, otherwise without waiting for an
    /// answer. A lost port gets none.
    pub(crate) async fn send_halts(&mut self) {
        for HaltOrder { frames, sent } in self.halts.take() {
            for (unit, request) in &frames.0 {
                if self.context.is_none() {
                    self.send_urgently(*unit, request).await;
                    // The answer comes before the next frame on the line.
                    let bytes = request.wire_len() + request.reply_wire_len();
                    let on_the_wire = self.port_loan.lock().port.duration_of(bytes);
                    sleep(on_the_wire + UNHEARD_ANSWER).await;
                    continue;
                }
                // The silence between two frames; the next request handles bytes that arrive in it.
                sleep(self.silence).await;
                let answer_by =
                    Some(Halts::answer_by(self.reply_by(request), self.settings.reply_within));
                if self.exchange(*unit, request, answer_by).await.is_err() {
                    self.context = None;
                }
            }
            // The receiver may have been dropped.
            _ = sent.send(());
        }
    }

    /// Sets the registers that identify a device, if there are any.
    pub(crate) fn set_check_registers(&mut self, unit: u8, registers: Option<CheckRegisters>) {
        match registers {
            Some(registers) => _ = self.check_registers.insert(unit, registers),
            None => _ = self.check_registers.remove(&unit),
        }
    }

    /// Name of the port.
    pub(crate) const fn name(&self) -> &Arc<str> {
        &self.name
    }

    /// The last exchange was left in the middle: its answer may still come.
    pub(crate) fn distrust(&mut self) {
        self.context = None;
    }

    /// Carries out one request, with as many attempts as the settings allow. Every request here may
    /// be repeated: reads, and writes of absolute values. A write that was requested after `halts`
    /// stops is not sent after a further one. An urgent one is sent at once before each attempt if the line is suspect.
    pub(crate) async fn request(
        &mut self,
        unit: u8,
        request: &Request,
        halts: u64,
        is_urgent: bool,
    ) -> Result<Reply, BusError> {
        self.count(unit, |health| health.requests += 1);
        let busy_until = Instant::now() + self.settings.busy_within;
        let mut attempts = 0;
        loop {
            attempts += 1;
            if is_urgent {
                self.send_urgently(unit, request).await;
            }
            let fault = match self.attempt(unit, request, halts).await {
                Ok(reply) => return Ok(reply),
                Err(fault) => fault,
            };
            match fault {
                ExchangeFault::Refused(_, Exception::Busy | Exception::Acknowledge)
                    if Instant::now() < busy_until =>
                {
                    // `Busy` is an answer, not a failed attempt.
                    attempts -= 1;
                    tokio::select! {
                        biased;
                        () = self.halts.come() => {}
                        () = sleep(self.settings.busy_pause) => {}
                    }
                }
                ExchangeFault::Refused(request, exception) => {
                    self.count(unit, |health| health.refusals += 1);
                    let port = self.name.clone();
                    return Err(DeviceRefusal { port, unit, request, exception }.into());
                }
                ExchangeFault::Unusable(request, symptom, _)
                    if attempts < self.settings.attempts =>
                {
                    self.count(unit, |health| health.retries += 1);
                    tracing::warn!(port = %self.name, unit, %request, %symptom, attempts, "again");
                }
                ExchangeFault::Unusable(request, symptom, received) => {
                    self.count(unit, |health| health.faults += 1);
                    let fault = LineFault::NoAnswer {
                        port: self.name.clone(),
                        unit,
                        request,
                        symptom,
                        received: received.into(),
                        attempts,
                        intruders: self.port_loan.lock().port.intruders(),
                    };
                    return Err(fault.into());
                }
                ExchangeFault::Fatal(fault) => {
                    self.count(unit, |health| health.faults += 1);
                    return Err(fault.into());
                }
                ExchangeFault::Halted => {
                    let (port, request) = (self.name.clone(), request.clone());
                    return Err(LineFault::Halted { port, unit, request }.into());
                }
            }
        }
    }

    fn count(&self, unit: u8, change: impl FnOnce(&mut Health)) {
        self.meters.of(unit).note(change);
    }

    /// Sends a request on a suspect line without waiting for an answer: an answer is discarded
    /// before the next request. A line in order, on which the request itself leaves at once, becomes suspect if
    /// it does not fall silent soon.
    async fn send_urgently(&mut self, unit: u8, request: &Request) {
        let mut port_loan = self.port_loan.lock();
        let heard = port_loan.port.settle_within(self.silence, SILENT_WITHIN).await;
        let (is_silent, is_lost) =
            (heard.is_ok_and(|strays| strays < STRAY_FRAME_BYTES), port_loan.port.is_lost());
        drop(port_loan);
        if is_silent && self.context.is_some() {
            return;
        }
        self.context = None;
        if !is_lost {
            self.say(unit, request).await;
        }
    }

    /// Sends, and leaves no trace in the library.
    async fn say(&mut self, unit: u8, request: &Request) {
        self.port_loan.lock().begin();
        let mut context = attach(&self.port_loan, self.settings.framing);
        context.set_slave(Slave(unit));
        // The call sends at its first poll, and is dropped when it waits.
        _ = timeout(Duration::ZERO, context.call(request.to_wire())).await;
    }

    async fn attempt(
        &mut self,
        unit: u8,
        request: &Request,
        halts: u64,
    ) -> Result<Reply, ExchangeFault> {
        let outcome = self.trust_and_exchange(unit, request, halts).await;
        if matches!(outcome, Err(ExchangeFault::Unusable(..) | ExchangeFault::Fatal(_))) {
            self.context = None;
        }
        outcome
    }

    async fn trust_and_exchange(
        &mut self,
        unit: u8,
        request: &Request,
        halts: u64,
    ) -> Result<Reply, ExchangeFault> {
        if self.context.is_some() {
            let strays = self.listen(None).await.map_err(fatal)?;
            if STRAY_FRAME_BYTES <= strays {
                tracing::warn!(port = %self.name, strays, "unexpected bytes");
                self.context = None;
            }
        }
        // A stop that is not answered is no fault of this request: the line is put in order again.
        for _ in 0..=UNANSWERED_STOPS {
            if self.context.is_none() {
                self.put_in_order().await.map_err(ExchangeFault::Fatal)?;
            }
            if self.doubtful.contains(&unit) {
                self.recognise(unit).await?;
            }
            self.send_halts().await;
            if self.context.is_some() {
                break;
            }
        }
        if request.is_write() && halts < self.halts.taken() {
            return Err(ExchangeFault::Halted);
        }
        if self.context.is_none() {
            let symptom = Symptom::Silence;
            return Err(ExchangeFault::Unusable(request.clone(), symptom, Vec::new()));
        }
        self.exchange(unit, request, None).await
    }

    /// Opens the port again where it was lost, and waits until no late answer can arrive.
    async fn put_in_order(&mut self) -> Result<(), LineFault> {
        self.doubtful.extend(self.check_registers.keys());
        let mut port_loan = self.port_loan.lock();
        // A new connection cannot carry answers to the requests of the old one.
        let is_tcp = self.settings.framing == Framing::Tcp && port_loan.port.can_reopen();
        if port_loan.port.is_lost() || is_tcp {
            let reopened = port_loan.port.reopen().await;
            reopened.map_err(|source| LineFault::Reopen { source: Arc::new(source) })?;
        }
        drop(port_loan);
        let discarded = self.listen(Some(self.settings.quarantine)).await?;
        tracing::info!(port = %self.name, discarded, "the line answers again");
        self.context = Some(attach(&self.port_loan, self.settings.framing));
        Ok(())
    }

    async fn recognise(&mut self, unit: u8) -> Result<(), ExchangeFault> {
        if let Some(registers) = self.check_registers.get(&unit).cloned() {
            let found = self.exchange(unit, &registers.request, None).await?;
            if registers.expected.is_some_and(|expected| expected != found) {
                let (port, request) = (self.name.clone(), registers.request);
                return Err(ExchangeFault::Fatal(LineFault::Changed { port, unit, request }));
            }
            // The check was an exchange; this is the next one.
            self.listen(None).await.map_err(fatal)?;
        }
        self.doubtful.remove(&unit);
        Ok(())
    }

    /// Waits for the silence between two frames, or for the end of a quarantine, and returns the
    /// number of discarded bytes. A stop is sent in between, and the wait begins again.
    async fn listen(&mut self, quarantine: Option<Duration>) -> Result<usize, LineError> {
        loop {
            let mut port_loan = self.port_loan.lock();
            let silence = self.silence;
            let heard = async {
                match quarantine {
                    Some(at_least) => port_loan.port.quarantine(at_least).await,
                    None => port_loan.port.settle(silence).await,
                }
            };
            tokio::select! {
                biased;
                heard = heard => return heard,
                () = self.halts.come() => {}
            }
            drop(port_loan);
            self.send_halts().await;
        }
    }

    /// When the answer to a request is too late.
    fn reply_by(&self, request: &Request) -> Instant {
        let port_loan = self.port_loan.lock();
        let mut bytes = request.wire_len() + request.reply_wire_len();
        if port_loan.is_echoing() {
            bytes += request.wire_len();
        }
        Instant::now() + port_loan.port.duration_of(bytes) + self.settings.reply_within
    }

    /// One request and one answer on a line that is in order and silent. Without a deadline the
    /// settings limit the wait for the answer; after a stop the wait is short.
    async fn exchange(
        &mut self,
        unit: u8,
        request: &Request,
        answer_by: Option<Instant>,
    ) -> Result<Reply, ExchangeFault> {
        let asked = Instant::now();
        let outcome = self.ask(unit, request, answer_by).await;
        self.count(unit, |health| match &outcome {
            Ok(_) | Err(ExchangeFault::Refused(..)) => {
                health.answered(asked.elapsed());
            }
            Err(ExchangeFault::Unusable(_, Symptom::Silence | Symptom::OnlyEcho, _)) => {
                health.late += 1;
            }
            Err(ExchangeFault::Unusable(..)) => health.corrupt += 1,
            Err(ExchangeFault::Fatal(_) | ExchangeFault::Halted) => {}
        });
        outcome
    }

    async fn ask(
        &mut self,
        unit: u8,
        request: &Request,
        answer_by: Option<Instant>,
    ) -> Result<Reply, ExchangeFault> {
        let deadline = self.reply_by(request);
        self.port_loan.lock().begin();
        let context = self.context.as_mut().expect("the line was put in order");
        context.set_slave(Slave(unit));
        let too_late = async {
            match answer_by {
                Some(answer_by) => sleep_until(answer_by).await,
                None => self.halts.too_late(deadline, self.settings.reply_within).await,
            }
        };
        let result = tokio::select! {
            biased;
            result = context.call(request.to_wire()) => Some(result),
            () = too_late => None,
        };
        let Some(result) = result else {
            return Err(self.diagnose(unit, request));
        };
        let (outcome, length) = match result {
            Ok(Ok(response)) => match request.accept(response) {
                Some(reply) => (Ok(reply), request.reply_wire_len()),
                None => return Err(self.diagnose(unit, request)),
            },
            Ok(Err(code)) => {
                let exception = Exception::from_code(code.into());
                (Err(ExchangeFault::Refused(request.clone(), exception)), 5)
            }
            // The library calls an answer that is shorter than it says an end of the stream, so
            // that only the port can tell whether it is lost.
            Err(tokio_modbus::Error::Transport(error)) if self.has_failed(&error) => {
                return Err(fatal(self.port_loan.lock().port.explain(error)));
            }
            Err(_) => return Err(self.diagnose(unit, request)),
        };
        let surplus = self.port_loan.lock().n_passed().saturating_sub(length);
        if self.settings.framing == Framing::Rtu && STRAY_FRAME_BYTES <= surplus {
            let received = self.last_frame().1;
            return Err(ExchangeFault::Unusable(request.clone(), Symptom::Surplus, received));
        }
        outcome
    }

    /// Whether an error concerns the port, and not the answer.
    fn has_failed(&self, error: &std::io::Error) -> bool {
        self.port_loan.lock().port.is_lost() || error.raw_os_error().is_some()
    }

    /// Classifies the bytes that arrived instead of an answer.
    fn diagnose(&self, unit: u8, request: &Request) -> ExchangeFault {
        let (sent, received) = self.last_frame();
        let symptom = Symptom::of(self.settings.framing, &sent, &received, unit, request);
        ExchangeFault::Unusable(request.clone(), symptom, received)
    }

    /// The last sent frame and the bytes after it, from the black box.
    fn last_frame(&self) -> (Vec<u8>, Vec<u8>) {
        let mut frames = self.port_loan.lock().port.transcript().frames();
        let Some(start) = frames.iter().rposition(|frame| frame.flow == Flow::Sent) else {
            return (Vec::new(), Vec::new());
        };
        let received =
            frames[start + 1..].iter().flat_map(|frame| frame.bytes.iter().copied()).collect();
        (frames.swap_remove(start).bytes, received)
    }
}

fn attach(port_loan: &PortLoan, framing: Framing) -> Context {
    match framing {
        Framing::Rtu => rtu::attach(port_loan.clone()),
        Framing::Tcp => tcp::attach(port_loan.clone()),
    }
}

fn fatal(error: LineError) -> ExchangeFault {
    ExchangeFault::Fatal(error.into())
}
