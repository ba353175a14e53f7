//! What the unknowns of a fit cannot explain.
//!
//! The derivatives of the readings with respect to the unknowns are made orthonormal once. A pattern
//! then costs one scalar product with each of them and one with the residuals, instead of a fit.

#![expect(
    clippy::inline_always,
    reason = "vector instructions are used only by what is inlined into the code compiled for them"
)]

use std::f64::consts::TAU;

use num_complex::Complex64;

use crate::{
    circuit::trace::{Row, UNKNOWNS},
    diagnose::alternatives::{Alternative, Cause},
    numeric::dense::Cholesky,
    numeric::simd::{F64x4, Isa, LANES, Lanes, on_this_machine},
};

/// Largest number of patterns of a cause.
pub(crate) const MOST: usize = 3;
/// Smallest fraction of a pattern that must remain after the circuit is fitted to it; below this it
/// cannot be distinguished from a change of the circuit.
const DISTINCT: f64 = 1e-4;

/// The residuals of a fit and its derivatives, as an orthonormal basis.
#[derive(Debug)]
pub(crate) struct Tangents {
    rows: Vec<TangentRow>,
    free: usize,
    /// Change of the logarithm of the resonance along each vector of the basis.
    lever: [f64; UNKNOWNS],
}

/// One reading, weighted.
#[derive(Debug, Clone, Copy)]
struct TangentRow {
    /// The root of its weight.
    root: f64,
    basis: [Complex64; UNKNOWNS],
    /// The residual without what the basis explains.
    residual: Complex64,
}

/// The scalar products of patterns.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Products {
    pub(super) basis: [[f64; UNKNOWNS]; MOST],
    pub(super) residual: [f64; MOST],
    pub(super) among: [[f64; MOST]; MOST],
}

impl Tangents {
    /// The tangents of rows with weights and `free` unknowns; `None` if the unknowns cannot be
    /// distinguished.
    pub(crate) fn new(rows: impl Iterator<Item = (f64, Row)>, free: usize) -> Option<Self> {
        let mut rows: Vec<TangentRow> = rows
            .map(|(weight, row)| {
                let root = weight.sqrt();
                let basis = row.slopes.map(|slope| root * slope);
                TangentRow { root, basis, residual: root * row.residual }
            })
            .collect();
        let mut lever = [0.0; UNKNOWNS];
        // Modified Gram–Schmidt; `along` is a column of the triangular factor.
        for j in 0..free {
            let before = norm_squared(&rows, j);
            let mut along = [0.0; UNKNOWNS];
            for (i, along) in along.iter_mut().enumerate().take(j) {
                *along = product(&rows, |row| (row.basis[i], row.basis[j]));
                for row in &mut rows {
                    row.basis[j] -= *along * row.basis[i];
                }
            }
            let left = norm_squared(&rows, j);
            let is_distinct = left > f64::EPSILON * before;
            if !is_distinct {
                return None;
            }
            let inverse = 1.0 / left.sqrt();
            for row in &mut rows {
                row.basis[j] *= inverse;
            }
            let unit = if j == 0 { 1.0 } else { 0.0 };
            let earlier: f64 = lever.iter().zip(along).take(j).map(|(a, b)| a * b).sum();
            lever[j] = (unit - earlier) * inverse;
            let explained = product(&rows, |row| (row.basis[j], row.residual));
            for row in &mut rows {
                row.residual -= explained * row.basis[j];
            }
        }
        Some(Self { rows, free, lever })
    }

    /// Adds the patterns of a reading to their products.
    pub(crate) fn add(&self, index: usize, patterns: &[Complex64], products: &mut Products) {
        let TangentRow { root, basis, residual } = &self.rows[index];
        for (k, pattern) in patterns.iter().enumerate() {
            let pattern = root * pattern;
            for (sum, basis) in products.basis[k].iter_mut().zip(basis).take(self.free) {
                *sum += dot(pattern, *basis);
            }
            products.residual[k] += dot(pattern, *residual);
            for (sum, other) in products.among[k].iter_mut().zip(patterns) {
                *sum += dot(pattern, root * other);
            }
        }
    }

    /// The effect of the first `count` patterns together with the unknowns.
    pub(crate) fn alternative(
        &self,
        cause: Cause,
        count: usize,
        products: &Products,
    ) -> Option<Alternative> {
        effect(&self.lever, cause, count, products)
    }

    /// The rows for the search for second modes, in which a mode of response 1 changes the logarithm
    /// of each reading by `unit`, at `frequency_hz`.
    pub(crate) fn mode_blocks(
        &self,
        reading: impl Fn(usize) -> (f64, Complex64),
    ) -> Vec<ModeBlock> {
        let mut blocks = vec![ModeBlock::EMPTY; self.rows.len().div_ceil(LANES)];
        for (n, row) in self.rows.iter().enumerate() {
            let (block, lane) = (&mut blocks[n / LANES], n % LANES);
            let (frequency_hz, unit) = reading(n);
            let unit = row.root * unit;
            block.frequency_hz.0[lane] = frequency_hz;
            block.size.0[lane] = unit.norm_sqr();
            let columns = std::iter::once(&row.residual).chain(&row.basis[..self.free]);
            for (to, column) in block.columns.iter_mut().zip(columns) {
                let both = column.conj() * unit;
                (to[0].0[lane], to[1].0[lane]) = (both.re, both.im);
            }
        }
        blocks
    }

