//! The table of touches.

use std::io::Write;

use super::{
    error::ExportError,
    table::{POSITION_DECIMALS, Table, TableValue},
};
use crate::results::RunResults;

/// The columns of `touches.csv`. Those that differ between two runs of one seed are the last.
const COLUMNS: [&str; 32] = [
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
    "attempts",
    "clock",
    "amended",
    "earlier",
    "is_simulated",
    "started_at",
    "run_id",
];

impl RunResults {
    /// `touches.csv`: one row for every planned touch with its result.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn touches_csv(&self, out: impl Write) -> Result<(), ExportError> {
        let (run_id, is_simulated) = (self.run.id.to_string(), self.data.is_simulated());
        let mut table = Table::new(&COLUMNS, out)?;
        for row in &self.touches {
            let [no_load, no_load_sigma] = pair(row.no_load_hz, row.no_load_sigma_hz);
            let [resonance, sigma] = pair(row.resonance_hz, row.sigma_hz);
            let [shift, shift_sigma] = pair(row.shift_hz, row.shift_sigma_hz);
            let [surface, surface_sigma] = pair(row.surface_mm, row.surface_sigma_mm);
            let [stiffness, stiffness_sigma] = pair(row.stiffness_mpa, row.stiffness_sigma_mpa);
            let position = |value| {
                TableValue::of(value, |value| TableValue::Decimals(value, POSITION_DECIMALS))
            };
            table.row([
                TableValue::Text(&row.step),
                TableValue::Text(row.phase),
                TableValue::Text(&row.sample),
                TableValue::Text(row.direction),
                TableValue::Exact(row.angle_deg),
                TableValue::Whole(row.repeat.into()),
                TableValue::Text(row.status.name()),
                TableValue::of(row.reason.as_deref(), TableValue::Text),
                TableValue::of(row.no_load_sweep, TableValue::Whole),
                no_load,
                no_load_sigma,
                TableValue::of(row.sweep, TableValue::Whole),
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
                TableValue::of(row.class.as_deref(), TableValue::Text),
                TableValue::of(row.known_mpa, TableValue::Exact),
                TableValue::Whole(row.attempts.into()),
                TableValue::of(row.clock, TableValue::Whole),
                TableValue::of(row.amended.as_deref(), TableValue::Text),
                TableValue::of(row.earlier.as_deref(), TableValue::Text),
                TableValue::Flag(is_simulated),
                TableValue::of(row.started_at.as_deref(), TableValue::Text),
                TableValue::Text(&run_id),
            ])?;
        }
        table.finish()
    }
}

/// The table values of a value and its standard deviation.
fn pair(value: Option<f64>, sigma: Option<f64>) -> [TableValue<'static>; 2] {
    value
        .zip(sigma)
        .map_or([TableValue::Empty; 2], |(value, sigma)| TableValue::with_sigma(value, sigma))
}
