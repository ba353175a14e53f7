//! Simulated sweeps with disturbances that an estimator does not model.
//!
//! This module shares no code with the estimators: the settled circuit is that of the contact
//! models, the motion in time is that of the simulated bench, and the softening spring is solved
//! here.

use std::f64::consts::TAU;

use num_complex::Complex64;
use rig_contact::Circuit;
use rig_model::{PointResult, Reading, RigTime, SweepPoint, Window, random::Stream};

use super::spring::Spring;
use crate::analyzer::{Analyzer, WINDOW, evenly, reading, sensor, time_constant_s};

/// A sweep with its disturbances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SimulatedSweep {
    pub(super) q: f64,
    pub(super) coupling: f64,
    pub(super) resonance_hz: f64,
    /// Standard deviation of each part of the relative error of a reading.
    pub(super) noise: f64,
    pub(super) window: Window,
    pub(super) points: u32,
    /// Whether the sweep goes up and down.
    pub(super) is_both_ways: bool,
    /// Time constants of settling at each point; `None` for settled readings.
    pub(super) waited: Option<f64>,
    /// Drift of the resonance from the first reading to the last, Hz.
    pub(super) drift_hz: f64,
    /// A second mode one linewidth above: its motional capacitance over that of the first.
    pub(super) second: f64,
    /// Share of outliers among the readings.
    pub(super) outliers: f64,
    /// Softening of the spring at the peak over the linewidth: κQ.
    pub(super) softening: f64,
    pub(super) dielectric_loss: f64,
    /// Decimal digits of the readings; `None` for full precision.
    pub(super) digits: Option<i32>,
}

/// Length of a burst of outliers: mostly one, sometimes two or four.
const fn burst_length(uniform: f64) -> u32 {
    if uniform < 0.7 {
        1
    } else if uniform < 0.9 {
        2
    } else {
        4
    }
}
const BURST_MEAN: f64 = 1.5;

/// Cycles integrated at each point.
const CYCLES: u32 = 10;

impl SimulatedSweep {
    /// An undisturbed sweep.
    pub(super) fn good(q: f64, coupling: f64) -> Self {
        Self {
            q,
            coupling,
            resonance_hz: 140.0,
            noise: 0.005,
            window: WINDOW,
            points: 101,
            is_both_ways: false,
            waited: None,
            drift_hz: 0.0,
            second: 0.0,
            outliers: 0.0,
            softening: 0.0,
            dielectric_loss: 0.018,
            digits: None,
        }
    }

    /// The undisturbed sensor.
    pub(super) fn circuit(&self) -> Circuit {
        let sensor = sensor(self.resonance_hz, self.q, self.coupling);
        Circuit { dielectric_loss: self.dielectric_loss, ..sensor }
    }

    /// The true resonance, at the middle of the sweep and at a small drive; `None` for a sensor
    /// without a resonance.
    pub(super) fn truth_hz(&self) -> Option<f64> {
        (self.coupling > 0.0).then_some(self.resonance_hz)
    }

    /// The sweep with the resonance at a time on the clock of the readings.
    pub(super) fn at(&self, effective_time_s: f64, readings: &[Reading]) -> Self {
        let (Some(first), Some(last)) = (readings.first(), readings.last()) else { return *self };
        let span_s = last.started.since(first.started).as_secs_f64();
        let from_middle =
            (effective_time_s - first.settle_s - first.started.as_seconds()) / span_s - 0.5;
        Self { resonance_hz: self.resonance_hz + self.drift_hz * from_middle, ..*self }
    }

    /// The points in measuring order.
    pub(super) fn points(&self) -> Vec<SweepPoint> {
        // Longer than the decay of any sensor.
        const SETTLE_S: f64 = 60.0;
        let settle_s =
            self.waited.map_or(SETTLE_S, |waited| waited * time_constant_s(&self.circuit()));
        let mut points = evenly(self.window, self.points, settle_s, CYCLES);
        if self.is_both_ways {
            let back: Vec<SweepPoint> = points.iter().rev().copied().collect();
            points.extend(back);
        }
        points
    }

