//! One of the two owners of devices: it carries out one operation at a time, each to its end.

use std::pin::Pin;

use rig_engine::{Failure, Operation, OperationId, Report};
use rig_link::StopSignal;

/// The end of an operation.
pub(super) type Ended = Result<Report, Failure>;

/// Devices that carry out operations.
pub(super) trait Perform: Sized + 'static {
    /// Carries an operation out and says how it ended. Not cancel-safe: a future that is dropped may
    /// leave half a frame on the line. `stop` ends it early.
    async fn perform(&mut self, operation: &Operation, stop: &StopSignal) -> Ended;
}

type InFlight<D> = Pin<Box<dyn Future<Output = (D, OperationId, Ended)>>>;

/// Devices and the operation that they carry out. An operation that comes while another is under way
/// waits for its end.
pub(super) struct Slot<D> {
    devices: Option<D>,
    in_flight: Option<InFlight<D>>,
    waiting: Option<(OperationId, Operation)>,
    stop: StopSignal,
}

impl<D: Perform> Slot<D> {
    pub(super) fn new(devices: D) -> Self {
        let stop = StopSignal::new();
        Self { devices: Some(devices), in_flight: None, waiting: None, stop }
    }

    /// Begins an operation, or lets it wait for the end of the one under way.
    pub(super) fn start(&mut self, id: OperationId, operation: Operation) {
        let Some(mut devices) = self.devices.take() else {
            // One that the engine has given up never began.
            self.waiting = Some((id, operation));
            return;
        };
        self.stop.lower();
        let stop = self.stop.clone();
        self.in_flight = Some(Box::pin(async move {
            let ended = devices.perform(&operation, &stop).await;
            (devices, id, ended)
        }));
    }

    /// Has the operation under way end early.
    pub(super) fn interrupt(&mut self) {
        self.stop.raise();
        self.waiting = None;
    }

    pub(super) const fn is_busy(&self) -> bool {
        self.in_flight.is_some()
    }

    /// Waits for the end of the operation under way; for ever, when there is none. May be dropped at
    /// any time.
    pub(super) async fn ended(&mut self) -> (OperationId, Ended) {
        let Some(in_flight) = &mut self.in_flight else { return std::future::pending().await };
        let (devices, id, ended) = in_flight.await;
        self.in_flight = None;
        self.devices = Some(devices);
        if let Some((id, operation)) = self.waiting.take() {
            self.start(id, operation);
        }
        (id, ended)
    }
}
