//! Whole-system tests: the daemon against the simulated rig, down to the bytes on the wire.

#![expect(clippy::unwrap_used, reason = "a test may stop where it stands")]

mod contact_sense;
mod descent;
mod documents;
mod drift;
mod edges;
mod emergency_stop;
mod errors;
mod faults;
mod first_records;
mod flags;
mod forged;
mod halfway;
mod homing;
mod makes;
mod operator;
mod out_of_contact;
mod read_only;
mod refusals;
mod remaining;
mod rotary_count;
mod rotary_stop;
mod runs;
mod shared_reference;
mod stops;
mod sweeps;
mod wrong_readings;
