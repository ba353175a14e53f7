//! What became of every planned touch, one row for each, for every output.

use std::io::Write;

use rig_record::{Ending, Indented, Phase, Run, RunStatus, Touch};
use rig_store::export::{Cell, ExportError, POSITION_DECIMALS, Table};
use serde::Serialize;

use super::{
    data::{Outcome, PlannedTouch, RunData},
    html::add,
    results::{DIRECTIONS, RunResults},
};

/// A planned touch and what became of it. The fields are an interface: scripts read them.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
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
    /// What became of it.
    pub status: TouchStatus,
    /// Why it was not measured; or why a measured touch has no stiffness.
    pub reason: Option<String>,
    /// Number of the sweep that gave the reference.
    pub no_load_sweep: Option<u64>,
    /// The reference, Hz.
    pub no_load_hz: Option<f64>,
    /// Its standard deviation, Hz.
    pub no_load_sigma_hz: Option<f64>,
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
    /// Young's modulus, calibrated by the samples that are known, MPa. Where the contact angle is
    /// unknown, that of the place which the touch belongs to.
    pub stiffness_mpa: Option<f64>,
    /// Its standard deviation, that of the calibration included, MPa.
    pub stiffness_sigma_mpa: Option<f64>,
    /// For a blind touch: the sample whose cluster it fell into.
    pub class: Option<String>,
    /// Young's modulus of the sample as it is known otherwise, MPa.
    pub known_mpa: Option<f64>,
    /// When it began: UTC, RFC 3339, on the rig's clock from the beginning of the run on.
    pub started_at: Option<String>,
}

/// What became of a planned touch.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum TouchStatus {
    /// It gave a shift.
    Measured,
    /// It was made and gave none.
    Refused,
    /// It was not made, or not to its end.
    #[default]
    NotReached,
}

impl TouchStatus {
    /// The word for programs.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Measured => "measured",
            Self::Refused => "refused",
            Self::NotReached => "not_reached",
        }
    }

    /// The words for people.
    pub(super) const fn describe(self) -> &'static str {
        match self {
            Self::NotReached => "not reached",
            status => status.name(),
        }
    }
}

/// How many touches were planned, and what became of them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Tally {
    pub(super) planned: usize,
    pub(super) measured: usize,
    pub(super) refused: usize,
    pub(super) not_reached: usize,
}

impl Tally {
    pub(super) fn add(&mut self, status: TouchStatus) {
        self.planned += 1;
        *match status {
            TouchStatus::Measured => &mut self.measured,
            TouchStatus::Refused => &mut self.refused,
            TouchStatus::NotReached => &mut self.not_reached,
        } += 1;
    }

    pub(super) fn of(rows: &[TouchRow]) -> Self {
        let mut tally = Self::default();
        for row in rows {
            tally.add(row.status);
        }
        tally
    }

    /// What stands in the place of a value when nothing was measured.
    pub(super) const fn missing(self) -> &'static str {
        match self {
            Self { planned: 0, .. } => "–",
            Self { refused: 0, .. } => TouchStatus::NotReached.describe(),
            _ => TouchStatus::Refused.describe(),
        }
    }

    /// `2 of 3`, where fewer were measured than planned.
    pub(super) fn shortfall(self) -> Option<String> {
        let Self { planned, measured, .. } = self;
        (measured < planned).then(|| format!("{measured} of {planned}"))
    }
}

/// So many refused touches are named in a sentence.
const NAMED_MAX: usize = 5;

/// `107 of 110 touches measured; 3 refused: …`, with the addresses of those.
pub(super) fn sentence(rows: &[TouchRow]) -> String {
    let Tally { planned, measured, refused, not_reached } = Tally::of(rows);
    let mut text = format!("{measured} of {planned} touches measured");
    if refused > 0 {
        let is_refused = |row: &&TouchRow| row.status == TouchStatus::Refused;
        let names = rows.iter().filter(is_refused).map(|row| row.step.as_str());
        let named: Vec<&str> = names.take(NAMED_MAX).collect();
        add(&mut text, format_args!("; {refused} refused: {}", named.join(", ")));
        if refused > NAMED_MAX {
            add(&mut text, format_args!(" and {} more", refused - NAMED_MAX));
        }
    }
    if not_reached > 0 {
        add(&mut text, format_args!("; {not_reached} not reached"));
    }
    text
}

