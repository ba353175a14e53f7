//! The loops over the readings: sums for the normal equations, and residuals.
//!
//! The model is written in a form without cancellation on a narrow window. With w = f/f₀, v = w² − 1
//! and p from [`Block`], the admittance over jωC₀(reference) is
//!
//! ```text
//!   y = c − jg + κh,   h = 1/(ν − v + jαw)
//!   ν = (fs/f₀)² − 1,  α = fs/(f₀Q),  κ = (C1/C₀)(fs/f₀)²,  c = C0/C₀,  g = c·tan δ
//! ```
//!
//! The residual of a reading is p·y − 1 = Z(measured)/Z(model) − 1, the relative error of the reading,
//! whose real and imaginary parts have equal noise. Every element of `JᵀJ` is a product of
//! |p|² and powers of h, so that a reading costs one division and some sixty other operations.

#![expect(
    clippy::inline_always,
    reason = "vector instructions are used only by what is inlined into the code compiled for them"
)]

use crate::{
    circuit::points::Block,
    numeric::descent::Normal,
    numeric::simd::{F64x4, Isa, Lanes, on_this_machine},
};

/// Number of parameters of the circuit.
pub(crate) const PARAMETERS: usize = 5;

/// The circuit in the units of [`Points`](super::points::Points), in the order (ν, α, c, κ, g).
/// Without dielectric loss only the first four are used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Theta {
    pub(crate) nu: f64,
    pub(crate) alpha: f64,
    pub(crate) c: f64,
    pub(crate) kappa: f64,
    pub(crate) g: f64,
}

/// The sums of the linearised rational fit: unknowns (c, cν + κ, αc, ν, α).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rational {
    pub(crate) matrix: [[f64; PARAMETERS]; PARAMETERS],
    pub(crate) right: [f64; PARAMETERS],
}

on_this_machine! {
    /// The normal equations of the circuit.
    pub(crate) fn normal(blocks: &'a [Block], theta: &'a Theta) -> Normal<PARAMETERS> = normal_of;
}