    /// The effect of a second mode.
    pub(crate) fn second_mode(&self, blocks: &[ModeBlock], cause: Cause) -> Option<Alternative> {
        let Cause::SecondMode { frequency_hz, q, .. } = cause else { return None };
        let ModeProducts { size, columns } = if self.free < FEW {
            few_products(blocks, frequency_hz, q)
        } else {
            all_products(blocks, frequency_hz, q)
        };
        let mut products = Products::default();
        products.among[0][0] = size;
        products.residual[0] = columns[0];
        products.basis[0][..self.free].copy_from_slice(&columns[1..=self.free]);
        self.alternative(cause, 1, &products)
    }
}

/// Four readings in the search for second modes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ModeBlock {
    pub(super) frequency_hz: Lanes,
    /// Squared change of the reading by a response of 1.
    pub(super) size: Lanes,
    /// That change times the conjugates of residual and basis, as real and imaginary part.
    pub(super) columns: [[Lanes; 2]; COLUMNS],
}

/// Number of columns: the residual and the basis.
const COLUMNS: usize = 1 + UNKNOWNS;
/// The same without an extra term.
pub(super) const FEW: usize = 6;

/// The scalar products of one second mode.
#[derive(Debug, Clone, Copy)]
pub(in crate::diagnose) struct ModeProducts {
    pub(super) size: f64,
    pub(super) columns: [f64; COLUMNS],
}

impl ModeBlock {
    pub(super) const EMPTY: Self =
        Self { frequency_hz: Lanes::ZERO, size: Lanes::ZERO, columns: [[Lanes::ZERO; 2]; COLUMNS] };
}

on_this_machine! {
    pub(super) fn few_products(blocks: &'a [ModeBlock], frequency_hz: f64, q: f64) -> ModeProducts
        = products_of::<_, FEW>;
}

on_this_machine! {
    fn all_products(blocks: &'a [ModeBlock], frequency_hz: f64, q: f64) -> ModeProducts
        = products_of::<_, COLUMNS>;
}

/// The products of a mode with the first `N` columns.
#[inline(always)]
fn products_of<M: Isa, const N: usize>(
    on: M,
    blocks: &[ModeBlock],
    frequency_hz: f64,
    q: f64,
) -> ModeProducts {
    let (inverse, damping, one) = (on.splat(1.0 / frequency_hz), on.splat(1.0 / q), on.splat(1.0));
    let mut size = on.splat(0.0);
    let mut sums = [on.splat(0.0); N];
    for block in blocks {
        let u = on.of(&block.frequency_hz) * inverse;
        let (d_re, d_im) = (one - u * u, u * damping);
        let hh = one / (d_re * d_re + d_im * d_im);
        let (h_re, minus_h_im) = (d_re * hh, d_im * hh);
        size += on.of(&block.size) * hh;
        for (sum, [re, im]) in sums.iter_mut().zip(&block.columns) {
            *sum += on.of(re) * h_re + on.of(im) * minus_h_im;
        }
    }
    let mut columns = [0.0; COLUMNS];
    for (column, sum) in columns.iter_mut().zip(sums) {
        *column = sum.lanes().sum();
    }
    ModeProducts { size: size.lanes().sum(), columns }
}

/// What a mode with response 1/(1 − u² + ju/q) adds to the admittance per unit of capacitance, relative
/// to `admittance`, without that response.
pub(crate) fn mode_unit(frequency_hz: f64, admittance: Complex64) -> Complex64 {
    Complex64::new(0.0, TAU * frequency_hz) / admittance
}

/// The effect of the first `count` patterns together with the unknowns. `lever` is the change of the
/// logarithm of the resonance along each vector of the basis.
pub(crate) fn effect(
    lever: &[f64; UNKNOWNS],
    cause: Cause,
    count: usize,
    products: &Products,
) -> Option<Alternative> {
    let mut left = products.among;
    for (one, row) in products.basis.iter().zip(&mut left).take(count) {
        for (other, element) in products.basis.iter().zip(row) {
            *element -= one.iter().zip(other).map(|(a, b)| a * b).sum::<f64>();
        }
    }
    let factor = Cholesky::new(&left, count, 0.0)?;
    let is_distinct = |i: usize| factor.distinct(i) * left[i][i] >= DISTINCT * products.among[i][i];
    if !(0..count).all(is_distinct) {
        return None;
    }
    let sizes = factor.solve(&products.residual);
    let errors = products.basis.map(|one| one.iter().zip(lever).map(|(a, b)| a * b).sum());
    let sum = |a: &[f64; MOST], b: &[f64; MOST]| -> f64 {
        a.iter().zip(b).take(count).map(|(a, b)| a * b).sum()
    };
    let variance_without = lever.iter().map(|one| one * one).sum();
    Some(Alternative {
        cause,
        saved: sum(&sizes, &products.residual),
        shift: sum(&sizes, &errors),
        variance: variance_without + sum(&errors, &factor.solve(&errors)),
        variance_without,
        size_variance: factor.solve(&[1.0, 0.0, 0.0])[0],
        error: errors[0],
        size: -sizes[0],
    })
}

fn dot(a: Complex64, b: Complex64) -> f64 {
    a.re * b.re + a.im * b.im
}

fn norm_squared(rows: &[TangentRow], j: usize) -> f64 {
    rows.iter().map(|row| row.basis[j].norm_sqr()).sum()
}

fn product(rows: &[TangentRow], of: impl Fn(&TangentRow) -> (Complex64, Complex64)) -> f64 {
    rows.iter()
        .map(|row| {
            let (a, b) = of(row);
            dot(a, b)
        })
        .sum()
}
