//! A system whose service managers are told nothing: launchd of macOS and the services of Windows do not ask for it.
//!
//! So there is no watchdog for a program that stands still as a whole. A rig loop that is silent is left all the same
//! ([`super::guard`]).

use crate::http::Shared;

/// Nobody is told.
pub(super) const fn ready() {}

/// Nobody is told.
pub(super) const fn reloading() {}

/// Nobody is told.
pub(super) const fn stopping() {}

/// Nobody is fed.
#[expect(clippy::unused_async, reason = "the same signature as on Linux")]
pub(super) async fn feed(_: Shared) {}
