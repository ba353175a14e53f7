//! What a handle asks of the rig thread.

use std::sync::Arc;

use rig_commission::{Answer, Asked, JogAxis, Jogged, Order};
use rig_engine::Command;
use rig_model::SweepRequest;
use rig_store::RunId;
use tokio::sync::oneshot;

use super::{NotMade, RequestRefusal, TouchOrder, identify};
use crate::protocol_file::LoadedProtocol;

/// A message to the rig thread.
#[derive(Debug)]
pub(super) enum Request {
    Run {
        protocol: Box<LoadedProtocol>,
        by: String,
        key: Option<String>,
        reply: oneshot::Sender<Result<RunId, RequestRefusal>>,
    },
    Resume {
        run: RunId,
        is_confirmed: bool,
        by: String,
        reply: oneshot::Sender<Result<(), RequestRefusal>>,
    },
    Redo {
        order: TouchOrder,
        is_confirmed: bool,
        by: String,
        reply: oneshot::Sender<Result<RunId, RequestRefusal>>,
    },
    Skip {
        order: TouchOrder,
        by: String,
        reply: oneshot::Sender<Result<(), RequestRefusal>>,
    },
    GiveUp {
        run: RunId,
        by: String,
        reply: oneshot::Sender<Result<(), RequestRefusal>>,
    },
    Sweep {
        request: SweepRequest,
        by: String,
        reply: oneshot::Sender<Result<u64, RequestRefusal>>,
    },
    Command {
        command: Command,
        run: Option<RunId>,
        by: String,
        reply: oneshot::Sender<Result<(), RequestRefusal>>,
    },
    Answer {
        run: RunId,
        step: String,
        by: String,
        reply: oneshot::Sender<Result<(), RequestRefusal>>,
    },
    Identify {
        by: String,
        reply: oneshot::Sender<Result<identify::Answers, RequestRefusal>>,
    },
    Commission {
        order: Order,
        by: String,
        reply: oneshot::Sender<Result<oneshot::Receiver<Result<Jogged, NotMade>>, RequestRefusal>>,
    },
    StepSeen {
        axis: JogAxis,
        by: String,
        reply: oneshot::Sender<Result<(), RequestRefusal>>,
    },
    AskSimulated {
        asked: Asked,
        reply: oneshot::Sender<Option<Answer>>,
    },
    Answered {
        asked: Asked,
        answer: Answer,
        reply: oneshot::Sender<()>,
    },
    ReadCalibrations {
        by: String,
        reply: oneshot::Sender<Option<Arc<str>>>,
    },
    Note {
        action: String,
        by: String,
        reply: oneshot::Sender<Result<(), RequestRefusal>>,
    },
    Close {
        reply: oneshot::Sender<()>,
    },
    /// Blocks the rig thread until the other end is dropped.
    #[cfg(test)]
    Block(std::sync::mpsc::Receiver<()>),
    /// Has the rig thread panic at this event of the engine, counted from now.
    #[cfg(test)]
    PanicAt(u64),
}

impl Request {
    /// Whether it asks for what is under way to end.
    pub(super) const fn is_stop(&self) -> bool {
        matches!(self, Self::Command { command: Command::Stop | Command::Abort, .. })
    }

    /// Whether the data directory is used to answer it.
    pub(super) const fn uses_data(&self) -> bool {
        matches!(
            self,
            Self::Run { .. }
                | Self::Resume { .. }
                | Self::Redo { .. }
                | Self::Skip { .. }
                | Self::GiveUp { .. }
                | Self::ReadCalibrations { .. }
        )
    }
}
