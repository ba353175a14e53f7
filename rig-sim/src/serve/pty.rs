//! A pseudo-terminal as a serial port that clients open and close.
//!
//! The other side is kept open here, so that the terminal stays raw and a client that closes it is
//! not an error. A client that opened it exclusively and closed would lock it for ever, and the
//! next client would read the rest of its data. Both are repaired after the last client has closed,
//! which the file system reports.

use std::{
    fs::File,
    io,
    path::{Path, PathBuf},
    time::Duration,
};

use rustix::{
    fd::{AsFd, OwnedFd},
    fs::{Mode, OFlags, inotify},
    pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt},
    termios::{OptionalActions, QueueSelector, ioctl_tiocnxcl, tcflush, tcgetattr, tcsetattr},
};
use tokio::{
    io::{AsyncReadExt, Join},
    net::unix::pipe,
};

/// Delay of bytes between the two sides of a terminal.
const WITHIN_THE_SYSTEM: Duration = Duration::from_millis(5);

/// The side of the device. To the runtime a terminal is a pipe for each way.
pub(super) type Terminal = Join<pipe::Receiver, pipe::Sender>;

/// A pseudo-terminal.
#[derive(Debug)]
pub(super) struct Pty {
    path: PathBuf,
    terminal: Terminal,
    line: Line,
    clients: Clients,
}

/// The side that clients open.
#[derive(Debug)]
pub(super) struct Line(OwnedFd);

impl Pty {
    pub(super) fn open() -> io::Result<Self> {
        let device = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        grantpt(&device)?;
        unlockpt(&device)?;
        let name = ptsname(&device, Vec::new())?;
        let path = PathBuf::from(name.into_string().map_err(io::Error::other)?);
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
        let line = rustix::fs::open(&path, flags, Mode::empty())?;
        make_raw(&line)?;
        let device = File::from(device);
        let terminal = tokio::io::join(
            pipe::Receiver::from_file_unchecked(device.try_clone()?)?,
            pipe::Sender::from_file_unchecked(device)?,
        );
        // Only now, so that the opening above is not counted.
        let clients = Clients::watch(&path)?;
        Ok(Self { path, terminal, line: Line(line), clients })
    }

    /// The path that clients open.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn parts(&mut self) -> (&mut Terminal, &Line, &mut Clients) {
        (&mut self.terminal, &self.line, &mut self.clients)
    }
}

impl Line {
    /// Restores the terminal for the next client, and discards the data that the last one did not
    /// read.
    pub(super) async fn refresh(&self) -> io::Result<()> {
        ioctl_tiocnxcl(&self.0)?;
        make_raw(&self.0)?;
        // The last written bytes have not arrived yet where they can be discarded.
        tokio::time::sleep(WITHIN_THE_SYSTEM).await;
        tcflush(&self.0, QueueSelector::IFlush)?;
        Ok(())
    }
}

fn make_raw(line: impl AsFd) -> io::Result<()> {
    let mut settings = tcgetattr(&line)?;
    settings.make_raw();
    tcsetattr(&line, OptionalActions::Now, &settings)?;
    Ok(())
}

/// Programs that have the other side open.
#[derive(Debug)]
pub(super) struct Clients {
    events: pipe::Receiver,
    count: usize,
}

/// An event without a name: the watch, what happened, a cookie, and a length of zero.
const EVENT_BYTES: usize = 16;

impl Clients {
    fn watch(path: &Path) -> io::Result<Self> {
        use inotify::{CreateFlags, WatchFlags};
        let events = inotify::init(CreateFlags::NONBLOCK | CreateFlags::CLOEXEC)?;
        let watched = WatchFlags::OPEN | WatchFlags::CLOSE_WRITE | WatchFlags::CLOSE_NOWRITE;
        inotify::add_watch(&events, path, watched)?;
        let events = pipe::Receiver::from_file_unchecked(File::from(events))?;
        Ok(Self { events, count: 0 })
    }

    /// Waits until the last client has closed.
    pub(super) async fn gone(&mut self) -> io::Result<()> {
        loop {
            // As many events as are there; the system hands out whole ones only.
            let mut buffer = [0; 64 * EVENT_BYTES];
            let read = self.events.read(&mut buffer).await?;
            let mut is_gone = false;
            for event in buffer[..read].chunks_exact(EVENT_BYTES) {
                let happened = u32::from_ne_bytes([event[4], event[5], event[6], event[7]]);
                if happened & inotify::ReadFlags::OPEN.bits() != 0 {
                    self.count += 1;
                    is_gone = false;
                } else {
                    // The system may have reported two openings as one.
                    self.count = self.count.saturating_sub(1);
                    is_gone = self.count == 0;
                }
            }
            if is_gone {
                return Ok(());
            }
        }
    }
}
