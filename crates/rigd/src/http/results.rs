//! The results of ended runs, computed once.

use std::{
    collections::VecDeque,
    sync::{Arc, Mutex, PoisonError},
};

use rig_report::RunResults;
use rig_store::{ChainCheck, Digest, Reader, Run, RunId, RunStatus, StoreError};

/// Number of runs whose results are kept. A browser shows one run at a time, and the results of a
/// long run take a few megabytes.
const KEPT: usize = 8;

/// The results of a run, and the check of the records that they were computed from.
#[derive(Debug)]
pub(super) struct CheckedResults {
    pub(super) results: RunResults,
    pub(super) check: ChainCheck,
}

/// The results of the last requested runs.
///
/// Only those of an ended run with an intact chain are kept. They hold as long as the journal has
/// the same entry and the same last digest for the run, which covers all of its records.
#[derive(Debug, Default)]
pub(super) struct ResultsCache {
    /// The latest last.
    kept: Mutex<VecDeque<Arc<CheckedResults>>>,
}

impl ResultsCache {
    /// The results of a run.
    ///
    /// # Errors
    /// [`StoreError::NoSuchRun`], or the error of reading the records before the first flaw.
    pub(super) fn of(&self, reader: &Reader, id: RunId) -> Result<Arc<CheckedResults>, StoreError> {
        let (run, digest) = (reader.run(id)?, reader.last_digest(id)?);
        if let Some(found) = self.find(&run, digest) {
            return Ok(found);
        }
        let chain = reader.chain(id)?;
        let results = RunResults::new(&run, &reader.amend(id, chain.records)?)?;
        let checked = Arc::new(CheckedResults { results, check: chain.check });
        if matches!((run.status, &checked.check), (RunStatus::Ended(_), ChainCheck::Intact { .. }))
        {
            let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
            kept.retain(|other| other.results.run().id != id);
            kept.truncate(KEPT - 1);
            kept.push_front(Arc::clone(&checked));
        }
        Ok(checked)
    }

    /// The results that are kept for a run with this last digest, which become the latest.
    fn find(&self, run: &Run, last: Option<Digest>) -> Option<Arc<CheckedResults>> {
        let is_same = |kept: &Arc<CheckedResults>| {
            let digest = match kept.check {
                ChainCheck::Intact { digest, .. } => Some(digest),
                ChainCheck::Broken { .. } => None,
            };
            kept.results.run() == run && digest == last
        };
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
        Ending, PlanSize, PromptAnswered, Record, RunFinished, RunKind, RunStarted, Source, Store,
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
            samples: Vec::new(),
            plan: PlanSize { steps: 0, touches: 0, prompts: 0 },
            touches: Vec::new(),
            classes: None,
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
    fn a_run_that_grows_is_computed_again_until_it_ends() {
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
            let is_kept = Arc::ptr_eq(&found, &cache.of(&reader, id).unwrap());
            assert_eq!(is_kept, count == 3, "after record {count}");
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
    fn records_that_differ_from_the_kept_ones_are_read_again() {
        let directory = TempDir::new().unwrap();
        let store = Store::open(directory.path()).unwrap();
        let id = run(&store, &[started(), END]);
        let (cache, reader) = (ResultsCache::default(), store.reader().unwrap());
        let kept = cache.of(&reader, id).unwrap();
        let entry = reader.run(id).unwrap();
        assert!(cache.find(&entry, reader.last_digest(id).unwrap()).is_some());
        assert!(cache.find(&entry, Some(Digest::START)).is_none(), "another last record");
        let longer = Run { records: entry.records + 1, ..entry };
        let ChainCheck::Intact { digest, .. } = kept.check else { panic!("{:?}", kept.check) };
        assert!(cache.find(&longer, Some(digest)).is_none(), "another length");
    }
}
