//! Definitions of the resonance of a circuit, and their distances from the series resonance.

use num_complex::Complex64;

use crate::Circuit;

/// A definition of the resonance.
///
/// Only the series resonance is independent of the damping. With every other definition a change of
/// damping appears as a change of stiffness.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Definition {
    /// The series resonance 1/(2π√(L1 C1)).
    SeriesResonance,
    /// The local minimum of the magnitude of the impedance.
    MagnitudeMinimum,
    /// The local maximum of the magnitude of the impedance, the antiresonance.
    MagnitudeMaximum,
    /// The lower of the two frequencies at which the impedance is real.
    PhaseZero,
    /// The maximum of the phase of the impedance.
    PhaseMaximum,
    /// The local maximum of the conductance.
    ConductanceMaximum,
}

/// Steps of the search for a sign change, in half linewidths near the resonance. A maximum and a
/// minimum closer together than this are not found.
const STEP: f64 = 0.02;
/// Start of the search relative to the series resonance.
const LOWEST: f64 = 0.05;
/// End of the search relative to the parallel resonance.
const HIGHEST: f64 = 4.0;

impl Definition {
    /// All definitions.
    pub const ALL: [Self; 6] = [
        Self::SeriesResonance,
        Self::MagnitudeMinimum,
        Self::MagnitudeMaximum,
        Self::PhaseZero,
        Self::PhaseMaximum,
        Self::ConductanceMaximum,
    ];

    /// The name in results and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::SeriesResonance => "series resonance",
            Self::MagnitudeMinimum => "impedance minimum",
            Self::MagnitudeMaximum => "impedance maximum",
            Self::PhaseZero => "zero phase",
            Self::PhaseMaximum => "phase maximum",
            Self::ConductanceMaximum => "conductance maximum",
        }
    }

    /// The frequency of this definition in a circuit, Hz; `None` if the circuit has none. A zero phase
    /// requires a figure of merit of at least 2 + 1/Q.
    pub fn frequency_hz(self, circuit: &Circuit) -> Option<f64> {
        let slope = Slope::of(circuit);
        let u = match self {
            Self::SeriesResonance => Some(1.0),
            Self::MagnitudeMinimum => slope.first(false, |by| by.logarithm.re),
            Self::MagnitudeMaximum => slope.first(true, |by| by.logarithm.re),
            Self::PhaseZero => slope.zero_phase(),
            // The phase of the impedance is minus that of the admittance.
            Self::PhaseMaximum => slope.first(true, |by| by.logarithm.im),
            Self::ConductanceMaximum => slope.first(false, |by| by.admittance.re),
        }?;
        Some(u * circuit.resonance_hz)
    }

    /// The frequency of this definition minus the series resonance, Hz.
    pub fn bias_hz(self, circuit: &Circuit) -> Option<f64> {
        self.frequency_hz(circuit).map(|frequency_hz| frequency_hz - circuit.resonance_hz)
    }
}

/// A circuit in units of its series resonance and its static capacitance.
#[derive(Debug, Clone, Copy)]
struct Slope {
    q: f64,
    /// Capacitance ratio C1/C0.
    ratio: f64,
    loss_tangent: f64,
}

/// Derivatives with respect to the frequency.
#[derive(Debug, Clone, Copy)]
struct FrequencyDerivatives {
    admittance: Complex64,
    /// Derivative of the logarithm of the admittance.
    logarithm: Complex64,
}

impl Slope {
    fn of(circuit: &Circuit) -> Self {
        let Circuit { q, c0_farad, c1_farad, loss_tangent, .. } = *circuit;
        Self { q, ratio: c1_farad / c0_farad, loss_tangent }
    }

    /// The derivatives at u = f/fs, where Y = ju·((1 − j tan δ) + m/(1 − u² + ju/Q)).
    fn at(&self, u: f64) -> FrequencyDerivatives {
        let i = Complex64::I;
        let response = 1.0 / Complex64::new(1.0 - u * u, u / self.q);
        let by_u = -response * response * Complex64::new(-2.0 * u, 1.0 / self.q);
        let capacitance = Complex64::new(1.0, -self.loss_tangent) + self.ratio * response;
        let admittance = i * (capacitance + u * self.ratio * by_u);
        FrequencyDerivatives { admittance, logarithm: admittance / (i * u * capacitance) }
    }

