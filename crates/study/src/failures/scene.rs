//! Simulated sensors with disturbances that an estimator does not model, and their sweeps.
//!
//! This module shares no code with the estimators: the settled circuit is that of the contact
//! models, the motion in time is that of the simulated bench, and the softening spring is solved
//! here.

use std::f64::consts::TAU;

use num_complex::Complex64;
use rig_contact::Circuit;
use rig_model::{PointResult, Reading, RigTime, SweepPoint, Window, random::Stream};
use rig_resonance::NoisePrior;

use super::{load::DisturbedSensor, outliers::Outliers, spring::Spring};
use crate::analyzer::{Analyzer, Gaps, WINDOW, reading, sensor, time_constant_s};

/// A sensor and a sweep with their disturbances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Scene {
    pub(super) q: f64,
    /// Effective coupling factor squared; 0 without a resonance.
    pub(super) coupling: f64,
    pub(super) resonance_hz: f64,
    /// Standard deviation of each part of the relative error of a reading of ten cycles.
    pub(super) noise: f64,
    /// The noise that the estimator is told; `None` for the usual knowledge.
    pub(super) stated_noise: Option<NoisePrior>,
    pub(super) window: Window,
    /// Points of a sweep that is not planned.
    pub(super) points: u32,
    /// Target standard deviation of a planned sweep, Hz.
    pub(super) target_hz: f64,
    /// Whether the sweep goes up and down.
    pub(super) is_both_ways: bool,
    /// Time constants of settling at each point; `None` for settled readings.
    pub(super) waited: Option<f64>,
    /// Whether the drive has any phase after a change of frequency.
    pub(super) is_any_phase: bool,
    /// Longest gap before a reading of a drive of any phase, s, and largest error of its length, s.
    pub(super) gap_s: f64,
    pub(super) clock_error_s: f64,
    /// Resonance, Hz, and quality factor of an earlier sweep of the sensor without a sample; `None` for a
    /// cold start.
    pub(super) reference: Option<(f64, f64)>,
    /// Drift of the resonance from the first reading to the last, Hz, or in Hz/s.
    pub(super) drift_hz: f64,
    /// By how much the resonance rises with the time constant [`RELAXATION_S`] in a planned sweep, Hz.
    pub(super) relaxation_hz: f64,
    /// Relative drift of the static capacitance from the first reading to the last, or in 1/s.
    pub(super) capacitance_drift: f64,
    pub(super) second: Option<SecondMode>,
    /// Share of outliers among the readings.
    pub(super) outliers: f64,
    /// Softening of the spring at the peak over the linewidth: κQ.
    pub(super) softening: f64,
    pub(super) dielectric: Dielectric,
    /// Phase error of the analyzer, rad.
    pub(super) phase_rad: f64,
    /// Decimal digits of the readings; `None` for full precision.
    pub(super) digits: Option<i32>,
}

/// A second mode of the same quality.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SecondMode {
    /// Its motional capacitance over that of the first.
    pub(super) part: f64,
    /// Its distance above the first in linewidths.
    pub(super) place: f64,
}

/// The static capacitance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Dielectric {
    /// With this loss tangent at all frequencies.
    Loss(f64),
    /// With a permittivity that falls with this power of the frequency, and the loss that causality then
    /// demands.
    ConstantPhase(f64),
}

/// Time constant of a relaxation, s.
const RELAXATION_S: f64 = 2.0;
/// Cycles integrated at each point.
const CYCLES: u32 = 10;
/// Frequency at which a dielectric has its nominal capacitance, Hz.
const NOMINAL_HZ: f64 = 140.0;

impl Scene {
    /// An undisturbed sweep.
    pub(super) fn good(q: f64, coupling: f64) -> Self {
        Self {
            q,
            coupling,
            resonance_hz: 140.0,
            noise: 0.005,
            stated_noise: None,
            window: WINDOW,
            points: 101,
            // Integration alone reaches the finer one for a weak sensor in a minute.
            target_hz: if q * coupling < 0.5 { 0.03 } else { 0.01 },
            is_both_ways: false,
            waited: None,
            is_any_phase: false,
            gap_s: Gaps::USUAL.longest_s,
            clock_error_s: Gaps::USUAL.error_s,
            reference: None,
            drift_hz: 0.0,
            relaxation_hz: 0.0,
            capacitance_drift: 0.0,
            second: None,
            outliers: 0.0,
            softening: 0.0,
            dielectric: Dielectric::Loss(0.018),
            phase_rad: 0.0,
            digits: None,
        }
    }

