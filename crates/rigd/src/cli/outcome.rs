//! The outcome of a sweep, for a person and for a program.

use rig_resonance::{FitOutcome, Reason, Resonance};
use rig_store::{Circuit, SweepOutcome};
use serde::Serialize;

use super::Failure;

/// The outcome of a sweep. Keys that do not apply are left out.
#[derive(Debug, Default, Serialize)]
pub(super) struct OutcomeView {
    /// `accepted` or `refused`.
    status: &'static str,
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    accepted: Option<FoundView>,
    /// For a program where `message` is there for a person; else the message itself, which is all
    /// that a journal keeps.
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    message: Option<String>,
    /// Side of the window on which the resonance is likely to be.
    #[serde(skip_serializing_if = "Option::is_none")]
    side: Option<String>,
    /// The best that could be made of refused readings; no result.
    #[serde(skip_serializing_if = "Option::is_none")]
    estimate: Option<FoundView>,
}

/// A resonance with its uncertainty and its circuit.
#[derive(Debug, Default, Serialize)]
struct FoundView {
    resonance_hz: f64,
    sigma_hz: f64,
    /// The time for which it holds, s on the clock of the readings.
    #[serde(skip_serializing_if = "Option::is_none")]
    effective_time_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    q: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    q_sigma: Option<f64>,
    /// Q times the ratio of the capacitances. Below 2 the phase does not cross zero.
    #[serde(skip_serializing_if = "Option::is_none")]
    figure_of_merit: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    k_eff_squared: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    k_eff_squared_sigma: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    static_capacitance_f: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    static_capacitance_sigma_f: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    loss_tangent: Option<f64>,
    /// None where the loss was not fitted.
    #[serde(skip_serializing_if = "Option::is_none")]
    loss_tangent_sigma: Option<f64>,
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    fit: Option<FitView>,
}

/// The goodness of fit.
#[derive(Debug, Serialize)]
struct FitView {
    model_order: &'static str,
    points: usize,
    chi_squared_per_dof: f64,
    /// Relative, of each part of a reading of ten cycles.
    noise_at_ten_cycles: f64,
    condition: f64,
}

impl OutcomeView {
    /// Adds the time for which an accepted resonance holds, s on the clock of the readings.
    pub(super) fn at(mut self, effective_time_s: Option<f64>) -> Self {
        if let Some(found) = &mut self.accepted {
            found.effective_time_s = effective_time_s;
        }
        self
    }

    /// For a person.
    pub(super) fn rows(&self) -> Vec<(&'static str, String)> {
        match (&self.accepted, &self.estimate) {
            (Some(found), _) => found.rows("resonance", ""),
            (None, Some(estimate)) => {
                let mut rows = vec![("resonance", self.status.to_owned())];
                rows.extend(estimate.rows("estimate", ", not reliable"));
                rows
            }
            (None, None) => vec![("resonance", self.status.to_owned())],
        }
    }

    /// In a table: the resonance, its standard deviation and the quality factor.
    pub(super) fn cells(&self) -> [String; 3] {
        let Some(found) = &self.accepted else {
            return [self.status.to_owned(), String::new(), String::new()];
        };
        let FoundView { resonance_hz, sigma_hz, q, .. } = found;
        let digits = found.digits();
        let of = |hz: &f64| format!("{hz:.digits$}");
        [of(resonance_hz), of(sigma_hz), q.map_or_else(String::new, |q| format!("{q:.1}"))]
    }

    /// The reason of a refusal as a word, or as a sentence if the journal has no word.
    pub(super) fn reason(&self) -> Option<&str> {
        self.reason.as_deref()
    }

    /// That there is no resonance, as the end of the command.
    pub(super) fn refusal(&self) -> Option<Failure> {
        let reason = self.message.as_ref().or(self.reason.as_ref());
        reason.map(|reason| Failure::NoResonance { reason: reason.clone() })
    }
}

impl FoundView {
    /// Number of decimals of a resonance.
    fn digits(&self) -> usize {
        decimals(self.sigma_hz)
    }

    fn rows(&self, name: &'static str, comment: &str) -> Vec<(&'static str, String)> {
        let Self { resonance_hz, sigma_hz, .. } = self;
        let digits = self.digits();
        let resonance = format!("{resonance_hz:.digits$} Hz ± {sigma_hz:.digits$} Hz{comment}");
        let mut rows = vec![(name, resonance)];
        rows.extend(
            self.effective_time_s
                .map(|effective_time_s| ("at the time", format!("{effective_time_s:.3} s"))),
        );
        let mut row = |name, value: Option<f64>, sigma: Option<f64>, digits: usize| {
            rows.extend(value.map(|value| (name, with_sigma(value, sigma, digits))));
        };
        row("Q", self.q, self.q_sigma, 1);
        row("figure of merit", self.figure_of_merit, None, 2);
        row("coupling k_eff²", self.k_eff_squared, self.k_eff_squared_sigma, 5);
        row("loss tangent", self.loss_tangent, self.loss_tangent_sigma, 4);
        rows.extend(self.static_capacitance_f.map(|farad| {
            let capacitance = capacitance(farad, self.static_capacitance_sigma_f);
            ("static capacitance", capacitance)
        }));
        if let Some(fit) = &self.fit {
            rows.push(("model", fit.model_order.to_owned()));
            rows.push(("readings used", fit.points.to_string()));
            rows.push(("chi² per degree", format!("{:.2}", fit.chi_squared_per_dof)));
            rows.push(("noise", format!("{:.3} %", 100.0 * fit.noise_at_ten_cycles)));
        }
        rows
    }
}

