//! The writer of the journal on the rig thread.

use std::{sync::Arc, time::Instant};

use rig_engine::Fault;
use rig_model::with_causes;
use rig_store::{Record, StoreError};

use super::{Shell, record};

impl Shell {
    pub(super) fn append(&mut self, record: &Record) {
        let (journal, _) = self.run.as_mut().unwrap_or(&mut self.session);
        match journal.append(self.clock.now().as_micros(), record) {
            Ok(id) => {
                self.view.last_event = id;
                if self.view.first_event == 0 {
                    self.view.first_event = id;
                }
            }
            // The journal is unchanged, and accepts the fault that follows.
            Err(error @ StoreError::Unwritable { .. }) => {
                let reason = with_causes(&error);
                tracing::error!(%reason, "a record was lost");
                self.unwritten = Some(reason);
            }
            Err(error) => self.journal_failed(&error),
        }
    }

    /// Records the last frames of the ports. On a simulated rig only after faults of devices: all
    /// other faults can be replayed from the seed.
    pub(super) fn open_black_boxes(&mut self, fault: &Fault) {
        if self.simulation.is_some() && !matches!(fault, Fault::Device(_)) {
            return;
        }
        let boxes = self.black_boxes.each_ref();
        for record in boxes.map(|(port, transcript)| record::black_box(port, transcript)) {
            self.append(&record);
        }
    }

    pub(super) fn commit(&mut self) {
        self.last_commit = Instant::now();
        if let Err(error) = self.session.0.commit() {
            self.journal_failed(&error);
        }
    }

    /// From now on only the way out of contact is allowed; the engine gets the error with its next
    /// operation.
    pub(super) fn journal_failed(&mut self, error: &StoreError) {
        if self.view.journal_error.is_none() {
            let reason: Arc<str> = with_causes(error).into();
            tracing::error!(%reason, "the journal cannot be written");
            self.view.journal_error = Some(reason);
        }
    }
}
