//! A descent, which both owners carry out together: it ends when the stage is at rest and the stream of readings
//! has ended. After an interruption the readings are not waited for.

use rig_engine::OperationId;

use super::slot::Ended;

/// The descent under way.
#[derive(Debug)]
pub(super) struct Descending {
    pub(super) id: OperationId,
    /// How the motion ended.
    motion: Option<Ended>,
    is_stream_over: bool,
}

impl Descending {
    pub(super) const fn new(id: OperationId) -> Self {
        Self { id, motion: None, is_stream_over: false }
    }

    pub(super) fn motion_ended(&mut self, ended: Ended) {
        self.motion = Some(ended);
    }

    pub(super) const fn is_moving(&self) -> bool {
        self.motion.is_none()
    }

    pub(super) const fn stream_ended(&mut self) {
        self.is_stream_over = true;
    }

    /// The end of the descent, as soon as both have ended. A stream that failed has ended.
    pub(super) fn take_end(&mut self) -> Option<(OperationId, Ended)> {
        let motion = self.motion.take_if(|_| self.is_stream_over)?;
        Some((self.id, motion))
    }
}
