//! The simulated analyzer of the studies: the exact sensor in time, with noise and a clock.
//!
//! Sensor and lock-in are those of the simulated bench. Nothing here is shared with the estimators
//! that are judged by it.

use std::time::Duration;

use num_complex::Complex64;
use rig_contact::Circuit;
use rig_model::{Impedance, Measured, Reading, RigTime, SweepPoint, Window, random::Stream};
use rig_sim::plant::Plant;

/// Where the resonance is sought, Hz.
pub(crate) const WINDOW: Window = Window { min_hz: 112.0, max_hz: 168.0 };

/// A sensor without contact, of a quality and a coupling (fp² − fs²)/fp².
pub(crate) fn sensor(series_resonance_hz: f64, q: f64, coupling: f64) -> Circuit {
    Circuit {
        series_resonance_hz,
        q,
        capacitance_f: 27e-9,
        capacitance_ratio: coupling / (1.0 - coupling),
        // The loss tangent of PZT-5A.
        dielectric_loss: 0.018,
    }
}

/// The time constant with which the motion of a sensor dies away, s.
pub(crate) fn time_constant_s(circuit: &Circuit) -> f64 {
    circuit.q / (std::f64::consts::PI * circuit.series_resonance_hz)
}

/// An analyzer with a sensor on it, whose drive never stops.
#[derive(Debug, Clone)]
pub(crate) struct Analyzer {
    plant: Plant,
    noise: f64,
    chance: Stream,
    now: RigTime,
}

impl Analyzer {
    /// A sensor at rest, whose drive begins with the first point. `noise` is the standard deviation
    /// of each part of the relative error of a reading of ten cycles.
    pub(crate) fn at_rest(circuit: Circuit, noise: f64, chance: Stream) -> Self {
        let plant = Plant::at_rest(circuit, WINDOW.min_hz).expect("the studies' sensors ring");
        Self { plant, noise, chance, now: RigTime::ZERO }
    }

    /// The time since the beginning, s.
    pub(crate) fn elapsed_s(&self) -> f64 {
        self.now.as_seconds()
    }

    /// Changes the sensor now; its motion goes on.
    pub(crate) fn set_circuit(&mut self, circuit: Circuit) {
        self.plant.set_circuit(circuit).expect("the studies' sensors ring");
    }

    /// Measures one point.
    pub(crate) fn visit(&mut self, point: &SweepPoint) -> Reading {
        let started = self.now;
        self.plant.set_frequency(point.frequency_hz);
        self.plant.advance(point.settle_s);
        let exact = self.plant.measure(point.cycles);
        let error = self.noise * (10.0 / f64::from(point.cycles)).sqrt();
        let [re, im] = [self.chance.normal(), self.chance.normal()];
        let impedance = exact * (1.0 + error * Complex64::new(re, im));
        self.now = self.now + Duration::from_secs_f64(point.duration_s());
        reading(point, impedance, started)
    }
}

/// A reading of a point.
pub(crate) fn reading(point: &SweepPoint, impedance: Complex64, started: RigTime) -> Reading {
    Reading {
        frequency_hz: point.frequency_hz,
        measured: Measured::Value(Impedance {
            resistance_ohm: impedance.re,
            reactance_ohm: impedance.im,
        }),
        started,
        settle_s: point.settle_s,
        integration_s: f64::from(point.cycles) / point.frequency_hz,
    }
}

/// Points at equal distances over a window, from end to end.
pub(crate) fn evenly(window: Window, points: u32, settle_s: f64, cycles: u32) -> Vec<SweepPoint> {
    let step_hz = (window.max_hz - window.min_hz) / f64::from(points.max(2) - 1);
    (0..points)
        .map(|index| SweepPoint {
            frequency_hz: (window.min_hz + step_hz * f64::from(index)).min(window.max_hz),
            settle_s,
            cycles,
        })
        .collect()
}
