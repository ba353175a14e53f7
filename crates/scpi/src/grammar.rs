//! The grammar of both ends: messages and their parts, values, units and error numbers.

pub(crate) mod error;
pub(crate) mod mnemonic;
pub(crate) mod param;
pub(crate) mod parse;
pub(crate) mod scan;
pub(crate) mod splitter;
pub(crate) mod unit;
pub(crate) mod value;
