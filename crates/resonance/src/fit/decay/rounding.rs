//! The rounding of readings that are repeated at one frequency.
//!
//! Readings of one stay are nearly equal. If the noise is smaller than the last digit, all are rounded
//! by the same amount, and their mean is no better than one of them.
//!
//! # Source
//! Widrow and Kollár, Quantization Noise, Cambridge 2008, section 4 (the characteristic function of
//! noise decides how far rounding errors are independent).

use std::f64::consts::PI;

use rig_model::Reading;

use super::Stays;
use crate::diagnose::rounding;

/// Common rounding below this fraction of the noise is left in the noise.
const NEGLIGIBLE: f64 = 0.01;

impl Stays {
    /// Reduces the weights of readings by the rounding errors that those of a stay have in common, for
    /// this variance of the noise at ten cycles. Returns whether any matters.
    pub(super) fn weigh_rounding(&mut self, readings: &[Reading], variance: f64) -> bool {
        let added = rounding::variances(readings);
        let mut is_relevant = false;
        let mut added = added.iter();
        for stay in &mut self.all {
            let others = stay.samples.iter().filter(|sample| sample.length > 0.0).count();
            let others = others.saturating_sub(1) as f64;
            for (sample, added) in stay.samples.iter_mut().zip(added.by_ref()) {
                if sample.length > 0.0 {
                    // The step of a part is the root of twelve times this.
                    let noise_in_steps = variance / sample.length / (12.0 * added);
                    let common = added * (-4.0 * PI * PI * noise_in_steps).exp();
                    let more = others * common * sample.length / variance;
                    if more > NEGLIGIBLE {
                        sample.length /= 1.0 + more;
                        is_relevant = true;
                    }
                }
            }
        }
        is_relevant
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use rig_model::{Impedance, PointResult, RigTime};

    use super::*;
    use crate::fit::decay::Known;

    /// The sum of the weights of ten readings of one stay in steps of 100 ohm, for this noise.
    fn weight(noise: f64) -> f64 {
        let impedance = Impedance { resistance_ohm: 300.0, reactance_ohm: -4100.0 };
        let readings: Vec<Reading> = (0..10)
            .map(|i| Reading {
                frequency_hz: 140.0,
                measured: PointResult::Value(impedance),
                started: RigTime::ZERO + Duration::from_millis(72 * i),
                settle_s: 0.0,
                integration_s: 10.0 / 140.0,
            })
            .collect();
        let variance = noise * noise;
        let mut stays = Stays::of(Known::with(variance), None, &readings).unwrap();
        let is_relevant = stays.weigh_rounding(&readings, variance);
        assert_eq!(is_relevant, noise < 0.02, "{noise}");
        stays.all[0].samples.iter().map(|sample| sample.length).sum()
    }

    #[test]
    fn readings_with_the_same_rounding_are_as_good_as_one() {
        // One step is 2.4 % of the magnitude.
        let rounding = (100.0 / 300_f64.hypot(4100.0)).powi(2) / 12.0;
        let least = 1e-3_f64.powi(2) / rounding;
        let found = weight(1e-3);
        assert!((0.9..1.3).contains(&(found / least)), "{found} {least}");
        // Noise of more than a step makes the rounding independent.
        assert!((weight(0.03) - 10.0).abs() < 1e-3, "{}", weight(0.03));
    }
}
