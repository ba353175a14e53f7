//! The two owners of devices, each with its operation under way, and the stop that waits for neither.

use rig_commission::{Jogged, Order};
use rig_engine::{Failure, Operation, OperationId};
use rig_model::Reading;
use tokio::sync::{mpsc, oneshot};

use super::{
    DeviceIdentity,
    descending::Descending,
    devices::{Axes, GatedAnalyzer},
    identify::{self, Answers},
    open::Halt,
    slot::{Ended, Slot},
    step,
};

/// What the devices have to say.
#[derive(Debug)]
pub(super) enum Said {
    /// Devices are free again after work that was no operation.
    Free,
    /// An operation has ended.
    Ended(OperationId, Ended),
    /// A reading of the descent under way.
    Read(OperationId, Reading),
}

/// The owners of the drives and of the analyzer.
pub(super) struct Owners {
    axes: Slot<Axes>,
    analyzer: Slot<GatedAnalyzer>,
    halt: Halt,
    /// An operation that ended before it was sent.
    refused: Option<(OperationId, Failure)>,
    descending: Option<Descending>,
    streamed: mpsc::UnboundedReceiver<Reading>,
}

impl Owners {
    pub(super) fn new(
        axes: Axes,
        analyzer: GatedAnalyzer,
        streamed: mpsc::UnboundedReceiver<Reading>,
        halt: Halt,
    ) -> Self {
        let (axes, analyzer) = (Slot::new(axes), Slot::new(analyzer));
        Self { axes, analyzer, halt, refused: None, descending: None, streamed }
    }

    pub(super) fn start(&mut self, id: OperationId, operation: Operation) {
        match &operation {
            Operation::Measure { .. } => self.analyzer.start(id, operation),
            Operation::Descend { .. } => {
                // Those of an earlier stream say nothing.
                while self.streamed.try_recv().is_ok() {}
                self.descending = Some(Descending::new(id));
                self.analyzer.start(id, operation.clone());
                self.axes.start(id, operation);
            }
            _ => self.axes.start(id, operation),
        }
    }

    /// Ends an operation that is not sent.
    pub(super) fn refuse(&mut self, id: OperationId, failure: Failure) {
        self.refused = Some((id, failure));
    }

    /// Ends the operation in progress. A moving axis stops at once, even while its bus is busy.
    pub(super) fn interrupt(&mut self) {
        self.analyzer.end();
        if let Some(descending) = &mut self.descending {
            descending.stream_ended();
        }
        if self.axes.is_busy() {
            self.axes.end();
            drop(self.halt.now());
        }
    }

    /// Ends the descent in progress, in order: the linear stage is stopped between two frames of the bus.
    pub(super) fn end_descent(&mut self) {
        self.axes.end();
        self.end_stream();
    }

    /// A stream that waits for another measurement, which may take minutes, is not waited for.
    fn end_stream(&mut self) {
        let is_waiting = self.analyzer.end();
        if let Some(descending) = self.descending.as_mut().filter(|_| is_waiting) {
            descending.stream_ended();
        }
    }

    /// Stops both axes without waiting for anything; see [`Halt::now`].
    pub(super) fn halt(&self) -> impl Future<Output = ()> + use<> {
        self.halt.now()
    }

    pub(super) const fn are_busy(&self) -> bool {
        self.axes.is_busy() || self.analyzer.is_busy()
    }

    /// Asks the devices, which are idle, again who they are.
    pub(super) fn identify(&mut self, known: &[DeviceIdentity; 3]) -> Answers {
        let [analyzer, linear, rotary] = known.clone();
        [
            self.analyzer.attend(async move |gated, _| identify::analyzer(analyzer, gated).await),
            self.axes.attend(async move |axes, _| identify::axes([linear, rotary], axes).await),
        ]
    }

    /// Has a drive, while the devices are idle, do something for commissioning.
    pub(super) fn commission(
        &mut self,
        order: Order,
    ) -> oneshot::Receiver<Result<Jogged, step::NotMade>> {
        self.axes.attend(async move |axes, stop| step::make(axes, order, stop).await)
    }

    /// Waits until the devices have something to say. May be dropped at any time.
    pub(super) async fn said(&mut self) -> Said {
        if let Some((id, failure)) = self.refused.take() {
            return Said::Ended(id, Err(failure));
        }
        loop {
            // Every reading comes before the end of its descent.
            if let Some(descending) = &mut self.descending {
                if let Ok(reading) = self.streamed.try_recv() {
                    return Said::Read(descending.id, reading);
                }
                if let Some((id, ended)) = descending.take_end() {
                    self.descending = None;
                    return Said::Ended(id, ended);
                }
            }
            let id = self.descending.as_ref().map(|descending| descending.id);
            // The order is fixed, so that a run replays.
            let (ended, is_of_axes) = tokio::select! {
                biased;
                Some(reading) = self.streamed.recv() => match id {
                    Some(id) => return Said::Read(id, reading),
                    None => continue,
                },
                ended = self.axes.ended() => (ended, true),
                ended = self.analyzer.ended() => (ended, false),
            };
            let Some((ended_id, ended)) = ended else { return Said::Free };
            let of_descent = self.descending.as_mut().filter(|one| one.id == ended_id);
            match of_descent {
                None => return Said::Ended(ended_id, ended),
                Some(descending) if is_of_axes => {
                    descending.motion_ended(ended);
                    self.end_stream();
                }
                Some(descending) => {
                    descending.stream_ended();
                    if descending.is_moving() {
                        self.axes.end();
                    }
                }
            }
        }
    }
}