    /// The scene with drifts and phase error of the opposite sign.
    pub(super) fn reversed(&self) -> Self {
        Self {
            drift_hz: -self.drift_hz,
            relaxation_hz: -self.relaxation_hz,
            capacitance_drift: -self.capacitance_drift,
            phase_rad: -self.phase_rad,
            ..*self
        }
    }

    /// The undisturbed sensor.
    pub(super) fn circuit(&self) -> Circuit {
        sensor(self.resonance_hz, self.q, self.coupling)
    }

    /// The true resonance, at the middle of the sweep or at the start of a planned one, and at a small
    /// drive; `None` for a sensor without a resonance.
    pub(super) fn truth_hz(&self) -> Option<f64> {
        (self.coupling > 0.0).then_some(self.resonance_hz)
    }

    /// The sweep with the resonance at a time on the clock of the readings.
    pub(super) fn at(&self, effective_time_s: f64, readings: &[Reading]) -> Self {
        let (Some(first), Some(last)) = (readings.first(), readings.last()) else { return *self };
        let span_s = last.started.since(first.started).as_secs_f64();
        let from_middle =
            (effective_time_s - first.settle_s - first.started.as_seconds()) / span_s - 0.5;
        Self { resonance_hz: self.resonance_at(from_middle), ..*self }
    }

    /// The resonance at a part of the sweep from its middle, or at a time in s from the start of a planned
    /// one, Hz.
    pub(super) fn resonance_at(&self, moment: f64) -> f64 {
        let relaxed = -(-moment / RELAXATION_S).exp_m1();
        self.resonance_hz + self.drift_hz * moment + self.relaxation_hz * relaxed
    }

    /// Whether the resonance moves with time.
    pub(super) const fn is_moving(&self) -> bool {
        self.drift_hz != 0.0 || self.relaxation_hz != 0.0
    }

    /// The admittance of the static capacitance at a moment as above, S.
    pub(super) fn static_admittance(&self, frequency_hz: f64, moment: f64) -> Complex64 {
        let farad = self.circuit().capacitance_f * (1.0 + self.capacitance_drift * moment);
        let lossless = Complex64::new(0.0, TAU * frequency_hz * farad);
        match self.dielectric {
            Dielectric::Loss(tangent) => lossless * Complex64::new(1.0, -tangent),
            Dielectric::ConstantPhase(exponent) => {
                lossless * Complex64::new(0.0, frequency_hz / NOMINAL_HZ).powf(-exponent)
            }
        }
    }

    /// The spring of the sensor.
    pub(super) const fn spring(&self) -> Spring {
        Spring::new(self.q, self.softening / self.q)
    }

    /// The points in measuring order.
    pub(super) fn points(&self) -> Vec<SweepPoint> {
        // Longer than the decay of any sensor.
        const SETTLE_S: f64 = 60.0;
        let settle_s =
            self.waited.map_or(SETTLE_S, |waited| waited * time_constant_s(&self.circuit()));
        let mut points = self.window.evenly(self.points, settle_s, CYCLES);
        if self.is_both_ways {
            let back: Vec<SweepPoint> = points.iter().rev().copied().collect();
            points.extend(back);
        }
        points
    }

    /// The readings of a sweep that is not planned.
    pub(super) fn measure(&self, mut random: Stream) -> Vec<Reading> {
        let points = self.points();
        let mut defects = self.defects(random.fork());
        let mut readings = if self.waited.is_some() {
            let mut analyzer = self.analyzer(random);
            points.iter().map(|point| analyzer.visit(point)).collect()
        } else {
            self.settled(&points, &mut random)
        };
        for reading in &mut readings {
            defects.apply(reading);
        }
        readings
    }

    /// An analyzer with this sensor at rest.
    pub(super) fn analyzer(&self, random: Stream) -> Analyzer<DisturbedSensor> {
        let analyzer = Analyzer::of(DisturbedSensor::at_rest(self), self.noise, random);
        let gaps = Gaps { longest_s: self.gap_s, error_s: self.clock_error_s };
        if self.is_any_phase { analyzer.with_any_phase(gaps) } else { analyzer }
    }