    /// The readings of the sweep.
    pub(super) fn measure(&self, mut random: Stream) -> Vec<Reading> {
        let points = self.points();
        let mut readings = if self.waited.is_some() {
            let mut analyzer = Analyzer::at_rest(self.circuit(), self.noise, random.clone());
            points.iter().map(|point| analyzer.visit(point)).collect()
        } else {
            self.settled(&points, &mut random)
        };
        // The analyzer has used the other stream.
        let mut random = random.fork();
        let (mut burst, mut kind, mut last) = (0_u32, 0.0, None);
        for reading in &mut readings {
            if burst == 0 && random.uniform() < self.outliers / BURST_MEAN {
                (burst, kind) = (burst_length(random.uniform()), random.uniform());
            }
            let PointResult::Value(value) = &mut reading.measured else { continue };
            if burst > 0 {
                burst -= 1;
                let factor = 10_f64.powf(4.0 * random.uniform() - 2.0);
                if kind < 0.4 {
                    // Both parts by the same factor, from 0.01 to 100.
                    value.resistance_ohm *= factor;
                    value.reactance_ohm *= factor;
                } else if kind < 0.6 {
                    value.resistance_ohm *= factor;
                } else if kind < 0.7 {
                    value.reactance_ohm = -value.reactance_ohm;
                } else if kind < 0.8 {
                    value.resistance_ohm = -value.resistance_ohm;
                    value.reactance_ohm = -value.reactance_ohm;
                } else if let Some(stuck) = last {
                    *value = stuck;
                }
            }
            last = Some(*value);
            if let Some(digits) = self.digits {
                value.resistance_ohm = rounded(value.resistance_ohm, digits);
                value.reactance_ohm = rounded(value.reactance_ohm, digits);
            }
        }
        readings
    }

    /// Settled readings.
    fn settled(&self, points: &[SweepPoint], random: &mut Stream) -> Vec<Reading> {
        let circuit = self.circuit();
        let series_f = circuit.capacitance_f * circuit.capacitance_ratio;
        let mut spring = Spring::new(self.q, self.softening / self.q);
        let steps = (points.len().max(2) - 1) as f64;
        let mut now = RigTime::ZERO;
        let one = |(index, point): (usize, &SweepPoint)| {
            let f = point.frequency_hz;
            let from_middle = index as f64 / steps - 0.5;
            let resonance_hz = self.resonance_hz + self.drift_hz * from_middle;
            let fixed = Complex64::new(circuit.dielectric_loss, 1.0) * circuit.capacitance_f;
            let mut admittance = TAU * f * fixed;
            // jωC1/D with the D of the spring at this amplitude.
            let turned = Complex64::new(0.0, TAU * f);
            admittance += turned * series_f / spring.response(f / resonance_hz);
            let beside_hz = resonance_hz * (1.0 + 1.0 / self.q);
            let beside = Spring::linear(self.q, f / beside_hz);
            admittance += turned * series_f * self.second / beside;
            let error = Complex64::new(random.normal(), random.normal());
            let started = now;
            now = now + std::time::Duration::from_secs_f64(point.duration_s());
            reading(point, (1.0 + self.noise * error) / admittance, started)
        };
        points.iter().enumerate().map(one).collect()
    }
}

/// A value rounded to a number of decimal digits.
fn rounded(value: f64, digits: i32) -> f64 {
    if value == 0.0 {
        return 0.0;
    }
    let points = digits - 1 - exponent(value);
    let unit = 10_f64.powi(-points);
    (value / unit).round() * unit
}

fn exponent(value: f64) -> i32 {
    #[expect(clippy::cast_possible_truncation, reason = "exponents of impedances are small")]
    let exponent = value.abs().log10().floor() as i32;
    exponent
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_good_sweep_is_the_settled_circuit() {
        let sweep = SimulatedSweep { noise: 0.0, ..SimulatedSweep::good(30.0, 0.1) };
        for reading in sweep.measure(Stream::new(1, 1)) {
            let expected = sweep.circuit().impedance_ohm(reading.frequency_hz);
            let value = reading.impedance().unwrap();
            let found = Complex64::new(value.resistance_ohm, value.reactance_ohm);
            assert!((found - expected).norm() < 1e-12 * expected.norm(), "{found} {expected}");
        }
    }

    #[test]
    fn values_are_rounded_to_their_digits() {
        for (value, digits, expected) in
            [(1234.5, 3, 1230.0), (-0.001_234_5, 3, -0.001_23), (999.6, 3, 1000.0), (0.0, 3, 0.0)]
        {
            let found = rounded(value, digits);
            assert!((found - expected).abs() <= 1e-12 * expected.abs(), "{value}: {found}");
        }
    }
}