    /// The first u at which this derivative crosses zero, rising or falling.
    fn first(
        &self,
        is_rising: bool,
        derivative: impl Fn(&FrequencyDerivatives) -> f64,
    ) -> Option<f64> {
        let value = |u: f64| {
            let value = derivative(&self.at(u));
            if is_rising { value } else { -value }
        };
        // The steps are fine within the linewidth and increasingly coarse outside.
        let linewidths = |u: f64| (2.0 * self.q * (u - 1.0)).asinh();
        let frequency = |t: f64| 1.0 + t.sinh() / (2.0 * self.q);
        let (from, to) = (linewidths(LOWEST), linewidths(HIGHEST * (1.0 + self.ratio).sqrt()));
        let mut t = from;
        while t < to {
            let next = t + STEP;
            if value(frequency(t)) < 0.0 && value(frequency(next)) >= 0.0 {
                return Some(root(frequency(t), frequency(next), value));
            }
            t = next;
        }
        None
    }

    /// The lower root of |D|² + m(1 − u²) = 0, in which Im Y is zero: with a = u² − 1,
    /// a² − (m − 1/Q²)a + 1/Q² = 0.
    fn zero_phase(&self) -> Option<f64> {
        let damping = 1.0 / (self.q * self.q);
        let half = 0.5 * (self.ratio - damping);
        let squared = half * half - damping;
        // The product of the roots avoids the cancellation in their difference.
        (half > 0.0 && squared >= 0.0).then(|| (1.0 + damping / (half + squared.sqrt())).sqrt())
    }
}

