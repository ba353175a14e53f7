//! A row for every planned touch with its result.

use rig_analysis::model::Verdict;
use rig_record::{Ending, Phase, Run, RunStatus, Touch, TouchPosition};
use schemars::JsonSchema;
use serde::Serialize;

use super::{
    budget::StiffnessBudget,
    classification::Classification,
    status::{Tally, TouchStatus},
    stiffness::Stiffness,
};
use crate::data::{Outcome, PlannedTouch, RunData};

/// A planned touch with its result. The fields are an interface: scripts read them.
#[derive(Debug, Clone, Default, PartialEq, Serialize, JsonSchema)]
pub struct TouchRow {
    /// Address of the step.
    pub step: String,
    /// `main` or `blind`.
    pub phase: &'static str,
    /// Name of the sample.
    pub sample: String,
    /// `front`, `back` or `left`.
    pub direction: &'static str,
    /// The contact angle, degrees.
    pub angle_deg: f64,
    /// The repeat of this pose, or the number of the blind touch; from 1.
    pub repeat: u32,
    /// Measured, refused, skipped or not reached.
    pub status: TouchStatus,
    /// Reason why it was not measured, or why a measured touch has no stiffness.
    pub reason: Option<String>,
    /// For a measured touch, whether what was measured after it confirms it; `None` while that is awaited.
    pub is_confirmed: Option<bool>,
    /// For a measured touch, whether the surface was found again after its sweep, so that steps lost in the touch
    /// would have shown.
    pub is_slip_checked: Option<bool>,
    /// For a measured touch, whether the free resonance has not jumped between its reference and the next one, as far
    /// as there is one.
    pub is_reference_steady: Option<bool>,
    /// Number of the sweep that gave the reference.
    pub no_load_sweep: Option<u64>,
    /// Number of the sweep that gave the reference after the touch, if the value is that between both.
    pub next_no_load_sweep: Option<u64>,
    /// The reference, Hz.
    pub no_load_hz: Option<f64>,
    /// Its standard deviation, Hz.
    pub no_load_sigma_hz: Option<f64>,
    /// Standard deviation of what the free resonance has drifted since the reference, or between both, Hz.
    pub drift_sigma_hz: Option<f64>,
    /// Number of the last sweep in contact.
    pub sweep: Option<u64>,
    /// The resonance in contact, Hz.
    pub resonance_hz: Option<f64>,
    /// Its standard deviation, Hz.
    pub sigma_hz: Option<f64>,
    /// Resonance in contact less the reference, Hz.
    pub shift_hz: Option<f64>,
    /// Its standard deviation, Hz.
    pub shift_sigma_hz: Option<f64>,
    /// Where the surface was found, mm.
    pub surface_mm: Option<f64>,
    /// Its standard deviation, mm.
    pub surface_sigma_mm: Option<f64>,
    /// Depth below it along the probe, mm.
    pub indentation_mm: Option<f64>,
    /// The linear stage as read back before the sweep, mm.
    pub linear_mm: Option<f64>,
    /// The rotary stage as read back, degrees.
    pub rotary_deg: Option<f64>,
    /// Young's modulus, calibrated by the known samples, MPa. If the contact angle is
    /// unknown, that of the site of the touch.
    pub stiffness_mpa: Option<f64>,
    /// Its standard deviation, those of calibration and model included, MPa.
    pub stiffness_sigma_mpa: Option<f64>,
    /// The parts of its standard deviation by cause.
    pub budget: Option<StiffnessBudget>,
    /// Whether the model behind the stiffness holds: `holds`, `strained` or `rejected`.
    pub model_verdict: Option<&'static str>,
    /// For a main touch: the logarithm of its stiffness less that of its sample, in standard deviations.
    pub model_residual: Option<f64>,
    /// For a blind touch: the sample that its cluster represents.
    pub class: Option<String>,
    /// Known Young's modulus of the sample, MPa.
    pub known_mpa: Option<f64>,
    /// Number of attempts: more than one if it was interrupted or measured again.
    pub attempts: u32,
    /// Number of the clock on which the times of its sweeps count, from 1.
    pub clock: Option<u64>,
    /// Its last amendment: action, person and reason.
    pub amended: Option<String>,
    /// The outcomes that amendments replaced, oldest first.
    pub earlier: Option<String>,
    /// When it began: UTC, RFC 3339, on the rig's clock from the beginning of the run on.
    pub started_at: Option<String>,
}