/// The planned touches of the main phase at one angle of one sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct GridRow {
    pub(super) sample: usize,
    pub(super) angle_deg: f64,
    /// What became of them, by direction.
    pub(super) directions: [Tally; DIRECTIONS.len()],
}

impl GridRow {
    /// The same over the directions, each counted once however often it was touched.
    pub(super) fn over_directions(&self) -> Tally {
        let mut all = Tally::default();
        for tally in self.directions.iter().filter(|tally| tally.planned > 0) {
            all.add(match tally {
                Tally { measured: 1.., .. } => TouchStatus::Measured,
                Tally { refused: 1.., .. } => TouchStatus::Refused,
                _ => TouchStatus::NotReached,
            });
        }
        all
    }
}

/// The grid of the main phase as it was planned, ordered by sample and angle.
pub(super) fn grid(data: &RunData) -> Vec<GridRow> {
    let mut grid: Vec<GridRow> = Vec::new();
    for planned in data.planned.iter().filter(|planned| planned.settings.phase == Phase::Main) {
        let (pose, Some(sample)) = (planned.settings.pose, data.sample(&planned.settings.sample))
        else {
            continue;
        };
        let key = (sample, pose.angle_deg);
        let known = grid.iter().position(|row| (row.sample, row.angle_deg) == key);
        let index = known.unwrap_or(grid.len());
        if known.is_none() {
            let directions = [Tally::default(); DIRECTIONS.len()];
            grid.push(GridRow { sample, angle_deg: pose.angle_deg, directions });
        }
        let direction = DIRECTIONS.iter().position(|direction| *direction == pose.direction);
        if let Some(direction) = direction {
            grid[index].directions[direction].add(planned.status());
        }
    }
    grid.sort_by(|a, b| a.sample.cmp(&b.sample).then(a.angle_deg.total_cmp(&b.angle_deg)));
    grid
}

impl PlannedTouch {
    pub(super) const fn status(&self) -> TouchStatus {
        match self.outcome {
            Some(Outcome::Measured(_)) => TouchStatus::Measured,
            Some(Outcome::Refused(_)) => TouchStatus::Refused,
            None => TouchStatus::NotReached,
        }
    }
}

/// A row for every planned touch, in the order of the plan.
pub(super) fn rows(run: &Run, data: &RunData, results: &RunResults) -> Vec<TouchRow> {
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
            started_at: planned.began_at.clone(),
            ..TouchRow::default()
        };
        match &planned.outcome {
            Some(Outcome::Measured(place)) => row.measured(&data.touches[*place], data, results),
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
            None => row.reason = Some(not_reached(run, data, planned)),
        }
        row
    };
    data.planned.iter().map(row).collect()
}

impl TouchRow {
    fn measured(&mut self, touch: &Touch, data: &RunData, results: &RunResults) {
        self.no_load_sweep = Some(touch.no_load_sweep);
        self.no_load_hz = Some(touch.no_load_hz);
        self.no_load_sigma_hz = Some(touch.no_load_sigma_hz);
        self.sweep = Some(touch.sweep);
        self.resonance_hz = Some(touch.resonance_hz);
        self.sigma_hz = Some(touch.sigma_hz);
        self.shift_hz = Some(touch.shift_hz);
        self.shift_sigma_hz = Some(touch.shift_sigma_hz);
        self.surface_mm = Some(touch.surface_mm);
        self.surface_sigma_mm = Some(touch.surface_sigma_mm);
        self.indentation_mm = Some(touch.indentation_mm);
        self.linear_mm = touch.linear_mm;
        self.rotary_deg = touch.rotary_deg;
        let stiffness = results.stiffness.as_ref().ok();
        match stiffness.and_then(|stiffness| stiffness.of_touch(&self.step)) {
            Some(Ok(young)) => {
                self.stiffness_mpa = Some(young.mpa);
                self.stiffness_sigma_mpa = Some(young.sigma_mpa);
            }
            Some(Err(error)) => self.reason = Some(format!("no stiffness: {error}")),
            None => {}
        }
        let class = results.classification.as_ref().filter(|_| touch.touch.phase == Phase::Blind);
        let class = class.and_then(|found| found.class_of(touch.touch.repeat));
        self.class = class.map(|sample| data.samples()[sample].name.clone());
    }

