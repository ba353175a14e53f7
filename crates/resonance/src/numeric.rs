//! SIMD vectors, small dense matrices, and damped least squares.

pub(crate) mod dense;
pub(crate) mod descent;
pub(crate) mod simd;
