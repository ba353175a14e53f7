//! The rows of the table of touches.

use super::table::{POSITION_DECIMALS, TableValue};
use crate::results::{budget::StiffnessBudget, touches::TouchRow};

/// The values of a touch, in the order of the columns. Those that differ between two runs of one
/// seed are the last two.
pub(super) fn touch<'a>(
    row: &'a TouchRow,
    run_id: &'a str,
    is_simulated: bool,
) -> [TableValue<'a>; 47] {
    let [no_load, no_load_sigma] = pair(row.no_load_hz, row.no_load_sigma_hz);
    let [resonance, sigma] = pair(row.resonance_hz, row.sigma_hz);
    let [shift, shift_sigma] = pair(row.shift_hz, row.shift_sigma_hz);
    let [surface, surface_sigma] = pair(row.surface_mm, row.surface_sigma_mm);
    let [stiffness, stiffness_sigma] = pair(row.stiffness_mpa, row.stiffness_sigma_mpa);
    let part = |of: fn(&StiffnessBudget) -> f64| {
        TableValue::of(row.budget.as_ref().map(of), TableValue::Exact)
    };
    let position =
        |value| TableValue::of(value, |value| TableValue::Decimals(value, POSITION_DECIMALS));
    [
        TableValue::Text(&row.step),
        TableValue::Text(row.phase),
        TableValue::Text(&row.sample),
        TableValue::Text(row.direction),
        TableValue::Exact(row.angle_deg),
        TableValue::Whole(row.repeat.into()),
        TableValue::Text(row.status.name()),
        TableValue::of(row.reason.as_deref(), TableValue::Text),
        TableValue::of(row.is_confirmed, TableValue::Flag),
        TableValue::of(row.is_slip_checked, TableValue::Flag),
        TableValue::of(row.is_reference_steady, TableValue::Flag),
        TableValue::of(row.no_load_sweep, TableValue::Whole),
        TableValue::of(row.next_no_load_sweep, TableValue::Whole),
        no_load,
        no_load_sigma,
        TableValue::of(row.drift_sigma_hz, TableValue::Exact),
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
        part(|budget| budget.sweep_mpa),
        part(|budget| budget.reference_mpa),
        part(|budget| budget.surface_mpa),
        part(|budget| budget.depth_mpa),
        part(|budget| budget.angle_mpa),
        part(|budget| budget.sensor_mpa),
        part(|budget| budget.model_mpa),
        part(|budget| budget.sample_mpa),
        TableValue::of(row.model_verdict, TableValue::Text),
        TableValue::of(row.model_residual, TableValue::Exact),
        TableValue::of(row.class.as_deref(), TableValue::Text),
        TableValue::of(row.known_mpa, TableValue::Exact),
        TableValue::Whole(row.attempts.into()),
        TableValue::of(row.clock, TableValue::Whole),
        TableValue::of(row.amended.as_deref(), TableValue::Text),
        TableValue::of(row.earlier.as_deref(), TableValue::Text),
        TableValue::Flag(is_simulated),
        TableValue::of(row.started_at.as_deref(), TableValue::Time),
        TableValue::Text(run_id),
    ]
}

/// The table values of a value and its standard deviation.
fn pair(value: Option<f64>, sigma: Option<f64>) -> [TableValue<'static>; 2] {
    value
        .zip(sigma)
        .map_or([TableValue::Empty; 2], |(value, sigma)| TableValue::with_sigma(value, sigma))
}