    const fn indented(&mut self, indented: Indented) {
        self.sweep = Some(indented.sweep);
        self.surface_mm = Some(indented.surface_mm);
        self.surface_sigma_mm = Some(indented.surface_sigma_mm);
        self.indentation_mm = Some(indented.indentation_mm);
        self.linear_mm = Some(indented.linear_mm);
    }
}

/// Why a touch has no end in the journal.
fn not_reached(run: &Run, data: &RunData, planned: &PlannedTouch) -> String {
    let during = if planned.began_at.is_some() { " during this touch" } else { "" };
    match run.status {
        RunStatus::Running if planned.began_at.is_some() => "the touch is under way".to_owned(),
        RunStatus::Running => "the run is under way".to_owned(),
        RunStatus::Ended(Ending::Aborted) => format!("the run was aborted{during}"),
        RunStatus::Ended(Ending::Faulted) => {
            let cause = data.fault.as_deref().map_or_else(String::new, |why| format!(": {why}"));
            format!("a fault ended the run{during}{cause}")
        }
        RunStatus::Interrupted | RunStatus::Ended(Ending::Interrupted) => {
            format!("rigd ended{during}, before the run did")
        }
        RunStatus::Ended(Ending::Completed | Ending::CompletedWithRefusals) => {
            "its record is missing from the journal".to_owned()
        }
    }
}

/// The columns of `touches.csv`. Those that differ between two runs of one seed are the last.
const COLUMNS: [&str; 28] = [
    "step",
    "phase",
    "sample",
    "direction",
    "angle_deg",
    "repeat",
    "status",
    "reason",
    "no_load_sweep",
    "no_load_hz",
    "no_load_sigma_hz",
    "sweep",
    "resonance_hz",
    "sigma_hz",
    "shift_hz",
    "shift_sigma_hz",
    "surface_mm",
    "surface_sigma_mm",
    "indentation_mm",
    "linear_mm",
    "rotary_deg",
    "stiffness_mpa",
    "stiffness_sigma_mpa",
    "class",
    "known_mpa",
    "is_simulated",
    "started_at",
    "run_id",
];

/// Writes one row for every planned touch.
pub(super) fn csv(
    run: &Run,
    data: &RunData,
    rows: &[TouchRow],
    out: &mut impl Write,
) -> Result<(), ExportError> {
    let (run_id, is_simulated) = (run.id.to_string(), data.is_simulated());
    let mut table = Table::new(&COLUMNS, out)?;
    for row in rows {
        let [no_load, no_load_sigma] = pair(row.no_load_hz, row.no_load_sigma_hz);
        let [resonance, sigma] = pair(row.resonance_hz, row.sigma_hz);
        let [shift, shift_sigma] = pair(row.shift_hz, row.shift_sigma_hz);
        let [surface, surface_sigma] = pair(row.surface_mm, row.surface_sigma_mm);
        let [stiffness, stiffness_sigma] = pair(row.stiffness_mpa, row.stiffness_sigma_mpa);
        let position = |value| Cell::of(value, |value| Cell::Decimals(value, POSITION_DECIMALS));
        table.row([
            Cell::Text(&row.step),
            Cell::Text(row.phase),
            Cell::Text(&row.sample),
            Cell::Text(row.direction),
            Cell::Exact(row.angle_deg),
            Cell::Whole(row.repeat.into()),
            Cell::Text(row.status.name()),
            Cell::of(row.reason.as_deref(), Cell::Text),
            Cell::of(row.no_load_sweep, Cell::Whole),
            no_load,
            no_load_sigma,
            Cell::of(row.sweep, Cell::Whole),
            resonance,
            sigma,
            shift,
            shift_sigma,
            surface,
            surface_sigma,
            position(row.indentation_mm),
            position(row.linear_mm),
            position(row.rotary_deg),
            stiffness,
            stiffness_sigma,
            Cell::of(row.class.as_deref(), Cell::Text),
            Cell::of(row.known_mpa, Cell::Exact),
            Cell::Flag(is_simulated),
            Cell::of(row.started_at.as_deref(), Cell::Text),
            Cell::Text(&run_id),
        ])?;
    }
    table.finish()
}

/// The cells of a value and its standard deviation.
fn pair(value: Option<f64>, sigma: Option<f64>) -> [Cell<'static>; 2] {
    value.zip(sigma).map_or([Cell::Empty; 2], |(value, sigma)| Cell::with_sigma(value, sigma))
}
