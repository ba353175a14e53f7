//! What Linux and macOS have in common.

use std::{
    fs::{self, File, Metadata, OpenOptions, Permissions},
    io,
    os::unix::{
        fs::{MetadataExt, OpenOptionsExt, PermissionsExt},
        process::CommandExt,
    },
    path::{Path, PathBuf},
    process::Command,
    time::Duration,
};

use rustix::{
    fs::{CWD, FlockOperation, RenameFlags, flock, renameat_with, statvfs},
    io::Errno,
    process::{Resource, Rlimit, getrlimit, setrlimit},
    termios::{QueueSelector, tcflush, tcgetwinsize},
    time::{ClockId, clock_gettime},
};
use thread_priority::{
    Error, NormalThreadSchedulePolicy, RealtimeThreadSchedulePolicy, ThreadPriority,
    ThreadSchedulePolicy, set_thread_priority_and_policy, thread_native_id,
};

pub(crate) use crate::kind::{give_way, limit_silence};
use crate::{files::Stamp, kind};

pub(crate) const RANDOM_NUMBERS: &str = "/dev/urandom";
pub(crate) const LOGIN_VARIABLES: &[&str] = &["LOGNAME", "USER"];
pub(crate) const COMES_FIRST_WITH: &str = "LimitRTPRIO=1 in a unit, or the superuser, allows it";

const REAL_TIME: ThreadSchedulePolicy =
    ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::RoundRobin);
pub(crate) const NORMAL: ThreadSchedulePolicy =
    ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Other);

pub(crate) fn with_mode(options: &mut OpenOptions, mode: u32) -> &mut OpenOptions {
    options.mode(mode)
}

pub(crate) fn set_mode(file: &File, mode: u32) -> io::Result<()> {
    file.set_permissions(Permissions::from_mode(mode))
}

pub(crate) fn forbidden_mode(file: &Metadata, forbidden: u32) -> Option<u32> {
    let mode = file.permissions().mode() & 0o777;
    (mode & forbidden != 0).then_some(mode)
}

pub(crate) fn protection(_: &Path) -> Option<String> {
    None
}

pub(crate) fn stamp(file: &Metadata) -> Stamp {
    Stamp(file.ino(), file.mtime(), file.mtime_nsec(), file.len())
}

pub(crate) fn sync_folder(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}

pub(crate) fn sync_file(path: &Path) -> io::Result<()> {
    File::open(path)?.sync_all()
}

pub(crate) fn whole_path(path: &Path) -> io::Result<PathBuf> {
    fs::canonicalize(path)
}

pub(crate) fn lock_to_hold(file: &File, _: &Path) -> io::Result<File> {
    file.try_clone()
}

pub(crate) fn lock_to_try(file: &File, _: &Path) -> io::Result<File> {
    file.try_clone()
}

pub(crate) fn folder_lock(folder: &Path) -> io::Result<File> {
    let folder = File::open(folder)?;
    flock(&folder, FlockOperation::LockExclusive)?;
    Ok(folder)
}

pub(crate) fn exchange(staged: &Path, place: &Path) -> io::Result<()> {
    match renameat_with(CWD, staged, CWD, place, RenameFlags::EXCHANGE) {
        Ok(()) => Ok(()),
        Err(Errno::NOENT) => fs::rename(staged, place),
        // Such as on a network file system.
        Err(Errno::INVAL | Errno::NOSYS | Errno::NOTSUP) => {
            crate::files::exchange_by_moves(staged, place)
        }
        Err(error) => Err(error.into()),
    }
}

pub(crate) fn free_bytes(directory: &Path) -> io::Result<u64> {
    let system = statvfs(directory)?;
    Ok(system.f_bavail.saturating_mul(system.f_frsize))
}

pub(crate) fn running() -> Duration {
    clock_gettime(kind::RUNNING).try_into().unwrap_or_default()
}

