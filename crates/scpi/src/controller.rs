//! The controller's end: program messages out, responses in.

pub(crate) mod decoder;
pub(crate) mod program;
pub(crate) mod report;
pub(crate) mod response;
