//! Complex dual numbers: values with their derivatives.

use std::ops::{Add, Mul, Neg, Sub};

use num_complex::Complex64;

/// Numbers for the ring-up model: complex, or complex with derivatives.
pub(crate) trait Value:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self>
{
    /// A number that does not depend on a parameter.
    fn constant(value: Complex64) -> Self;
    /// The product with a number that does not depend on a parameter.
    fn times(self, factor: Complex64) -> Self;
    /// The complex conjugate.
    fn conj(self) -> Self;
    /// The real part.
    fn re(self) -> Self;
    /// The exponential.
    fn exp(self) -> Self;
    /// The reciprocal.
    fn recip(self) -> Self;
    /// The value without derivatives.
    fn value(self) -> Complex64;
}

impl Value for Complex64 {
    fn constant(value: Complex64) -> Self {
        value
    }
    fn times(self, factor: Complex64) -> Self {
        self * factor
    }
    fn conj(self) -> Self {
        Complex64::conj(&self)
    }
    fn re(self) -> Self {
        Complex64::new(self.re, 0.0)
    }
    fn exp(self) -> Self {
        Complex64::exp(self)
    }
    fn recip(self) -> Self {
        // The division of the library guards against overflow, which cannot occur here.
        let norm = 1.0 / (self.re * self.re + self.im * self.im);
        Complex64::new(self.re * norm, -self.im * norm)
    }
    fn value(self) -> Complex64 {
        self
    }
}

/// A complex function of two real parameters: its value and its two derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Dual {
    pub(crate) value: Complex64,
    pub(crate) by: [Complex64; 2],
}

impl Dual {
    /// Applies a function that has this value and this derivative here.
    fn chain(self, value: Complex64, slope: Complex64) -> Self {
        Self { value, by: self.by.map(|by| by * slope) }
    }

    fn each(self, f: impl Fn(Complex64) -> Complex64) -> Self {
        Self { value: f(self.value), by: self.by.map(f) }
    }
}

impl Value for Dual {
    fn constant(value: Complex64) -> Self {
        Self { value, by: [Complex64::ZERO; 2] }
    }
    fn times(self, factor: Complex64) -> Self {
        self.each(|x| x * factor)
    }
    fn conj(self) -> Self {
        self.each(Value::conj)
    }
    fn re(self) -> Self {
        self.each(|x| Complex64::new(x.re, 0.0))
    }
    fn exp(self) -> Self {
        let exp = self.value.exp();
        self.chain(exp, exp)
    }
    fn recip(self) -> Self {
        let recip = Value::recip(self.value);
        self.chain(recip, -recip * recip)
    }
    fn value(self) -> Complex64 {
        self.value
    }
}

impl Add for Dual {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            value: self.value + other.value,
            by: [self.by[0] + other.by[0], self.by[1] + other.by[1]],
        }
    }
}

impl Sub for Dual {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Neg for Dual {
    type Output = Self;
    fn neg(self) -> Self {
        self.each(|x| -x)
    }
}

impl Mul for Dual {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let Self { value, by } = self.times(other.value);
        let more = other.by.map(|by| self.value * by);
        Self { value, by: [by[0] + more[0], by[1] + more[1]] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A function of x = 0.3a + jb and y = ab that uses all operations.
    fn function<V: Value>(x: V, y: V) -> V {
        (x * y.exp() - y.recip().conj() + -(x.re() + x).exp()).times(Complex64::new(0.2, -0.7))
    }

    #[test]
    fn derivatives_agree_with_differences() {
        let x = |a: f64, b: f64| Complex64::new(0.3 * a, b);
        let y = |a: f64, b: f64| Complex64::new(a * b, 0.0);
        let plain = |a, b| function(x(a, b), y(a, b));
        let (a, b) = (0.8, 1.3);
        let dual_x = Dual { value: x(a, b), by: [x(1.0, 0.0), x(0.0, 1.0)] };
        let dual_y = Dual { value: y(a, b), by: [Complex64::from(b), Complex64::from(a)] };
        let dual = function(dual_x, dual_y);
        let h = 1e-6;
        let by_a = (plain(a + h, b) - plain(a - h, b)) / (2.0 * h);
        let by_b = (plain(a, b + h) - plain(a, b - h)) / (2.0 * h);
        assert!((dual.value - plain(a, b)).norm() < 1e-14);
        assert!((dual.by[0] - by_a).norm() < 1e-8, "{:?} {by_a}", dual.by[0]);
        assert!((dual.by[1] - by_b).norm() < 1e-8, "{:?} {by_b}", dual.by[1]);
    }
}
