//! The options of a program that uses a queue.

use std::{
    path::{Path, PathBuf},
    time::Duration,
};

use async_nats::ServerAddr;
use clap::Args;

use crate::{
    chunk::Work,
    error::QueueError,
    server::{Queue, Redelivery},
};

/// A queue, and what is done with it.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "From a queue of NATS JetStream")]
pub struct QueueArguments {
    /// The server: `nats://HOST[:PORT]`, or `tls://HOST[:PORT]`.
    #[arg(long, value_name = "URL", requires = "action")]
    queue: Option<ServerAddr>,
    /// Put the work into the queue, in chunks. What is there already or was computed is not added twice.
    #[arg(long, group = "action", requires = "queue")]
    fill: bool,
    /// Compute chunks of the queue until none is left.
    #[arg(long, group = "action", requires = "queue")]
    worker: bool,
    /// Write the page of what the workers have computed, when all of it is there.
    #[arg(long, group = "action", requires = "queue")]
    gather: bool,
    /// Directory with `ca.pem`, the certificate of the authority of the server, and, if the server asks for one,
    /// `worker.pem` and `worker.key`.
    #[arg(long, value_name = "DIR", requires = "queue")]
    queue_files: Option<PathBuf>,
    /// A chunk goes to another worker if its own has said nothing for this time [default: that of the queue, or 60 in a new one]
    #[arg(long, value_name = "S", requires = "fill", conflicts_with_all = ["worker", "gather"], value_parser = clap::value_parser!(u64).range(1..))]
    silent_s: Option<u64>,
    /// Workers that get a chunk, one after the other, before it is given up [default: that of the queue, or 3 in a new one]
    #[arg(long, value_name = "N", requires = "fill", conflicts_with_all = ["worker", "gather"], value_parser = clap::value_parser!(i64).range(1..))]
    deliveries: Option<i64>,
    /// Longest time that a worker waits while others have the last chunks, and that pieces are waited for.
    #[arg(
        long,
        value_name = "S",
        requires = "action",
        conflicts_with = "fill",
        default_value_t = 3600
    )]
    within_s: u64,
}

/// A queue that is asked for.
#[derive(Debug)]
pub struct Asked<'a> {
    server: &'a ServerAddr,
    files: Option<&'a Path>,
    /// What is done with it.
    pub action: Action,
}

/// What is done with a queue.
#[derive(Debug, Clone, Copy)]
pub enum Action {
    /// It is filled.
    Fill(Redelivery),
    /// Chunks are computed, with this longest time of waiting.
    Work(Duration),
    /// Pieces are gathered within this time.
    Gather(Duration),
}

impl QueueArguments {
    /// The queue, if one is asked for.
    pub fn asked(&self) -> Option<Asked<'_>> {
        let (server, files) = (self.queue.as_ref()?, self.queue_files.as_deref());
        let within = Duration::from_secs(self.within_s);
        let action = if self.fill {
            let after = self.silent_s.map(Duration::from_secs);
            Action::Fill(Redelivery { after, deliveries: self.deliveries })
        } else if self.worker {
            Action::Work(within)
        } else {
            Action::Gather(within)
        };
        Some(Asked { server, files, action })
    }
}

impl Asked<'_> {
    /// Connects to the server.
    ///
    /// # Errors
    /// [`QueueError`].
    pub fn connect(&self, work: Work) -> Result<Queue, QueueError> {
        Queue::connect(self.server, self.files, work)
    }
}
