//! What was made of a sweep, for a person and for a program.

use rig_store::{Circuit, SweepVerdict};
use serde::Serialize;

use super::Failure;

/// The verdict on a sweep. What does not apply is left out.
#[derive(Debug, Default, Serialize)]
pub(super) struct VerdictView {
    /// `accepted` or `refused`.
    status: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    resonance_hz: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    sigma_hz: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    q: Option<f64>,
    /// Q times the ratio of the capacitances. Below 2 the phase does not cross zero.
    #[serde(skip_serializing_if = "Option::is_none")]
    figure_of_merit: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    static_capacitance_f: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    loss_tangent: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<String>,
}

impl VerdictView {
    /// For a person.
    pub(super) fn rows(&self) -> Vec<(&'static str, String)> {
        let (Some(resonance_hz), Some(sigma_hz)) = (self.resonance_hz, self.sigma_hz) else {
            return vec![("resonance", self.status.to_owned())];
        };
        let mut rows = vec![("resonance", format!("{resonance_hz:.4} Hz ± {sigma_hz:.4} Hz"))];
        rows.extend(self.q.map(|q| ("Q", format!("{q:.1}"))));
        rows.extend(self.figure_of_merit.map(|merit| ("figure of merit", format!("{merit:.2}"))));
        let nanofarad = self.static_capacitance_f.map(|farad| farad * 1e9);
        rows.extend(nanofarad.map(|value| ("static capacitance", format!("{value:.3} nF"))));
        rows
    }

    /// That there is no resonance, as the end of the command.
    pub(super) fn refusal(&self) -> Option<Failure> {
        self.reason.clone().map(|reason| Failure::NoResonance { reason })
    }
}

impl From<&SweepVerdict> for VerdictView {
    fn from(verdict: &SweepVerdict) -> Self {
        match verdict {
            SweepVerdict::Accepted { resonance_hz, sigma_hz, circuit } => {
                let of = |value: fn(&Circuit) -> f64| circuit.as_ref().map(value);
                Self {
                    status: "accepted",
                    resonance_hz: Some(*resonance_hz),
                    sigma_hz: Some(*sigma_hz),
                    q: of(|circuit| circuit.quality_factor),
                    figure_of_merit: of(|circuit| {
                        circuit.quality_factor * circuit.capacitance_ratio
                    }),
                    static_capacitance_f: of(|circuit| circuit.static_capacitance_f),
                    loss_tangent: of(|circuit| circuit.loss_tangent),
                    reason: None,
                }
            }
            SweepVerdict::Refused { reason } => {
                Self { status: "refused", reason: Some(reason.clone()), ..Self::default() }
            }
        }
    }
}
