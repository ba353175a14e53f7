//! Read-outs of a resonance from an impedance curve.

use num_complex::Complex64;

/// A definition of the resonance frequency.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ReadOut {
    /// The greatest conductance.
    Conductance,
    /// The least magnitude of impedance.
    LeastImpedance,
    /// The greatest magnitude of impedance: the parallel resonance, roughly.
    GreatestImpedance,
    /// The lower of the two frequencies at which the phase is zero.
    ZeroPhase,
}

impl ReadOut {
    pub(crate) const ALL: [Self; 4] =
        [Self::Conductance, Self::LeastImpedance, Self::GreatestImpedance, Self::ZeroPhase];

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Conductance => "conductance peak",
            Self::LeastImpedance => "least impedance",
            Self::GreatestImpedance => "greatest impedance",
            Self::ZeroPhase => "zero phase",
        }
    }

    /// The frequency by this definition on an admittance curve around `near_hz`; `None` if the
    /// curve has no such frequency.
    pub(crate) fn read_hz(
        self,
        near_hz: f64,
        admittance_s: impl Fn(f64) -> Complex64,
    ) -> Option<f64> {
        // The capacitor's slope hides the turning points of a weak resonance; the window ends
        // before the slope dominates.
        let from = near_hz * (1.0 - WINDOW);
        let at = |index: u32| from + 2.0 * WINDOW * near_hz * f64::from(index) / f64::from(POINTS);
        let value = |frequency: f64| {
            let y = admittance_s(frequency);
            match self {
                Self::Conductance => y.re,
                Self::LeastImpedance => y.norm(),
                Self::GreatestImpedance => -y.norm(),
                Self::ZeroPhase => -y.im,
            }
        };
        if self == Self::ZeroPhase {
            let crossing =
                (0..POINTS).find(|&index| value(at(index)) <= 0.0 && value(at(index + 1)) > 0.0)?;
            return Some(bisect(at(crossing), at(crossing + 1), value));
        }
        // A true turning point, not the end of the window.
        let peak = (1..POINTS).filter(|&index| {
            let here = value(at(index));
            here > value(at(index - 1)) && here >= value(at(index + 1))
        });
        let best = peak.max_by(|&a, &b| value(at(a)).total_cmp(&value(at(b))))?;
        let [left, middle, right] = [best - 1, best, best + 1].map(|index| value(at(index)));
        let bend = left - 2.0 * middle + right;
        Some(at(best) + 0.5 * (left - right) / bend * (at(best + 1) - at(best)))
    }
}

/// Half of the window relative to the resonance, and points across it.
const WINDOW: f64 = 0.12;
const POINTS: u32 = 2400;

/// The zero of a function that is at most zero at `low` and positive at `high`.
fn bisect(mut low: f64, mut high: f64, value: impl Fn(f64) -> f64) -> f64 {
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if value(middle) <= 0.0 { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use rig_contact::Circuit;

    use super::*;

    /// Around a figure of merit of two: 2.11 crosses zero phase, 1.71 does not.
    #[test]
    fn zero_phase_exists_only_for_a_strong_resonance() {
        let read = |q: f64| {
            let circuit = Circuit {
                series_resonance_hz: 140.0,
                q,
                capacitance_f: 27e-9,
                capacitance_ratio: 0.05,
                dielectric_loss: 0.0,
            };
            ReadOut::ZeroPhase.read_hz(140.0, |frequency| circuit.admittance_s(frequency))
        };
        assert!(read(2.11 / 0.05).is_some());
        assert!(read(1.71 / 0.05).is_none());
    }

    #[test]
    fn a_strong_resonance_reads_the_same_by_conductance_and_by_zero_phase() {
        let circuit = Circuit {
            series_resonance_hz: 140.0,
            q: 5000.0,
            capacitance_f: 27e-9,
            capacitance_ratio: 0.05,
            dielectric_loss: 0.0,
        };
        for read_out in [ReadOut::Conductance, ReadOut::LeastImpedance, ReadOut::ZeroPhase] {
            let found = read_out.read_hz(140.0, |frequency| circuit.admittance_s(frequency));
            assert!((found.unwrap() - 140.0).abs() < 0.02, "{read_out:?} {found:?}");
        }
        let parallel = ReadOut::GreatestImpedance.read_hz(140.0, |f| circuit.admittance_s(f));
        assert!((parallel.unwrap() - 140.0 * 1.05_f64.sqrt()).abs() < 0.02, "{parallel:?}");
    }
}
