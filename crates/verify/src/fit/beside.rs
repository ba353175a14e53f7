//! What readings can show beside the circuit: settled ones a drift, an impedance in series, a second resonance, a
//! static capacitance that changes with the frequency, or a phase error of the analyzer; those with a free decay a
//! drift or a relaxation.

use std::f64::consts::TAU;

use num_complex::Complex64;

use super::trace::BESIDE;
use crate::record::{Circuit, Extra};

/// How a resonance moves from the begin of a sweep, 0, to its end, 1.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::struct_field_names, reason = "all are times, in seconds")]
pub(super) struct Course {
    pub(super) span_s: f64,
    /// Time constant of its approach to a final value, s; infinite if it moves evenly.
    pub(super) time_s: f64,
    /// The time for which it is stated, s after the begin.
    pub(super) stated_s: f64,
}

impl Course {
    /// A resonance that rises by one in a second.
    pub(super) const EVEN: Self = Self { span_s: 1.0, time_s: f64::INFINITY, stated_s: 0.0 };

    /// The part of its change that is done at this time.
    pub(super) fn done(&self, s: f64) -> f64 {
        if self.time_s.is_finite() {
            (1.0 - (-s / self.time_s).exp()) / self.all()
        } else {
            s / self.span_s
        }
    }

    /// The part of an exponential approach that happens during the sweep.
    fn all(&self) -> f64 {
        1.0 - (-self.span_s / self.time_s).exp()
    }
}

/// The kind of what is beside the circuit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Beside {
    /// The change of the logarithm of the resonance during the sweep.
    Moving(Course),
    /// The change of the resonance from the middle of the sweep to its end, as a part of it.
    Drift,
    /// Resistance and inductance in series.
    Stray,
    /// The logarithms of its frequency and quality factor, and its capacitance.
    SecondMode,
    /// The slope of C0 by the logarithm of the frequency.
    Dispersion,
    /// The phase error, rad.
    Phase,
}

/// A reading in its sweep, and the circuit's part in it.
pub(super) struct Place {
    pub(super) omega: f64,
    /// From −1 at the first reading to 1 at the last.
    pub(super) when: f64,
    /// Impedance times the unit of capacitance, s.
    pub(super) z: Complex64,
    /// The angular frequency of the resonance.
    pub(super) resonance: f64,
    /// The slope of the admittance by the logarithm of the resonance.
    pub(super) by_f: Complex64,
    /// That by the change of a moving resonance.
    pub(super) by_change: Complex64,
}

/// The admittance with what is beside the circuit, the impedance without it, and slopes.
pub(super) struct Seen {
    pub(super) z: Complex64,
    /// What it adds to the admittance.
    pub(super) y: Complex64,
    /// Slopes of the admittance by its unknowns.
    pub(super) y_by: [Complex64; BESIDE],
    /// Slopes of the impedance by its unknowns.
    pub(super) z_by: [Complex64; BESIDE],
    /// What it adds to the slope of the admittance by the logarithm of the resonance.
    pub(super) by_f: Complex64,
}

impl Beside {
    /// What a fit with free decay can have beside the circuit, with its unknown.
    pub(super) fn of_ringing(stated: &Extra, course: Course) -> Option<(Self, [f64; BESIDE])> {
        match *stated {
            // From the middle to the end.
            Extra::Drift { change } => Some((Self::Moving(course), [2.0 * change, 0.0, 0.0])),
            Extra::Relaxation { change, time_s } => {
                Some((Self::Moving(Course { time_s, ..course }), [change, 0.0, 0.0]))
            }
            _ => None,
        }
    }

    /// The kind in settled readings, and its unknowns in units of the capacitance `unit`.
    pub(super) fn of(
        stated: &Extra,
        circuit: &Circuit,
        unit: f64,
    ) -> Option<(Self, [f64; BESIDE])> {
        let c0 = circuit.static_capacitance_f / unit;
        Some(match *stated {
            Extra::Relaxation { .. } => return None,
            Extra::Drift { change } => (Self::Drift, [change, 0.0, 0.0]),
            Extra::Stray { resistance_ohm, inductance_h } => {
                (Self::Stray, [resistance_ohm * unit, inductance_h * unit, 0.0])
            }
            Extra::SecondMode { resonance_hz, quality_factor, capacitance_f } => {
                let unknowns = [resonance_hz.ln(), quality_factor.ln(), capacitance_f / unit];
                (Self::SecondMode, unknowns)
            }
            Extra::Dispersion { slope } => (Self::Dispersion, [slope * c0, 0.0, 0.0]),
            Extra::AnalyzerPhase { phase_rad } => (Self::Phase, [phase_rad, 0.0, 0.0]),
        })
    }

    /// The number of its unknowns.
    pub(super) const fn count(self) -> usize {
        match self {
            Self::Moving(_) | Self::Drift | Self::Dispersion | Self::Phase => 1,
            Self::Stray => 2,
            Self::SecondMode => 3,
        }
    }

    /// The logarithm of the resonance at a settled reading less that of the circuit.
    pub(super) fn ln_shift(self, unknowns: &[f64; BESIDE], when: f64) -> f64 {
        match self {
            Self::Drift => (unknowns[0] * when).ln_1p(),
            _ => 0.0,
        }
    }
}

/// A reading with these unknowns.
pub(super) fn seen(kind: Option<Beside>, unknowns: &[f64; BESIDE], at: &Place) -> Seen {
    let zero = [Complex64::ZERO; BESIDE];
    let drive = Complex64::new(0.0, at.omega);
    let mut seen =
        Seen { z: at.z, y: Complex64::ZERO, y_by: zero, z_by: zero, by_f: Complex64::ZERO };
    let [a, b, c] = *unknowns;
    match kind {
        None => {}
        Some(Beside::Moving(_)) => seen.y_by[0] = at.by_change,
        Some(Beside::Drift) => seen.y_by[0] = at.by_f * (at.when / (1.0 + a * at.when)),
        Some(Beside::Stray) => {
            seen.z -= a + b * drive;
            (seen.z_by[0], seen.z_by[1]) = (-Complex64::ONE, -drive);
        }
        Some(Beside::SecondMode) => {
            let (u, q) = (at.omega / (TAU * a.exp()), b.exp());
            let response = Complex64::new(1.0 - u * u, u / q).inv();
            seen.y = c * drive * response;
            let by = -seen.y * response;
            seen.y_by = [
                by * Complex64::new(2.0 * u * u, -u / q),
                by * Complex64::new(0.0, -u / q),
                drive * response,
            ];
        }
        Some(Beside::Dispersion) => {
            let folds = (at.omega / at.resonance).ln();
            seen.y = a * folds * drive;
            seen.y_by[0] = folds * drive;
            seen.by_f = -a * drive;
        }
        Some(Beside::Phase) => {
            seen.z *= Complex64::cis(-a);
            seen.z_by[0] = -Complex64::I * seen.z;
        }
    }
    seen
}