on_this_machine! {
    /// The sums of the rational fit, weighted with |h|² of an earlier estimate of (ν, α), if any.
    /// Without that weight the readings near the resonance, which are the most informative, have the
    /// least weight.
    pub(crate) fn rational(blocks: &'a [Block], earlier: Option<(f64, f64)>) -> Rational = rational_of;
}

on_this_machine! {
    /// Computes and stores the residuals of a fit, and their statistics.
    pub(crate) fn statistics(
        blocks: &'a [Block],
        theta: &'a Theta,
        residuals: &'a mut Vec<Residual>,
    ) -> ResidualStatistics = statistics_of;
}

#[inline(always)]
fn normal_of<M: Isa>(on: M, blocks: &[Block], theta: &Theta) -> Normal<PARAMETERS> {
    let nu = on.splat(theta.nu);
    let alpha = on.splat(theta.alpha);
    let (c, kappa, g) = (on.splat(theta.c), on.splat(theta.kappa), on.splat(theta.g));
    let one = on.splat(1.0);
    let mut s = [on.splat(0.0); 18];
    for block in blocks {
        let block = block.on(on);
        let (d_re, d_im) = (nu - block.v, alpha * block.w);
        let hh = one / (d_re * d_re + d_im * d_im);
        let (h_re, h_im) = (d_re * hh, -(d_im * hh));
        let (h2_re, h2_im) = (h_re * h_re - h_im * h_im, (h_re + h_re) * h_im);
        let (y_re, y_im) = (c + kappa * h_re, kappa * h_im - g);
        let r_re = block.p_re * y_re - block.p_im * y_im - one;
        let r_im = block.p_re * y_im + block.p_im * y_re;
        // e = W p* r.
        let (wp_re, wp_im) = (block.weight * block.p_re, block.weight * block.p_im);
        let e_re = wp_re * r_re + wp_im * r_im;
        let e_im = wp_re * r_im - wp_im * r_re;
        let pp = wp_re * block.p_re + wp_im * block.p_im;
        let wpp = block.w * pp;
        let pphh = pp * hh;
        let wpphh = block.w * pphh;
        s[0] += pp;
        s[1] += pp * h_re;
        s[2] += pp * h_im;
        s[3] += pp * h2_re;
        s[4] += pp * h2_im;
        s[5] += wpp * h2_re;
        s[6] += wpp * h2_im;
        s[7] += pphh;
        s[8] += pphh * h_re;
        s[9] += wpphh * h_im;
        s[10] += pphh * hh;
        s[11] += wpphh * hh * block.w;
        s[12] += e_re;
        s[13] += e_im;
        s[14] += h_re * e_re + h_im * e_im;
        s[15] += h2_re * e_re + h2_im * e_im;
        s[16] += block.w * (h2_re * e_im - h2_im * e_re);
        s[17] += block.weight * (r_re * r_re + r_im * r_im);
    }
    assemble(&s.map(|sum| sum.lanes().sum()), theta.kappa)
}

#[inline(always)]
fn assemble(s: &[f64; 18], kappa: f64) -> Normal<PARAMETERS> {
    let k2 = kappa * kappa;
    let (nu_c, nu_kappa, nu_g) = (-kappa * s[3], -kappa * s[8], kappa * s[4]);
    let (alpha_c, alpha_kappa, alpha_g) = (kappa * s[6], kappa * s[9], kappa * s[5]);
    Normal {
        matrix: [
            [k2 * s[10], 0.0, nu_c, nu_kappa, nu_g],
            [0.0, k2 * s[11], alpha_c, alpha_kappa, alpha_g],
            [nu_c, alpha_c, s[0], s[1], 0.0],
            [nu_kappa, alpha_kappa, s[1], s[7], -s[2]],
            [nu_g, alpha_g, 0.0, -s[2], s[0]],
        ],
        gradient: [-kappa * s[15], -kappa * s[16], s[12], s[14], -s[13]],
        cost: s[17],
    }
}

#[inline(always)]
fn rational_of<M: Isa>(on: M, blocks: &[Block], earlier: Option<(f64, f64)>) -> Rational {
    let one = on.splat(1.0);
    let mut s = [on.splat(0.0); 13];
    for block in blocks {
        let block = block.on(on);
        let (w, v, p_re, p_im) = (block.w, block.v, block.p_re, block.p_im);
        let weight = match earlier {
            None => block.weight,
            Some((nu, alpha)) => {
                let (d_re, d_im) = (on.splat(nu) - v, on.splat(alpha) * w);
                block.weight * (one / (d_re * d_re + d_im * d_im))
            }
        };
        let wv = weight * v;
        let (wp_re, ww_im) = (weight * p_re, weight * w * p_im);
        let pp = weight * (p_re * p_re + p_im * p_im);
        let vpp = v * pp;
        s[0] += weight;
        s[1] += weight * w * w;
        s[2] += wv;
        s[3] += wp_re;
        s[4] += wv * p_re;
        s[5] += v * wv * p_re;
        s[6] += ww_im;
        s[7] += ww_im * v;
        s[8] += wp_re * w * w;
        s[9] += pp;
        s[10] += vpp;
        s[11] += vpp * v;
        s[12] += pp * w * w;
    }
    let s = s.map(|sum| sum.lanes().sum());
    Rational {
        matrix: [
            [s[11], -s[10], 0.0, s[4], s[7]],
            [-s[10], s[9], 0.0, -s[3], -s[6]],
            [0.0, 0.0, s[12], s[6], -s[8]],
            [s[4], -s[3], s[6], s[0], 0.0],
            [s[7], -s[6], -s[8], 0.0, s[1]],
        ],
        right: [s[5], -s[4], s[7], s[2], 0.0],
    }
}

/// Number of patterns that [`statistics`] fits to the residuals.
pub(crate) const PATTERNS: usize = 4;

/// Number of unknowns of the circuit and the patterns together.
pub(crate) const WIDE: usize = PARAMETERS + PATTERNS;

/// Statistics of the residuals.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ResidualStatistics {
    /// The sum of the squares of |r|² times weight.
    pub(crate) fourth: f64,
    /// The largest |r|² times weight.
    pub(crate) largest: f64,
    /// Decrease of the cost below the sum of the weights by the best capacitor with loss.
    pub(crate) capacitor: f64,
    /// The sum over neighbours of |r − r′|² over the sum of their variances.
    pub(crate) differences: f64,
    /// `XᵀWr`, `XᵀWJ` and `XᵀWX` of the patterns jph, ph³, jph³ and j: the next orders of a misfit at the
    /// resonance after the first two, which are changes of the circuit itself, and a phase error of the
    /// analyzer, which resembles an impedance in series.
    pub(crate) gradient: [f64; PATTERNS],
    pub(crate) with_circuit: [[f64; PARAMETERS]; PATTERNS],
    pub(crate) among: [[f64; PATTERNS]; PATTERNS],
}

