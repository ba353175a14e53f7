//! The journal from outside.

mod archive;
mod backup;
mod damage;
mod interruption;
mod journal;
mod memory;
mod restore;
mod resume;
mod salvage;
mod sample;
