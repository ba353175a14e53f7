//! The resolution of readings, found from their digits.
//!
//! An analyzer has a limited number of digits of resistance and reactance, or of magnitude and phase.
//! If the rounding is larger than the noise, the residuals underestimate the error: readings with the
//! same last digit are wrong together.

use rig_model::{Impedance, Reading};

use crate::{Resonance, circuit::points::weight};

/// Largest number of digits of an analyzer; a number with more was computed.
const DIGITS_MAX: i32 = 9;
/// Tolerance of a multiple of a step, relative to the step.
const TOLERANCE: f64 = 1e-6;

/// The variance that rounding adds to each part of the relative error of each reading; empty if the
/// readings were not rounded.
pub(crate) fn variances(readings: &[Reading]) -> Vec<f64> {
    let resistance = Written::of(readings, |impedance| impedance.resistance_ohm);
    let reactance = Written::of(readings, |impedance| impedance.reactance_ohm);
    let size = Written::of(readings, Impedance::magnitude_ohm);
    if resistance.or(reactance).or(size).is_none() {
        return Vec::new();
    }
    let degrees = Written::of(readings, phase_deg);
    let step = |written: Option<Written>, x: f64| written.map_or(0.0, |written| written.step(x));
    readings
        .iter()
        .map(|reading| {
            let Some(impedance) = reading.impedance() else { return 0.0 };
            let size_ohm = impedance.magnitude_ohm();
            let [across, along] = [
                (resistance, impedance.resistance_ohm, reactance, impedance.reactance_ohm),
                (size, size_ohm, degrees, phase_deg(impedance)),
            ]
            .map(|(one, x, other, y)| (step(one, x), step(other, y)));
            let across = across.0.hypot(across.1) / size_ohm;
            let along = (along.0 / size_ohm).hypot(along.1.to_radians());
            // Two numbers with a variance of step²/12 each give the error of two parts.
            across.max(along).powi(2) / 24.0
        })
        .collect()
}

/// Rounding below this fraction of the noise is treated as noise.
const NEGLIGIBLE: f64 = 0.05;

/// Whether rounding is more than a small part of the noise.
pub(crate) fn matters(variances: &[f64], readings: &[Reading], found: &Resonance) -> bool {
    let noise = found.noise_at_ten_cycles.powi(2);
    let is_large =
        |(variance, reading): (&f64, &Reading)| variance * weight(reading) > NEGLIGIBLE * noise;
    variances.iter().zip(readings).any(is_large)
}

fn phase_deg(impedance: Impedance) -> f64 {
    impedance.reactance_ohm.atan2(impedance.resistance_ohm).to_degrees()
}

/// The format of a column of numbers.
#[derive(Debug, Clone, Copy)]
struct Written {
    /// Largest number of significant digits.
    digits: i32,
    /// Largest number of decimal places.
    decimals: i32,
}

impl Written {
    /// `None` if a number has too many digits for an analyzer.
    fn of(readings: &[Reading], column: fn(Impedance) -> f64) -> Option<Self> {
        let mut written = Self { digits: 0, decimals: -DIGITS_MAX };
        let measured = readings.iter().filter_map(Reading::impedance);
        for x in measured.map(column).filter(|x| *x != 0.0) {
            let exponent = exponent(x);
            let is_written = |digits: i32| {
                let steps = x * 10_f64.powi(digits - 1 - exponent);
                (steps - steps.round()).abs() < TOLERANCE
            };
            if !is_written(DIGITS_MAX) {
                return None;
            }
            let digits = (1..DIGITS_MAX).find(|&digits| is_written(digits)).unwrap_or(DIGITS_MAX);
            written.digits = written.digits.max(digits);
            written.decimals = written.decimals.max(digits - 1 - exponent);
        }
        (written.digits > 0).then_some(written)
    }

    /// The step at a number: fixed, or proportional to its power of ten. The rule that does not apply
    /// gives a smaller step.
    fn step(self, x: f64) -> f64 {
        let fixed = 10_f64.powi(-self.decimals);
        if x == 0.0 { fixed } else { fixed.max(10_f64.powi(exponent(x) + 1 - self.digits)) }
    }
}

/// The decimal exponent of the first digit.
#[expect(clippy::cast_possible_truncation, reason = "of a finite number it is small")]
fn exponent(x: f64) -> i32 {
    x.abs().log10().floor() as i32
}

#[cfg(test)]
mod tests {
    use rig_model::{PointResult, RigTime};

    use super::*;

    fn reading(resistance_ohm: f64, reactance_ohm: f64) -> Reading {
        Reading {
            frequency_hz: 140.0,
            measured: PointResult::Value(Impedance { resistance_ohm, reactance_ohm }),
            started: RigTime::ZERO,
            settle_s: 0.0,
            integration_s: 0.0,
        }
    }

    #[track_caller]
    fn check(numbers: &[(f64, f64)], expected: &[f64]) {
        let readings: Vec<_> = numbers.iter().map(|&(r, x)| reading(r, x)).collect();
        let found = variances(&readings);
        assert_eq!(found.len(), expected.len(), "{found:?}");
        for (found, expected) in found.iter().zip(expected) {
            assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
        }
    }

    #[test]
    fn the_step_is_seen_in_the_digits() {
        // Two steps of 1 ohm at 5000 ohm; of 0.1 ohm; of three digits, once 10 and 10, once 1 and 10.
        let at = |re: f64, im: f64, size: f64| (re * re + im * im) / (24.0 * size * size);
        check(
            &[(3000.0, -4000.0), (3001.0, -4001.0)],
            &[at(1.0, 1.0, 5000.0), at(1.0, 1.0, 3001_f64.hypot(4001.0))],
        );
        check(
            &[(300.0, -400.0), (301.1, -400.1)],
            &[at(0.1, 0.1, 500.0), at(0.1, 0.1, 301.1_f64.hypot(400.1))],
        );
        check(
            &[(3010.0, -4020.0), (301.0, -4030.0)],
            &[at(10.0, 10.0, 3010_f64.hypot(4020.0)), at(1.0, 10.0, 301_f64.hypot(4030.0))],
        );
    }

    #[test]
    fn the_step_of_magnitude_and_phase_is_seen_too() {
        let polar = |ohm: f64, degrees: f64| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            (ohm * cos, ohm * sin)
        };
        let expected = |ohm: f64| ((1.0 / ohm).powi(2) + 0.1_f64.to_radians().powi(2)) / 24.0;
        check(&[polar(3451.0, -87.3), polar(3462.0, -80.0)], &[expected(3451.0), expected(3462.0)]);
    }

    #[test]
    fn what_was_computed_is_not_rounded() {
        check(&[(1000.0 / 3.0, -4000.0 / 7.0), (3000.0, -4000.0)], &[]);
    }
}
