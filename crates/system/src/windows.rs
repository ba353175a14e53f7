//! What Windows does in its own way.

use std::{
    env,
    fs::{self, File, Metadata, OpenOptions},
    io::{self, Read},
    os::windows::fs::MetadataExt,
    path::{Path, PathBuf},
    process::{self, Command, Stdio},
    sync::LazyLock,
    time::{Duration, Instant},
};

use crossterm_winapi::{Console, Handle};
use rustix::fd::AsFd;
use thread_priority::{Error, WinAPIThreadPriority, set_winapi_thread_priority, thread_native_id};

use crate::{files::Stamp, priority::as_io, program::REPLACES};

pub(crate) const RANDOM_NUMBERS: &str = "the random numbers of Windows";
pub(crate) const LOGIN_VARIABLES: &[&str] = &["USERNAME"];
pub(crate) const COMES_FIRST_WITH: &str = "Windows refused";

/// The file that stands for the lock of its folder.
const FOLDER_LOCK: &str = ".rigd.lock";
/// More steps of `nice` than these are the lowest priority of a thread.
const BELOW_NORMAL_UP_TO: i32 = 9;

pub(crate) fn with_mode(options: &mut OpenOptions, _: u32) -> &mut OpenOptions {
    options
}

#[expect(clippy::unnecessary_wraps, reason = "the same signature as on Unix")]
pub(crate) fn set_mode(_: &File, _: u32) -> io::Result<()> {
    Ok(())
}

pub(crate) fn forbidden_mode(_: &Metadata, _: u32) -> Option<u32> {
    None
}

#[expect(clippy::unnecessary_wraps, reason = "the same signature as on Unix")]
pub(crate) fn protection(path: &Path) -> Option<String> {
    Some(format!(
        "{}: who may read and change it is what the access list of its folder says; rigd does not look at access lists of \
         Windows, so keep it in a folder of this user alone, such as below %LOCALAPPDATA%",
        path.display()
    ))
}

pub(crate) fn stamp(file: &Metadata) -> Stamp {
    let written = file.last_write_time().cast_signed();
    Stamp(file.creation_time(), written, 0, file.len())
}

pub(crate) fn sync_folder(folder: &Path) -> io::Result<()> {
    if fs::metadata(folder)?.is_dir() { Ok(()) } else { Err(io::ErrorKind::NotADirectory.into()) }
}

pub(crate) fn sync_file(path: &Path) -> io::Result<()> {
    let permissions = fs::metadata(path)?.permissions();
    if !permissions.readonly() {
        return File::options().write(true).open(path)?.sync_all();
    }
    let mut writable = permissions.clone();
    #[expect(clippy::permissions_set_readonly_false, reason = "an attribute here, not a mode")]
    writable.set_readonly(false);
    fs::set_permissions(path, writable)?;
    let synced = File::options().write(true).open(path).and_then(|file| file.sync_all());
    fs::set_permissions(path, permissions)?;
    synced
}

pub(crate) fn whole_path(path: &Path) -> io::Result<PathBuf> {
    fs::metadata(path)?;
    std::path::absolute(path)
}

pub(crate) fn lock_to_hold(_: &File, path: &Path) -> io::Result<File> {
    File::options().create(true).truncate(false).write(true).open(lock_of(path))
}

pub(crate) fn lock_to_try(_: &File, path: &Path) -> io::Result<File> {
    File::open(lock_of(path))
}

fn lock_of(path: &Path) -> PathBuf {
    let mut lock = path.as_os_str().to_owned();
    lock.push(".lock");
    PathBuf::from(lock)
}

pub(crate) fn folder_lock(folder: &Path) -> io::Result<File> {
    let path = folder.join(FOLDER_LOCK);
    let lock = File::options().create(true).truncate(false).write(true).open(path)?;
    lock.lock()?;
    Ok(lock)
}

pub(crate) fn exchange(staged: &Path, place: &Path) -> io::Result<()> {
    if place.exists() {
        crate::files::exchange_by_moves(staged, place)
    } else {
        fs::rename(staged, place)
    }
}

