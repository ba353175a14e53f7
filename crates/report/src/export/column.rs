//! The columns of the tables: one list for CSV, Parquet, documents and the dictionary of columns.

use std::fmt::Write as _;

/// A column of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Column {
    /// Name of the column; ends with the unit, if it has one.
    pub name: &'static str,
    /// Type of its values.
    pub kind: ColumnKind,
    /// Unit of its values in UCUM; empty without one.
    pub unit: &'static str,
    /// Meaning of its values, in a sentence without a full stop.
    pub description: &'static str,
}

/// The type of the values of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColumnKind {
    /// A label or a sentence.
    Text,
    /// A whole number, not negative.
    Whole,
    /// A number.
    Number,
    /// True or false.
    Flag,
    /// A time of the wall clock, UTC, in milliseconds.
    Time,
}

impl ColumnKind {
    /// The word in the dictionary of columns.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Text => "text",
            Self::Whole => "whole",
            Self::Number => "number",
            Self::Flag => "true, false",
            Self::Time => "time",
        }
    }
}

const fn column(
    kind: ColumnKind,
    name: &'static str,
    unit: &'static str,
    description: &'static str,
) -> Column {
    Column { name, kind, unit, description }
}

const fn text(name: &'static str, description: &'static str) -> Column {
    column(ColumnKind::Text, name, "", description)
}

const fn whole(name: &'static str, description: &'static str) -> Column {
    column(ColumnKind::Whole, name, "", description)
}

const fn flag(name: &'static str, description: &'static str) -> Column {
    column(ColumnKind::Flag, name, "", description)
}

const fn number(name: &'static str, unit: &'static str, description: &'static str) -> Column {
    column(ColumnKind::Number, name, unit, description)
}

/// A table of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TableName {
    /// One row for each planned touch.
    Touches,
    /// One row for each sweep.
    Sweeps,
    /// One row for each reading of each sweep.
    Readings,
    /// One row for each reading of each search for the surface, and of each check of it.
    Searches,
}

impl TableName {
    /// All tables.
    pub const ALL: [Self; 4] = [Self::Touches, Self::Sweeps, Self::Readings, Self::Searches];

    /// The name of its file, without an extension.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Touches => "touches",
            Self::Sweeps => "sweeps",
            Self::Readings => "readings",
            Self::Searches => "searches",
        }
    }

    /// Its rows, in a sentence.
    pub const fn description(self) -> &'static str {
        match self {
            Self::Touches => {
                "One row for every planned touch, in the order of the plan, whatever its status."
            }
            Self::Sweeps => {
                "One row for each sweep: its purpose, and the fitted circuit or the reason of its \
                 refusal."
            }
            Self::Readings => {
                "One row for each reading of each sweep, with all digits and the settings of the \
                 fit."
            }
            Self::Searches => {
                "One row for each reading of a search for the surface, successful or not, and of \
                 each check of the surface after a touch."
            }
        }
    }

    /// Its columns, in order.
    pub fn columns(self) -> Vec<Column> {
        match self {
            Self::Touches => TOUCH.to_vec(),
            Self::Sweeps => [&SWEEP[..], &END].concat(),
            Self::Readings => [&SWEEP[..3], &[NUMBER], &READING, &FIT, &END].concat(),
            Self::Searches => [&SEARCH[..], &READING, &END].concat(),
        }
    }

    /// The table of its columns as Markdown.
    pub fn dictionary(self) -> String {
        dictionary(&self.columns())
    }
}

/// A table of columns as Markdown.
pub(super) fn dictionary(columns: &[Column]) -> String {
    let mut text = "| column | type | unit | meaning |\n|---|---|---|---|\n".to_owned();
    for Column { name, kind, unit, description } in columns {
        let unit = if unit.is_empty() { String::new() } else { format!("`{unit}`") };
        writeln!(text, "| `{name}` | {} | {unit} | {description} |", kind.name())
            .expect("a string takes all text");
    }
    text
}

/// The columns of a sealed run in an object store. None is named as a part of the path, `lab`, `bench` or `month`.
pub(super) const SEALED: [Column; 10] = [
    text("run_id", "id of the run"),
    text("run_kind", "`run`, `session`, `amendment` or `archive`"),
    text(
        "run_name",
        "name of the protocol; of an amendment or a note of an archive, the id of the run it is about",
    ),
    whole("seq", "number of the record in the run, from 1"),
    whole("epoch", "number of the opening of the journal from which `rig_us` counts"),
    column(ColumnKind::Whole, "rig_us", "us", "time of the record on the rig's clock"),
    column(
        ColumnKind::Time,
        "at",
        "",
        "time of the record, UTC: the wall-clock start of its stretch plus the time on the rig's clock",
    ),
    text("kind", "kind of the record"),
    text("payload", "the record as JSON, byte for byte as in the journal"),
    text("digest", "digest of the record and of the ones before it, SHA-256 in hexadecimal"),
];

/// The first column of a table of several runs.
pub(super) const RUN: Column = text("run", "short name of the run");

