//! The impedance from two quantities of a row.

use std::f64::consts::TAU;

use num_complex::Complex64;

use super::{fault::SweepFileFault, measured, of_admittance, of_reflection, quantity::Quantity};

/// Reference of reflections in a table, which does not state it.
const REFERENCE_OHM: f64 = 50.0;

/// The pairs of quantities that give an impedance: those of the modes of LCR meters, of impedance
/// analyzers and of network analyzers. In a file with several, the first one counts.
pub(super) const PAIRS: [[Quantity; 2]; 21] = {
    use Quantity as Q;
    [
        [Q::Resistance, Q::Reactance],
        [Q::Magnitude, Q::Phase],
        [Q::Conductance, Q::Susceptance],
        [Q::ReflectionReal, Q::ReflectionImaginary],
        [Q::ReflectionMagnitude, Q::ReflectionPhase],
        [Q::ReflectionDecibel, Q::ReflectionPhase],
        [Q::AdmittanceMagnitude, Q::AdmittancePhase],
        [Q::SeriesCapacitance, Q::Resistance],
        [Q::ParallelCapacitance, Q::Conductance],
        [Q::ParallelCapacitance, Q::ParallelResistance],
        [Q::SeriesCapacitance, Q::Dissipation],
        [Q::ParallelCapacitance, Q::Dissipation],
        [Q::SeriesCapacitance, Q::Quality],
        [Q::ParallelCapacitance, Q::Quality],
        [Q::SeriesInductance, Q::Resistance],
        [Q::ParallelInductance, Q::Conductance],
        [Q::ParallelInductance, Q::ParallelResistance],
        [Q::SeriesInductance, Q::Dissipation],
        [Q::ParallelInductance, Q::Dissipation],
        [Q::SeriesInductance, Q::Quality],
        [Q::ParallelInductance, Q::Quality],
    ]
};

/// The impedance, Ω, from a pair of [`PAIRS`] with its values `a` and `b`, at a frequency in Hz.
///
/// # Source
/// D = 1/Q = Rs/|Xs| = G/|B|: Keysight, Impedance Measurement Handbook (5950-3000), chapter 1.
pub(super) fn impedance_ohm(
    pair: [Quantity; 2],
    [a, b]: [f64; 2],
    frequency_hz: f64,
) -> Result<Complex64, SweepFileFault> {
    let omega = TAU * frequency_hz;
    let polar = || Complex64::from_polar(a, b.to_radians());
    let [stored, other] = pair;
    // Some meters print D = ω C R, which is negative if they show an inductive sample as a negative
    // capacitance. Its loss is positive.
    let loss = |factor: f64| if a < 0.0 { factor.abs() } else { factor };
    let lossy = |part: f64| match other {
        Quantity::Dissipation => loss(b) * part.abs(),
        Quantity::Quality => loss(1.0 / b) * part.abs(),
        Quantity::ParallelResistance => 1.0 / b,
        _ => b,
    };
    let series = |reactance: f64| Ok(Complex64::new(lossy(reactance), reactance));
    let parallel =
        |susceptance: f64| of_admittance(Complex64::new(lossy(susceptance), susceptance));
    let impedance = match stored {
        Quantity::Magnitude => Ok(polar()),
        Quantity::Conductance => of_admittance(Complex64::new(a, b)),
        Quantity::AdmittanceMagnitude => of_admittance(polar()),
        Quantity::SeriesCapacitance => series(-1.0 / (omega * a)),
        Quantity::ParallelCapacitance => parallel(omega * a),
        Quantity::SeriesInductance => series(omega * a),
        Quantity::ParallelInductance => parallel(-1.0 / (omega * a)),
        Quantity::ReflectionReal => Ok(REFERENCE_OHM * of_reflection(Complex64::new(a, b))?),
        Quantity::ReflectionMagnitude => Ok(REFERENCE_OHM * of_reflection(polar())?),
        Quantity::ReflectionDecibel => {
            let reflection = Complex64::from_polar(10_f64.powf(a / 20.0), b.to_radians());
            Ok(REFERENCE_OHM * of_reflection(reflection)?)
        }
        _ => Ok(Complex64::new(a, b)),
    };
    measured(impedance?)
}
