//! What became of the aim of a protocol: the time and the standard deviations that were expected, beside what came.

use rig_record::{Aim, RunStatus, SweepPurpose};
use schemars::JsonSchema;
use serde::Serialize;

use super::{budget::StiffnessBudget, cost::swept_s, status::TouchStatus, touches::TouchRow};
use crate::data::RunData;

/// The aim of a protocol and what became of it. The fields are an interface: scripts read them.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct AimSummary {
    /// The largest relative standard deviation of the stiffness of a touch that is wanted, %.
    pub stiffness_percent: Option<f64>,
    /// The mean time of a touch that is wanted, s.
    pub seconds_per_touch: Option<f64>,
    /// Target of the sweeps in contact, Hz.
    pub contact_sigma_hz: f64,
    /// Target of the references, Hz.
    pub no_load_sigma_hz: f64,
    /// The last step of the search for the surface, mm.
    pub fine_step_mm: f64,
    /// When the reference was measured: a word of `no_load` of protocols.
    pub no_load: String,
    /// The keys of these settings that the protocol states.
    pub stated: Vec<String>,
    /// Whether every touch so far is as wanted, or the mean time is; `None` before the first touch.
    pub is_reached: Option<bool>,
    /// Touches that were refused: the standard deviations are those of the others.
    pub refused: usize,
    /// Time of a touch: that of the run over the touches that were made, s.
    pub seconds: Option<f64>,
    /// The expected one, s.
    pub expected_seconds: f64,
    /// Root mean square of the standard deviations of the touches by themselves, %.
    pub percent: Option<f64>,
    /// The expected one, %.
    pub expected_percent: f64,
    /// The largest of them, %.
    pub worst_percent: Option<f64>,
    /// The expected one, %.
    pub expected_worst_percent: f64,
    /// Root mean square of the standard deviations that sensor and model add, which the touches share, %.
    pub shared_percent: Option<f64>,
    /// The touches whose standard deviation is larger than wanted, and the measured ones without a stiffness.
    pub wider: Vec<String>,
    /// Each part of a touch.
    pub parts: Vec<AimPartSummary>,
}

/// A part of a touch: what was expected, and what came.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct AimPartSummary {
    /// `sweep`, `reference`, `surface`, `depth`, `angle` or `rest`.
    pub part: String,
    /// Time for each touch, s.
    pub seconds: Option<f64>,
    /// The expected one, s.
    pub expected_seconds: Option<f64>,
    /// Root mean square of the standard deviations that it causes, %.
    pub percent: Option<f64>,
    /// The expected one, %.
    pub expected_percent: Option<f64>,
}

impl AimSummary {
    /// What became of the aim so far; `None` for a protocol without one.
    pub(super) fn of(data: &RunData, rows: &[TouchRow]) -> Option<Self> {
        let aim = data.started.as_ref()?.aim.as_ref()?;
        let is_made =
            |row: &&TouchRow| matches!(row.status, TouchStatus::Measured | TouchStatus::Refused);
        let made = rows.iter().filter(is_made).count() as f64;
        let per_touch = |seconds: f64| (made > 0.0).then(|| seconds / made);
        let of_purpose = |purpose: SweepPurpose| {
            data.own_sweeps()
                .iter()
                .filter(|sweep| sweep.purpose == purpose)
                .map(swept_s)
                .sum::<f64>()
        };
        let sweep_s = of_purpose(SweepPurpose::Touch);
        let reference_s = of_purpose(SweepPurpose::NoLoad);
        let rest_s = data.rig_s() - sweep_s - reference_s - data.surfaces_s;
        let seconds = per_touch(data.rig_s());
        let budgets: Vec<Relative> = rows.iter().filter_map(Relative::of).collect();
        let rms = |of: &dyn Fn(&Relative) -> f64| {
            let squares: f64 = budgets.iter().map(|budget| of(budget).powi(2)).sum();
            (!budgets.is_empty()).then(|| (squares / budgets.len() as f64).sqrt())
        };
        let part = |part: &rig_record::AimPart| {
            let seconds = match part.part.as_str() {
                "sweep" => Some(sweep_s),
                "reference" => Some(reference_s),
                "surface" => Some(data.surfaces_s),
                "rest" => Some(rest_s),
                _ => None,
            };
            AimPartSummary {
                part: part.part.clone(),
                seconds: seconds.and_then(per_touch),
                expected_seconds: part.seconds,
                percent: part.percent.and_then(|_| rms(&|budget| budget.part(&part.part))),
                expected_percent: part.percent,
            }
        };
        let wider = wider(aim, rows);
        let is_reached = seconds.map(|seconds| match aim.seconds_per_touch {
            Some(wanted) => seconds <= wanted,
            None => wider.is_empty(),
        });
        let own = budgets.iter().map(Relative::own);
        Some(Self {
            stiffness_percent: aim.stiffness_percent,
            seconds_per_touch: aim.seconds_per_touch,
            contact_sigma_hz: aim.settings.contact_sigma_hz,
            no_load_sigma_hz: aim.settings.no_load_sigma_hz,
            fine_step_mm: aim.settings.fine_step_mm,
            no_load: aim.settings.no_load.clone(),
            stated: aim.stated.clone(),
            is_reached,
            refused: rows.iter().filter(|row| row.status == TouchStatus::Refused).count(),
            seconds,
            expected_seconds: aim.seconds,
            percent: rms(&Relative::own),
            expected_percent: aim.percent,
            worst_percent: own.max_by(f64::total_cmp),
            expected_worst_percent: aim.worst_percent,
            shared_percent: rms(&Relative::shared),
            wider,
            parts: aim.parts.iter().map(part).collect(),
        })
    }

