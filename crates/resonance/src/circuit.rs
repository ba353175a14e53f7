//! The Butterworth–Van Dyke circuit near one resonance.
//!
//! ```text
//!        ┌──── C0 (1 − j tan δ) ────┐
//!     ───┤                          ├───
//!        └──── R1 ─── L1 ─── C1 ────┘
//! ```

pub(crate) mod dual;
pub(crate) mod kernel;
pub(crate) mod points;
pub(crate) mod residual_transient;
pub(crate) mod ringup;
pub(crate) mod trace;

use std::f64::consts::TAU;

use num_complex::Complex64;

/// A resonator with its static capacitance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circuit {
    /// Series resonance 1/(2π√(L1 C1)), Hz.
    pub resonance_hz: f64,
    /// Quality factor of the series branch, (1/R1)·√(L1/C1).
    pub q: f64,
    /// Static capacitance, F.
    pub c0_farad: f64,
    /// Motional capacitance, F.
    pub c1_farad: f64,
    /// Dielectric loss tangent of the static capacitance.
    pub loss_tangent: f64,
}

impl Circuit {
    /// The steady-state admittance, S.
    pub fn admittance_siemens(&self, frequency_hz: f64) -> Complex64 {
        let u = frequency_hz / self.resonance_hz;
        let motional = self.c1_farad / Complex64::new(1.0 - u * u, u / self.q);
        let fixed = self.c0_farad * Complex64::new(1.0, -self.loss_tangent);
        Complex64::new(0.0, TAU * frequency_hz) * (fixed + motional)
    }

    /// The steady-state impedance, ohm.
    pub fn impedance_ohm(&self, frequency_hz: f64) -> Complex64 {
        1.0 / self.admittance_siemens(frequency_hz)
    }

    /// The effective coupling factor squared, (fp² − fs²)/fp² = C1/(C0 + C1).
    pub fn k_eff_squared(&self) -> f64 {
        self.c1_farad / (self.c0_farad + self.c1_farad)
    }

    /// The figure of merit M = Q·C1/C0 = 1/(ωs C0 R1).
    ///
    /// Without dielectric loss the phase crosses zero only if M > 2.
    pub fn figure_of_merit(&self) -> f64 {
        self.q * self.c1_farad / self.c0_farad
    }

    /// Full width of the conductance peak at half its height, Hz.
    pub fn linewidth_hz(&self) -> f64 {
        self.resonance_hz / self.q
    }

    /// Decay time constant of the motional amplitude, s.
    pub fn time_constant_s(&self) -> f64 {
        self.q / (std::f64::consts::PI * self.resonance_hz)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn admittance_is_that_of_the_four_elements() {
        let circuit = Circuit {
            resonance_hz: 140.0,
            q: 30.0,
            c0_farad: 27e-9,
            c1_farad: 2e-9,
            loss_tangent: 0.02,
        };
        let inductance = 1.0 / ((TAU * 140.0_f64).powi(2) * 2e-9);
        let resistance = TAU * 140.0 * inductance / 30.0;
        for frequency_hz in [90.0, 139.0, 140.0, 146.0, 300.0] {
            let omega = TAU * frequency_hz;
            let branch = Complex64::new(resistance, omega * inductance - 1.0 / (omega * 2e-9));
            let expected = omega * 27e-9 * Complex64::new(0.02, 1.0) + 1.0 / branch;
            let found = circuit.admittance_siemens(frequency_hz);
            assert!((found - expected).norm() < 1e-12 * expected.norm(), "{found} {expected}");
        }
    }
}
