//! Which threads the system runs first.

use std::io;

pub use thread_priority::Error;

/// What [`come_first`] needs, for a person.
pub const COMES_FIRST_WITH: &str = crate::system::COMES_FIRST_WITH;

/// Asks the system to run the calling thread as soon as it has something to do.
///
/// On Unix that is the lowest of the real-time priorities, which comes before every program that has none; threads that it
/// begins inherit that. Without the permission it keeps its nice value. On Windows it is the highest priority within a process of
/// normal class, for which no permission is needed, and which threads do not inherit; programs of a higher class come before it.
///
/// # Errors
/// [`Error`] of the system, which may not allow it.
pub fn come_first() -> Result<(), Error> {
    crate::system::come_first()
}

/// Gives back what [`come_first`] has taken: for a thread that inherited it.
///
/// # Errors
/// [`Error`] of the system.
pub fn come_after() -> Result<(), Error> {
    crate::system::come_after()
}

/// Lowers the priority of the calling thread by 1 to 19 steps of `nice`.
///
/// Linux counts nice values for each thread, and threads that it begins have them too. macOS counts them for the whole program,
/// so that the rig thread would give way too: there the thread gets a lower priority of its own. Windows has two lower
/// priorities for a thread: one below normal for up to 9 steps, the lowest beyond that.
///
/// # Errors
/// [`io::Error`] of the system.
pub fn give_way(by: i32) -> io::Result<()> {
    crate::system::give_way(by)
}

/// An error of the library as one of the system.
#[cfg(not(target_os = "linux"))]
pub(crate) fn as_io(error: Error) -> io::Error {
    match error {
        Error::OS(number) => io::Error::from_raw_os_error(number),
        other => io::Error::other(format!("{other:?}")),
    }
}
