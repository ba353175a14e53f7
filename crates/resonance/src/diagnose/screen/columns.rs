//! The readings, their derivatives and the patterns of the causes, four readings at a time.

#![expect(
    clippy::inline_always,
    reason = "vector instructions are used only by what is inlined into the code compiled for them"
)]

use crate::{
    circuit::kernel::Theta,
    circuit::points::Block,
    diagnose::tangents::{FEW, ModeBlock},
    numeric::simd::{F64x4, Isa, Lanes, on_this_machine},
};

/// Patterns: drift, change with the amplitude of resonance and of damping, dispersion, resistance and
/// inductance in series, and a lag of one reading with either phase.
pub(super) const PATTERNS: usize = 8;

/// Four readings.
#[derive(Debug, Clone, Copy)]
pub(super) struct Columns {
    pub(super) weight: Lanes,
    /// Residual and derivatives, times the weight.
    pub(super) fitted: [[Lanes; 2]; FEW],
    pub(super) patterns: [[Lanes; 2]; PATTERNS],
}

/// What is known of the readings before they are screened.
#[derive(Debug, Clone, Copy)]
pub(super) struct Input<'a> {
    pub(super) blocks: &'a [Block],
    pub(super) theta: Theta,
    pub(super) count: usize,
}

/// The scalar products of a pattern with residual and derivatives, with itself and with the next.
#[derive(Debug, Clone, Copy)]
pub(super) struct PatternProducts {
    pub(super) fitted: [f64; FEW],
    pub(super) own: f64,
    pub(super) next: f64,
}

on_this_machine! {
    /// Fills the columns.
    pub(super) fn fill(
        input: &'a Input<'a>,
        columns: &'a mut Vec<Columns>,
        modes: &'a mut Vec<ModeBlock>,
    ) -> () = fill_of;
}

