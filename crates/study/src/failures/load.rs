//! The disturbed sensor in time.

use std::f64::consts::TAU;

use num_complex::Complex64;
use rig_contact::Circuit;
use rig_sim::plant::Plant;

use super::{
    scene::{Scene, SecondMode},
    spring::Spring,
};
use crate::analyzer::{Load, WINDOW};

/// A sensor whose resonance and capacitance may drift, perhaps with a second mode.
#[derive(Debug, Clone)]
pub(super) struct DisturbedSensor {
    scene: Scene,
    /// The motional branches; none without a resonance.
    modes: Vec<Plant>,
    spring: Spring,
    frequency_hz: f64,
    elapsed_s: f64,
}

impl DisturbedSensor {
    pub(super) fn at_rest(scene: &Scene) -> Self {
        let frequency_hz = WINDOW.min_hz;
        let plant =
            |circuit| Plant::at_rest(circuit, frequency_hz).expect("the studies' sensors ring");
        let modes = circuits(scene, scene.resonance_hz, 1.0).into_iter().map(plant).collect();
        Self { scene: *scene, modes, spring: scene.spring(), frequency_hz, elapsed_s: 0.0 }
    }

    /// Moves the modes to the resonance at this time and amplitude. The amplitude is that of the settled
    /// motion.
    fn move_modes(&mut self, at_s: f64) {
        if !self.scene.is_moving() && self.scene.softening == 0.0 {
            return;
        }
        let free_hz = self.scene.resonance_at(at_s);
        let stiffness = self.spring.stiffness(self.frequency_hz / free_hz);
        for (mode, circuit) in self.modes.iter_mut().zip(circuits(&self.scene, free_hz, stiffness))
        {
            mode.set_circuit(circuit).expect("the studies' sensors ring");
        }
    }
}

/// The circuits of the modes, each beside the same lossless capacitance. The spring of the first has this
/// stiffness over that of a small amplitude, at which it resonates at `free_hz`.
fn circuits(scene: &Scene, free_hz: f64, stiffness: f64) -> Vec<Circuit> {
    if scene.coupling == 0.0 {
        return Vec::new();
    }
    let free = Circuit { series_resonance_hz: free_hz, dielectric_loss: 0.0, ..scene.circuit() };
    // Inductance and resistance stay.
    let first = Circuit {
        series_resonance_hz: free_hz * stiffness.sqrt(),
        q: free.q * stiffness.sqrt(),
        capacitance_ratio: free.capacitance_ratio / stiffness,
        ..free
    };
    let second = scene.second.filter(|second| second.part > 0.0);
    let second = second.map(|SecondMode { part, place }| Circuit {
        series_resonance_hz: free_hz * (1.0 + place / scene.q),
        capacitance_ratio: part * free.capacitance_ratio,
        ..free
    });
    [first].into_iter().chain(second).collect()
}

impl Load for DisturbedSensor {
    fn set_frequency(&mut self, frequency_hz: f64) {
        self.frequency_hz = frequency_hz;
        self.modes.iter_mut().for_each(|mode| mode.set_frequency(frequency_hz));
    }

    fn turn_drive(&mut self, radians: f64) {
        self.modes.iter_mut().for_each(|mode| mode.turn_drive(radians));
    }

    fn advance(&mut self, seconds: f64) {
        self.move_modes(self.elapsed_s);
        self.elapsed_s += seconds;
        self.modes.iter_mut().for_each(|mode| mode.advance(seconds));
    }

    fn measure(&mut self, cycles: u32) -> Complex64 {
        let duration_s = f64::from(cycles) / self.frequency_hz;
        let middle_s = self.elapsed_s + 0.5 * duration_s;
        self.move_modes(middle_s);
        self.elapsed_s += duration_s;
        let beside =
            Complex64::new(0.0, TAU * self.frequency_hz * self.scene.circuit().capacitance_f);
        let mut admittance = self.scene.static_admittance(self.frequency_hz, middle_s);
        for mode in &mut self.modes {
            admittance += 1.0 / mode.measure(cycles) - beside;
        }
        1.0 / admittance
    }
}