/// A capacitance with its standard deviation, F.
fn capacitance(farad: f64, sigma_farad: Option<f64>) -> String {
    let (unit, in_unit, digits) = if farad < 1e-9 { ("pF", 1e12, 4) } else { ("nF", 1e9, 3) };
    let sigma = sigma_farad.map(|sigma| sigma * in_unit);
    format!("{} {unit}", with_sigma(farad * in_unit, sigma, digits))
}

/// A value with its standard deviation, both to two digits of the latter. One without has `digits` decimals.
fn with_sigma(value: f64, sigma: Option<f64>, digits: usize) -> String {
    match sigma.filter(|sigma| *sigma > 0.0) {
        Some(sigma) => {
            let digits = decimals(sigma);
            format!("{value:.digits$} ± {sigma:.digits$}")
        }
        None => format!("{value:.digits$}"),
    }
}

/// Number of decimals of a standard deviation with two digits.
fn decimals(sigma: f64) -> usize {
    let is_short = |digits: &i32| sigma * 10_f64.powi(*digits) < 10.0;
    (0..12).take_while(is_short).count()
}

fn k_eff_squared(circuit: &Circuit) -> f64 {
    circuit.capacitance_ratio / (1.0 + circuit.capacitance_ratio)
}

/// Standard deviation of k² = m/(1 + m) from that of m, the ratio of the capacitances: dk²/dm = (1 − k²)².
fn k_eff_squared_sigma(k_eff_squared: f64, ratio_sigma: f64) -> f64 {
    (1.0 - k_eff_squared).powi(2) * ratio_sigma
}

impl From<&Resonance> for FoundView {
    fn from(found: &Resonance) -> Self {
        Self {
            resonance_hz: found.resonance_hz,
            sigma_hz: found.sigma_hz,
            effective_time_s: None,
            q: Some(found.q),
            q_sigma: Some(found.q_sigma()),
            figure_of_merit: Some(found.figure_of_merit),
            k_eff_squared: Some(found.k_eff_squared),
            k_eff_squared_sigma: Some(k_eff_squared_sigma(
                found.k_eff_squared,
                found.capacitance_ratio_sigma(),
            )),
            static_capacitance_f: Some(found.c0_farad),
            static_capacitance_sigma_f: Some(found.c0_sigma_farad()),
            loss_tangent: Some(found.loss_tangent),
            loss_tangent_sigma: found.loss_tangent_sigma(),
            fit: Some(FitView {
                model_order: found.model_order.name(),
                points: found.points,
                chi_squared_per_dof: found.chi_squared_per_dof,
                noise_at_ten_cycles: found.noise_at_ten_cycles,
                condition: found.condition,
            }),
        }
    }
}

impl From<&FitOutcome> for OutcomeView {
    fn from(outcome: &FitOutcome) -> Self {
        match outcome {
            FitOutcome::Accepted(found) => {
                Self { status: "accepted", accepted: Some(found.into()), ..Self::default() }
            }
            FitOutcome::Refused(refusal) => Self {
                status: "refused",
                reason: Some(refusal.reason.code().to_owned()),
                message: Some(refusal.reason.to_string()),
                side: match refusal.reason {
                    Reason::OutsideWindow { side, .. } => Some(side.to_string()),
                    _ => None,
                },
                estimate: refusal.estimate.as_ref().map(FoundView::from),
                ..Self::default()
            },
        }
    }
}

impl From<&SweepOutcome> for OutcomeView {
    fn from(outcome: &SweepOutcome) -> Self {
        match outcome {
            SweepOutcome::Accepted {
                resonance_hz, sigma_hz, effective_time_s, circuit, ..
            } => {
                let of = |value: fn(&Circuit) -> f64| circuit.as_ref().map(value);
                let sigma_of =
                    |sigma: fn(&Circuit) -> Option<f64>| circuit.as_ref().and_then(sigma);
                let found = FoundView {
                    resonance_hz: *resonance_hz,
                    sigma_hz: *sigma_hz,
                    effective_time_s: *effective_time_s,
                    q: of(|circuit| circuit.quality_factor),
                    q_sigma: sigma_of(|circuit| circuit.quality_factor_sigma),
                    figure_of_merit: of(|circuit| {
                        circuit.quality_factor * circuit.capacitance_ratio
                    }),
                    k_eff_squared: of(k_eff_squared),
                    k_eff_squared_sigma: sigma_of(|circuit| {
                        let ratio_sigma = circuit.capacitance_ratio_sigma?;
                        Some(k_eff_squared_sigma(k_eff_squared(circuit), ratio_sigma))
                    }),
                    static_capacitance_f: of(|circuit| circuit.static_capacitance_f),
                    static_capacitance_sigma_f: sigma_of(|circuit| {
                        circuit.static_capacitance_sigma_f
                    }),
                    loss_tangent: of(|circuit| circuit.loss_tangent),
                    loss_tangent_sigma: sigma_of(|circuit| circuit.loss_tangent_sigma),
                    fit: None,
                };
                Self { status: "accepted", accepted: Some(found), ..Self::default() }
            }
            SweepOutcome::Refused { reason } => {
                Self { status: "refused", reason: Some(reason.clone()), ..Self::default() }
            }
        }
    }
}
