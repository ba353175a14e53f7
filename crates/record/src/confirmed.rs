//! Whether what was measured after a touch confirms it.

use std::collections::BTreeSet;

use crate::{Amendment, Ending, Record, SweepOutcome, SweepPurpose};

/// Which measured touches are confirmed, found by taking in the records of a run in their order.
///
/// A contact sense that fails during a touch shows in what is measured next: the impedance of the clear
/// probe before another approach or at the end of the run, or another reference. A run that ends before that
/// leaves its last touch unconfirmed.
#[derive(Debug, Default)]
pub struct Confirmed {
    /// The step of the last measured touch, as long as nothing is measured after it.
    last: Option<String>,
    unconfirmed: BTreeSet<String>,
    /// The next end is that of an amendment that leaves a touch out.
    is_skip: bool,
}

impl Confirmed {
    /// Takes in the next record of a run, or of an amendment of it.
    pub fn take(&mut self, record: &Record) {
        match record {
            Record::TouchResult(touch) => {
                self.unconfirmed.remove(&touch.touch.step);
                self.last = Some(touch.touch.step.clone());
            }
            Record::TouchRefused(refused) => {
                let step = &refused.touch.step;
                self.unconfirmed.remove(step);
                // One that was refused before the probe touched says nothing of the touch before it.
                self.last.take_if(|last| last == step || refused.indented.is_some());
            }
            Record::SurfaceFound(_) => self.last = None,
            Record::Sweep(sweep) => {
                let is_accepted = matches!(sweep.outcome, SweepOutcome::Accepted { .. });
                self.last.take_if(|_| sweep.purpose == SweepPurpose::NoLoad && is_accepted);
            }
            Record::RunFinished(_) if self.is_skip => self.is_skip = false,
            Record::RunFinished(finished) => {
                let is_whole =
                    matches!(finished.status, Ending::Completed | Ending::CompletedWithRefusals);
                self.last.take_if(|_| is_whole);
                self.end();
            }
            // Nothing is measured where a touch is left out, which may be during the run.
            Record::Amended(amended) if amended.what == Amendment::Skip => self.is_skip = true,
            Record::Resumed(_) | Record::GivenUp(_) | Record::Amended(_) => self.end(),
            _ => {}
        }
    }

    fn end(&mut self) {
        self.unconfirmed.extend(self.last.take());
    }

    /// Whether the measured touch of this step is confirmed; `None` for the last one if the records end
    /// behind it.
    pub fn touch(&self, step: &str) -> Option<bool> {
        let is_last = self.last.as_deref() == Some(step);
        (!is_last).then(|| !self.unconfirmed.contains(step))
    }
}
