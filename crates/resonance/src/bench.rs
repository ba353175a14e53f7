//! What stays the same on a bench from sweep to sweep.

use std::f64::consts::TAU;

use num_complex::Complex64;
use rig_model::Window;

/// The knowledge of an analyzer and its surroundings from a survey.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bench {
    /// Phase error of the analyzer, rad: it is subtracted from each impedance.
    pub phase_rad: f64,
    /// Its standard deviation, rad.
    pub phase_sigma_rad: f64,
    /// By how much the time from the begin of the first reading of a stay to that of the second is longer
    /// than recorded, s: an analyzer may begin a reading that comes with its settings later than others. It
    /// varies by as much.
    pub first_gap_s: f64,
    /// Change of the static capacitance for each factor e of the frequency, F, from the middle of `surveyed` on:
    /// the dielectric disperses. Its admittance is subtracted from that of each reading.
    pub dispersion_farad: f64,
    /// Its standard deviation, F.
    pub dispersion_sigma_farad: f64,
    /// Standard deviation of the capacitance of a possible second mode, relative to that of the first.
    pub mode_sigma: f64,
    /// The frequencies at which a second mode would have been noticed.
    pub surveyed: Window,
}

impl Bench {
    /// The impedance, ohm, without the errors of the analyzer and the dispersion.
    pub(crate) fn corrected(&self, frequency_hz: f64, ohm: Complex64) -> Complex64 {
        let turned = ohm * Complex64::cis(-self.phase_rad);
        let admittance = dispersion(self.surveyed, frequency_hz) * self.dispersion_farad;
        turned / (1.0 - turned * admittance)
    }
}

/// The admittance of a dispersion of 1 F after a survey of this window.
pub(crate) fn dispersion(surveyed: Window, frequency_hz: f64) -> Complex64 {
    let middle_hz = 0.5 * (surveyed.min_hz + surveyed.max_hz);
    Complex64::new(0.0, TAU * frequency_hz * (frequency_hz / middle_hz).ln())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reading_is_corrected_for_the_phase_and_for_the_capacitance_at_its_frequency() {
        let bench = Bench {
            phase_rad: 0.02,
            phase_sigma_rad: 1e-3,
            first_gap_s: 0.0,
            dispersion_farad: -3e-10,
            dispersion_sigma_farad: 1e-11,
            mode_sigma: 0.01,
            surveyed: Window { min_hz: 126.0, max_hz: 154.0 },
        };
        let admittance = |hz: f64, farad: f64| Complex64::new(2e-6, TAU * hz * farad);
        for (hz, farad) in [(140.0, 28e-9), (154.0, 28e-9 - 3e-10 * 1.1_f64.ln())] {
            let measured = admittance(hz, farad).inv() * Complex64::cis(0.02);
            let (found, right) = (bench.corrected(hz, measured), admittance(hz, 28e-9).inv());
            assert!((found - right).norm() < 1e-9 * right.norm(), "{hz}: {found}, not {right}");
        }
        assert_eq!(bench.corrected(154.0, Complex64::ZERO), Complex64::ZERO);
    }
}
