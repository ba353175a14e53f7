//! Four numbers side by side.
//!
//! Plain arithmetic on arrays, written so that the compiler turns it into vector instructions where
//! the caller was compiled for them (see [`crate::kernel`]). Sums are kept per lane and added up in
//! one fixed order at the end; multiplications and additions are never contracted. Every machine
//! therefore gets the same bits, whatever instructions it has.

#![expect(
    clippy::inline_always,
    reason = "vector instructions are used only by what is inlined into the code compiled for them"
)]

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// Compiles a function for the instructions of this machine as well, and runs what fits.
///
/// Only what is inlined into it is compiled so, which a closure is not: what is called from its body
/// must be `inline(always)`.
macro_rules! on_this_machine {
    ($(#[$about:meta])* $public:vis fn $name:ident($($input:ident: $kind:ty),* $(,)?) -> $output:ty
        $body:block
    ) => {
        $(#[$about])*
        $public fn $name<'a>($($input: $kind),*) -> $output {
            struct Work<'a> { $($input: $kind),* }
            impl<'a> pulp::NullaryFnOnce for Work<'a> {
                type Output = $output;
                #[inline(always)]
                fn call(self) -> $output {
                    let Self { $($input),* } = self;
                    $body
                }
            }
            pulp::Arch::new().dispatch(Work { $($input),* })
        }
    };
}
pub(crate) use on_this_machine;

/// How many numbers stand side by side.
pub(crate) const LANES: usize = 4;

/// Four numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(32))]
pub(crate) struct Lanes(pub(crate) [f64; LANES]);

impl Lanes {
    pub(crate) const ZERO: Self = Self([0.0; LANES]);

    #[inline(always)]
    pub(crate) const fn splat(value: f64) -> Self {
        Self([value; LANES])
    }

    /// The sum of the four, in a fixed order.
    #[inline(always)]
    pub(crate) fn sum(self) -> f64 {
        let [a, b, c, d] = self.0;
        (a + c) + (b + d)
    }

    /// The larger of each pair; a number wins over what is not one.
    #[inline(always)]
    pub(crate) fn max(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| if self.0[i] > other.0[i] { self.0[i] } else { other.0[i] }))
    }
}

macro_rules! lane_by_lane {
    ($($operation:ident :: $method:ident),*) => {$(
        impl $operation for Lanes {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(std::array::from_fn(|i| self.0[i].$method(other.0[i])))
            }
        }
    )*};
}

lane_by_lane!(Add::add, Sub::sub, Mul::mul, Div::div);

impl AddAssign for Lanes {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Neg for Lanes {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.map(|x| -x))
    }
}