    /// The aim and what became of it, in a sentence without its full stop.
    pub(crate) fn sentence(&self, status: RunStatus) -> String {
        let so_far = if status == RunStatus::Running { " so far" } else { "" };
        let seconds = self.seconds.map_or_else(String::new, |seconds| {
            format!("; {seconds:.2} s a touch, {:.2} s expected", self.expected_seconds)
        });
        let percent = self.percent.zip(self.worst_percent).map_or_else(String::new, |(all, worst)| {
            format!(
                "; standard deviation of a touch {all:.2} %, {:.2} % expected, {worst:.2} % at most",
                self.expected_percent
            )
        });
        let (wanted, missed) = match (self.stiffness_percent, self.seconds_per_touch) {
            (Some(wanted), _) => {
                let wider = self.wider.len();
                let subject = if wider == 1 { "1 touch is" } else { "touches are" };
                let count = if wider == 1 { String::new() } else { format!("{wider} ") };
                let named = self.wider.iter().take(NAMED_MAX).cloned().collect::<Vec<_>>();
                let more = match wider.saturating_sub(NAMED_MAX) {
                    0 => String::new(),
                    more => format!(" and {more} more"),
                };
                let missed = format!("{count}{subject} wider: {}{more}", named.join(", "));
                (format!("{wanted} % for each touch"), missed)
            }
            (None, wanted) => {
                let wanted = wanted.unwrap_or_default();
                (format!("{wanted} s a touch"), "a touch took longer".to_owned())
            }
        };
        let reached = match self.is_reached {
            None => "no touch yet".to_owned(),
            Some(true) => format!("reached{so_far}"),
            Some(false) => format!("not reached{so_far}: {missed}"),
        };
        let refused = match self.refused {
            0 => String::new(),
            1 => "; 1 touch was refused".to_owned(),
            more => format!("; {more} touches were refused"),
        };
        format!("{wanted}, {reached}{seconds}{percent}{refused}")
    }
}

/// Largest number of wider touches named in a sentence.
const NAMED_MAX: usize = 5;

/// The touches that are not as well known as wanted.
fn wider(aim: &Aim, rows: &[TouchRow]) -> Vec<String> {
    let Some(wanted) = aim.stiffness_percent else { return Vec::new() };
    let is_wider = |row: &&TouchRow| {
        let is_measured = row.status == TouchStatus::Measured;
        is_measured && Relative::of(row).is_none_or(|found| found.own() > wanted)
    };
    rows.iter().filter(is_wider).map(|row| row.step.clone()).collect()
}

/// The budget of a touch relative to its stiffness, %.
struct Relative {
    budget: StiffnessBudget,
    percent_per_mpa: f64,
}

impl Relative {
    fn of(row: &TouchRow) -> Option<Self> {
        Some(Self { budget: row.budget?, percent_per_mpa: 100.0 / row.stiffness_mpa? })
    }

    fn part(&self, name: &str) -> f64 {
        let budget = &self.budget;
        let mpa = match name {
            "sweep" => budget.sweep_mpa,
            "reference" => budget.reference_mpa,
            "surface" => budget.surface_mpa,
            "depth" => budget.depth_mpa,
            "angle" => budget.angle_mpa,
            _ => 0.0,
        };
        self.percent_per_mpa * mpa
    }

    /// Of the touch by itself.
    fn own(&self) -> f64 {
        let parts = ["sweep", "reference", "surface", "depth", "angle"];
        parts.iter().map(|name| self.part(name)).fold(0.0, f64::hypot)
    }

    /// Of what it shares with the others.
    fn shared(&self) -> f64 {
        self.percent_per_mpa * self.budget.sensor_mpa.hypot(self.budget.model_mpa)
    }
}
