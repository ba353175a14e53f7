//! The results of runs, computed once for their records.

use std::{
    collections::VecDeque,
    path::Path,
    sync::{Arc, Mutex, OnceLock, PoisonError},
};

use rig_report::{RunResults, RunVerdict};
use rig_store::{ChainCheck, Digest, Reader, Run, RunId, StoreError};

use crate::verdict;

/// Number of runs whose results are kept. A browser shows one run at a time, and the results of a
/// long run take a few megabytes.
const KEPT: usize = 8;

/// The results of a run, and the check of the records that they were computed from.
#[derive(Debug)]
pub(super) struct CheckedResults {
    pub(super) results: RunResults,
    pub(super) check: ChainCheck,
    tips: Vec<Tip>,
    verdict: OnceLock<RunVerdict>,
}

impl CheckedResults {
    /// The verdict of the checker, which is asked once.
    pub(super) fn verdict(&self, data: &Path) -> &RunVerdict {
        self.verdict.get_or_init(|| verdict::for_report(data, self.results.run().id))
    }
}

/// A run or an amendment, with the digest of its last record.
type Tip = (RunId, Option<Digest>);

/// The results of the last requested runs.
///
/// Those of a run with an intact chain are kept. They hold as long as the journal has the same entry for
/// the run, and the same last digests, which cover all records of the run and of its amendments. Of a run
/// that has grown, the stiffness holds until the next touch.
#[derive(Debug, Default)]
pub(super) struct ResultsCache {
    /// The latest first.
    kept: Mutex<VecDeque<Arc<CheckedResults>>>,
}

impl ResultsCache {
    /// The results of a run.
    ///
    /// # Errors
    /// [`StoreError::NoSuchRun`], or the error of reading the records before the first flaw.
    pub(super) fn of(&self, reader: &Reader, id: RunId) -> Result<Arc<CheckedResults>, StoreError> {
        let (run, amendments) = (reader.run(id)?, reader.amendments(id)?);
        let tip = |id| -> Result<Tip, StoreError> { Ok((id, reader.last_digest(id)?)) };
        let tips: Vec<Tip> =
            [id].into_iter().chain(amendments).map(tip).collect::<Result<_, _>>()?;
        if let Some(found) = self.find(&run, &tips) {
            return Ok(found);
        }
        let chain = reader.chain(id)?;
        let is_intact = matches!(chain.check, ChainCheck::Intact { .. });
        let earlier = self.earlier(id);
        let earlier = earlier.as_ref().map(|earlier| &earlier.results);
        let results = RunResults::after(&run, &reader.amend(id, chain.records)?, earlier)?;
        let verdict = OnceLock::new();
        let checked = Arc::new(CheckedResults { results, check: chain.check, tips, verdict });
        if is_intact {
            let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
            kept.retain(|other| other.results.run().id != id);
            kept.truncate(KEPT - 1);
            kept.push_front(Arc::clone(&checked));
        }
        Ok(checked)
    }

    /// The results of a run as they were.
    fn earlier(&self, id: RunId) -> Option<Arc<CheckedResults>> {
        let kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.iter().find(|kept| kept.results.run().id == id).map(Arc::clone)
    }

    /// The results that are kept for a run with these last digests, which become the latest.
    fn find(&self, run: &Run, tips: &[Tip]) -> Option<Arc<CheckedResults>> {
        let is_same = |kept: &Arc<CheckedResults>| kept.results.run() == run && kept.tips == tips;
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let found = kept.iter().position(is_same)?;
        let found = kept.remove(found)?;
        kept.push_front(Arc::clone(&found));
        Some(found)
    }
}

#[cfg(test)]
mod tests {
    use rig_store::{
        Amended, Amendment, Ending, PlanSize, PromptAnswered, Record, RunFinished, RunKind,
        RunStarted, Source, Store,
    };
    use tempfile::TempDir;

    use super::*;

    fn started() -> Record {
        let source = || Source { name: "empty".to_owned(), toml: String::new() };
        Record::RunStarted(RunStarted {
            software: "rigd".to_owned(),
            seed: 1,
            protocol: source(),
            rig: source(),
            is_simulated: true,
            scene: None,
            devices: Vec::new(),
            calibrations: Vec::new(),
            samples: Vec::new(),
            plan: PlanSize { steps: 0, touches: 0, prompts: 0 },
            touches: Vec::new(),
            classes: None,
            expected: None,
            aim: None,
            idempotency_key: None,
        })
    }

    const END: Record = Record::RunFinished(RunFinished { status: Ending::Completed });