    /// What the analyzer does to its readings.
    pub(super) fn defects(&self, random: Stream) -> Defects {
        Defects { scene: *self, outliers: Outliers::new(self.outliers, random) }
    }

    /// Settled readings.
    fn settled(&self, points: &[SweepPoint], random: &mut Stream) -> Vec<Reading> {
        let circuit = self.circuit();
        let series_f = circuit.capacitance_f * circuit.capacitance_ratio;
        let mut spring = self.spring();
        let steps = (points.len().max(2) - 1) as f64;
        let mut now = RigTime::ZERO;
        let one = |(index, point): (usize, &SweepPoint)| {
            let f = point.frequency_hz;
            let from_middle = index as f64 / steps - 0.5;
            let resonance_hz = self.resonance_at(from_middle);
            let mut admittance = self.static_admittance(f, from_middle);
            // jωC1/D with the D of the spring at this amplitude.
            let turned = Complex64::new(0.0, TAU * f);
            admittance += turned * series_f / spring.response(f / resonance_hz);
            if let Some(SecondMode { part, place }) = self.second {
                let beside_hz = resonance_hz * (1.0 + place / self.q);
                admittance += turned * series_f * part / Spring::linear(self.q, f / beside_hz);
            }
            let error = Complex64::new(random.normal(), random.normal());
            let started = now;
            now = now + std::time::Duration::from_secs_f64(point.duration_s());
            reading(point, (1.0 + self.noise * error) / admittance, started)
        };
        points.iter().enumerate().map(one).collect()
    }
}

/// What an analyzer does to its readings: phase error, outliers and rounding.
#[derive(Debug, Clone)]
pub(super) struct Defects {
    scene: Scene,
    outliers: Outliers,
}

impl Defects {
    /// Changes the next reading.
    pub(super) fn apply(&mut self, reading: &mut Reading) {
        if let PointResult::Value(value) = &mut reading.measured {
            let exact = Complex64::new(value.resistance_ohm, value.reactance_ohm);
            let turned = exact * Complex64::cis(self.scene.phase_rad);
            (value.resistance_ohm, value.reactance_ohm) = (turned.re, turned.im);
        }
        self.outliers.apply(reading);
        if let (PointResult::Value(value), Some(digits)) =
            (&mut reading.measured, self.scene.digits)
        {
            value.resistance_ohm = rounded(value.resistance_ohm, digits);
            value.reactance_ohm = rounded(value.reactance_ohm, digits);
        }
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
        let sweep = Scene { noise: 0.0, ..Scene::good(30.0, 0.1) };
        for reading in sweep.measure(Stream::new(1, 1)) {
            let expected = sweep.circuit().impedance_ohm(reading.frequency_hz);
            let value = reading.impedance().unwrap();
            let found = Complex64::new(value.resistance_ohm, value.reactance_ohm);
            assert!((found - expected).norm() < 1e-12 * expected.norm(), "{found} {expected}");
        }
    }

    /// The sensor in time and the settled one are computed independently.
    #[test]
    fn a_disturbed_sensor_settles_to_the_settled_one() {
        let good = Scene { noise: 0.0, ..Scene::good(10.0, 0.1) };
        let second = Some(SecondMode { part: 0.2, place: -1.0 });
        for settled in [
            good,
            Scene { second, ..good },
            Scene { dielectric: Dielectric::ConstantPhase(0.1), phase_rad: 0.02, ..good },
            Scene { softening: 0.5, ..good },
            Scene { coupling: 0.0, ..good },
        ] {
            let in_time = Scene { waited: Some(40.0), is_any_phase: true, ..settled };
            let pairs = settled.measure(Stream::new(1, 1)).into_iter();
            for (settled, in_time) in pairs.zip(in_time.measure(Stream::new(1, 1))) {
                let [a, b] = [settled, in_time].map(|one| one.impedance().unwrap());
                let off =
                    (a.resistance_ohm - b.resistance_ohm).hypot(a.reactance_ohm - b.reactance_ohm);
                assert!(off < 1e-9 * a.reactance_ohm.abs(), "{settled:?} {in_time:?}");
            }
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
