//! Vectors of four numbers.
//!
//! Arithmetic on arrays, or on wide registers if the machine has them; the compiler does not vectorise
//! loops with this many sums by itself. Sums are kept per lane and added in a fixed order at the end;
//! multiplications and additions are never contracted. The results are therefore bit-identical on every
//! machine.

#![expect(
    clippy::inline_always,
    reason = "vector instructions are used only by what is inlined into the code compiled for them"
)]

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// Compiles a function also for wider instruction sets, and runs the version that this machine
/// supports.
///
/// This applies only to inlined code, which excludes closures: the working function must be
/// `inline(always)`. Its first argument is the instruction set.
macro_rules! on_this_machine {
    ($(#[$about:meta])* $public:vis fn $name:ident($($input:ident: $kind:ty),* $(,)?) -> $output:ty
        = $work:path;
    ) => {
        $(#[$about])*
        $public fn $name<'a>($($input: $kind),*) -> $output {
            struct Kernel<'a, M> { machine: M, $($input: $kind),* }
            impl<'a, M: $crate::numeric::simd::Isa> pulp::NullaryFnOnce for Kernel<'a, M> {
                type Output = $output;
                #[inline(always)]
                fn call(self) -> $output {
                    $work(self.machine, $(self.$input),*)
                }
            }
            #[cfg(target_arch = "x86_64")]
            if let Some(machine) = pulp::x86::V3::try_new() {
                return machine.vectorize(Kernel { machine, $($input),* });
            }
            pulp::NullaryFnOnce::call(Kernel { machine: $crate::numeric::simd::Any, $($input),* })
        }
    };
}
pub(crate) use on_this_machine;

/// Number of elements of a vector.
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
}

/// A vector of four numbers in the representation of an instruction set.
pub(crate) trait F64x4:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
{
    /// The elements as an array.
    fn lanes(self) -> Lanes;
    /// The larger of each pair; a number takes precedence over NaN.
    fn max(self, other: Self) -> Self;
}

/// The operations of an instruction set.
pub(crate) trait Isa: Copy {
    /// A vector of four numbers.
    type F64x4: F64x4;
    /// A vector of these four numbers.
    fn of(self, lanes: &Lanes) -> Self::F64x4;
    /// A vector of four equal numbers.
    #[inline(always)]
    fn splat(self, value: f64) -> Self::F64x4 {
        self.of(&Lanes::splat(value))
    }
}

/// The portable instruction set.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Any;

impl Isa for Any {
    type F64x4 = Lanes;
    #[inline(always)]
    fn of(self, lanes: &Lanes) -> Lanes {
        *lanes
    }
}

impl F64x4 for Lanes {
    #[inline(always)]
    fn lanes(self) -> Lanes {
        self
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| if self.0[i] > other.0[i] { self.0[i] } else { other.0[i] }))
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

    use pulp::{Simd, f64x4, x86::V3};

    use super::{F64x4, Isa, Lanes};

    /// Four numbers in one register of AVX2.
    #[derive(Clone, Copy)]
    pub(crate) struct Register(V3, f64x4);

    impl Isa for V3 {
        type F64x4 = Register;
        #[inline(always)]
        fn of(self, lanes: &Lanes) -> Register {
            Register(self, pulp::bytemuck::cast(lanes.0))
        }
    }

    impl F64x4 for Register {
        #[inline(always)]
        fn lanes(self) -> Lanes {
            Lanes(pulp::bytemuck::cast(self.1))
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            Self(self.0, self.0.max_f64s(self.1, other.1))
        }
    }

    macro_rules! at_once {
        ($($operation:ident :: $method:ident = $instruction:ident),*) => {$(
            impl $operation for Register {
                type Output = Self;
                #[inline(always)]
                fn $method(self, other: Self) -> Self {
                    Self(self.0, self.0.$instruction(self.1, other.1))
                }
            }
        )*};
    }

    at_once!(Add::add = add_f64s, Sub::sub = sub_f64s, Mul::mul = mul_f64s, Div::div = div_f64s);

    impl AddAssign for Register {
        #[inline(always)]
        fn add_assign(&mut self, other: Self) {
            *self = *self + other;
        }
    }

    impl Neg for Register {
        type Output = Self;
        #[inline(always)]
        fn neg(self) -> Self {
            Self(self.0, self.0.neg_f64s(self.1))
        }
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
