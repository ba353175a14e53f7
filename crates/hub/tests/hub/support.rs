//! A PostgreSQL for all tests of this program, journals, and what the hub must have of them.

use std::{
    collections::BTreeMap,
    path::Path,
    sync::{
        OnceLock,
        atomic::{AtomicU32, Ordering},
    },
    time::Duration,
};

use rig_hub::{BenchName, Inlet, InletError, Trial, admin, connect};
use rig_store::{
    BlackBox, Clearance, Ending, Fault, Frame, Journal, Operator, Reader, Record, RunFinished,
    RunKind, StateChanged, Store,
};
use tempfile::TempDir;
use tokio::time::timeout;
use tokio_postgres::Client;

/// Longest time in which something happens.
pub(crate) const PATIENCE: Duration = Duration::from_secs(60);

/// The server. It ends with this program.
pub(crate) fn server() -> &'static Trial {
    static SERVER: OnceLock<Trial> = OnceLock::new();
    SERVER.get_or_init(|| {
        let directory = TempDir::with_prefix("hub").unwrap().keep();
        Trial::start(&directory, false).unwrap()
    })
}

/// A hub with a database of its own.
pub(crate) struct Hub {
    pub(crate) database: String,
    pub(crate) admin: Client,
}

impl Hub {
    pub(crate) async fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let database = format!("hub_{}", COUNT.fetch_add(1, Ordering::Relaxed));
        let config = server().admin(&database);
        admin::init(&config).await.unwrap();
        let (admin, _task) = connect(&config, None).await.unwrap();
        Self { database, admin }
    }

    /// Connects again, after a crash of the server.
    pub(crate) async fn reconnect(&mut self) {
        self.admin = self.another().await;
    }

    /// Another connection of the administrator.
    pub(crate) async fn another(&self) -> Client {
        connect(&server().admin(&self.database), None).await.unwrap().0
    }

    /// Adds a bench of this hub; the name of its role is the answer.
    pub(crate) async fn bench(&self, name: &str) -> String {
        let role = format!("{}/{name}", self.database);
        let bench: BenchName = role.parse().unwrap();
        admin::add_bench(&self.admin, &bench).await.unwrap();
        role
    }

    /// A connection with this role, by the socket of the server.
    pub(crate) async fn as_role(&self, role: &str) -> Client {
        let mut config = server().admin(&self.database);
        config.user(role);
        connect(&config, None).await.unwrap().0
    }

    /// Ships everything of a journal, or what a hub takes of it.
    pub(crate) async fn ship(&self, role: &str, data: &Path) -> Result<u64, InletError> {
        let reader = Reader::open(data)?;
        let mut inlet = Inlet::open(self.as_role(role).await, &reader, "rigd 0").await?;
        while let Some(batch) = inlet.next(&reader)? {
            inlet.send(&batch).await?;
        }
        Ok(inlet.cursor().event)
    }

    pub(crate) async fn count(&self, from: &str) -> i64 {
        let select = format!("SELECT count(*) FROM {from}");
        self.admin.query_one(&select, &[]).await.unwrap().get(0)
    }

    /// Waits until something is so of this database, within the time of a test.
    pub(crate) async fn until(&self, what: &str, is_so: impl AsyncFn() -> bool) {
        let all = async {
            while !is_so().await {
                tokio::task::yield_now().await;
            }
        };
        timeout(PATIENCE, all).await.unwrap_or_else(|_| panic!("{what} within {PATIENCE:?}"));
    }

    /// How many connections to this database wait for a lock.
    pub(crate) async fn waiting(&self) -> i64 {
        self.count(
            "pg_stat_activity WHERE datname = current_database() AND wait_event_type = 'Lock'",
        )
        .await
    }

    /// The kinds of the alarms that wait, in order.
    pub(crate) async fn alarms(&self) -> Vec<String> {
        let state = rig_hub::state(&self.admin).await.unwrap();
        state.alarms.into_iter().map(|alarm| alarm.kind).collect()
    }

    /// Every run in the hub as lines: its entry, stretches, records and end, each byte of them.
    pub(crate) async fn contents(&self) -> BTreeMap<String, Vec<String>> {
        self.contents_of("%").await
    }

    /// The same of the benches whose role is like this.
    pub(crate) async fn contents_of(&self, role: &str) -> BTreeMap<String, Vec<String>> {
        let rows = "
            WITH wanted AS (SELECT * FROM hub.run WHERE bench IN (SELECT id FROM hub.bench WHERE role::text LIKE $1))
            SELECT id::text AS run, 0 AS part, 0::bigint AS n,
                   concat_ws('|', origin_bench, origin_journal, kind, name, format, epoch, started_at) AS line
            FROM wanted
            UNION ALL SELECT run::text, 1, epoch, concat_ws('|', epoch, started_at, rig_us) FROM hub.stretch WHERE run IN (SELECT id FROM wanted)
            UNION ALL SELECT run::text, 2, seq,
                   concat_ws('|', event, seq, epoch, rig_us, kind, payload, encode(digest, 'hex'))
            FROM hub.record WHERE run IN (SELECT id FROM wanted)
            UNION ALL SELECT id::text, 3, 0, concat_ws('|', finished_at, status, records, encode(head, 'hex'),
                                                       encode(seal, 'hex'))
            FROM wanted WHERE finished_at IS NOT NULL
            ORDER BY run, part, n";
        let mut contents = BTreeMap::<String, Vec<String>>::new();
        for row in self.admin.query(rows, &[&role]).await.unwrap() {
            contents.entry(row.get(0)).or_default().push(row.get(3));
        }
        contents
    }
}

