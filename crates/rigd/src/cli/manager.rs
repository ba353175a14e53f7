//! What a service manager such as systemd is told: that the daemon is ready, that it lives, and that it ends.
//!
//! Without a service manager, as in a container, nothing is told. The watchdog is fed by the HTTP server
//! while the rig loop gives signs of life. A loop that is silent is replaced by `rigd safe` before the
//! watchdog acts ([`super::guard`]); the watchdog is for the case that the whole program stands still.

use std::time::Duration;

use rig_engine::RigState;
use sd_notify::NotifyState;
use tokio::time::{MissedTickBehavior, interval};

use super::screen::say;
use crate::{http::Shared, rig::Status};

/// Interval of the status line without a watchdog.
const TELL: Duration = Duration::from_secs(5);

/// Says that requests are answered from now on.
pub(super) fn ready() {
    tell(&[NotifyState::Ready]);
}

/// Says that the configuration is being read again; [`ready`] says that it was.
pub(super) fn reloading() {
    match NotifyState::monotonic_usec_now() {
        Ok(now) => tell(&[NotifyState::Reloading, now]),
        Err(error) => say(&format!("rigd: the system has no monotonic clock: {error}")),
    }
}

/// Says that the daemon is ending. The retract may take as long as the unit allows.
pub(super) fn stopping() {
    tell(&[NotifyState::Stopping, NotifyState::Status("ending what is under way and closing")]);
}

/// Feeds the watchdog and tells the state, for as long as the rig loop gives signs of life.
pub(super) async fn feed(shared: Shared) {
    let Some(_) = std::env::var_os("NOTIFY_SOCKET") else { return };
    let limit = sd_notify::watchdog_enabled();
    // Twice in the time that the manager allows.
    let mut looks = interval(limit.map_or(TELL, |limit| limit / 2));
    looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        looks.tick().await;
        let text = sentence(&shared.status());
        let because = shared.ailments();
        if limit.is_some() && because.is_empty() {
            tell(&[NotifyState::Watchdog, NotifyState::Status(&text)]);
        } else {
            tell(&[NotifyState::Status(because.first().unwrap_or(&text.as_str()))]);
        }
    }
}

fn sentence(status: &Status) -> String {
    let (state, probe) = (status.snapshot.state, status.snapshot.clearance.text());
    match (&status.run, &status.snapshot.progress) {
        (Some(run), Some(progress)) if state != RigState::Latched => format!(
            "{}: {} of {} touches of {}; probe {probe}",
            state.name(),
            run.touches_done,
            run.touches_planned(),
            progress.protocol
        ),
        _ => format!("{}; probe {probe}", state.name()),
    }
}

fn tell(state: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(state) {
        say(&format!("rigd: the service manager cannot be told: {error}"));
    }
}
