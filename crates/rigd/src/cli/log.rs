//! The log of the program.

use tracing::level_filters::LevelFilter;
use tracing_subscriber::{
    EnvFilter, Layer,
    filter::{FilterExt, Targets},
    fmt,
    layer::SubscriberExt,
    util::SubscriberInitExt,
};

use super::{screen, table::note};
use crate::telemetry::{self, Exported};

/// What is exported: the spans of this program, and none of the libraries.
const EXPORTED: [&str; 4] = ["rigd", "rig_analyzer", "rig_link", "rig_stage"];

/// A library that logs each attempt to connect. rigd logs when attempts begin to fail, and when one succeeds.
const QUIET: &str = "async_nats";

/// Starts the log, which goes to stderr; `RUST_LOG` selects its contents. Spans are also exported, if the
/// variables of `OpenTelemetry` name a collector, until what is returned is dropped.
pub(super) fn start(level: LevelFilter) -> Option<Exported> {
    let chosen = EnvFilter::builder().with_default_directive(level.into()).from_env_lossy();
    let not_quiet =
        Targets::new().with_default(LevelFilter::TRACE).with_target(QUIET, LevelFilter::OFF);
    let log = fmt::layer()
        .with_writer(|| screen::Log)
        .with_ansi(screen::is_coloured())
        .with_filter(chosen.and(not_quiet));
    let exported = telemetry::start().unwrap_or_else(|error| {
        note(&format!("rigd: no spans are exported: {error}"));
        None
    });
    let of_rigd = Targets::new().with_targets(EXPORTED.map(|target| (target, LevelFilter::INFO)));
    let spans = exported.as_ref().map(|exported| exported.layer().with_filter(of_rigd));
    tracing_subscriber::registry().with(spans).with(log).init();
    exported
}
