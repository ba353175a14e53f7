//! What a sweep states as known of the bench comes from the survey before it.

use crate::{
    finding::{Check, Findings},
    record::{Bench, Sweep},
};

/// The bench of the last survey.
#[derive(Debug, Default)]
pub(super) struct BenchChain {
    last: Option<Bench>,
}

impl BenchChain {
    /// `is_asked` says whether the protocol asks for a survey.
    pub(super) fn sweep(
        &mut self,
        seq: u64,
        sweep: &Sweep,
        (is_accepted, is_asked): (bool, bool),
        findings: &mut Findings,
    ) {
        let stated = sweep.fit.as_ref().and_then(|fit| fit.bench);
        let number = sweep.number;
        match (self.last, stated) {
            (None, Some(_)) if sweep.purpose == "no_load" && is_asked => {
                // A refused survey is made again.
                self.last = stated.filter(|_| is_accepted);
            }
            (None, None) if !(is_asked && is_accepted) => {}
            (last, stated) if last.is_some() && last == stated => {}
            (last, stated) => {
                let what = format!("sweep {number}: the bench is not that of the survey before it");
                findings.add(Check::Request, seq, what, format!("{last:?}"), format!("{stated:?}"));
            }
        }
    }
}
