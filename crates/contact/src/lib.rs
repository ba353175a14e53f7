//! Forward models of the sensor and the tissue in tiers, their validity and their inverses.
//!
//! A [`Sensor`] touches a [`Tissue`] in a [`Contact`]. The contact at rest is a [`Load`]. Near its
//! resonance the sensor is a [`Circuit`] to an impedance analyzer.

#![deny(clippy::disallowed_methods)]

pub mod equations;
pub mod inverse;

mod choice;
mod circuit;
mod contact;
mod description;
mod design;
mod element;
mod equilibrium;
mod exact;
mod grip;
mod law;
mod lumped;
mod models;
mod pose;
mod reference;
mod refusal;
mod rest;
mod section;
mod sensor;
mod sneddon;
mod specimen;
mod tier;
mod tip_stiffness;
mod tissue;

pub use choice::{Choice, Requirements};
pub use circuit::Circuit;
pub use contact::{Contact, Depth, Friction, Load};
pub use description::{SensorDescription, Uncertainty};
pub use design::{CoreMaterial, PiezoMaterial, SensorDesign};
use element::Element;
use exact::ExactBeam;
pub use law::{ContactLaw, ContactPatch, LawError};
use lumped::Lumped;
pub use models::{Models, Prediction};
pub use pose::{Pose, PoseError};
use reference::Reference;
pub use refusal::Refusal;
pub use rig_model::Direction;
pub use sensor::{Sensor, SensorError};
pub use specimen::{Specimen, SpecimenError};
pub use tier::{Tier, Validity};
pub use tissue::{Tissue, TissueError};
