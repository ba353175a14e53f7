//! The journal from outside.

mod damage;
mod journal;
mod sample;
