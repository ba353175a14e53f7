//! The two owners of devices, each with its operation under way, and the stop that waits for neither.

use rig_commission::{Jog, Jogged};
use rig_engine::{Failure, Operation, OperationId};
use tokio::sync::oneshot;

use super::{
    DeviceIdentity,
    devices::{Axes, GatedAnalyzer},
    identify::{self, Answers},
    open::Halt,
    slot::{Ended, Slot},
    step,
};

/// The owners of the drives and of the analyzer.
pub(super) struct Owners {
    axes: Slot<Axes>,
    analyzer: Slot<GatedAnalyzer>,
    halt: Halt,
    /// An operation that ended before it was sent.
    refused: Option<(OperationId, Failure)>,
}

impl Owners {
    pub(super) fn new(axes: Axes, analyzer: GatedAnalyzer, halt: Halt) -> Self {
        Self { axes: Slot::new(axes), analyzer: Slot::new(analyzer), halt, refused: None }
    }

    pub(super) fn start(&mut self, id: OperationId, operation: Operation) {
        match &operation {
            Operation::Measure { .. } => self.analyzer.start(id, operation),
            _ => self.axes.start(id, operation),
        }
    }

    /// Ends an operation that is not sent.
    pub(super) fn refuse(&mut self, id: OperationId, failure: Failure) {
        self.refused = Some((id, failure));
    }

    /// Ends the operation in progress. A moving axis stops at once, even while its bus is busy.
    pub(super) fn interrupt(&mut self) {
        self.analyzer.interrupt();
        if self.axes.is_busy() {
            self.axes.interrupt();
            drop(self.halt.now());
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

    /// Has an axis, while the devices are idle, make a step of commissioning.
    pub(super) fn jog(&mut self, jog: Jog) -> oneshot::Receiver<Result<Jogged, String>> {
        self.axes.attend(async move |axes, stop| step::make(axes, jog, stop).await)
    }

    /// Waits until devices are free, and returns the end of the operation if it was one. May be dropped at
    /// any time.
    pub(super) async fn ended(&mut self) -> Option<(OperationId, Ended)> {
        if let Some((id, failure)) = self.refused.take() {
            return Some((id, Err(failure)));
        }
        // The order is fixed, so that a run replays.
        tokio::select! {
            biased;
            ended = self.axes.ended() => ended,
            ended = self.analyzer.ended() => ended,
        }
    }
}
