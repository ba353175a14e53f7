//! IEEE 488.2 and SCPI-99 for a controller and for an instrument, without I/O.
#![deny(clippy::disallowed_methods)]
