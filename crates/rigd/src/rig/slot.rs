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

/// An operation that waits for the end of another one.
struct Waiting {
    id: OperationId,
    operation: Operation,
    /// It was asked to end before it has begun: it begins with its stop raised, and says so at once.
    is_stopped: bool,
}

/// Devices and the operation that they carry out. An operation that comes while another is under way
/// waits for its end. Each operation reports, unless a later one takes its place while it waits: the engine
/// begins another one only if it no longer expects a report.
pub(super) struct Slot<D> {
    devices: Option<D>,
    in_flight: Option<InFlight<D>>,
    waiting: Option<Waiting>,
    stop: StopSignal,
}

impl<D: Perform> Slot<D> {
    pub(super) fn new(devices: D) -> Self {
        Self { devices: Some(devices), in_flight: None, waiting: None, stop: StopSignal::new() }
    }

    /// Begins an operation, or lets it wait for the end of the one under way.
    pub(super) fn start(&mut self, id: OperationId, operation: Operation) {
        self.begin(Waiting { id, operation, is_stopped: false });
    }

    fn begin(&mut self, next: Waiting) {
        let Some(mut devices) = self.devices.take() else {
            self.waiting = Some(next);
            return;
        };
        let Waiting { id, operation, is_stopped } = next;
        if is_stopped {
            self.stop.raise();
        } else {
            self.stop.lower();
        }
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
            let stop = self.stop.clone();
            self.in_flight = Some(Box::pin(async move {
                // The caller may have gone away.
                _ = tell.send(work(&mut devices, &stop).await);
                (devices, None)
            }));
        }
        told
    }

    /// Has the operation under way end early, and the one that waits for it too. Returns whether one waits.
    pub(super) fn end(&mut self) -> bool {
        self.stop.raise();
        if let Some(waiting) = &mut self.waiting {
            waiting.is_stopped = true;
        }
        self.waiting.is_some()
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
        if let Some(waiting) = self.waiting.take() {
            self.begin(waiting);
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
            Ok(Report::Stopped(None))
        }
    }

    /// The engine waits for the end of what it has begun.
    #[tokio::test]
    async fn an_operation_begun_while_the_devices_are_asked_something_else_always_ends() {
        for is_stopped in [false, true] {
            let mut slot = Slot::new(Devices);
            let told = slot.attend(async |_, _| 7);
            assert!(slot.is_busy());
            slot.start(OperationId(1), Operation::StopMotion);
            if is_stopped {
                assert!(slot.end());
            }
            assert_eq!(slot.ended().await, None);
            assert_eq!(told.await, Ok(7));
            let (id, ended) = slot.ended().await.unwrap();
            assert_eq!((id, ended.is_err()), (OperationId(1), is_stopped));
            slot.start(OperationId(2), Operation::StopMotion);
            assert!(slot.ended().await.unwrap().1.is_ok());
        }
    }

    /// The first one has been given up, and its end says nothing of the second.
    #[tokio::test]
    async fn an_operation_that_waits_for_a_stopped_one_begins_unless_it_is_stopped_too() {
        for is_stopped in [false, true] {
            let mut slot = Slot::new(Devices);
            slot.start(OperationId(1), Operation::StopMotion);
            assert!(!slot.end());
            slot.start(OperationId(2), Operation::StopMotion);
            if is_stopped {
                assert!(slot.end());
            }
            let (id, ended) = slot.ended().await.unwrap();
            assert_eq!((id, ended.is_err()), (OperationId(1), true));
            let (id, ended) = slot.ended().await.unwrap();
            assert_eq!((id, ended.is_err()), (OperationId(2), is_stopped));
            assert!(!slot.is_busy());
        }
    }
}
