//! The simulated bench behind the drivers. A program for real benches alone is built without it
//! (`--no-default-features`): it has the same types without a value, and refuses each scene.

#[cfg(not(feature = "simulator"))]
mod absent;
#[cfg(feature = "simulator")]
mod bench;

#[cfg(not(feature = "simulator"))]
pub(crate) use absent::{BenchPerson, Simulation};
#[cfg(not(feature = "simulator"))]
pub use absent::{LoadedScene, SceneError, SimHandle};
#[cfg(feature = "simulator")]
pub(crate) use bench::{BenchPerson, Simulation};
#[cfg(feature = "simulator")]
pub use bench::{LoadedScene, SceneError, SimHandle};
