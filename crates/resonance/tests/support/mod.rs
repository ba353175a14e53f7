//! Sweeps of known circuits.

use std::f64::consts::TAU;

use num_complex::Complex64;
use rand_core::Rng;
use rand_pcg::Pcg64;
use rig_model::{DriveLevel, Reading, ReadingFlag, RigTime, SweepMethod, SweepRequest, Window};
use rig_resonance::Circuit;

/// Random numbers from a seed that a failing test prints.
#[derive(Debug)]
pub(crate) struct Random(Pcg64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(Pcg64::new(u128::from(seed), 0x5eed))
    }

    /// Evenly distributed between the ends.
    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.0.next_u64() >> 11) as f64 / 2_f64.powi(53)
    }

    /// Evenly distributed on a logarithmic scale.
    pub(crate) fn log_between(&mut self, low: f64, high: f64) -> f64 {
        self.between(low.ln(), high.ln()).exp()
    }

    /// Two independent normal numbers.
    pub(crate) fn normal(&mut self) -> Complex64 {
        let radius = (-2.0 * self.between(f64::MIN_POSITIVE, 1.0).ln()).sqrt();
        Complex64::from_polar(radius, self.between(0.0, TAU))
    }
}

pub(crate) fn circuit(q: f64, k_eff_squared: f64) -> Circuit {
    let c1_farad = 27e-9 * k_eff_squared / (1.0 - k_eff_squared);
    Circuit { resonance_hz: 140.0, q, c0_farad: 27e-9, c1_farad, loss_tangent: 0.0 }
}

pub(crate) fn reading(frequency_hz: f64, impedance: Complex64) -> Reading {
    Reading {
        frequency_hz,
        resistance_ohm: impedance.re,
        reactance_ohm: impedance.im,
        started: RigTime::ZERO,
        settle_s: 0.0,
        integration_s: 10.0 / frequency_hz,
        flag: ReadingFlag::Normal,
    }
}

/// An even sweep of anything that has an impedance, ten cycles at each point.
pub(crate) fn sweep(
    window: (f64, f64),
    points: usize,
    noise: f64,
    random: &mut Random,
    impedance: impl Fn(f64) -> Complex64,
) -> Vec<Reading> {
    (0..points)
        .map(|i| {
            let frequency_hz = window.0 + (window.1 - window.0) * i as f64 / (points - 1) as f64;
            let error = 1.0 + noise * random.normal();
            reading(frequency_hz, impedance(frequency_hz) * error)
        })
        .collect()
}

pub(crate) fn request(method: SweepMethod) -> SweepRequest {
    SweepRequest {
        window: Window { min_hz: 112.0, max_hz: 168.0 },
        method,
        target_sigma_hz: 0.01,
        time_limit_s: 60.0,
        cycles: 10,
        settle_s: 0.5,
        level: DriveLevel { volt: 1.0 },
    }
}
