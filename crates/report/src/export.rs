//! The records of a run as tables that other programs read.
//!
//! Each function writes one file from the records of a run. The same records give the same bytes.
//! They contain no wall time and no id of the run, so that two runs of one protocol with the same
//! seed give the same files. [`RunResults::touches_csv`](crate::RunResults::touches_csv) writes the
//! table of touches, which needs the results.

mod error;
mod table;
#[cfg(test)]
mod tests;
mod touches;

use std::io::Write;

use crate::data::{clock, epochs};
pub use error::ExportError;
use rig_record::{Circuit, Pose, ReadingRecord, Record, StoredRecord, Sweep, SweepOutcome};
use table::{POSITION_DECIMALS, Table, TableValue};

/// Every record in order, one JSON object a line: `seq`, `rig_us`, `digest` and the `record`.
///
/// # Errors
/// Errors of the writer.
pub fn jsonl(records: &[StoredRecord], out: &mut impl Write) -> Result<(), ExportError> {
    for StoredRecord { seq, rig_us, digest, payload, .. } in records {
        writeln!(
            out,
            r#"{{"seq":{seq},"rig_us":{rig_us},"digest":"{digest}","record":{payload}}}"#
        )?;
    }
    Ok(())
}

/// One row for each sweep with its purpose and outcome. Columns that do not apply are empty.
///
/// # Errors
/// Errors of the writer, or a record that cannot be understood.
pub fn sweeps_csv(records: &[StoredRecord], out: &mut impl Write) -> Result<(), ExportError> {
    let columns = [
        "sweep",
        "purpose",
        "step",
        "direction",
        "angle_deg",
        "readings",
        "outcome",
        "resonance_hz",
        "sigma_hz",
        "effective_time_s",
        "quality_factor",
        "static_capacitance_f",
        "capacitance_ratio",
        "loss_tangent",
        "loss_tangent_sigma",
        "reason",
        "clock",
        "is_simulated",
    ];
    let (is_simulated, epochs) = (is_simulated(records), epochs(records));
    let mut table = Table::new(&columns, out)?;
    for stored in records.iter().filter(|stored| stored.kind == "sweep") {
        let Record::Sweep(sweep) = stored.record()? else { continue };
        let (direction, angle) = pose(sweep.pose);
        let (outcome, found, reason) = match &sweep.outcome {
            SweepOutcome::Accepted {
                resonance_hz, sigma_hz, effective_time_s, circuit, ..
            } => ("accepted", Some((*resonance_hz, *sigma_hz, *effective_time_s, *circuit)), None),
            SweepOutcome::Refused { reason } => ("refused", None, Some(reason.as_str())),
        };
        let [resonance, sigma] = found
            .map_or([TableValue::Empty; 2], |(resonance_hz, sigma_hz, ..)| {
                TableValue::with_sigma(resonance_hz, sigma_hz)
            });
        let moment = found.and_then(|(_, _, effective_time_s, _)| effective_time_s);
        let circuit = found.and_then(|(.., circuit)| circuit);
        // Their uncertainty is not in the journal; six digits are more than any sweep gives.
        let of = |value: fn(Circuit) -> f64| {
            TableValue::of(circuit.map(value), |v| TableValue::Digits(v, 6))
        };
        let loss = circuit.map(|circuit| (circuit.loss_tangent, circuit.loss_tangent_sigma));
        let [loss, loss_sigma] = match loss {
            Some((loss, Some(sigma))) => TableValue::with_sigma(loss, sigma),
            Some((loss, None)) => [TableValue::Digits(loss, 6), TableValue::Empty],
            None => [TableValue::Empty; 2],
        };
        table.row([
            TableValue::Whole(sweep.number),
            TableValue::Text(sweep.purpose.name()),
            TableValue::of(sweep.step.as_deref(), TableValue::Text),
            direction,
            angle,
            TableValue::Whole(sweep.readings.len() as u64),
            TableValue::Text(outcome),
            resonance,
            sigma,
            TableValue::of(moment, |effective_time_s| TableValue::Decimals(effective_time_s, 6)),
            of(|circuit| circuit.quality_factor),
            of(|circuit| circuit.static_capacitance_f),
            of(|circuit| circuit.capacitance_ratio),
            loss,
            loss_sigma,
            TableValue::of(reason, TableValue::Text),
            TableValue::Whole(clock(&epochs, stored.epoch)),
            TableValue::Flag(is_simulated),
        ])?;
    }
    table.finish()
}

/// One row for each reading of each sweep, with all of its digits and the settings of the fit:
/// `rigd fit` of the file gives the resonances of the run.
///
/// # Errors
/// Errors of the writer, or a record that cannot be understood.
pub fn readings_csv(records: &[StoredRecord], out: &mut impl Write) -> Result<(), ExportError> {
    let columns = ["sweep", "purpose", "step", "reading"];
    let (is_simulated, epochs) = (is_simulated(records), epochs(records));
    let columns = [&columns[..], &READING, &OF_SWEEP, &["clock", "is_simulated"]].concat();
    let mut table = Table::new(&columns, out)?;
    for stored in records.iter().filter(|stored| stored.kind == "sweep") {
        let Record::Sweep(sweep) = stored.record()? else { continue };
        for (index, one) in sweep.readings.iter().enumerate() {
            let head = [
                TableValue::Whole(sweep.number),
                TableValue::Text(sweep.purpose.name()),
                TableValue::of(sweep.step.as_deref(), TableValue::Text),
                TableValue::Whole(index as u64 + 1),
            ];
            let cells = head.into_iter().chain(reading(one)).chain(of_sweep(&sweep, index));
            let clock = TableValue::Whole(clock(&epochs, stored.epoch));
            table.row(cells.chain([clock, TableValue::Flag(is_simulated)]))?;
        }
    }
    table.finish()
}

