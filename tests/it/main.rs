//! Whole-system tests: the daemon against the simulated rig, down to the bytes on the wire.

mod edges;