on_this_machine! {
    /// The products of this pattern.
    pub(super) fn products(columns: &'a [Columns], pattern: usize) -> PatternProducts = products_of;
}

/// 1/(ν − v + jαw).
#[inline(always)]
fn response<F: F64x4>(one: F, nu: F, alpha: F, block: &Block<F>) -> (F, F, F) {
    let (d_re, d_im) = (nu - block.v, alpha * block.w);
    let hh = one / (d_re * d_re + d_im * d_im);
    (d_re * hh, -(d_im * hh), hh)
}

#[inline(always)]
fn fill_of<M: Isa>(
    on: M,
    input: &Input<'_>,
    columns: &mut Vec<Columns>,
    modes: &mut Vec<ModeBlock>,
) {
    let Input { blocks, theta, count } = *input;
    columns.clear();
    modes.clear();
    let Some(end) = blocks.last() else { return };
    let one = on.splat(1.0);
    let (nu, alpha, kappa) = (on.splat(theta.nu), on.splat(theta.alpha), on.splat(theta.kappa));
    let (c, g) = (on.splat(theta.c), on.splat(theta.g));
    // At constant quality factor and capacitances.
    let (by_nu, by_kappa) = (on.splat(2.0 * (1.0 + theta.nu)), on.splat(2.0 * theta.kappa));
    // A lane holds consecutive readings; the first of each follows the last of the lane before.
    let end = end.on(on);
    let (re, im, _) = response(one, nu, alpha, &end);
    let after = |lanes: Lanes| {
        let [a, b, c, _] = lanes.0;
        on.of(&Lanes([0.0, a, b, c]))
    };
    let (mut before_re, mut before_im) = (after((end.w * re).lanes()), after((end.w * im).lanes()));
    let step = 2.0 / (count.max(2) - 1) as f64;
    let starts = Lanes(std::array::from_fn(|lane| step * (lane * blocks.len()) as f64 - 1.0));
    let (mut when, step) = (on.of(&starts), on.splat(step));
    let (half, quarter, sixth) = (on.splat(0.5), on.splat(0.25), on.splat(1.0 / 6.0));
    for block in blocks {
        let block = block.on(on);
        let (h_re, h_im, hh) = response(one, nu, alpha, &block);
        let (h2_re, h2_im) = (h_re * h_re - h_im * h_im, (h_re + h_re) * h_im);
        let (p_re, p_im) = (block.p_re, block.p_im);
        let (y_re, y_im) = (c + kappa * h_re, kappa * h_im - g);
        let r = [p_re * y_re - p_im * y_im - one, p_re * y_im + p_im * y_re];
        let ph = [p_re * h_re - p_im * h_im, p_re * h_im + p_im * h_re];
        let minus = -kappa;
        let of_nu = [minus * (p_re * h2_re - p_im * h2_im), minus * (p_re * h2_im + p_im * h2_re)];
        let of_alpha = [-(block.w * of_nu[1]), block.w * of_nu[0]];
        let fitted = [r, of_nu, of_alpha, [p_re, p_im], ph, [p_im, -p_re]];
        let of_frequency = [
            by_nu * of_nu[0] + alpha * of_alpha[0] + by_kappa * ph[0],
            by_nu * of_nu[1] + alpha * of_alpha[1] + by_kappa * ph[1],
        ];
        let of_damping = [alpha * of_alpha[0], alpha * of_alpha[1]];
        let power = block.w * block.w * hh;
        // The derivatives by the circuit carry the noise of the reading, and so must every pattern.
        let x = [r[0] + one, r[1]];
        let z = [x[0] * y_re - x[1] * y_im, x[0] * y_im + x[1] * y_re];
        // ln w to the third order in w² − 1.
        let logarithm = block.v * (half - block.v * (quarter - block.v * sixth));
        let (w_re, w_im) = (block.w * h_re, block.w * h_im);
        let (ratio_re, ratio_im) = (before_re / block.w - h_re, before_im / block.w - h_im);
        let lag = [p_re * ratio_re - p_im * ratio_im, p_re * ratio_im + p_im * ratio_re];
        (before_re, before_im) = (w_re, w_im);
        let patterns = [
            [when * of_frequency[0], when * of_frequency[1]],
            [power * of_frequency[0], power * of_frequency[1]],
            [power * of_damping[0], power * of_damping[1]],
            [logarithm * p_re, logarithm * p_im],
            [-(block.w * z[1]), block.w * z[0]],
            [-(block.w * block.w * z[0]), -(block.w * block.w * z[1])],
            lag,
            [-lag[1], lag[0]],
        ];
        when += step;
        let (all, mode) = stored(&block, &fitted, &patterns);
        columns.push(all);
        modes.push(mode);
    }
}

/// The columns, and those of a second mode.
#[inline(always)]
fn stored<F: F64x4>(
    block: &Block<F>,
    fitted: &[[F; 2]; FEW],
    patterns: &[[F; 2]; PATTERNS],
) -> (Columns, ModeBlock) {
    let Block { p_re, p_im, weight, .. } = *block;
    let mut mode = ModeBlock {
        frequency_hz: block.w.lanes(),
        size: (weight * (p_re * p_re + p_im * p_im)).lanes(),
        ..ModeBlock::EMPTY
    };
    let mut all = Columns {
        weight: weight.lanes(),
        fitted: [[Lanes::ZERO; 2]; FEW],
        patterns: [[Lanes::ZERO; 2]; PATTERNS],
    };
    for ((column, to), to_mode) in fitted.iter().zip(&mut all.fitted).zip(&mut mode.columns) {
        let (re, im) = (weight * column[0], weight * column[1]);
        *to = [re.lanes(), im.lanes()];
        // The conjugate of the column times p.
        *to_mode = [(re * p_re + im * p_im).lanes(), (re * p_im - im * p_re).lanes()];
    }
    for (pattern, to) in patterns.iter().zip(&mut all.patterns) {
        *to = [pattern[0].lanes(), pattern[1].lanes()];
    }
    (all, mode)
}

#[inline(always)]
fn products_of<M: Isa>(on: M, columns: &[Columns], pattern: usize) -> PatternProducts {
    let next = (pattern + 1).min(PATTERNS - 1);
    let mut sums = [on.splat(0.0); FEW];
    let (mut own, mut beside) = (on.splat(0.0), on.splat(0.0));
    for block in columns {
        let [re, im] = [on.of(&block.patterns[pattern][0]), on.of(&block.patterns[pattern][1])];
        for (sum, column) in sums.iter_mut().zip(&block.fitted) {
            *sum += on.of(&column[0]) * re + on.of(&column[1]) * im;
        }
        let weight = on.of(&block.weight);
        own += weight * (re * re + im * im);
        let other = &block.patterns[next];
        beside += weight * (re * on.of(&other[0]) + im * on.of(&other[1]));
    }
    let fitted = sums.map(|sum| sum.lanes().sum());
    PatternProducts { fitted, own: own.lanes().sum(), next: beside.lanes().sum() }
}
