//! One of the two owners of devices: it carries out one operation at a time, each to its end.

use std::pin::Pin;

use rig_engine::{Failure, Operation, OperationId, Report};
use rig_link::StopSignal;
use tokio::sync::oneshot;

/// The end of an operation.
pub(super) type Ended = Result<Report, Failure>;

/// Devices that carry out operations.
pub(super) trait Perform: Sized + 'static {
    /// Carries an operation out and says how it ended. Not cancel-safe: a future that is dropped may
    /// leave half a frame on the line. `stop` ends it early.
    async fn perform(&mut self, operation: &Operation, stop: &StopSignal) -> Ended;
}

/// What gives the devices back, with the end of an operation if it was one.
type InFlight<D> = Pin<Box<dyn Future<Output = (D, Option<(OperationId, Ended)>)>>>;

/// Devices and the operation that they carry out. An operation that comes while another is under way
/// waits for its end.
pub(super) struct Slot<D> {
    devices: Option<D>,
    in_flight: Option<InFlight<D>>,
    waiting: Option<(OperationId, Operation)>,
    /// They do something that is no operation.
    is_attending: bool,
    stop: StopSignal,
}

impl<D: Perform> Slot<D> {
    pub(super) fn new(devices: D) -> Self {
        let stop = StopSignal::new();
        Self { devices: Some(devices), in_flight: None, waiting: None, is_attending: false, stop }
    }

    /// Begins an operation, or lets it wait for the end of the one under way.
    pub(super) fn start(&mut self, id: OperationId, operation: Operation) {
        if self.devices.is_some() {
            self.stop.lower();
        }
        self.begin(id, operation);
    }

    fn begin(&mut self, id: OperationId, operation: Operation) {
        let Some(mut devices) = self.devices.take() else {
            // One that the engine has given up never began.
            self.waiting = Some((id, operation));
            return;
        };
        let stop = self.stop.clone();
        self.in_flight = Some(Box::pin(async move {
            let ended = devices.perform(&operation, &stop).await;
            (devices, Some((id, ended)))
        }));
    }

    /// Has idle devices do something that is no operation of the engine. The signal ends it early.
    pub(super) fn attend<T: 'static>(
        &mut self,
        work: impl AsyncFnOnce(&mut D, &StopSignal) -> T + 'static,
    ) -> oneshot::Receiver<T> {
        let (tell, told) = oneshot::channel();
        if let Some(mut devices) = self.devices.take() {
            self.stop.lower();
            self.is_attending = true;
            let stop = self.stop.clone();
            self.in_flight = Some(Box::pin(async move {
                // The caller may have gone away.
                _ = tell.send(work(&mut devices, &stop).await);
                (devices, None)
            }));
        }
        told
    }

    /// Has the operation under way end early.
    pub(super) fn interrupt(&mut self) {
        self.stop.raise();
        // The engine waits for the end of the only operation that it has begun.
        if !self.is_attending {
            self.waiting = None;
        }
    }

    /// Has the operation under way end early, in order. `false` if it had not begun, and never will.
    pub(super) fn end(&mut self) -> bool {
        self.stop.raise();
        self.waiting.take().is_none()
    }

    pub(super) const fn is_busy(&self) -> bool {
        self.in_flight.is_some()
    }

    /// Waits until the devices are free, and returns the end of the operation if it was one; for ever,
    /// when they are free. May be dropped at any time.
    pub(super) async fn ended(&mut self) -> Option<(OperationId, Ended)> {
        let Some(in_flight) = &mut self.in_flight else { return std::future::pending().await };
        let (devices, ended) = in_flight.await;
        self.in_flight = None;
        self.devices = Some(devices);
        let was_attending = std::mem::take(&mut self.is_attending);
        match self.waiting.take() {
            // A stop that came meanwhile ends it.
            Some((id, operation)) if was_attending => self.begin(id, operation),
            Some((id, operation)) => self.start(id, operation),
            None => {}
        }
        ended
    }
}

#[cfg(test)]
mod tests {
    use rig_engine::{Device, FailureKind};

    use super::*;

    struct Devices;

    impl Perform for Devices {
        async fn perform(&mut self, _: &Operation, stop: &StopSignal) -> Ended {
            if stop.is_raised() {
                let (device, kind) = (Device::LinearStage, FailureKind::Interrupted);
                return Err(Failure { device, kind, detail: String::new() });
            }
            Ok(Report::Stopped)
        }
    }

    /// The engine waits for the end of what it has begun.
    #[tokio::test]
    async fn an_operation_begun_while_the_devices_are_asked_something_else_always_ends() {
        for is_interrupted in [false, true] {
            let mut slot = Slot::new(Devices);
            let told = slot.attend(async |_, _| 7);
            assert!(slot.is_busy());
            slot.start(OperationId(1), Operation::StopMotion);
            if is_interrupted {
                slot.interrupt();
            }
            assert_eq!(slot.ended().await, None);
            assert_eq!(told.await, Ok(7));
            let (id, ended) = slot.ended().await.unwrap();
            assert_eq!((id, ended.is_err()), (OperationId(1), is_interrupted));
            slot.start(OperationId(2), Operation::StopMotion);
            assert!(slot.ended().await.unwrap().1.is_ok());
        }
    }
}