const TOUCH: [Column; 47] = [
    text(
        "step",
        "address of the step: `main/<sample>/<direction>/<angle>/<repeat>` or `blind/<number>`",
    ),
    text("phase", "`main` or `blind`"),
    text("sample", "name of the sample; the analysis of the blind phase does not use it"),
    text("direction", "`front`, `back` or `left`"),
    number("angle_deg", "deg", "planned contact angle"),
    whole("repeat", "repeat of this pose, or number of the blind touch, from 1"),
    text("status", "`measured`, `refused`, `skipped` or `not_reached`"),
    text(
        "reason",
        "the reason why a touch was refused, skipped or not reached, or why a measured touch has \
         no stiffness",
    ),
    flag(
        "is_confirmed",
        "for a measured touch, whether what was measured after it confirms it: `false` if the run ended \
         before that, empty while it is awaited",
    ),
    flag(
        "is_slip_checked",
        "for a measured touch, whether the surface was found again after its sweep: `false` if the protocol has \
         `slip_mm = 0`, so that steps lost in the touch would not show",
    ),
    flag(
        "is_reference_steady",
        "for a measured touch, whether the free resonance has not jumped between its reference and the next one, as \
         far as there is one",
    ),
    whole("no_load_sweep", "the sweep that gave the reference, a row of the table of sweeps"),
    whole(
        "next_no_load_sweep",
        "the sweep that gave the reference after the touch, if the next column is the value between both",
    ),
    number("no_load_hz", "Hz", "resonance with the probe clear"),
    number("no_load_sigma_hz", "Hz", "its standard deviation"),
    number(
        "drift_sigma_hz",
        "Hz",
        "standard deviation of what the free resonance has drifted since, or between both, by the references so far",
    ),
    whole("sweep", "the last sweep in contact, a row of the table of sweeps"),
    number("resonance_hz", "Hz", "resonance in contact"),
    number("sigma_hz", "Hz", "its standard deviation"),
    number("shift_hz", "Hz", "resonance in contact less the reference"),
    number("shift_sigma_hz", "Hz", "its standard deviation: of both resonances and the drift"),
    number("surface_mm", "mm", "height of the surface found"),
    number("surface_sigma_mm", "mm", "its standard deviation"),
    number(
        "indentation_mm",
        "mm",
        "depth below the surface along the probe during the sweep, as read back",
    ),
    number("linear_mm", "mm", "read-back of the linear stage before the sweep"),
    number("rotary_deg", "deg", "read-back of the rotary stage before the sweep"),
    number(
        "stiffness_mpa",
        "MPa",
        "Young's modulus from this touch, calibrated by the known samples of the run; with \
         `angle = \"unknown\"` the value of the site",
    ),
    number(
        "stiffness_sigma_mpa",
        "MPa",
        "its standard deviation, with those of calibration and model",
    ),
    number("sigma_of_sweep_mpa", "MPa", "the part of it from the resonance in contact"),
    number("sigma_of_reference_mpa", "MPa", "the part from the reference"),
    number("sigma_of_surface_mpa", "MPa", "the part from the surface found"),
    number("sigma_of_depth_mpa", "MPa", "the part from the depth below the surface"),
    number(
        "sigma_of_angle_mpa",
        "MPa",
        "the part from the contact angle; from what the touches leave unknown of it with \
         `angle = \"unknown\"`",
    ),
    number(
        "sigma_of_sensor_mpa",
        "MPa",
        "the part from the calibration by known samples, or from the description of the sensor",
    ),
    number(
        "sigma_of_model_mpa",
        "MPa",
        "the part from what was learnt, and from a misfit of the model",
    ),
    number(
        "sigma_of_sample_mpa",
        "MPa",
        "the part from the variation of the sample from one point to the next; 0 at a known angle, where the stiffness is that of the touched point",
    ),
    text("model_verdict", "whether the model behind it holds: `holds`, `strained` or `rejected`"),
    number(
        "model_residual",
        "1",
        "for a main touch: logarithm of its stiffness less that of its sample, in standard deviations",
    ),
    text(
        "class",
        "for a blind touch: the sample that its cluster represents, by k-means on the shifts",
    ),
    number("known_mpa", "MPa", "Young's modulus of the sample from another method"),
    whole(
        "attempts",
        "how often the touch was begun: more than once if it was interrupted or measured again",
    ),
    whole("clock", "the clock on which the times of the touch count, from 1"),
    text("amended", "the last amendment of the touch: `redo` or `skip`, by whom, and why"),
    text("earlier", "the outcomes that amendments replaced, oldest first"),
    flag("is_simulated", "whether the instruments were simulated"),
    column(
        ColumnKind::Time,
        "started_at",
        "",
        "start of the touch, UTC: the wall-clock start of the run plus the time on the rig's \
         clock, so that a run in virtual time has the duration of a run on a bench",
    ),
    text("run_id", "id of the run"),
];

/// Of a value of the circuit.
const OF_CIRCUIT: &str = "its standard deviation; empty in journals of earlier versions";

