//! The cases: sensors and noise of the comparison.

use std::fmt;

use rig_contact::Circuit;

use crate::analyzer::sensor;

/// A sensor with the noise of the analyzer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Case {
    pub(super) q: f64,
    /// The effective coupling factor squared.
    pub(super) coupling: f64,
    /// Standard deviation of each part of the relative error of a reading of ten cycles.
    pub(super) noise: f64,
}

pub(super) const QUALITIES: [f64; 3] = [10.0, 30.0, 100.0];
pub(super) const COUPLINGS: [f64; 2] = [0.02, 0.1];
pub(super) const NOISES: [f64; 3] = [0.001, 0.005, 0.02];
/// The noise of the goals.
pub(super) const NOISE: f64 = 0.005;
/// Range of the resonance, Hz. Each trial draws its own, so that no position on a grid is favoured.
pub(super) const RESONANCES_HZ: (f64, f64) = (130.0, 150.0);

impl Case {
    /// All cases, by noise, quality factor and coupling.
    pub(super) fn all() -> Vec<Self> {
        let of = |noise| {
            QUALITIES.into_iter().flat_map(move |q| {
                COUPLINGS.into_iter().map(move |coupling| Self { q, coupling, noise })
            })
        };
        NOISES.into_iter().flat_map(of).collect()
    }

    /// The sensor with its resonance in the middle.
    pub(super) fn middle(&self) -> Circuit {
        sensor(140.0, self.q, self.coupling)
    }

    /// The name in files: `q30-k0.1-n0.5`, with the noise in percent.
    pub(super) fn file(&self) -> String {
        let Self { q, coupling, noise } = self;
        format!("q{q}-k{coupling}-n{}", 100.0 * noise)
    }

    /// A unique number for random streams, below 2⁴⁴.
    pub(super) fn number(&self) -> u64 {
        let whole = |value: f64, places: u32| {
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "small positive numbers with few decimals"
            )]
            let whole = (value * 10_f64.powi(places.cast_signed())).round() as u64;
            whole
        };
        whole(self.q, 1) | whole(self.coupling, 4) << 14 | whole(self.noise, 5) << 28
    }
}

impl fmt::Display for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { q, coupling, noise } = self;
        write!(f, "Q {q}, k² {coupling}, noise {} %", 100.0 * noise)
    }
}
