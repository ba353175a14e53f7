//! Which frequency to measure next, by the model of the free decay.

pub(crate) mod decay;
