//! The simulated analyzer of the studies: the exact response of the sensor in time, with noise and
//! a clock.
//!
//! Sensor and lock-in are those of the simulated bench. The estimators under study share no code
//! with this module.

use std::{f64::consts::TAU, time::Duration};

use num_complex::Complex64;
use rig_contact::Circuit;
use rig_model::{Impedance, PointResult, Reading, RigTime, SweepPoint, Window, random::Stream};
use rig_sim::plant::Plant;

/// The search window for the resonance.
pub(crate) const WINDOW: Window = Window { min_hz: 112.0, max_hz: 168.0 };

/// A sensor without contact, with a given quality factor and coupling (fp² − fs²)/fp².
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

/// The decay time constant of a sensor, s.
pub(crate) fn time_constant_s(circuit: &Circuit) -> f64 {
    circuit.q / (std::f64::consts::PI * circuit.series_resonance_hz)
}

/// An electrical load in time, under a sinusoidal drive.
pub(crate) trait Load {
    /// Changes the frequency of the drive now, without a jump of its phase.
    fn set_frequency(&mut self, frequency_hz: f64);
    /// Turns the phase of the drive now, rad.
    fn turn_drive(&mut self, radians: f64);
    /// Lets time pass, s.
    fn advance(&mut self, seconds: f64);
    /// The impedance that a lock-in finds over the next whole cycles, ohm. Time passes.
    fn measure(&mut self, cycles: u32) -> Complex64;
}

impl Load for Plant {
    fn set_frequency(&mut self, frequency_hz: f64) {
        self.set_frequency(frequency_hz);
    }

    fn turn_drive(&mut self, radians: f64) {
        self.turn_drive(radians);
    }

    fn advance(&mut self, seconds: f64) {
        self.advance(seconds);
    }

    fn measure(&mut self, cycles: u32) -> Complex64 {
        self.measure(cycles)
    }
}

/// An analyzer that drives a load without interruption.
#[derive(Debug, Clone)]
pub(crate) struct Analyzer<L = Plant> {
    load: L,
    noise: f64,
    random: Stream,
    now: RigTime,
    any_phase: Option<AnyPhase>,
}

/// The state of an analyzer whose drive starts at any phase at each change of frequency, and whose times
/// are known to a millisecond.
#[derive(Debug, Clone)]
struct AnyPhase {
    random: Stream,
    gaps: Gaps,
    frequency_hz: f64,
    /// The error of the clock of the readings, s.
    clock_error_s: f64,
}

/// The gaps before the readings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Gaps {
    /// The longest gap, with the dead time of a change of frequency, s.
    pub(crate) longest_s: f64,
    /// The largest error of its length, s. The errors add up.
    pub(crate) error_s: f64,
}

impl Gaps {
    /// The gaps of a usual analyzer.
    pub(crate) const USUAL: Self = Self { longest_s: 3e-3, error_s: 1e-3 };
}
/// Time of the first reading on an analyzer of any phase, s: late enough that no error of its clock leads
/// to a time before the start.
pub(crate) const ANY_PHASE_STARTS_S: f64 = 1.0;

impl Analyzer {
    /// Starts with a sensor at rest. `noise` is the standard deviation of each part of the relative
    /// error of a reading of ten cycles.
    pub(crate) fn at_rest(circuit: Circuit, noise: f64, random: Stream) -> Self {
        let plant = Plant::at_rest(circuit, WINDOW.min_hz).expect("the studies' sensors ring");
        Self::of(plant, noise, random)
    }

    /// Changes the sensor now. Its motion continues.
    pub(crate) fn set_circuit(&mut self, circuit: Circuit) {
        self.load.set_circuit(circuit).expect("the studies' sensors ring");
    }
}

impl<L: Load> Analyzer<L> {
    /// Starts with a load. `noise` is the standard deviation of each part of the relative error of a
    /// reading of ten cycles.
    pub(crate) fn of(load: L, noise: f64, random: Stream) -> Self {
        Self { load, noise, random, now: RigTime::ZERO, any_phase: None }
    }

    /// The same with a drive of any phase and with gaps of which the length is not quite known.
    pub(crate) fn with_any_phase(mut self, gaps: Gaps) -> Self {
        let random = self.random.fork();
        self.any_phase = Some(AnyPhase { random, gaps, frequency_hz: 0.0, clock_error_s: 0.0 });
        self
    }

    /// The elapsed time, s.
    pub(crate) fn elapsed_s(&self) -> f64 {
        self.now.as_seconds()
    }

    /// Measures one point.
    pub(crate) fn visit(&mut self, point: &SweepPoint) -> Reading {
        let mut started = self.now;
        self.load.set_frequency(point.frequency_hz);
        if let Some(any) = &mut self.any_phase {
            if any.frequency_hz.to_bits() != point.frequency_hz.to_bits() {
                any.frequency_hz = point.frequency_hz;
                self.load.turn_drive(TAU * any.random.uniform());
            }
            let gap_s = any.gaps.longest_s * any.random.uniform();
            self.load.advance(gap_s);
            self.now = self.now + Duration::from_secs_f64(gap_s);
            any.clock_error_s += any.gaps.error_s * (2.0 * any.random.uniform() - 1.0);
            let off_s = (ANY_PHASE_STARTS_S + any.clock_error_s).max(0.0);
            started = self.now + Duration::from_secs_f64(off_s);
        }
        self.load.advance(point.settle_s);
        let exact = self.load.measure(point.cycles);
        let error = self.noise * (10.0 / f64::from(point.cycles)).sqrt();
        let [re, im] = [self.random.normal(), self.random.normal()];
        let impedance = exact * (1.0 + error * Complex64::new(re, im));
        self.now = self.now + Duration::from_secs_f64(point.duration_s());
        reading(point, impedance, started)
    }
}

/// A reading of a point.
pub(crate) fn reading(point: &SweepPoint, impedance: Complex64, started: RigTime) -> Reading {
    Reading {
        frequency_hz: point.frequency_hz,
        measured: PointResult::Value(Impedance {
            resistance_ohm: impedance.re,
            reactance_ohm: impedance.im,
        }),
        started,
        settle_s: point.settle_s,
        integration_s: f64::from(point.cycles) / point.frequency_hz,
    }
}