/// The zero of a function that is negative at `low` and not negative at `high`.
fn root(mut low: f64, mut high: f64, value: impl Fn(f64) -> f64) -> f64 {
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return middle;
        }
        if value(middle) < 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn circuit(q: f64, k_eff_squared: f64) -> Circuit {
        let c1_farad = 27e-9 * k_eff_squared / (1.0 - k_eff_squared);
        Circuit { resonance_hz: 140.0, q, c0_farad: 27e-9, c1_farad, loss_tangent: 0.0 }
    }

    /// Biases of a resonance at 140 Hz, mHz, computed by dense sampling in another program.
    const BIASES: [(f64, f64, [Option<f64>; 4]); 24] = [
        (0.02, 100.0, [Some(-284.0), Some(1702.0), Some(586.0), Some(709.0)]),
        (0.02, 50.0, [Some(-836.0), Some(2244.0), None, Some(704.0)]),
        (0.02, 30.0, [Some(-1623.0), Some(3009.0), None, Some(691.0)]),
        (0.02, 20.0, [Some(-2523.0), Some(3872.0), None, Some(667.0)]),
        (0.02, 10.0, [Some(-4236.0), Some(5417.0), None, Some(537.0)]),
        (0.02, 5.0, [Some(-927.0), Some(1421.0), None, Some(14.0)]),
        (0.05, 100.0, [Some(-128.0), Some(3762.0), Some(138.0), Some(1817.0)]),
        (0.05, 50.0, [Some(-466.0), Some(4090.0), Some(651.0), Some(1812.0)]),
        (0.05, 30.0, [Some(-1098.0), Some(4699.0), None, Some(1799.0)]),
        (0.05, 20.0, [Some(-1990.0), Some(5550.0), None, Some(1775.0)]),
        (0.05, 10.0, [Some(-4452.0), Some(7822.0), None, Some(1646.0)]),
        (0.05, 5.0, [Some(-6739.0), Some(9465.0), None, Some(1127.0)]),
        (0.1, 100.0, [Some(-62.0), Some(7632.0), Some(63.0), Some(3785.0)]),
        (0.1, 50.0, [Some(-243.0), Some(7803.0), Some(261.0), Some(3780.0)]),
        (0.1, 30.0, [Some(-636.0), Some(8174.0), Some(785.0), Some(3768.0)]),
        (0.1, 20.0, [Some(-1298.0), Some(8794.0), Some(2299.0), Some(3744.0)]),
        (0.1, 10.0, [Some(-3685.0), Some(10974.0), None, Some(3616.0)]),
        (0.1, 5.0, [Some(-7569.0), Some(14191.0), None, Some(3105.0)]),
        (0.2, 100.0, [Some(-28.0), Some(16550.0), Some(28.0), Some(8261.0)]),
        (0.2, 50.0, [Some(-111.0), Some(16624.0), Some(112.0), Some(8256.0)]),
        (0.2, 30.0, [Some(-303.0), Some(16796.0), Some(317.0), Some(8244.0)]),
        (0.2, 20.0, [Some(-663.0), Some(17115.0), Some(736.0), Some(8221.0)]),
        (0.2, 10.0, [Some(-2311.0), Some(18558.0), Some(3707.0), Some(8097.0)]),
        (0.2, 5.0, [Some(-6387.0), Some(21929.0), None, Some(7601.0)]),
    ];

    #[test]
    fn biases_are_those_of_dense_sampling() {
        let order = [
            Definition::MagnitudeMinimum,
            Definition::MagnitudeMaximum,
            Definition::PhaseZero,
            Definition::PhaseMaximum,
        ];
        for (k_eff_squared, q, expected) in BIASES {
            let circuit = circuit(q, k_eff_squared);
            for (definition, expected) in order.into_iter().zip(expected) {
                let found = definition.bias_hz(&circuit).map(|hz| 1e3 * hz);
                let is_same = match (found, expected) {
                    (Some(found), Some(expected)) => (found - expected).abs() < 1.0,
                    (found, expected) => found == expected,
                };
                assert!(is_same, "{definition:?}, Q {q}, k² {k_eff_squared}: {found:?}");
            }
            for unbiased in [Definition::ConductanceMaximum, Definition::SeriesResonance] {
                let found = unbiased.bias_hz(&circuit).unwrap();
                assert!(found.abs() < 1e-9, "{unbiased:?}, Q {q}: {found}");
            }
        }
    }

    #[test]
    fn zero_phase_is_where_the_impedance_is_real_and_ends_at_two_and_one_over_q() {
        for q in [5.0, 30.0, 1e4] {
            for (merit, exists) in [(1.99, false), (2.0 + 0.99 / q, false), (2.0 + 1.01 / q, true)]
            {
                let ratio = merit / q;
                let circuit = Circuit { loss_tangent: 0.02, ..circuit(q, ratio / (1.0 + ratio)) };
                let found = Definition::PhaseZero.frequency_hz(&circuit);
                assert_eq!(found.is_some(), exists, "Q {q}, M {merit}");
                if let Some(frequency_hz) = found {
                    let phase = circuit.impedance_ohm(frequency_hz).arg();
                    assert!(phase.abs() < 1e-9, "Q {q}, M {merit}: {phase}");
                }
            }
        }
    }

    #[test]
    fn extremes_are_above_or_below_their_neighbours_also_with_loss() {
        let circuit = Circuit { loss_tangent: 0.02, ..circuit(10.0, 0.02) };
        let check = |definition: Definition, value: &dyn Fn(Complex64) -> f64| {
            let peak_hz = definition.frequency_hz(&circuit).unwrap();
            let at = |hz: f64| value(circuit.impedance_ohm(hz));
            for aside_hz in [-0.1, 0.1] {
                assert!(at(peak_hz) > at(peak_hz + aside_hz), "{definition:?} at {peak_hz} Hz");
            }
            definition.bias_hz(&circuit).unwrap()
        };
        check(Definition::MagnitudeMinimum, &|z| -z.norm());
        check(Definition::MagnitudeMaximum, &|z| z.norm());
        check(Definition::PhaseMaximum, &|z| z.arg());
        // Loss adds a conductance that increases with frequency.
        let conductance = check(Definition::ConductanceMaximum, &|z| (1.0 / z).re);
        assert!((0.0171..0.0172).contains(&conductance), "{conductance}");
    }

    #[test]
    fn a_circuit_that_hardly_resonates_has_no_extremes() {
        let circuit = circuit(5.0, 0.01);
        for definition in [Definition::MagnitudeMinimum, Definition::MagnitudeMaximum] {
            assert_eq!(definition.frequency_hz(&circuit), None);
        }
        // Its conductance is still largest at the series resonance.
        assert!(Definition::ConductanceMaximum.bias_hz(&circuit).unwrap().abs() < 1e-9);
    }
}