pub(crate) fn free_bytes(directory: &Path) -> io::Result<u64> {
    fs4::available_space(directory)
}

/// The counter of Windows goes on while the computer sleeps.
///
/// # Source
/// `QueryPerformanceCounter`, "Acquiring high-resolution time stamps".
pub(crate) fn running() -> Duration {
    static FIRST: LazyLock<Instant> = LazyLock::new(Instant::now);
    FIRST.elapsed()
}

pub(crate) fn of_thread() -> Duration {
    running()
}

pub(crate) const fn handle_limit() -> Option<u64> {
    None
}

#[expect(clippy::unnecessary_wraps, reason = "the same signature as on Unix")]
pub(crate) const fn take_handles() -> io::Result<()> {
    Ok(())
}

pub(crate) fn limit_silence(stream: &impl AsFd, within: Duration) -> io::Result<()> {
    crate::network::ask_whether_it_is_there(stream, within)
}

pub(crate) fn without_a_name() -> String {
    "a user without a name".to_owned()
}

pub(crate) fn come_first() -> Result<(), Error> {
    set(WinAPIThreadPriority::TimeCritical)
}

pub(crate) fn come_after() -> Result<(), Error> {
    set(WinAPIThreadPriority::Normal)
}

pub(crate) fn give_way(by: i32) -> io::Result<()> {
    let priority = if by <= BELOW_NORMAL_UP_TO {
        WinAPIThreadPriority::BelowNormal
    } else {
        WinAPIThreadPriority::Lowest
    };
    set(priority).map_err(as_io)
}

fn set(priority: WinAPIThreadPriority) -> Result<(), Error> {
    set_winapi_thread_priority(thread_native_id(), priority)
}

pub(crate) fn replace_by(mut command: Command, exit_code: i32) -> io::Error {
    // The end of this program closes the other side of the pipe.
    match command.env(REPLACES, "1").stdin(Stdio::piped()).spawn() {
        Ok(_) => process::exit(exit_code),
        Err(error) => error,
    }
}

pub(crate) fn wait_for_the_replaced() {
    if env::var_os(REPLACES).is_some() {
        // An error is an end too.
        _ = io::stdin().lock().read_to_end(&mut Vec::new());
    }
}

pub(crate) fn can_redraw() -> bool {
    anstyle_query::windows::enable_ansi_colors() == Some(true)
}

pub(crate) fn columns() -> Option<usize> {
    let (width, _) = terminal_size::terminal_size_of(io::stderr())?;
    Some(usize::from(width.0)).filter(|&columns| columns > 0)
}

pub(crate) fn forget_input() {
    let Ok(input) = Handle::current_in_handle() else { return };
    let console = Console::from(input);
    // Reading waits where there is nothing to read.
    while console.number_of_console_input_events().is_ok_and(|events| events > 0) {
        if console.read_console_input().is_err() {
            return;
        }
    }
}

#[cfg(feature = "signals")]
#[derive(Debug)]
pub(crate) struct Ending {
    c: tokio::signal::windows::CtrlC,
    breaks: tokio::signal::windows::CtrlBreak,
    close: tokio::signal::windows::CtrlClose,
    logoff: tokio::signal::windows::CtrlLogoff,
    shutdown: tokio::signal::windows::CtrlShutdown,
}

#[cfg(feature = "signals")]
impl Ending {
    pub(crate) fn listen() -> io::Result<Self> {
        use tokio::signal::windows::{ctrl_break, ctrl_c, ctrl_close, ctrl_logoff, ctrl_shutdown};
        Ok(Self {
            c: ctrl_c()?,
            breaks: ctrl_break()?,
            close: ctrl_close()?,
            logoff: ctrl_logoff()?,
            shutdown: ctrl_shutdown()?,
        })
    }

    pub(crate) async fn asked_for(&mut self) {
        tokio::select! {
            _ = self.c.recv() => {}
            _ = self.breaks.recv() => {}
            _ = self.close.recv() => {}
            _ = self.logoff.recv() => {}
            _ = self.shutdown.recv() => {}
        }
    }
}
