//! What a survey states of the bench follows from its readings.

use std::f64::consts::TAU;

use num_complex::Complex64;

use crate::{
    finding::Check,
    record::{Bench, Dispersion, Reading},
};

/// The phase error and the dispersion of a survey are those at which its readings fit best, within this many standard
/// deviations.
const SIGMAS: f64 = 3.0;
/// The sum of squares rises by four at two standard deviations. Stated ones include the drift that the
/// survey allows for, which this checker does not: by how much less or more it may rise.
const RISE: [f64; 2] = [0.4, 40.0];
/// Standard deviation of the dispersion before a survey, as a part of the static capacitance.
const DISPERSION_BEFORE: f64 = 0.05;
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

/// The doubts about a survey with this sum of squares for each statement of the bench, this scatter and these degrees of
/// freedom at the stated one, and this standard deviation of a second mode.
pub(crate) fn doubts(
    bench: &Bench,
    cost: impl Fn(&Bench) -> Option<f64>,
    (scatter, degrees): (f64, f64),
    static_f: f64,
    mode_sigma: f64,
) -> Vec<Doubt> {
    let mut doubts = Vec::new();
    let Bench { phase_rad, first_gap_s, mode_sigma: stated, .. } = *bench;
    // What was known before counts as another reading.
    let before = |bench: &Bench| {
        let away = |found: Dispersion| found.dispersion_f / (DISPERSION_BEFORE * static_f);
        bench.dispersion.map_or(0.0, |found| away(found).powi(2))
    };
    // How much the sum of squares rises on both sides of what is stated, and where the parabola through the
    // three points is lowest, in units of the distance to the sides.
    let parabola = |sides: [Bench; 2]| {
        let of = |side: Bench| cost(&side).unwrap_or(f64::NAN) / scatter + before(&side);
        let [below, above] = sides.map(of);
        let rise = 0.5 * (below + above) - degrees - before(bench);
        (rise, 0.25 * (below - above) / rise)
    };
    let mut check = |what, found: f64, sigma: f64, at: &dyn Fn(f64) -> Bench| {
        let (rise, lowest) = parabola([-2.0, 2.0].map(|sigmas| at(found + sigmas * sigma)));
        let off = 2.0 * lowest;
        if !((RISE[0]..=RISE[1]).contains(&rise) && off.abs() <= SIGMAS) {
            doubts.push(Doubt {
                check: Check::Resonance,
                what,
                expected: found + off * sigma,
                found,
                limit: format!("{SIGMAS} standard deviations of {sigma}"),
            });
        }
    };
    let what = "the phase error of the analyzer, rad";
    check(what, phase_rad, bench.phase_sigma_rad, &|phase_rad| Bench { phase_rad, ..*bench });
    if let Some(Dispersion { dispersion_f, dispersion_sigma_f }) = bench.dispersion {
        let what = "the dispersion of the dielectric, F";
        check(what, dispersion_f, dispersion_sigma_f, &|dispersion_f| {
            let dispersion = Some(Dispersion { dispersion_f, dispersion_sigma_f });
            Bench { dispersion, ..*bench }
        });
    }
    let beside_s = FIRST_GAP_BESIDE_S;
    let (rise, lowest) = parabola(
        [-beside_s, beside_s].map(|away_s| Bench { first_gap_s: first_gap_s + away_s, ..*bench }),
    );
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

/// The readings without the phase error of the analyzer and the dispersion of the dielectric.
pub(crate) fn corrected(readings: &[Reading], bench: &Bench) -> Vec<Reading> {
    let turn = Complex64::cis(-bench.phase_rad);
    let [low_hz, high_hz] = bench.surveyed_hz;
    let dispersion_f = bench.dispersion.map_or(0.0, |found| found.dispersion_f);
    let corrected = |reading: &Reading| {
        let hz = reading.frequency_hz;
        let farad = dispersion_f * (2.0 * hz / (low_hz + high_hz)).ln();
        let siemens = Complex64::new(0.0, TAU * hz * farad);
        // Also right for a reading of 0 ohm.
        let without = |ohm: Complex64| ohm * turn / (1.0 - ohm * turn * siemens);
        let ohm = reading.resistance_ohm.zip(reading.reactance_ohm);
        let ohm = ohm.map(|(re, im)| without(Complex64::new(re, im)));
        Reading {
            resistance_ohm: ohm.map(|ohm| ohm.re),
            reactance_ohm: ohm.map(|ohm| ohm.im),
            ..*reading
        }
    };
    readings.iter().map(corrected).collect()
}
