//! The register maps that are shipped.

mod oriental_az;

pub use oriental_az::ORIENTAL_AZ;

use crate::RegisterMap;

/// All of them.
pub const ALL: [&RegisterMap; 1] = [&ORIENTAL_AZ];

/// The map of this name.
pub fn by_name(name: &str) -> Option<&'static RegisterMap> {
    ALL.into_iter().find(|map| map.name == name)
}
