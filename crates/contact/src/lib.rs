//! Forward models of the sensor and the tissue in tiers, their validity and their inverses.
#![deny(clippy::disallowed_methods)]
