//! Ships sealed runs to an object store: a folder, or a bucket of S3 (feature `s3`). Each run is one Parquet file with
//! all of its records and its seal, under a name that follows from the run, and is never written again.
//!
//! ```text
//!  journal ─▶ read and checked ─▶ put under a new name ─▶ read back, checked ─▶ receipt put
//!                                 (or found there)
//! ```
//!
//! A program that is killed at any of these steps leaves a whole object or none, and the same command goes on
//! from there. A receipt says that an object was read back; a run with both is not read again. The checker of
//! objects is in `rig-verify`, which shares no code with what writes them.

mod address;
mod folder;
mod key;
mod names;
mod receipt;
#[cfg(feature = "s3")]
mod s3;
mod shipper;
mod store;
mod stored;

pub use address::{Address, AddressError};
pub use key::{BenchKey, KeyError, PublicKey, PublicKeyError};
pub use names::{Label, LabelError};
pub use shipper::{Outcome, ShipError, Shipper};
pub use store::{ObjectStore, StorageError};
pub use stored::{StoredObject, objects};
