//! What a survey states of the bench follows from its readings.

use num_complex::Complex64;

use crate::{
    finding::Check,
    record::{Bench, Reading},
};

/// The phase error of a survey is the one at which its readings fit best, within this many standard
/// deviations.
const PHASE_SIGMAS: f64 = 3.0;
/// The sum of squares rises by four at two standard deviations. Stated ones include the drift that the
/// survey allows for, which this checker does not: by how much less or more it may rise.
const RISE: [f64; 2] = [0.4, 40.0];
/// The error of the first gap of a survey is the one at which its readings fit best, within this many
/// standard deviations, which the sum of squares at these times beside it tells.
const FIRST_GAP_SIGMAS: f64 = 4.0;
const FIRST_GAP_BESIDE_S: f64 = 0.3e-3;
/// A stated standard deviation of a second mode over that of this checker, at least.
const MODE_LEAST: f64 = 0.4;

/// A statement that does not follow.
#[derive(Debug)]
pub(crate) struct Doubt {
    pub(crate) check: Check,
    pub(crate) what: &'static str,
    pub(crate) expected: f64,
    pub(crate) found: f64,
    pub(crate) limit: String,
}

/// The doubts about a survey with this sum of squares for each phase error and error of the first gap, this
/// scatter and these degrees of freedom at the stated ones, and this standard deviation of a second mode.
pub(crate) fn doubts(
    bench: &Bench,
    cost: impl Fn(f64, f64) -> Option<f64>,
    (scatter, degrees): (f64, f64),
    mode_sigma: f64,
) -> Vec<Doubt> {
    let mut doubts = Vec::new();
    let Bench { phase_rad, phase_sigma_rad: sigma, first_gap_s, mode_sigma: stated, .. } = *bench;
    // How much the sum of squares rises on both sides of what is stated, and where the parabola through the
    // three points is lowest, in units of the distance to the sides.
    let parabola = |sides: [Option<f64>; 2]| {
        let [below, above] = sides.map(|cost| cost.unwrap_or(f64::NAN) / scatter);
        let rise = 0.5 * (below + above) - degrees;
        (rise, 0.25 * (below - above) / rise)
    };
    let (rise, lowest) =
        parabola([-2.0, 2.0].map(|sigmas| cost(phase_rad + sigmas * sigma, first_gap_s)));
    let off = 2.0 * lowest;
    if !((RISE[0]..=RISE[1]).contains(&rise) && off.abs() <= PHASE_SIGMAS) {
        doubts.push(Doubt {
            check: Check::Resonance,
            what: "the phase error of the analyzer, rad",
            expected: phase_rad + off * sigma,
            found: phase_rad,
            limit: format!("{PHASE_SIGMAS} standard deviations of {sigma}"),
        });
    }
    let beside_s = FIRST_GAP_BESIDE_S;
    let (rise, lowest) =
        parabola([-beside_s, beside_s].map(|away_s| cost(phase_rad, first_gap_s + away_s)));
    let (off_s, sigma_s) = (lowest * beside_s, beside_s / rise.sqrt());
    let limit_s = FIRST_GAP_SIGMAS * sigma_s;
    let is_near = off_s.abs() <= limit_s;
    // Below that the readings do not tell it.
    let is_told = rise.is_nan() || rise > 1.0;
    if is_told && !is_near {
        doubts.push(Doubt {
            check: Check::Resonance,
            what: "the error of the first gap, s",
            expected: first_gap_s + off_s,
            found: first_gap_s,
            limit: format!("{limit_s} s"),
        });
    }
    let least = MODE_LEAST * mode_sigma;
    if stated.is_nan() || stated < least {
        doubts.push(Doubt {
            check: Check::Sigma,
            what: "the standard deviation of a second mode",
            expected: mode_sigma,
            found: stated,
            limit: format!("at least {least}"),
        });
    }
    doubts
}

/// The readings with their phases turned by this angle, rad.
pub(crate) fn turned(readings: &[Reading], angle_rad: f64) -> Vec<Reading> {
    let turn = Complex64::cis(angle_rad);
    let turned = |reading: &Reading| {
        let ohm = reading.resistance_ohm.zip(reading.reactance_ohm);
        let ohm = ohm.map(|(re, im)| Complex64::new(re, im) * turn);
        Reading {
            resistance_ohm: ohm.map(|ohm| ohm.re),
            reactance_ohm: ohm.map(|ohm| ohm.im),
            ..*reading
        }
    };
    readings.iter().map(turned).collect()
}
