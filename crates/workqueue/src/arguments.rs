//! The options of a program that uses a queue.

use std::{
    ffi::OsStr,
    path::{Path, PathBuf},
    time::Duration,
};

use async_nats::ServerAddr;
use clap::{Arg, Args, Command, builder::TypedValueParser, error::ErrorKind};

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
    #[arg(long, value_name = "URL", requires = "action", value_parser = ServerParser)]
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

/// Reads the address of a server. It may have a password, so that a text that is none is not repeated.
#[derive(Debug, Clone, Copy)]
struct ServerParser;

impl TypedValueParser for ServerParser {
    type Value = ServerAddr;

    fn parse_ref(
        &self,
        command: &Command,
        _argument: Option<&Arg>,
        value: &OsStr,
    ) -> Result<ServerAddr, clap::Error> {
        value.to_str().and_then(server).ok_or_else(|| {
            let told = "the URL of --queue is not nats://[USER:PASSWORD@]HOST[:PORT] or tls://[USER:PASSWORD@]HOST[:PORT], with a \
                        password of letters and digits; it is not repeated here\n";
            clap::Error::raw(ErrorKind::ValueValidation, told).with_cmd(command)
        })
    }
}

/// The address in a text. With a path or a query, it is none: a password with such a character is not taken for host and port.
fn server(text: &str) -> Option<ServerAddr> {
    let server: ServerAddr = text.parse().ok()?;
    let rest = text.split_once("://").map_or(text, |(_, rest)| rest);
    let rest = rest.strip_suffix('/').unwrap_or(rest);
    (!server.host().is_empty() && !rest.contains(['/', '?', '#', '\\'])).then_some(server)
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

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Debug, Parser)]
    struct Program {
        #[command(flatten)]
        queue: QueueArguments,
    }

    fn read(url: &str) -> Result<Program, clap::Error> {
        Program::try_parse_from(["program", "--fill", "--queue", url])
    }

    #[test]
    fn an_address_that_cannot_be_read_is_not_repeated() {
        for url in [
            "nats://lab:secret@host:high",
            "nats://lab:secret@",
            "http://lab:secret@host",
            "lab:secret@host:99999",
            "nats://lab:12/secret@host",
            "nats://lab:12?secret@host",
            "nats://lab:12#secret@host",
        ] {
            let refused = read(url).unwrap_err();
            assert_eq!(refused.exit_code(), 2, "{url}");
            let said = refused.to_string();
            assert!(said.contains("--queue") && !said.contains("secret"), "{said}");
            assert!(!said.contains("12"), "{said}");
        }
    }

    #[test]
    fn an_address_may_have_a_user_and_a_port() {
        for url in
            ["nats://lab:secret@host:4222", "tls://host/", "host", "host:4", "nats://[::1]:5"]
        {
            let program = read(url).unwrap();
            assert!(program.queue.asked().is_some(), "{url}");
        }
    }
}
