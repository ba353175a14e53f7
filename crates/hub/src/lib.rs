//! The hub: the records of many rigs in one PostgreSQL.
//!
//! ```text
//!   rig ─▶ journal (SQLite) ─▶ shipper ─▶ ingest() in PostgreSQL ─▶ runs, records, typed tables
//!                                 ▲               │
//!                                 └─── cursor ────┘  the last event that is committed
//! ```
//!
//! PostgreSQL is the truth of the hub. A bench writes by three functions of the database and by nothing else: their SQL
//! (`sql/04-ingest.sql`) refuses gaps, checks each digest and seal, and puts aside what differs from what is there. The
//! journal of a bench stays complete by itself, and what is here can be sent again from it.
//!
//! [`ship`] is the side of a bench, and [`live`] tells viewers what it does; [`admin`] and [`doctor`] are what the program `rigd-hub` does for the administrator.

pub mod admin;
mod batch;
mod catalogue;
mod certificates;
pub mod cli;
mod compare;
mod connect;
pub mod doctor;
mod inlet;
mod judge;
pub mod live;
mod migrations;
mod name;
mod page;
mod pem_files;
mod prune;
mod reproducibility;
mod retry;
mod serve;
mod shipper;
mod state;
mod tls;
#[cfg(unix)]
mod trial;
// A server of its own is begun and ended by a shell of Unix.
#[cfg(windows)]
#[path = "no_trial.rs"]
mod trial;

pub use admin::AdminError;
pub use batch::Batch;
pub use catalogue::{Catalogue, CatalogueError, FoundRun, Limits, Rig, Wanted};
pub use certificates::{Authority, CertificateError};
pub use compare::{BenchChart, ChartPoint, Reference};
pub use connect::{ConnectError, connect};
pub use inlet::{Cursor, Inlet, InletError};
pub use judge::judge;
pub use migrations::{MIGRATIONS, MigrationError, VersionError, migrate};
pub use name::{BenchName, NameError};
pub use pem_files::{TlsError, read_certificates, read_key};
pub use prune::{PruneError, Pruned, prune};
pub use reproducibility::{Deviation, Reproducibility};
pub use serve::{is_local, serve};
pub use shipper::{Destination, Held, ShipperError, Standing, ship};
pub use state::{Alarm, BenchState, State, state};
pub use tls::Identity;
pub use trial::{Trial, TrialError};
