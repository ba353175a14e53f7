//! Sweeps of known circuits.

use std::{f64::consts::TAU, time::Duration};

use num_complex::Complex64;
use rand_core::Rng;
use rand_pcg::Pcg64;
use rig_model::{
    DriveLevel, Impedance, PointResult, Reading, RigTime, SweepMethod, SweepPoint, SweepRequest,
    Window,
};
use rig_resonance::{Circuit, Resonance};

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

    /// One or minus one.
    pub(crate) fn sign(&mut self) -> f64 {
        if self.between(0.0, 1.0) < 0.5 { -1.0 } else { 1.0 }
    }

    /// A whole number between these, evenly on a logarithmic scale.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole and small")]
    pub(crate) fn count(&mut self, low: f64, high: f64) -> usize {
        self.log_between(low, high).floor() as usize
    }

    /// A whole number below this one, each as likely.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below a count")]
    pub(crate) fn below(&mut self, count: usize) -> usize {
        self.between(0.0, count as f64) as usize
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

/// Errors of Q, C₀ and C₁/C₀ of a fit, in the standard deviations that it states.
pub(crate) fn circuit_scores(found: &Resonance, truth: &Circuit) -> [f64; 3] {
    let ratio = |circuit: &Circuit| circuit.c1_farad / circuit.c0_farad;
    [
        (found.q - truth.q) / found.q_sigma(),
        (found.c0_farad - truth.c0_farad) / found.c0_sigma_farad(),
        (ratio(&found.circuit()) - ratio(truth)) / found.capacitance_ratio_sigma(),
    ]
}

pub(crate) fn measured(impedance: Complex64) -> PointResult {
    PointResult::Value(Impedance { resistance_ohm: impedance.re, reactance_ohm: impedance.im })
}

pub(crate) fn impedance(reading: &Reading) -> Complex64 {
    let impedance = reading.impedance().expect("the scene has a value");
    Complex64::new(impedance.resistance_ohm, impedance.reactance_ohm)
}

pub(crate) fn reading(frequency_hz: f64, impedance: Complex64) -> Reading {
    Reading {
        frequency_hz,
        measured: measured(impedance),
        started: RigTime::ZERO,
        settle_s: 60.0,
        integration_s: 10.0 / frequency_hz,
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

/// The four elements in time, integrated blindly: fourth-order Runge–Kutta on charge and current,
/// the lock-in as a third integral.
#[derive(Debug, Clone)]
pub(crate) struct Plant {
    pub(crate) circuit: Circuit,
    charge: f64,
    current: f64,
    turns: f64,
    passed_s: f64,
    /// How fast the resonance moves, Hz/s.
    pub(crate) drift_hz_per_s: f64,
}

impl Plant {
    /// At rest; the drive begins at its crest.
    pub(crate) fn at_rest(circuit: Circuit) -> Self {
        let (charge, current, turns, passed_s, drift_hz_per_s) = (0.0, 0.0, 0.0, 0.0, 0.0);
        Self { circuit, charge, current, turns, passed_s, drift_hz_per_s }
    }

    /// Drives for some time; gives the impedance a lock-in finds over it, which makes sense over
    /// whole cycles.
    pub(crate) fn drive(&mut self, frequency_hz: f64, seconds: f64) -> Complex64 {
        const STEPS_PER_CYCLE: f64 = 200.0;
        let Circuit { resonance_hz, q, c0_farad, c1_farad, loss_tangent } = self.circuit;
        let omega = TAU * frequency_hz;
        let (passed_s, drift_hz_per_s) = (self.passed_s, self.drift_hz_per_s);
        let start = TAU * self.turns;
        let steps = (seconds * frequency_hz * STEPS_PER_CYCLE).ceil();
        let dt = seconds / steps;
        let slope = |t: f64, charge: f64, current: f64| {
            let volt = (start + omega * t).cos();
            let omega_s = TAU * (resonance_hz + drift_hz_per_s * (passed_s + t));
            let force = omega_s * omega_s * (c1_farad * volt - charge);
            (current, force - omega_s / q * current, current * Complex64::cis(-(start + omega * t)))
        };
        let (mut x, mut y, mut sum) = (self.charge, self.current, Complex64::ZERO);
        let mut step = 0.0;
        while step < steps {
            let t = step * dt;
            let a = slope(t, x, y);
            let b = slope(t + 0.5 * dt, x + 0.5 * dt * a.0, y + 0.5 * dt * a.1);
            let c = slope(t + 0.5 * dt, x + 0.5 * dt * b.0, y + 0.5 * dt * b.1);
            let d = slope(t + dt, x + dt * c.0, y + dt * c.1);
            x += dt / 6.0 * (a.0 + 2.0 * b.0 + 2.0 * c.0 + d.0);
            y += dt / 6.0 * (a.1 + 2.0 * b.1 + 2.0 * c.1 + d.1);
            sum += dt / 6.0 * (a.2 + 2.0 * b.2 + 2.0 * c.2 + d.2);
            step += 1.0;
        }
        (self.charge, self.current) = (x, y);
        self.passed_s += seconds;
        self.turns = (self.turns + frequency_hz * seconds).fract();
        let fixed = omega * c0_farad * Complex64::new(loss_tangent, 1.0);
        1.0 / (2.0 / seconds * sum + fixed)
    }

    /// Lets the phase of the drive jump by a part of a turn.
    pub(crate) fn jump(&mut self, turns: f64) {
        self.turns += turns;
    }

    /// Makes one visit; gives the reading and the time after it.
    pub(crate) fn visit(
        &mut self,
        point: &SweepPoint,
        now: RigTime,
        noise: f64,
        random: &mut Random,
    ) -> (Reading, RigTime) {
        if point.settle_s > 0.0 {
            self.drive(point.frequency_hz, point.settle_s);
        }
        let integration_s = f64::from(point.cycles) / point.frequency_hz;
        let impedance = self.drive(point.frequency_hz, integration_s);
        let error = noise * (10.0 / f64::from(point.cycles)).sqrt() * random.normal();
        let mut reading = reading(point.frequency_hz, impedance * (1.0 + error));
        (reading.started, reading.settle_s) = (now, point.settle_s);
        reading.integration_s = integration_s;
        (reading, now + Duration::from_secs_f64(point.settle_s + integration_s))
    }
}

/// Number of ways in which a reading can be wrong.
pub(crate) const WAYS: usize = 6;

/// A wrong reading: scaled, mirrored, or stuck at the reading before.
pub(crate) fn wrong(
    way: usize,
    right: Complex64,
    before: Complex64,
    noise: f64,
    random: &mut Random,
) -> Complex64 {
    match way {
        0 | 1 => right * random.log_between(0.01, 100.0),
        2 => right * (1.0 + 20.0 * noise * random.normal()),
        3 => [-right, right.conj(), -right.conj()][random.below(3)],
        4 => before,
        _ => Complex64::new(right.re * random.log_between(0.01, 100.0), right.im * random.sign()),
    }
}