    /// A run of these records.
    fn run(store: &Store, records: &[Record]) -> RunId {
        let mut journal = store.begin(RunKind::Run, "empty").unwrap();
        for record in records {
            journal.append(0, record).unwrap();
        }
        journal.commit().unwrap();
        journal.id()
    }

    #[test]
    fn the_results_of_an_ended_run_are_computed_once() {
        let directory = TempDir::new().unwrap();
        let store = Store::open(directory.path()).unwrap();
        let id = run(&store, &[started(), END]);
        let cache = ResultsCache::default();
        let first = cache.of(&store.reader().unwrap(), id).unwrap();
        assert!(Arc::ptr_eq(&first, &cache.of(&store.reader().unwrap(), id).unwrap()));
        drop(store);
        let reader = Reader::open(directory.path()).unwrap();
        assert!(Arc::ptr_eq(&first, &cache.of(&reader, id).unwrap()));
    }

    #[test]
    fn a_run_that_grows_is_computed_again_for_each_record() {
        let directory = TempDir::new().unwrap();
        let store = Store::open(directory.path()).unwrap();
        let mut journal = store.begin(RunKind::Run, "empty").unwrap();
        let (cache, id, reader) = (ResultsCache::default(), journal.id(), store.reader().unwrap());
        let answer = PromptAnswered { step: "prompt/1".to_owned(), by: "the page".to_owned() };
        for (count, record) in (1..).zip([started(), Record::PromptAnswered(answer), END]) {
            journal.append(0, &record).unwrap();
            journal.commit().unwrap();
            let found = cache.of(&reader, id).unwrap();
            assert_eq!(found.results.run().records, count);
            assert!(matches!(found.check, ChainCheck::Intact { records, .. } if records == count));
            assert!(Arc::ptr_eq(&found, &cache.of(&reader, id).unwrap()), "after record {count}");
        }
    }

    #[test]
    fn an_amendment_of_an_ended_run_is_computed_in() {
        let directory = TempDir::new().unwrap();
        let store = Store::open(directory.path()).unwrap();
        let id = run(&store, &[started(), END]);
        let (cache, reader) = (ResultsCache::default(), store.reader().unwrap());
        for count in 0..3 {
            let found = cache.of(&reader, id).unwrap();
            assert_eq!(found.tips.len(), 1 + count);
            assert!(Arc::ptr_eq(&found, &cache.of(&reader, id).unwrap()));
            let mut journal = store.begin(RunKind::Amendment, &id.to_string()).unwrap();
            let amended = Record::Amended(Amended {
                run: id.to_string(),
                head: String::new(),
                step: "main/1/front/0/1".to_owned(),
                what: Amendment::Skip,
                who: "the lab".to_owned(),
                why: "a bubble".to_owned(),
                software: "rigd".to_owned(),
                rig: None,
                calibrations: None,
                devices: Vec::new(),
                changes: Vec::new(),
            });
            journal.append(0, &amended).unwrap();
            journal.append(0, &END).unwrap();
            journal.commit().unwrap();
            assert!(!Arc::ptr_eq(&found, &cache.of(&reader, id).unwrap()));
        }
    }

    #[test]
    fn the_cache_drops_the_run_that_was_asked_for_least_recently() {
        let directory = TempDir::new().unwrap();
        let store = Store::open(directory.path()).unwrap();
        let (cache, reader) = (ResultsCache::default(), store.reader().unwrap());
        let ids: Vec<RunId> = (0..=KEPT).map(|_| run(&store, &[started(), END])).collect();
        let ask = |id| cache.of(&reader, id).unwrap();
        let first: Vec<_> = ids[..KEPT].iter().map(|&id| ask(id)).collect();
        assert!(Arc::ptr_eq(&first[0], &ask(ids[0])));
        ask(ids[KEPT]);
        assert_eq!(cache.kept.lock().unwrap().len(), KEPT);
        assert!(Arc::ptr_eq(&first[0], &ask(ids[0])), "it was asked for again");
        assert!(!Arc::ptr_eq(&first[1], &ask(ids[1])), "it was asked for least recently");
    }

    #[test]
    fn another_entry_or_another_digest_is_computed_again() {
        let directory = TempDir::new().unwrap();
        let store = Store::open(directory.path()).unwrap();
        let id = run(&store, &[started(), END]);
        let (cache, reader) = (ResultsCache::default(), store.reader().unwrap());
        let tips = cache.of(&reader, id).unwrap().tips.clone();
        let entry = reader.run(id).unwrap();
        assert!(cache.find(&entry, &tips).is_some());
        assert!(cache.find(&entry, &[(id, Some(Digest::START))]).is_none(), "another last record");
        let longer = Run { records: entry.records + 1, ..entry };
        assert!(cache.find(&longer, &tips).is_none(), "another length");
    }
}
