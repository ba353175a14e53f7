//! The journal from outside.

mod archive;
mod backup;
mod damage;
mod directory;
mod interruption;
mod journal;
mod memory;
mod restore;
mod resume;
mod salvage;
mod sample;