/// Compares what the hub has with what it must have, line by line.
#[track_caller]
pub(crate) fn assert_same(
    found: &BTreeMap<String, Vec<String>>,
    wanted: &BTreeMap<String, Vec<String>>,
) {
    assert!(found.keys().eq(wanted.keys()), "{:?} are not {:?}", found.keys(), wanted.keys());
    for (run, lines) in wanted {
        for (number, line) in lines.iter().enumerate() {
            assert_eq!(found[run].get(number), Some(line), "{run}, line {number}");
        }
        assert_eq!(found[run].len(), lines.len(), "{run}");
    }
}

/// The same of a journal, read from SQLite by statements of these tests.
pub(crate) fn contents_of(data: &Path) -> BTreeMap<String, Vec<String>> {
    let journal = rusqlite::Connection::open(data.join("rigd.db")).unwrap();
    let rows = "
        SELECT id, 0, 0, concat_ws('|', bench, journal, kind, name, format, epoch, started_at) FROM runs
        UNION ALL SELECT runs.id, 1, s.epoch, concat_ws('|', s.epoch, s.started_at, s.rig_us)
        FROM stretches AS s JOIN runs ON key = run
        UNION ALL SELECT runs.id, 2, seq, concat_ws('|', r.id, seq, r.epoch, r.rig_us, r.kind, payload,
                                                    lower(hex(r.digest)))
        FROM records AS r JOIN runs ON key = r.run
        UNION ALL SELECT id, 3, 0, concat_ws('|', finished_at, status,
            (SELECT max(seq) FROM records WHERE run = key),
            (SELECT lower(hex(digest)) FROM records WHERE run = key ORDER BY seq DESC LIMIT 1),
            iif(seal IS NULL, NULL, lower(hex(seal))))
        FROM runs LEFT JOIN seals ON seals.run = key WHERE status <> 'running'
        ORDER BY 1, 2, 3";
    let mut contents = BTreeMap::<String, Vec<String>>::new();
    let mut statement = journal.prepare(rows).unwrap();
    let mut rows = statement.query([]).unwrap();
    while let Some(row) = rows.next().unwrap() {
        contents.entry(row.get(0).unwrap()).or_default().push(row.get(3).unwrap());
    }
    contents
}

/// A command of a person with this text.
pub(crate) fn command(text: &str) -> Record {
    Record::Operator(Operator { action: text.to_owned(), who: "ada".to_owned() })
}

/// A fault with a text that is hard to carry.
pub(crate) fn fault() -> Record {
    Record::Fault(Fault {
        step: None,
        cause: "\u{0}\"quoted\" \\u0000 \u{1f9ea} µ\n".to_owned(),
        probe: Clearance::Clear,
        hint: "nothing".to_owned(),
        last_moves_mm: None,
    })
}

/// A record as long as the mean one of a run, about 600 bytes.
pub(crate) fn frames() -> Record {
    let frame = Frame { rig_us: 1, is_sent: true, hex: "0123456789abcdef".repeat(16) };
    Record::BlackBox(BlackBox { port: "bus".to_owned(), frames: vec![frame.clone(), frame] })
}

/// Appends records to a run, and commits.
pub(crate) fn append(journal: &mut Journal, records: &[Record]) {
    for record in records {
        journal.append(1_000_000, record).unwrap();
    }
    journal.commit().unwrap();
}

/// A sealed run with this many commands of a person and a fault.
pub(crate) fn sealed_run(store: &Store, name: &str, commands: usize) {
    let mut journal = store.begin(RunKind::Run, name).unwrap();
    let commands: Vec<_> =
        (0..commands).map(|number| command(&format!("{name} {number}"))).collect();
    append(&mut journal, &commands);
    append(&mut journal, &[fault(), finished(Ending::Completed)]);
}

pub(crate) fn finished(status: Ending) -> Record {
    Record::RunFinished(RunFinished { status })
}

pub(crate) fn state(state: &str) -> Record {
    Record::StateChanged(StateChanged { state: state.to_owned(), reason: None })
}

/// A journal with a session that goes on and two sealed runs.
pub(crate) fn journal() -> (TempDir, Store, Journal) {
    let data = TempDir::new().unwrap();
    let store = Store::open(data.path()).unwrap();
    let mut session = store.begin(RunKind::Session, "session").unwrap();
    append(&mut session, &[state("idle")]);
    sealed_run(&store, "smoke", 3);
    append(&mut session, &[fault()]);
    sealed_run(&store, "smoke", 1200);
    (data, store, session)
}
