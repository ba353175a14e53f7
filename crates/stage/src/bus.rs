//! The one owner of a line, and the handles through which it is used.

use std::{
    panic::AssertUnwindSafe,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
};

use futures_util::FutureExt;
use rig_link::{HealthMeter, Port};
use rig_model::{RigTime, panic_message};
use tokio::sync::{mpsc, oneshot};

use crate::{
    BusError, BusSettings, HaltFrames, LineFault, Reply, Request,
    halt::{HaltOrder, Halts},
    line::{CheckRegisters, Line, Meters},
};

/// A handle of a line. All handles share one owner, which carries out one request at a time, and
/// each to its end, even if the caller has gone away.
#[derive(Debug, Clone)]
pub struct BusHandle {
    orders: mpsc::Sender<LineRequest>,
    halts: mpsc::UnboundedSender<HaltOrder>,
    /// Number of stops ordered so far.
    halts_ordered: Arc<AtomicU64>,
    meters: Meters,
    name: Arc<str>,
    clock: rig_link::Clock,
}

/// A request to the owner of the line.
#[derive(Debug)]
enum LineRequest {
    Request {
        unit: u8,
        request: Request,
        is_urgent: bool,
        /// Number of stops at the time of the request.
        halts: u64,
        answer: oneshot::Sender<Result<Reply, BusError>>,
    },
    CheckRegisters {
        unit: u8,
        registers: Option<CheckRegisters>,
        answer: oneshot::Sender<()>,
    },
}

impl BusHandle {
    /// Gives a port to a new owner, which lives until the last handle is dropped. Must be called
    /// inside a tokio runtime.
    pub fn open(port: Port, settings: BusSettings) -> Self {
        let (orders, inbox) = mpsc::channel(16);
        // No stop is refused or waits for room; each is taken out at the next exchange.
        let (halts, halts_inbox) = mpsc::unbounded_channel();
        let handle = Self {
            orders,
            halts,
            halts_ordered: Arc::default(),
            meters: Meters::default(),
            name: port.name().clone(),
            clock: port.clock(),
        };
        let line = Line::new(port, settings, Halts::new(halts_inbox), handle.meters.clone());
        tokio::spawn(own(line, inbox));
        handle
    }

    /// The name of the port.
    pub fn name(&self) -> &Arc<str> {
        &self.name
    }

    /// The rig's time now.
    pub fn now(&self) -> RigTime {
        self.clock.now()
    }

    /// Sends a request to one device, and accepts only the answer to this request.
    ///
    /// # Errors
    /// [`BusError::Refused`] with the device's reason, [`BusError::Failed`] when no answer could be
    /// used; then it is unknown whether the device has received the request.
    pub async fn request(&self, unit: u8, request: Request) -> Result<Reply, BusError> {
        self.carry_out(unit, request, false).await
    }

    /// Makes a request that also leaves a suspect line at once, before silence is
    /// waited for. For a stop, which may arrive twice and must not wait.
    ///
    /// # Errors
    /// As [`request`](Self::request).
    pub(crate) async fn urge(&self, unit: u8, request: Request) -> Result<Reply, BusError> {
        self.carry_out(unit, request, true).await
    }

    async fn carry_out(
        &self,
        unit: u8,
        request: Request,
        is_urgent: bool,
    ) -> Result<Reply, BusError> {
        let (answer, answered) = oneshot::channel();
        let halts = self.halts_ordered.load(Ordering::Relaxed);
        self.send(LineRequest::Request { unit, request, is_urgent, halts, answer }).await?;
        answered.await.map_err(|_| LineFault::Closed)?
    }

    /// Stops drives now: the frames leave before all waiting requests and between the attempts of
    /// the current one, whose writes are not repeated. Returns when they have left; a lost line
    /// sends none. They leave even if the future is dropped.
    pub fn halt(&self, frames: HaltFrames) -> impl Future<Output = ()> + use<> {
        let (sent, left) = oneshot::channel();
        self.halts_ordered.fetch_add(1, Ordering::Relaxed);
        // An owner that has ended has nothing to stop.
        _ = self.halts.send(HaltOrder { frames, sent });
        async move { _ = left.await }
    }

    /// Reads holding registers.
    ///
    /// # Errors
    /// As [`request`](Self::request).
    pub async fn read(&self, unit: u8, address: u16, count: u16) -> Result<Vec<u16>, BusError> {
        match self.request(unit, Request::ReadHolding { address, count }).await? {
            Reply::Words(words) => Ok(words),
            Reply::Bits(_) | Reply::Written => unreachable!("a read is answered by words"),
        }
    }

    /// The counts of a device on the line.
    pub fn health(&self, unit: u8) -> HealthMeter {
        self.meters.of(unit)
    }

    /// Sets registers of a device with known values. They are read after each fault, before other
    /// answers of the device count again. Without them, only the quarantine separates a late answer
    /// from the right one.
    ///
    /// # Errors
    /// [`LineFault::Closed`] when the owner of the line has ended.
    pub async fn set_check_registers(
        &self,
        unit: u8,
        registers: Option<CheckRegisters>,
    ) -> Result<(), BusError> {
        let (answer, answered) = oneshot::channel();
        self.send(LineRequest::CheckRegisters { unit, registers, answer }).await?;
        Ok(answered.await.map_err(|_| LineFault::Closed)?)
    }

    async fn send(&self, order: LineRequest) -> Result<(), BusError> {
        self.orders.send(order).await.map_err(|_| LineFault::Closed.into())
    }
}

async fn own(mut line: Line, mut inbox: mpsc::Receiver<LineRequest>) {
    loop {
        let order = tokio::select! {
            biased;
            () = line.halt_come() => {
                // The operation that follows a stop sends it again, and the way out repeats that of a rotary stage.
                _ = unbroken(&mut line, async |line| line.send_halts().await).await;
                continue;
            }
            order = inbox.recv() => order,
        };
        let Some(order) = order else { return };
        // The caller may have gone away; the exchange is finished in any case.
        match order {
            LineRequest::Request { unit, request, is_urgent, halts, answer } => {
                let exchange =
                    async |line: &mut Line| line.request(unit, &request, halts, is_urgent).await;
                let reply = unbroken(&mut line, exchange).await;
                _ = answer.send(reply.unwrap_or_else(|fault| Err(fault.into())));
            }
            LineRequest::CheckRegisters { unit, registers, answer } => {
                line.set_check_registers(unit, registers);
                _ = answer.send(());
            }
        }
    }
}

/// Does something with the line. A panic is a fault of this exchange, so that the owner lives and
/// the probe can be retracted over the same line.
async fn unbroken<T>(
    line: &mut Line,
    exchange: impl AsyncFnOnce(&mut Line) -> T,
) -> Result<T, LineFault> {
    let done = AssertUnwindSafe(exchange(line)).catch_unwind().await;
    done.map_err(|panic| {
        line.distrust();
        let what = panic_message(&*panic).to_owned();
        LineFault::Panicked { port: line.name().clone(), what }
    })
}
