//! What rigs do now, for many viewers: states and events as messages of NATS.
//!
//! ```text
//!   rig ─▶ journal ─▶ publisher ─▶ nats-server ─▶ viewers of the laboratory
//!                     (forgets)     (forgets)
//! ```
//!
//! Nothing rests on it. A message is sent once, and nobody waits until it has arrived: the records are in the journal, and
//! the cursor of the hub is what PostgreSQL has committed. Each laboratory is an account of the server. A bench and a viewer
//! are known to it by their certificates, a bench by the one with which it ships.

mod accounts;
mod broker;
mod publish;
#[cfg(unix)]
mod server;
#[cfg(windows)]
#[path = "live/no_server.rs"]
mod server;
mod subject;
mod watch;

pub use accounts::{LiveServer, LiveSetup, add_viewer, remove_viewer, set_up, setup, viewer_name};
pub use broker::{Broker, LiveError};
pub use publish::{LiveStanding, publish};
pub use server::NatsServer;
pub use subject::Subjects;
pub use watch::{Heard, LiveState, Scope, Watch, live_state};

/// Common name of the certificate with which the hub itself watches all laboratories. It is not the name of a bench, and not
/// one of a viewer.
pub const HUB_NAME: &str = "rigd-hub:live";