/// Largest number of refused touches named in a sentence.
const NAMED_MAX: usize = 5;

/// `107 of 110 touches measured; 3 refused: …`, with the addresses of those, of touches that nothing confirms, and
/// of touches in which lost steps would not have shown.
pub(crate) fn sentence(rows: &[TouchRow]) -> String {
    let Tally { planned, measured, refused, skipped, not_reached } =
        Tally::of(rows.iter().map(|row| row.status));
    let mut parts = vec![format!("{measured} of {planned} touches measured")];
    let named = |count: usize, what: &str, is_meant: fn(&&TouchRow) -> bool| {
        let names = rows.iter().filter(is_meant).map(|row| row.step.as_str());
        let named = names.take(NAMED_MAX).collect::<Vec<_>>().join(", ");
        let more = match count.saturating_sub(NAMED_MAX) {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        format!("{count} {what}: {named}{more}")
    };
    let unconfirmed = rows.iter().filter(|row| row.is_unconfirmed()).count();
    if unconfirmed > 0 {
        parts.push(named(unconfirmed, "of them not confirmed", |row| row.is_unconfirmed()));
    }
    let unchecked = rows.iter().filter(|row| row.is_slip_unchecked()).count();
    if unchecked > 0 {
        parts.push(named(unchecked, "of them not checked for slip", |row| row.is_slip_unchecked()));
    }
    let jumped = rows.iter().filter(|row| row.is_reference_unsteady()).count();
    if jumped > 0 {
        let what = "of them before a jump of the no-load resonance";
        parts.push(named(jumped, what, |row| row.is_reference_unsteady()));
    }
    if refused > 0 {
        parts.push(named(refused, "refused", |row| row.status == TouchStatus::Refused));
    }
    if skipped > 0 {
        parts.push(format!("{skipped} skipped"));
    }
    if not_reached > 0 {
        parts.push(format!("{not_reached} not reached"));
    }
    parts.join("; ")
}

/// A row for every planned touch, in the order of the plan.
pub(super) fn rows(
    run: &Run,
    data: &RunData,
    stiffness: Option<&Stiffness>,
    classification: Option<&Classification>,
) -> Vec<TouchRow> {
    let row = |planned: &PlannedTouch| {
        let settings = &planned.settings;
        let sample = data.sample(&settings.sample);
        let mut row = TouchRow {
            step: settings.step.clone(),
            phase: settings.phase.name(),
            sample: settings.sample.clone(),
            direction: settings.pose.direction.name(),
            angle_deg: settings.pose.angle_deg,
            repeat: settings.repeat,
            status: planned.status(),
            known_mpa: sample.and_then(|sample| data.samples()[sample].stiffness_mpa),
            attempts: planned.attempts,
            clock: planned.clock,
            amended: planned.amendments.last().map(|last| last.amendment.clone()),
            earlier: earlier(planned),
            started_at: planned.began_at.clone(),
            ..TouchRow::default()
        };
        match &planned.outcome {
            Some(Outcome::Measured(index)) => {
                row.measured(&data.touches[*index], data, stiffness, classification);
                let confirmed = data.confirmed.touch(&row.step);
                row.is_confirmed =
                    confirmed.or((run.status != RunStatus::Running).then_some(false));
            }
            Some(Outcome::Refused(refused)) => {
                row.reason = Some(refused.reason.clone());
                row.no_load_sweep = Some(refused.no_load_sweep);
                row.no_load_hz = Some(refused.no_load_hz);
                row.no_load_sigma_hz = Some(refused.no_load_sigma_hz);
                row.rotary_deg = Some(refused.rotary_deg);
                if let Some(indented) = refused.indented {
                    row.indented(indented);
                }
            }
            Some(Outcome::Skipped(why)) => row.reason = Some(why.clone()),
            None => row.reason = Some(not_reached(run, data, planned)),
        }
        row
    };
    data.planned.iter().map(row).collect()
}

impl TouchRow {
    /// Whether it was measured, and nothing of it is marked.
    pub(crate) fn is_measured_without_doubt(&self) -> bool {
        let is_doubtful =
            self.is_unconfirmed() || self.is_slip_unchecked() || self.is_reference_unsteady();
        self.status == TouchStatus::Measured && !is_doubtful
    }

    /// Whether the run ended before anything confirmed it.
    pub(crate) fn is_unconfirmed(&self) -> bool {
        self.is_confirmed == Some(false)
    }

    /// Whether steps that the linear stage lost in it would not have shown.
    pub(crate) fn is_slip_unchecked(&self) -> bool {
        self.is_slip_checked == Some(false)
    }

    /// Whether the free resonance has jumped between its reference and the next one.
    pub(crate) fn is_reference_unsteady(&self) -> bool {
        self.is_reference_steady == Some(false)
    }

    fn measured(
        &mut self,
        touch: &Touch,
        data: &RunData,
        stiffness: Option<&Stiffness>,
        classification: Option<&Classification>,
    ) {
        self.is_reference_steady = Some(data.between.is_steady(touch.no_load_sweep));
        self.no_load_sweep = Some(touch.no_load_sweep);
        self.next_no_load_sweep = data.between.next_of(touch.sweep);
        self.no_load_hz = Some(touch.no_load_hz);
        self.no_load_sigma_hz = Some(touch.no_load_sigma_hz);
        self.drift_sigma_hz = Some(touch.drift_sigma_hz);
        self.sweep = Some(touch.sweep);
        self.resonance_hz = Some(touch.resonance_hz);
        self.sigma_hz = Some(touch.sigma_hz);
        self.shift_hz = Some(touch.shift_hz);
        self.shift_sigma_hz = Some(touch.shift_sigma_hz);
        self.surface_mm = Some(touch.surface_mm);
        self.surface_sigma_mm = Some(touch.surface_sigma_mm);
        self.indentation_mm = Some(touch.indentation_mm);
        self.linear_mm = Some(touch.linear_mm);
        self.rotary_deg = Some(touch.rotary_deg);
        self.is_slip_checked = touch.is_slip_checked;
        match stiffness.and_then(|stiffness| stiffness.of_touch(&self.step)) {
            Some(Ok(found)) => {
                let young = found.whole();
                self.budget = Some(StiffnessBudget::of(&found.budget, young.mpa));
                self.stiffness_mpa = Some(young.mpa);
                self.stiffness_sigma_mpa = Some(young.sigma_mpa);
                let verdict = stiffness.and_then(Stiffness::verdict);
                self.model_verdict = verdict.map(Verdict::name);
                self.model_residual = stiffness.and_then(|found| found.residual(&self.step));
            }
            Some(Err(error)) => self.reason = Some(format!("no stiffness: {error}")),
            None if stiffness.is_some_and(|found| !found.describes(data.part_of(touch))) => {
                let why =
                    "no stiffness: the rig file of this part of the run describes another sensor";
                self.reason = Some(why.to_owned());
            }
            None => {}
        }
        let class = classification.filter(|_| touch.touch.phase == Phase::Blind);
        let class = class.and_then(|found| found.class_of(touch.touch.repeat));
        self.class = class.map(|sample| data.samples()[sample].name.clone());
    }

    const fn indented(&mut self, indented: TouchPosition) {
        self.sweep = Some(indented.sweep);
        self.surface_mm = Some(indented.surface_mm);
        self.surface_sigma_mm = Some(indented.surface_sigma_mm);
        self.indentation_mm = Some(indented.indentation_mm);
        self.linear_mm = Some(indented.linear_mm);
    }
}

/// The outcomes that amendments replaced.
fn earlier(planned: &PlannedTouch) -> Option<String> {
    let replaced = planned.amendments.iter().filter_map(|replaced| replaced.before.as_deref());
    let all: Vec<&str> = replaced.collect();
    (!all.is_empty()).then(|| all.join("; "))
}

/// The reason why a touch has no end in the journal.
fn not_reached(run: &Run, data: &RunData, planned: &PlannedTouch) -> String {
    let during = if planned.is_begun { " during this touch" } else { "" };
    match run.status {
        RunStatus::Running if planned.is_begun => "the touch is under way".to_owned(),
        RunStatus::Running => "the run is under way".to_owned(),
        RunStatus::Ended(Ending::Aborted) => format!("the run was aborted{during}"),
        RunStatus::Ended(Ending::Faulted) => {
            let cause = data.fault.as_deref().map_or_else(String::new, |why| format!(": {why}"));
            format!("a fault ended the run{during}{cause}")
        }
        RunStatus::Interrupted | RunStatus::Ended(Ending::Interrupted) => {
            format!("rigd ended{during}, before the end of the run")
        }
        RunStatus::Ended(Ending::Completed | Ending::CompletedWithRefusals) => {
            "its record is missing from the journal".to_owned()
        }
    }
}
