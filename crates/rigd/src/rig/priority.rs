//! The priority of the rig thread: before all other programs of the computer, where the system allows it.

use thread_priority::{
    Error, NormalThreadSchedulePolicy, RealtimeThreadSchedulePolicy, ThreadPriority,
    ThreadSchedulePolicy, set_thread_priority_and_policy, thread_native_id,
};

const REAL_TIME: ThreadSchedulePolicy =
    ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::RoundRobin);
const NORMAL: ThreadSchedulePolicy =
    ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Other);
/// The middle of the scale of 0 to 99 is the nice value 0, which other programs have.
const OTHER_PROGRAMS: u8 = 50;

/// Asks the system to run the calling thread as soon as it has something to do. Threads that it begins from then
/// on inherit that. Without the permission it keeps its nice value.
pub(super) fn come_first() {
    // The lowest of the real-time priorities comes before every program that has none.
    match set(ThreadPriority::Min, REAL_TIME) {
        Ok(()) => tracing::debug!("the rig thread has real-time priority"),
        Err(error) => tracing::debug!(
            error = ?error,
            "the rig thread has no real-time priority: LimitRTPRIO=1 in a unit, or the superuser, allows it"
        ),
    }
}

/// Gives back what [`come_first`] has taken: for a thread that inherited it.
pub(super) fn come_after() {
    let given_back = ThreadPriority::try_from(OTHER_PROGRAMS)
        .map_err(Error::Priority)
        .and_then(|priority| set(priority, NORMAL));
    if let Err(error) = given_back {
        tracing::warn!(error = ?error, "a thread that waits for files has the priority of the rig thread");
    }
}

fn set(priority: ThreadPriority, policy: ThreadSchedulePolicy) -> Result<(), Error> {
    set_thread_priority_and_policy(thread_native_id(), priority, policy)
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
        let taken = by_thread(come_first);
        assert!(taken == REAL_TIME || taken == NORMAL, "{taken:?}");
        let given_back = by_thread(|| {
            come_first();
            // It inherits.
            thread::spawn(come_after).join().unwrap();
            come_after();
        });
        assert_eq!(given_back, NORMAL);
        let before = rustix::process::nice(0).unwrap();
        let after = thread::spawn(|| {
            come_after();
            rustix::process::nice(0).unwrap()
        });
        assert!(after.join().unwrap() <= before.max(0));
    }
}