/// Four residuals.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Residual {
    re: Lanes,
    im: Lanes,
}

#[inline(always)]
fn statistics_of<M: Isa>(
    on: M,
    blocks: &[Block],
    theta: &Theta,
    residuals: &mut Vec<Residual>,
) -> ResidualStatistics {
    let nu = on.splat(theta.nu);
    let alpha = on.splat(theta.alpha);
    let (c, kappa, g) = (on.splat(theta.c), on.splat(theta.kappa), on.splat(theta.g));
    let one = on.splat(1.0);
    residuals.clear();
    let mut largest = on.splat(0.0);
    let mut s = [on.splat(0.0); 29];
    for block in blocks {
        let block = block.on(on);
        let (d_re, d_im) = (nu - block.v, alpha * block.w);
        let hh = one / (d_re * d_re + d_im * d_im);
        let (h_re, h_im) = (d_re * hh, -(d_im * hh));
        let (h2_re, h2_im) = (h_re * h_re - h_im * h_im, (h_re + h_re) * h_im);
        let (h3_re, h3_im) = (h_re * h2_re - h_im * h2_im, h_re * h2_im + h_im * h2_re);
        let (y_re, y_im) = (c + kappa * h_re, kappa * h_im - g);
        let re = block.p_re * y_re - block.p_im * y_im - one;
        let im = block.p_re * y_im + block.p_im * y_re;
        let size = block.weight * (re * re + im * im);
        residuals.push(Residual { re: re.lanes(), im: im.lanes() });
        largest = largest.max(size);
        let (wp_re, wp_im) = (block.weight * block.p_re, block.weight * block.p_im);
        let (e_re, e_im) = (wp_re * re + wp_im * im, wp_re * im - wp_im * re);
        let pp = wp_re * block.p_re + wp_im * block.p_im;
        let pphh = pp * hh;
        let (pphh_re, pphh_im) = (pphh * h_re, pphh * h_im);
        let (pphhhh_re, pphhhh_im) = (pphh_re * hh, pphh_im * hh);
        s[0] += size * size;
        s[1] += wp_re;
        s[2] += wp_im;
        s[3] += pp;
        s[4] += pp * h_re;
        s[5] += pp * h_im;
        s[6] += pphh;
        s[7] += pphh_im;
        s[8] += block.w * pphh_re;
        s[9] += pphhhh_re;
        s[10] += pphhhh_im;
        s[11] += block.w * pphhhh_re;
        s[12] += block.w * pphhhh_im;
        s[13] += pp * h3_re;
        s[14] += pp * h3_im;
        s[15] += pphh * h2_re;
        s[16] += pphh * h2_im;
        s[17] += pphh * hh * hh;
        s[18] += h_re * e_im - h_im * e_re;
        s[19] += h3_re * e_re + h3_im * e_im;
        s[20] += h3_re * e_im - h3_im * e_re;
        s[21] += wp_re * h_re - wp_im * h_im;
        s[22] += wp_re * h_im + wp_im * h_re;
        s[23] += wp_re * h2_im + wp_im * h2_re;
        s[24] += block.w * (wp_re * h2_re - wp_im * h2_im);
        s[25] += wp_re * h3_re - wp_im * h3_im;
        s[26] += wp_re * h3_im + wp_im * h3_re;
        s[27] += block.weight * im;
        s[28] += block.weight;
    }
    let differences = differences(on, blocks, residuals);
    let largest = largest.lanes().0.into_iter().fold(0.0, f64::max);
    collect(&s.map(|sum| sum.lanes().sum()), theta.kappa, largest, differences)
}

