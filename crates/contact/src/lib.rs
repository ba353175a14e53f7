//! Forward models of the sensor and the tissue in tiers, their validity and their inverses.
//!
//! A [`Sensor`] touches a [`Tissue`] in a [`Contact`]; at rest this is a [`Load`], and near its
//! resonance a [`Circuit`] that an impedance analyzer sees.

#![deny(clippy::disallowed_methods)]

pub mod equations;
pub mod inverse;

mod choice;
mod circuit;
mod contact;
mod element;
mod exact;
mod law;
mod lumped;
mod pose;
#[cfg(test)]
mod random;
mod reference;
mod refusal;
mod section;
mod sensor;
mod sneddon;
mod stage;
mod tier;
mod tissue;

pub use choice::{Cell, Choice, ErrorTable, RATIOS, Scene, SceneErrors, TILTS_DEG};
pub use circuit::Circuit;
pub use contact::{Contact, Depth, Friction, Load};
pub use element::Element;
pub use exact::{ExactBeam, cantilever_characteristic, clamped_pinned_characteristic};
pub use law::{ContactLaw, LawError, Spot};
pub use lumped::{Lumped, PRINTED_NO_LOAD_HZ, PRINTED_RANGE_MPA, PRINTED_SENSITIVITY_HZ_PER_MPA};
pub use pose::{Direction, Pose, PoseError};
pub use reference::Reference;
pub use refusal::Refusal;
pub use sensor::{CoreMaterial, PiezoMaterial, Sensor, SensorDesign, SensorError};
pub use tier::{Models, Prediction, Tier, Validity};
pub use tissue::{Tissue, TissueError};
