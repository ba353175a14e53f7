//! The impedance of a sensor whose probe goes into a sample, as a lock-in reads it at one frequency.
//!
//! The amplitude I of the motional current at the drive ω goes to its steady value V/Z as e^((s − jω)t), with
//! the free motion s of the sensor and the impedance Z of its series branch; the part of the free motion at −ω is
//! left out, as whole cycles average it away. A contact of depth d adds 4π ω₀ S (1 + jη) to the square of the
//! natural frequency, where S = A (d/d₀)^p is the rise of the resonance while it is small, and η the loss factor
//! of the sample. For a ball on a soft half space p is ½.

use std::f64::consts::TAU;

use num_complex::Complex64;

use super::EvenWay;
use crate::{Resonance, circuit::Circuit};

/// d₀, mm: a depth at which contacts are noticed.
pub(super) const DEPTH_MM: f64 = 0.05;

/// The steps of the integration grow with the time since the probe touched, as the rise of the resonance slows
/// down: by this part of it, between these limits, s.
const STEP_PART: f64 = 0.15;
const STEPS_S: (f64, f64) = (0.25e-3, 1e-3);

/// What is fitted beside the impedance of the clear probe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ContactModel {
    pub(super) surface_mm: f64,
    /// Natural logarithm of A in Hz.
    pub(super) strength: f64,
    pub(super) exponent: f64,
    pub(super) loss: f64,
    pub(super) latency_s: f64,
}

/// The free sensor under its drive.
#[derive(Debug, Clone, Copy)]
pub(super) struct FreeSensor {
    omega: f64,
    natural: f64,
    /// R/L, 1/s, and L, H.
    damping: f64,
    inductance_h: f64,
    parallel: Complex64,
}

impl FreeSensor {
    pub(super) fn new(free: &Resonance, frequency_hz: f64) -> Self {
        let Circuit { resonance_hz, q, c0_farad, c1_farad, loss_tangent } = free.circuit();
        let (omega, natural) = (TAU * frequency_hz, TAU * resonance_hz);
        Self {
            omega,
            natural,
            damping: natural / q,
            inductance_h: 1.0 / (natural * natural * c1_farad),
            parallel: omega * c0_farad * Complex64::new(loss_tangent, 1.0),
        }
    }

    /// s − jω with a contact of this strength, Hz, and depth, mm, and the steady current of a drive of 1 V, A.
    fn motion(
        &self,
        contact: &ContactModel,
        strength_hz: f64,
        depth_mm: f64,
    ) -> (Complex64, Complex64) {
        let mut square = Complex64::from(self.natural * self.natural);
        if depth_mm > 0.0 {
            let rise_hz = strength_hz * (depth_mm / DEPTH_MM).powf(contact.exponent);
            square += 2.0 * self.natural * TAU * rise_hz * Complex64::new(1.0, contact.loss);
        }
        let half = 0.5 * self.damping;
        let free = Complex64::I * (square - half * half).sqrt() - half;
        // Z = L (jω + R/L + ω_c²/jω).
        let drive = Complex64::new(0.0, self.omega);
        let impedance_ohm = self.inductance_h * (drive + self.damping + square / drive);
        (free - drive, impedance_ohm.inv())
    }

    /// The impedance over that of the clear probe, in each of these windows of integration, s, one after the other.
    pub(super) fn relative<'a>(
        &'a self,
        contact: &'a ContactModel,
        windows: &'a [(f64, f64)],
        way: &'a EvenWay,
    ) -> impl Iterator<Item = Complex64> + 'a {
        let strength_hz = contact.strength.exp();
        let (_, clear) = self.motion(contact, strength_hz, 0.0);
        let touched_s =
            way.time_s - contact.latency_s + (way.at_mm - contact.surface_mm) / way.speed_mm_per_s;
        let (mut now_s, mut current) = (touched_s, clear);
        let mut step_to = move |until_s: f64| {
            let mut charge = Complex64::ZERO;
            while now_s < until_s {
                let step_s = STEP_PART * (now_s - touched_s);
                let step_s = step_s.clamp(STEPS_S.0, STEPS_S.1).min(until_s - now_s);
                let middle_s = now_s + 0.5 * step_s + contact.latency_s;
                let depth_mm = contact.surface_mm - way.position_mm(middle_s);
                let (rate, steady) = self.motion(contact, strength_hz, depth_mm);
                let decay = (rate * step_s).exp();
                charge += steady * step_s + (current - steady) * (decay - 1.0) / rate;
                current = steady + (current - steady) * decay;
                now_s += step_s;
            }
            charge
        };
        let read = move |&(from_s, until_s): &(f64, f64)| {
            let clear_s = (until_s.min(touched_s) - from_s).max(0.0);
            step_to(from_s);
            let charge = clear * clear_s + step_to(until_s);
            let mean = charge / (until_s - from_s);
            (self.parallel + clear) / (self.parallel + mean)
        };
        windows.iter().map(read)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::ModelOrder;

    /// The free sensor of the shipped bench, with a noise of 0.5 % in ten cycles.
    pub(crate) fn free() -> Resonance {
        Resonance {
            resonance_hz: 140.4,
            sigma_hz: 0.01,
            q: 66.0,
            c0_farad: 27.4e-9,
            k_eff_squared: 0.04,
            loss_tangent: 0.018,
            figure_of_merit: 2.75,
            chi_squared_per_dof: 1.0,
            noise_at_ten_cycles: 0.005,
            noise_degrees_of_freedom: 1000.0,
            model_order: ModelOrder::Loss,
            extra: None,
            mains_hz: None,
            points: 500,
            covariance: [[0.0; 5]; 5],
            condition: 1.0,
        }
    }
}