pub(crate) fn of_thread() -> Duration {
    clock_gettime(ClockId::ThreadCPUTime).try_into().unwrap_or_default()
}

pub(crate) fn handle_limit() -> Option<u64> {
    getrlimit(Resource::Nofile).current
}

pub(crate) fn take_handles() -> io::Result<()> {
    let Rlimit { maximum, .. } = getrlimit(Resource::Nofile);
    let current = kind::handles_of(maximum);
    Ok(setrlimit(Resource::Nofile, Rlimit { current, maximum })?)
}

pub(crate) fn without_a_name() -> String {
    format!("uid {}", rustix::process::getuid())
}

pub(crate) fn come_first() -> Result<(), Error> {
    set_priority(ThreadPriority::Min, REAL_TIME)
}

pub(crate) fn come_after() -> Result<(), Error> {
    let priority = ThreadPriority::try_from(kind::OTHER_PROGRAMS).map_err(Error::Priority)?;
    set_priority(priority, NORMAL)
}

pub(crate) fn set_priority(
    priority: ThreadPriority,
    policy: ThreadSchedulePolicy,
) -> Result<(), Error> {
    set_thread_priority_and_policy(thread_native_id(), priority, policy)
}

pub(crate) fn replace_by(mut command: Command, _: i32) -> io::Error {
    command.exec()
}

pub(crate) const fn wait_for_the_replaced() {}

pub(crate) const fn can_redraw() -> bool {
    true
}

pub(crate) fn columns() -> Option<usize> {
    let size = tcgetwinsize(io::stderr()).ok()?;
    Some(usize::from(size.ws_col)).filter(|&columns| columns > 0)
}

pub(crate) fn forget_input() {
    _ = tcflush(io::stdin(), QueueSelector::IFlush);
}

#[cfg(feature = "signals")]
#[derive(Debug)]
pub(crate) struct Ending {
    interrupt: tokio::signal::unix::Signal,
    terminate: tokio::signal::unix::Signal,
}

#[cfg(feature = "signals")]
impl Ending {
    pub(crate) fn listen() -> io::Result<Self> {
        use tokio::signal::unix::{SignalKind, signal};
        let (interrupt, terminate) = (SignalKind::interrupt(), SignalKind::terminate());
        Ok(Self { interrupt: signal(interrupt)?, terminate: signal(terminate)? })
    }

    pub(crate) async fn asked_for(&mut self) {
        tokio::select! {
            _ = self.interrupt.recv() => {}
            _ = self.terminate.recv() => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use std::thread;

    use thread_priority::unix::thread_schedule_policy;

    use super::*;

    #[test]
    fn what_one_thread_takes_another_gives_back() {
        let by_thread = |work: fn()| {
            let thread = thread::spawn(move || {
                work();
                thread_schedule_policy().unwrap()
            });
            thread.join().unwrap()
        };
        // A thread of a user who may not have it stays as it was.
        let taken = by_thread(|| drop(come_first()));
        assert!(taken == REAL_TIME || taken == NORMAL, "{taken:?}");
        let given_back = by_thread(|| {
            drop(come_first());
            // It inherits.
            thread::spawn(|| come_after().unwrap()).join().unwrap();
            come_after().unwrap();
        });
        assert_eq!(given_back, NORMAL);
    }

    #[test]
    fn a_file_for_its_owner_is_known_by_its_mode() {
        let folder = tempfile::TempDir::new().unwrap();
        let path = folder.path().join("file");
        let mut options = File::options();
        let file = with_mode(options.create_new(true).write(true), 0o600).open(&path).unwrap();
        let forbidden = || forbidden_mode(&fs::metadata(&path).unwrap(), 0o022);
        assert_eq!(forbidden(), None);
        set_mode(&file, 0o620).unwrap();
        assert_eq!(forbidden(), Some(0o620));
        set_mode(&file, 0o644).unwrap();
        assert_eq!(forbidden(), None);
    }
}