#[inline(always)]
fn collect(s: &[f64; 29], k: f64, largest: f64, differences: f64) -> ResidualStatistics {
    ResidualStatistics {
        fourth: s[0],
        largest,
        capacitor: (s[1] * s[1] + s[2] * s[2]) / s[3],
        differences,
        gradient: [s[18], s[19], s[20], s[27]],
        with_circuit: [
            [-k * s[7], -k * s[8], -s[5], 0.0, -s[4]],
            [-k * s[9], -k * s[12], s[13], s[15], -s[14]],
            [k * s[10], -k * s[11], -s[14], -s[16], -s[13]],
            [-k * s[23], -k * s[24], s[2], s[22], -s[1]],
        ],
        among: [
            [s[6], s[16], s[15], s[21]],
            [s[16], s[17], 0.0, s[26]],
            [s[15], 0.0, s[17], s[25]],
            [s[21], s[26], s[25], s[28]],
        ],
    }
}

/// The sum over neighbours of |r − r′|² over their variances; a lane holds consecutive readings.
#[inline(always)]
fn differences<M: Isa>(on: M, blocks: &[Block], residuals: &[Residual]) -> f64 {
    let mut sum = on.splat(0.0);
    for (pair, r) in blocks.windows(2).zip(residuals.windows(2)) {
        let re = on.of(&r[1].re) - on.of(&r[0].re);
        let im = on.of(&r[1].im) - on.of(&r[0].im);
        let (one, other) = (on.of(&pair[0].weight), on.of(&pair[1].weight));
        let (both, total) = (one * other, one + other);
        // 1/(1/W + 1/W′), which is 0 if either weight is 0.
        sum += (re * re + im * im) * both / total.max(on.splat(f64::MIN_POSITIVE));
    }
    sum.lanes().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::simd::Any;

    #[test]
    fn every_machine_gets_the_same_bits() {
        let number = |i: usize| Lanes(std::array::from_fn(|lane| ((7 * i + lane) as f64).sin()));
        let blocks: Vec<Block> = (0..9)
            .map(|i| Block {
                w: number(5 * i),
                v: number(5 * i + 1),
                p_re: number(5 * i + 2),
                p_im: number(5 * i + 3),
                weight: number(5 * i + 4),
            })
            .collect();
        let theta = Theta { nu: 0.1, alpha: 0.03, c: 1.0, kappa: 0.05, g: 0.02 };
        let (here, there) = (normal(&blocks, &theta), normal_of(Any, &blocks, &theta));
        assert_eq!(format!("{here:?}"), format!("{there:?}"));
        let (mut here, mut there) = (Vec::new(), Vec::new());
        let both = (
            statistics(&blocks, &theta, &mut here),
            statistics_of(Any, &blocks, &theta, &mut there),
        );
        assert_eq!(format!("{:?} {here:?}", both.0), format!("{:?} {there:?}", both.1));
        for earlier in [None, Some((0.1, 0.03))] {
            let (here, there) = (rational(&blocks, earlier), rational_of(Any, &blocks, earlier));
            assert_eq!(format!("{here:?}"), format!("{there:?}"));
        }
    }
}
