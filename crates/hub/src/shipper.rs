//! Ships a journal for as long as its rig is open.
//!
//! ```text
//!   connect ─▶ ask for the cursor ─▶ batch, batch, … ─▶ wait for news, or greet every half minute
//!      ▲                                  │ any failure
//!      └──────── wait 1 s, 2 s, … 5 min ──┘
//! ```
//!
//! Nothing waits for it. It keeps one batch in memory, and whatever was not committed it sends again.

use std::{
    io,
    path::{Path, PathBuf},
    time::Duration,
};

use rig_model::with_causes;
use rig_store::Reader;
use tokio::{
    sync::watch,
    time::{Instant, error::Elapsed, sleep, sleep_until, timeout},
};
use tokio_postgres::{Client, Config};

use crate::{
    ConnectError, Identity, Inlet, InletError, TlsError, connect,
    retry::{Waits, closed},
};

/// Time limits of a connection, and of an answer: a batch is committed in milliseconds.
const CONNECT_TIME: Duration = Duration::from_secs(10);
/// Time limit of one address: a name may have several, and the first may be silent.
pub(crate) const ADDRESS_TIME: Duration = Duration::from_secs(3);
const ANSWER_TIME: Duration = Duration::from_secs(60);
/// The hub is told this often that the bench is there.
const GREET_EVERY: Duration = Duration::from_secs(30);
/// What is recorded within this time is sent together.
const TOGETHER: Duration = Duration::from_millis(200);
/// Longest time between two attempts.
const WAIT_MAX: Duration = Duration::from_secs(300);

/// Where a journal is shipped to, and as whom.
#[derive(Debug, Clone)]
pub struct Destination {
    config: Config,
    /// Certificate, key and authority; without them, there is no TLS.
    files: Option<[PathBuf; 3]>,
}

/// How the shipping of a journal stands.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Standing {
    /// Whether the hub has answered last.
    pub is_connected: bool,
    /// The last event that the hub has committed, as far as it has said so.
    pub event: u64,
    /// Records that were committed since the start.
    pub records: u64,
    /// Attempts that failed since the start.
    pub failures: u64,
    /// Why the last attempt failed, until one succeeds.
    pub error: Option<String>,
}

/// What the hub has of a journal.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Held {
    /// The last event that it has committed; 0 for a journal that it does not know.
    pub event: u64,
    /// Why it takes nothing more of the journal.
    pub quarantined: Option<String>,
}