/// One row for each reading of a sweep, with the columns of [`readings_csv`] except those that name the
/// sweep.
///
/// # Errors
/// Errors of the writer.
pub fn sweep_csv(sweep: &Sweep, out: &mut impl Write) -> Result<(), ExportError> {
    let mut table = Table::new(&[&READING[..], &OF_SWEEP].concat(), out)?;
    for (index, one) in sweep.readings.iter().enumerate() {
        table.row(reading(one).into_iter().chain(of_sweep(sweep, index)))?;
    }
    table.finish()
}

/// One row for each reading of each search for a surface. The surface is empty if it was not found.
///
/// # Errors
/// Errors of the writer, or a record that cannot be understood.
pub fn searches_csv(records: &[StoredRecord], out: &mut impl Write) -> Result<(), ExportError> {
    let columns =
        ["step", "direction", "angle_deg", "surface_mm", "surface_sigma_mm", "try", "position_mm"];
    let (is_simulated, epochs) = (is_simulated(records), epochs(records));
    let mut table =
        Table::new(&[&columns[..], &READING, &["clock", "is_simulated"]].concat(), out)?;
    let is_search = |stored: &&StoredRecord| stored.kind.starts_with("surface_");
    for stored in records.iter().filter(is_search) {
        let (step, at, [position, sigma], trail) = match stored.record()? {
            Record::SurfaceFound(found) => {
                let place = TableValue::with_sigma(found.position_mm, found.sigma_mm);
                (found.step, found.pose, place, found.trail)
            }
            Record::SurfaceNotFound(lost) => {
                (lost.step, lost.pose, [TableValue::Empty; 2], lost.trail)
            }
            _ => continue,
        };
        let (direction, angle) = pose(Some(at));
        for (index, tried) in trail.iter().enumerate() {
            let head = [
                TableValue::Text(&step),
                direction,
                angle,
                position,
                sigma,
                TableValue::Whole(index as u64 + 1),
                TableValue::Decimals(tried.position_mm, POSITION_DECIMALS),
            ];
            let cells = head.into_iter().chain(reading(&tried.reading));
            let clock = TableValue::Whole(clock(&epochs, stored.epoch));
            table.row(cells.chain([clock, TableValue::Flag(is_simulated)]))?;
        }
    }
    table.finish()
}

/// The columns of a reading.
const READING: [&str; 7] = [
    "frequency_hz",
    "resistance_ohm",
    "reactance_ohm",
    "started_s",
    "settle_s",
    "integration_s",
    "flag",
];

fn reading(reading: &ReadingRecord) -> [TableValue<'static>; 7] {
    [
        TableValue::Exact(reading.frequency_hz),
        TableValue::of(reading.resistance_ohm, TableValue::Exact),
        TableValue::of(reading.reactance_ohm, TableValue::Exact),
        TableValue::Exact(reading.started_s),
        TableValue::Exact(reading.settle_s),
        TableValue::Exact(reading.integration_s),
        TableValue::Text(reading.flag.name()),
    ]
}

/// Whether the fit used a reading, and the settings of the fit.
const OF_SWEEP: [&str; 13] = [
    "is_used",
    "fit_min_hz",
    "fit_max_hz",
    "fit_noise_at_ten_cycles",
    "fit_noise_degrees_of_freedom",
    "fit_timing",
    "fit_always_loss",
    "fit_target_sigma_hz",
    "fit_near_resonance_hz",
    "fit_near_quality_factor",
    "fit_near_static_capacitance_f",
    "fit_near_capacitance_ratio",
    "fit_near_loss_tangent",
];

fn of_sweep(sweep: &Sweep, reading: usize) -> [TableValue<'static>; 13] {
    let fit = sweep.fit;
    let noise = fit.and_then(|fit| fit.noise);
    let near = fit.and_then(|fit| fit.near);
    [
        TableValue::Flag(reading >= sweep.probe_readings && sweep.readings[reading].is_normal()),
        TableValue::of(fit, |fit| TableValue::Exact(fit.window_hz[0])),
        TableValue::of(fit, |fit| TableValue::Exact(fit.window_hz[1])),
        TableValue::of(noise, |noise| TableValue::Exact(noise.at_ten_cycles)),
        TableValue::of(noise, |noise| TableValue::Exact(noise.degrees_of_freedom)),
        TableValue::of(fit, |fit| TableValue::Text(fit.timing.name())),
        TableValue::of(fit, |fit| TableValue::Flag(fit.always_loss)),
        TableValue::of(fit.and_then(|fit| fit.target_sigma_hz), TableValue::Exact),
        TableValue::of(near, |near| TableValue::Exact(near.resonance_hz)),
        TableValue::of(near, |near| TableValue::Exact(near.circuit.quality_factor)),
        TableValue::of(near, |near| TableValue::Exact(near.circuit.static_capacitance_f)),
        TableValue::of(near, |near| TableValue::Exact(near.circuit.capacitance_ratio)),
        TableValue::of(near, |near| TableValue::Exact(near.circuit.loss_tangent)),
    ]
}

/// Whether no real device took part in the run; false if its first record is missing.
fn is_simulated(records: &[StoredRecord]) -> bool {
    let first = records.first().map(StoredRecord::record);
    matches!(first, Some(Ok(Record::RunStarted(started))) if started.is_simulated)
}

/// Direction and contact angle.
fn pose(pose: Option<Pose>) -> (TableValue<'static>, TableValue<'static>) {
    let direction = TableValue::of(pose, |pose| TableValue::Text(pose.direction.name()));
    (direction, TableValue::of(pose, |pose| TableValue::Exact(pose.angle_deg)))
}
