//! The hub on a real PostgreSQL, which these tests start in a directory of their own.

// The tests start servers by a shell of Unix.
#![cfg(unix)]
#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

mod access;
mod forks;
mod ingest;
mod live;
mod migrations;
mod page;
mod partitions;
mod prune;
#[expect(dead_code, reason = "other tests use more of it")]
mod support;
mod typed;
