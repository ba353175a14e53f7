//! The Butterworth–Van Dyke circuit: the equivalent circuit of the sensor near one resonance.
//!
//! A lossy capacitor in parallel with a series branch of inductance, capacitance and resistance.
//! With u = f/fs the admittance is
//! Y = jωC₀ [1 − j tan δ + (C₁/C₀)/(1 − u² + ju/Q)].

use std::f64::consts::TAU;

use num_complex::Complex64;

/// The five parameters of the circuit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circuit {
    /// Resonance of the series branch, 1/(2π√(L₁C₁)), Hz.
    pub series_resonance_hz: f64,
    /// Quality factor of the series branch.
    pub q: f64,
    /// Parallel capacitance C₀, F.
    pub capacitance_f: f64,
    /// C₁/C₀.
    pub capacitance_ratio: f64,
    /// Loss tangent of the parallel capacitance.
    pub dielectric_loss: f64,
}

impl Circuit {
    /// The admittance at a frequency above zero, S.
    pub fn admittance_s(&self, frequency_hz: f64) -> Complex64 {
        let u = frequency_hz / self.series_resonance_hz;
        let (real, imaginary) = (1.0 - u * u, u / self.q);
        let size = self.capacitance_ratio / (real * real + imaginary * imaginary);
        // C/C₀ = bracket of the module's formula; the factor j turns it by a quarter.
        let bracket = (1.0 + size * real, -self.dielectric_loss - size * imaginary);
        let scale = TAU * frequency_hz * self.capacitance_f;
        Complex64::new(-scale * bracket.1, scale * bracket.0)
    }

    /// The impedance at a frequency above zero, ohm.
    pub fn impedance_ohm(&self, frequency_hz: f64) -> Complex64 {
        let admittance = self.admittance_s(frequency_hz);
        let size = admittance.re * admittance.re + admittance.im * admittance.im;
        Complex64::new(admittance.re / size, -admittance.im / size)
    }

    /// Q C₁/C₀. Below two the phase never crosses zero.
    pub fn figure_of_merit(&self) -> f64 {
        self.q * self.capacitance_ratio
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CIRCUIT: Circuit = Circuit {
        series_resonance_hz: 140.4,
        q: 60.0,
        capacitance_f: 27e-9,
        capacitance_ratio: 0.08,
        dielectric_loss: 0.02,
    };

    /// The same circuit put together from its elements.
    #[test]
    fn the_admittance_is_that_of_the_elements() {
        let c1 = CIRCUIT.capacitance_ratio * CIRCUIT.capacitance_f;
        let resonance = TAU * CIRCUIT.series_resonance_hz;
        let (l1, r1) = (1.0 / (resonance.powi(2) * c1), 1.0 / (resonance * c1 * CIRCUIT.q));
        for frequency in [1.0, 100.0, 140.0, 140.4, 141.0, 146.0, 500.0] {
            let omega = TAU * frequency;
            let j = Complex64::i();
            let branch = r1 + j * (omega * l1 - 1.0 / (omega * c1));
            let shunt = j * omega * CIRCUIT.capacitance_f * (1.0 - j * CIRCUIT.dielectric_loss);
            let expected = branch.inv() + shunt;
            let error = (CIRCUIT.admittance_s(frequency) - expected).norm() / expected.norm();
            assert!(error < 1e-12, "{frequency} Hz: {error}");
            let product = CIRCUIT.impedance_ohm(frequency) * expected;
            assert!((product - 1.0).norm() < 1e-12, "{frequency} Hz: {product}");
        }
    }

    #[test]
    fn the_phase_crosses_zero_only_above_a_figure_of_merit_of_two() {
        let crosses = |q: f64| {
            let circuit = Circuit { q, dielectric_loss: 0.0, ..CIRCUIT };
            (0..20_000).any(|i| circuit.admittance_s(140.0 + f64::from(i) * 5e-4).im < 0.0)
        };
        assert!(crosses(2.1 / CIRCUIT.capacitance_ratio));
        assert!(!crosses(1.9 / CIRCUIT.capacitance_ratio));
    }
}
