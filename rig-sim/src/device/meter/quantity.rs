//! The quantities and the rounding of analyzers.

use num_complex::Complex64;

/// The quantities on the displays of these instruments.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Quantity {
    Off,
    Z,
    Y,
    PhaseDeg,
    PhaseRad,
    AdmittancePhaseDeg,
    AdmittancePhaseRad,
    Rs,
    Rp,
    X,
    G,
    B,
    Cs,
    Cp,
    Ls,
    Lp,
    D,
    Q,
}

impl Quantity {
    /// The value for an impedance at a frequency, in SI units and degrees.
    pub(crate) fn of(self, impedance_ohm: Complex64, frequency_hz: f64) -> f64 {
        let omega = std::f64::consts::TAU * frequency_hz;
        let admittance = impedance_ohm.inv();
        match self {
            Self::Off => 0.0,
            Self::Z => impedance_ohm.norm(),
            Self::Y => admittance.norm(),
            Self::PhaseDeg => impedance_ohm.arg().to_degrees(),
            Self::PhaseRad => impedance_ohm.arg(),
            Self::AdmittancePhaseDeg => admittance.arg().to_degrees(),
            Self::AdmittancePhaseRad => admittance.arg(),
            Self::Rs => impedance_ohm.re,
            Self::Rp => 1.0 / admittance.re,
            Self::X => impedance_ohm.im,
            Self::G => admittance.re,
            Self::B => admittance.im,
            Self::Cs => -1.0 / (omega * impedance_ohm.im),
            Self::Cp => admittance.im / omega,
            Self::Ls => impedance_ohm.im / omega,
            Self::Lp => -1.0 / (omega * admittance.im),
            Self::D => impedance_ohm.re / impedance_ohm.im.abs(),
            Self::Q => impedance_ohm.im.abs() / impedance_ohm.re,
        }
    }
}

/// Rounds to a multiple of a decimal step, to the float that is nearest to the decimal.
pub(crate) fn round_step(value: f64, step: f64) -> f64 {
    let per_unit = (1.0 / step).round();
    if per_unit >= 1.0 {
        (value * per_unit).round() / per_unit
    } else {
        (value / step).round() * step
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_quantities_agree_with_each_other() {
        let impedance = Complex64::new(3.0, -4.0);
        let value = |quantity: Quantity| quantity.of(impedance, 1.0 / std::f64::consts::TAU);
        let rows = [
            (Quantity::Off, 0.0),
            (Quantity::Z, 5.0),
            (Quantity::PhaseDeg, -53.130_102_354_155_98),
            (Quantity::PhaseRad, -0.927_295_218_001_612_2),
            (Quantity::AdmittancePhaseDeg, 53.130_102_354_155_98),
            (Quantity::AdmittancePhaseRad, 0.927_295_218_001_612_2),
            (Quantity::Y, 0.2),
            (Quantity::Rs, 3.0),
            (Quantity::X, -4.0),
            (Quantity::Cs, 0.25),
            (Quantity::G, 0.12),
            (Quantity::B, 0.16),
            (Quantity::Rp, 25.0 / 3.0),
            (Quantity::Cp, 0.16),
            (Quantity::Ls, -4.0),
            (Quantity::Lp, -6.25),
            (Quantity::D, 0.75),
            (Quantity::Q, 4.0 / 3.0),
        ];
        for (quantity, expected) in rows {
            assert!((value(quantity) - expected).abs() < 1e-12, "{quantity:?}");
        }
    }

    #[test]
    fn decimals_are_rounded_to_the_nearest_float() {
        for (value, step, rounded) in
            [(139.998, 0.01, 140.0), (140.406, 0.01, 140.41), (0.1 + 0.2, 1e-3, 0.3)]
        {
            assert_eq!(round_step(value, step), rounded);
        }
        assert_eq!(round_step(123_456.0, 10.0), 123_460.0);
    }
}
