//! Tells viewers by NATS what the rig does.
//!
//! It has a thread of its own beside the rig, as the shipper has, and knows nothing of that: no message moves the cursor of
//! the hub, and a nats-server that is slow or gone delays neither the rig nor the shipper.

use std::{io, path::PathBuf};

use rig_files::service_file::HubFile;
use rig_hub::{
    BenchName, NameError,
    live::{Broker, LiveError, LiveStanding, publish},
};
use tokio::sync::watch;

use crate::{
    beside::{Beside, Words, tell},
    rig::Status,
};

const WORDS: Words = Words {
    fails: "live messages do not reach NATS, which is tried again",
    goes_on: "viewers are told by NATS again",
};

/// Where viewers are told, and as which bench.
#[derive(Debug, Clone)]
pub(crate) struct Audience {
    broker: Broker,
    bench: BenchName,
}

/// Tells for as long as it is kept.
#[derive(Debug)]
pub(crate) struct Live {
    standing: watch::Receiver<LiveStanding>,
    beside: Beside,
}

impl Audience {
    /// The nats-server of a service file, if it has one.
    ///
    /// # Errors
    /// [`NameError`] for a bench with another name than a hub gives.
    pub(crate) fn of(file: &HubFile) -> Result<Option<Self>, NameError> {
        let Some((host, port)) = &file.live else { return Ok(None) };
        let files = [&file.certificate, &file.key, &file.authority].map(Clone::clone);
        let broker = Broker::new((host, *port), files);
        Ok(Some(Self { broker, bench: file.bench.parse()? }))
    }

    /// Host and port of the nats-server.
    pub(crate) fn address(&self) -> &str {
        self.broker.address()
    }

    /// Connects once. Nobody is told anything.
    ///
    /// # Errors
    /// [`LiveError`].
    pub(crate) fn try_out(&self) -> Result<(), LiveError> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        runtime.map_err(LiveError::Runtime)?.block_on(self.broker.try_out())
    }
}

impl Live {
    /// Begins to tell what the rig does and what the journal in `data` gets, until the rig has closed. `state` makes the
    /// document of the rig.
    ///
    /// # Errors
    /// The system has no thread.
    pub(crate) fn start(
        to: Audience,
        data: PathBuf,
        status: watch::Receiver<Status>,
        state: impl Fn(&Status) -> String + Send + 'static,
    ) -> io::Result<Self> {
        let (sender, standing) = watch::channel(LiveStanding::default());
        let beside = Beside::start("live", move || async move {
            let told = tell(sender.subscribe(), |standing| standing.error.clone(), WORDS);
            tokio::select! {
                () = publish(&to.broker, &to.bench, &data, status, state, &sender) => {}
                () = told => {}
            }
        })?;
        Ok(Self { standing, beside })
    }

    /// For the figures of the service.
    pub(crate) fn standing(&self) -> watch::Receiver<LiveStanding> {
        self.standing.clone()
    }

    /// Waits a short time until the last state is sent, once the rig has closed.
    pub(crate) async fn finish(self) {
        self.beside.finish(self.standing).await;
    }
}