/// Why shipping failed.
#[derive(Debug, thiserror::Error)]
pub enum ShipperError {
    /// The certificate of the bench.
    #[error(transparent)]
    Tls(#[from] TlsError),
    /// No connection.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// A batch.
    #[error(transparent)]
    Inlet(#[from] InletError),
    /// The runtime of the connection.
    #[error("the system gives no runtime for the connection to the hub")]
    Runtime(#[source] io::Error),
    /// No answer in time.
    #[error("the hub has not answered in time")]
    Silent(#[from] Elapsed),
}

impl Destination {
    /// The database at this host and port, as the role of a bench, by TLS with these files of PEM: the certificate of
    /// the bench, the key of that, and the certificate of the authority of the server. They are read at each connection.
    pub fn new(address: (&str, u16), database: &str, bench: &str, files: [PathBuf; 3]) -> Self {
        let mut config = Config::new();
        config.host(address.0).port(address.1).dbname(database).user(bench);
        config.connect_timeout(ADDRESS_TIME);
        Self { config, files: Some(files) }
    }

    /// A hub on this computer, without TLS.
    pub const fn local(config: Config) -> Self {
        Self { config, files: None }
    }

    /// Reads the files.
    ///
    /// # Errors
    /// [`TlsError`] names the file and its fault.
    pub fn check(&self) -> Result<(), TlsError> {
        self.identity().map(drop)
    }

    fn identity(&self) -> Result<Option<Identity>, TlsError> {
        let read = |[certificate, key, authority]: &[PathBuf; 3]| {
            Identity::read(certificate, key, authority)
        };
        self.files.as_ref().map(read).transpose()
    }

    async fn connect(&self) -> Result<Client, ShipperError> {
        let identity = self.identity()?;
        let (client, _task) =
            timeout(CONNECT_TIME, connect(&self.config, identity.as_ref())).await??;
        Ok(client)
    }

    /// Asks what the hub has of a journal, and changes nothing.
    ///
    /// # Errors
    /// [`ShipperError`].
    pub async fn held(&self, reader: &Reader) -> Result<Held, ShipperError> {
        let (journal, _) = reader.identity().map_err(InletError::from)?;
        let client = self.connect().await?;
        let select = "SELECT cursor_event, quarantined FROM hub.journal WHERE id = $1::text::uuid";
        let row = timeout(ANSWER_TIME, client.query_opt(select, &[&journal]))
            .await?
            .map_err(InletError::from)?;
        let held = row.map(|row| Held {
            event: row.get::<_, i64>(0).cast_unsigned(),
            quarantined: row.get(1),
        });
        Ok(held.unwrap_or(Held { event: 0, quarantined: None }))
    }
}

/// Ships the journal in `data` until everything is there and nobody has `news` of it any more. It never fails for
/// good: `standing` says how it stands.
pub async fn ship<T>(
    to: &Destination,
    data: &Path,
    software: &str,
    mut news: watch::Receiver<T>,
    standing: &watch::Sender<Standing>,
) {
    let mut waits = Waits::up_to(WAIT_MAX);
    loop {
        let Err(error) = passage(to, data, software, &mut news, standing).await else { return };
        if standing.borrow().error.is_none() {
            // The hub had taken everything, or a part of it.
            waits.begin_anew();
        }
        standing.send_modify(|standing| {
            standing.is_connected = false;
            standing.failures += 1;
            standing.error = Some(with_causes(&error));
        });
        tokio::select! {
            () = sleep(waits.next()) => {}
            // What is left is sent when the journal is open again.
            () = closed(&mut news) => return,
        }
    }
}

/// Ships over one connection.
async fn passage<T>(
    to: &Destination,
    data: &Path,
    software: &str,
    news: &mut watch::Receiver<T>,
    standing: &watch::Sender<Standing>,
) -> Result<(), ShipperError> {
    let reader = Reader::open(data).map_err(InletError::from)?;
    let client = to.connect().await?;
    let mut inlet = timeout(ANSWER_TIME, Inlet::open(client, &reader, software)).await??;
    let note = |event, records| {
        standing.send_modify(|standing| {
            *standing = Standing {
                is_connected: true,
                event,
                records: standing.records + records,
                failures: standing.failures,
                error: None,
            };
        });
    };
    // It has answered, and has taken nothing yet.
    standing.send_modify(|standing| {
        (standing.is_connected, standing.event) = (true, inlet.cursor().event);
    });
    let mut greeting_due = Instant::now() + GREET_EVERY;
    loop {
        let has_closed = news.has_changed().is_err();
        news.mark_unchanged();
        while let Some(batch) = inlet.next(&reader)? {
            let cursor = timeout(ANSWER_TIME, inlet.send(&batch)).await??;
            note(cursor.event, batch.records as u64);
            greeting_due = Instant::now() + GREET_EVERY;
        }
        note(inlet.cursor().event, 0);
        if has_closed {
            return Ok(());
        }
        if greeting_due <= Instant::now() {
            timeout(ANSWER_TIME, inlet.greet(&reader, software)).await??;
            greeting_due = Instant::now() + GREET_EVERY;
            continue;
        }
        tokio::select! {
            changed = news.changed() => {
                if changed.is_ok() {
                    sleep(TOGETHER).await;
                }
            }
            () = sleep_until(greeting_due) => {}
        }
    }
}
