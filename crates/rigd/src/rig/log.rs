//! The journals that the rig thread writes: that of the session, and that of the run under way.

use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use rig_engine::{Device, Event, Failure, FailureKind, RigState};
use rig_link::Clock;
use rig_model::{RigTime, with_causes};
use rig_store::{Ending, Journal, Record, RunFinished, RunId, RunKind, Store, StoreError};

use super::{
    meters::Meters,
    pulse::{Doing, Pulse},
    record::Recorder,
};

/// A session is sealed when it ends, and a daemon runs for months.
const SESSION: Duration = Duration::from_secs(24 * 3600);

/// Why nothing may begin: the journal cannot be written.
pub(crate) fn unwritable(reason: &str) -> Failure {
    let detail = format!("cannot be written: {reason}");
    Failure { device: Device::Journal, kind: FailureKind::Line, detail }
}

/// Writes the records of the rig thread.
pub(super) struct Log {
    store: Store,
    clock: Clock,
    /// Name of the rig file, which names the sessions.
    rig: String,
    session: (Journal, Recorder),
    session_began: RigTime,
    run: Option<(Journal, Recorder)>,
    /// Ids of the first event of the session, 0 before it, and of the newest one that is committed.
    events: [u64; 2],
    /// Id of the newest event, which may not be committed yet.
    newest: u64,
    /// Why the journal refused a record; `None` after the engine has been informed.
    unwritten: Option<String>,
    /// Why the journal cannot be written any more.
    error: Option<Arc<str>>,
    last_commit: Instant,
    pulse: Arc<Pulse>,
    meters: Meters,
}

impl Log {
    pub(super) fn open(
        store: Store,
        rig: String,
        clock: Clock,
        pulse: &Arc<Pulse>,
        meters: &Meters,
    ) -> Result<Self, StoreError> {
        let mut journal = store.begin(RunKind::Session, &rig)?;
        // The status names the session: a disk that cannot hold it is told before anything is.
        journal.commit()?;
        let newest = store.newest_event()?;
        let session = (journal, Recorder::for_session());
        Ok(Self {
            store,
            clock,
            rig,
            session,
            session_began: clock.now(),
            run: None,
            events: [0, newest],
            newest,
            unwritten: None,
            error: None,
            last_commit: Instant::now(),
            pulse: Arc::clone(pulse),
            meters: meters.clone(),
        })
    }

    pub(super) const fn store(&self) -> &Store {
        &self.store
    }

    pub(super) const fn session(&self) -> RunId {
        self.session.0.id()
    }

    /// The run under way.
    pub(super) fn run(&self) -> Option<(RunId, &Recorder)> {
        self.run.as_ref().map(|(journal, recorder)| (journal.id(), recorder))
    }

    /// Ids of the first event of the session, 0 before it, and of the newest one that is committed, which others can
    /// read.
    pub(super) const fn events(&self) -> [u64; 2] {
        self.events
    }

    pub(super) const fn error(&self) -> Option<&Arc<str>> {
        self.error.as_ref()
    }

    /// The time since the last commit, by the wall clock.
    pub(super) fn since_commit(&self) -> Duration {
        self.last_commit.elapsed()
    }

    /// Events belong to this run until it is finished.
    pub(super) fn follow_run(&mut self, journal: Journal, recorder: Recorder) {
        self.run = Some((journal, recorder));
    }

    /// Gives a manual sweep its number.
    pub(super) const fn begin_sweep(&mut self) -> u64 {
        self.session.1.begin_sweep()
    }

    /// Records an event. The end of a run closes its journal.
    pub(super) fn note(&mut self, event: &Event) {
        let (_, recorder) = self.run.as_mut().unwrap_or(&mut self.session);
        let Some(record) = recorder.record(event) else { return };
        self.append(&record);
        if matches!(record, Record::RunFinished(_)) {
            self.commit();
            if let Some((_, run)) = self.run.take() {
                self.session.1.follow(&run);
            }
        }
    }

    pub(super) fn append(&mut self, record: &Record) {
        let before = self.pulse.beat(Doing::Recording);
        let (journal, _) = self.run.as_mut().unwrap_or(&mut self.session);
        let appended = journal.append(self.clock.now().as_micros(), record);
        self.pulse.beat(before);
        match appended {
            Ok(id) => {
                self.newest = id;
                if self.events[0] == 0 {
                    self.events[0] = id;
                }
            }
            // The journal is unchanged, and accepts the fault that follows.
            Err(error @ StoreError::Unwritable { .. }) => {
                let reason = with_causes(&error);
                tracing::error!(%reason, "a record was lost");
                self.unwritten = Some(reason);
            }
            Err(error) => self.failed(&error),
        }
    }

    pub(super) fn commit(&mut self) {
        let _span = tracing::info_span!("commit").entered();
        self.last_commit = Instant::now();
        let before = self.pulse.beat(Doing::Recording);
        let committed = self.session.0.commit();
        self.meters.committed(self.last_commit.elapsed());
        self.pulse.beat(before);
        match committed {
            Ok(()) => self.events[1] = self.newest,
            Err(error) => self.failed(&error),
        }
    }

    /// Whether everything that was noted is on disk after a commit.
    pub(super) const fn is_complete(&self) -> bool {
        self.error.is_none() && self.unwritten.is_none()
    }

    /// Whether a request that used the store by itself has left it usable.
    pub(super) fn check(&mut self) {
        if let Err(error) = self.store.epoch() {
            self.failed(&error);
        }
    }

    /// Counts what a request has committed to the store by itself. If that cannot be read, it counts with the next record.
    pub(super) fn count_others(&mut self) {
        let Ok(newest) = self.store.newest_event() else { return };
        self.newest = self.newest.max(newest);
        self.events[1] = self.events[1].max(newest);
    }

    /// Why nothing may begin without a journal; a refused record is reported once.
    pub(super) fn failure(&mut self) -> Option<Failure> {
        let closed = self.error.as_ref().map(|reason| unwritable(reason));
        closed.or_else(|| {
            let detail = self.unwritten.take()?;
            Some(Failure { device: Device::Journal, kind: FailureKind::Refused, detail })
        })
    }

    /// Whether the session has lasted a day and can be replaced, between runs.
    pub(super) fn is_session_old(&self) -> bool {
        let lasted = self.clock.now().since(self.session_began);
        lasted >= SESSION && self.run.is_none() && self.error.is_none()
    }

    /// Begins another session of a rig in this state, so that the one before is sealed.
    pub(super) fn renew_session(&mut self, state: RigState) {
        self.end_session();
        self.session_began = self.clock.now();
        match self.store.begin(RunKind::Session, &self.rig) {
            Ok(journal) => {
                self.events[0] = 0;
                // Sweeps are counted on, so that no number means two of them.
                self.session.0 = journal;
                // The end of the session before says of the rig that it was closed.
                self.note(&Event::StateChanged(state));
                self.commit();
            }
            Err(error) => self.failed(&error),
        }
    }

    pub(super) fn end_session(&mut self) {
        let end = Record::RunFinished(RunFinished { status: Ending::Completed });
        if let Err(error) = self.session.0.append(self.clock.now().as_micros(), &end) {
            self.failed(&error);
        }
        self.commit();
    }

    /// From now on only the way out of contact is allowed; the engine gets the error with its next
    /// operation.
    fn failed(&mut self, error: &StoreError) {
        if self.error.is_none() {
            let reason: Arc<str> = with_causes(error).into();
            tracing::error!(%reason, "the journal cannot be written");
            self.error = Some(reason);
        }
    }
}