const SWEEP: [Column; 20] = [
    whole("sweep", "number of the sweep in the run, from 1"),
    text("purpose", "`no_load`, `touch` or `manual`"),
    text("step", "address of the step"),
    text("direction", "`front`, `back` or `left`"),
    number("angle_deg", "deg", "contact angle"),
    number(
        "level_v",
        "V",
        "level of the drive, open circuit; empty in journals of earlier versions",
    ),
    whole("readings", "number of readings"),
    text("outcome", "`accepted` or `refused`"),
    number("resonance_hz", "Hz", "series resonance"),
    number("sigma_hz", "Hz", "its standard deviation"),
    number("effective_time_s", "s", "the time for which the resonance holds, on the rig's clock"),
    number("quality_factor", "1", "quality factor of the motional branch"),
    number("quality_factor_sigma", "1", OF_CIRCUIT),
    number("static_capacitance_f", "F", "static capacitance C₀"),
    number("static_capacitance_sigma_f", "F", OF_CIRCUIT),
    number("capacitance_ratio", "1", "motional capacitance in units of C₀"),
    number("capacitance_ratio_sigma", "1", OF_CIRCUIT),
    number("loss_tangent", "1", "dielectric loss tan δ of C₀"),
    number("loss_tangent_sigma", "1", "its standard deviation, if it was fitted"),
    text("reason", "the reason of a refusal"),
];

/// Behind the sweep of a reading, its purpose and its step.
const NUMBER: Column = whole("reading", "number of the reading in the sweep, from 1");

const SEARCH: [Column; 8] = [
    text("step", "address of the step"),
    text("purpose", "`search`, or `check` for a check of the surface after the sweep"),
    text("direction", "`front`, `back` or `left`"),
    number("angle_deg", "deg", "contact angle"),
    number("surface_mm", "mm", "height of the surface; empty if this search found none"),
    number("surface_sigma_mm", "mm", "its standard deviation"),
    whole("try", "number of the reading in the search or the check, from 1"),
    number("position_mm", "mm", "read-back of the linear stage"),
];

/// The columns of a reading.
pub(super) const READING: [Column; 7] = [
    number("frequency_hz", "Hz", "frequency of the drive"),
    number("resistance_ohm", "Ohm", "real part of the impedance; empty after an overload"),
    number("reactance_ohm", "Ohm", "imaginary part of the impedance; empty after an overload"),
    number("started_s", "s", "when the frequency was set, on the rig's clock"),
    number("settle_s", "s", "settling before the integration"),
    number("integration_s", "s", "duration of the integration"),
    text("flag", "flag of the analyzer: `normal`, `overload` (no value) or `low_signal`"),
];

/// Whether the fit used a reading, and the settings of the fit.
pub(super) const FIT: [Column; 21] = [
    flag(
        "is_used",
        "whether the outcome uses the reading; false if it is flagged or only helped to find the \
         resonance",
    ),
    number("fit_min_hz", "Hz", "lower end of the window of the resonance"),
    number("fit_max_hz", "Hz", "upper end of the window of the resonance"),
    number(
        "fit_noise_at_ten_cycles",
        "1",
        "standard deviation of the relative error of a reading of ten cycles, from earlier readings",
    ),
    number(
        "fit_noise_degrees_of_freedom",
        "1",
        "number of independent errors behind that estimate",
    ),
    text(
        "fit_timing",
        "known timing of the readings: `unknown`, `waited`, `exact`, `exact-from-rest` or \
         `any-phase`",
    ),
    flag("fit_always_loss", "whether dielectric loss was always a free parameter"),
    number("fit_target_sigma_hz", "Hz", "largest standard deviation of an accepted resonance"),
    number(
        "fit_near_resonance_hz",
        "Hz",
        "series resonance of the circuit by which unsettled readings were weighted",
    ),
    number("fit_near_quality_factor", "1", "its quality factor"),
    number("fit_near_static_capacitance_f", "F", "its static capacitance"),
    number("fit_near_capacitance_ratio", "1", "its motional capacitance in units of C₀"),
    number("fit_near_loss_tangent", "1", "its dielectric loss tan δ"),
    number(
        "fit_bench_phase_rad",
        "rad",
        "phase error of the analyzer by the survey, which the fit subtracts from each impedance",
    ),
    number("fit_bench_phase_sigma_rad", "rad", "its standard deviation"),
    number(
        "fit_bench_first_gap_s",
        "s",
        "by how much the time from the begin of the first reading of a stay to that of the second is \
         longer than recorded, by the survey",
    ),
    number(
        "fit_bench_dispersion_f",
        "F",
        "change of the static capacitance for each factor e of the frequency by the survey, from the middle of the \
         surveyed frequencies on; the fit subtracts its admittance",
    ),
    number("fit_bench_dispersion_sigma_f", "F", "its standard deviation"),
    number(
        "fit_bench_mode_sigma",
        "1",
        "standard deviation of the capacitance of a possible second mode by the survey, in units of \
         that of the first",
    ),
    number("fit_bench_min_hz", "Hz", "lower end of the surveyed frequencies"),
    number("fit_bench_max_hz", "Hz", "upper end of the surveyed frequencies"),
];

const END: [Column; 2] = [
    whole("clock", "the clock on which the times of the row count, from 1"),
    flag("is_simulated", "whether the instruments were simulated"),
];
