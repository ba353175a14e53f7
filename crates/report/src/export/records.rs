//! The rows of the tables of sweeps, readings and searches.

use rig_record::{
    Circuit, Pose, ReadingRecord, Record, StoredRecord, SurfaceReading, Sweep, SweepOutcome,
};

use super::{
    error::ExportError,
    table::{POSITION_DECIMALS, TableValue},
};
use crate::data::{clock, epochs};

/// Takes one row.
pub(super) type Take<'a> = &'a mut dyn FnMut(&[TableValue<'_>]) -> Result<(), ExportError>;

/// The last columns of every table but that of the touches.
#[derive(Debug)]
pub(super) struct Ends {
    epochs: Vec<u64>,
    is_simulated: bool,
}

impl Ends {
    pub(super) const fn new(epochs: Vec<u64>, is_simulated: bool) -> Self {
        Self { epochs, is_simulated }
    }

    pub(super) fn of(records: &[StoredRecord]) -> Self {
        let first = records.first().map(StoredRecord::record);
        // False if the first record is missing.
        let is_simulated =
            matches!(first, Some(Ok(Record::RunStarted(started))) if started.is_simulated);
        Self { epochs: epochs(records), is_simulated }
    }

    /// Number of the clock, and whether the run is simulated.
    fn at(&self, stored: &StoredRecord) -> [TableValue<'static>; 2] {
        let clock = TableValue::Whole(clock(&self.epochs, stored.epoch));
        [clock, TableValue::Flag(self.is_simulated)]
    }
}

/// Each sweep with its record.
pub(super) fn each_sweep(
    records: &[StoredRecord],
    mut take: impl FnMut(&StoredRecord, &Sweep) -> Result<(), ExportError>,
) -> Result<(), ExportError> {
    for stored in records.iter().filter(|stored| stored.kind == "sweep") {
        if let Record::Sweep(sweep) = stored.record()? {
            take(stored, &sweep)?;
        }
    }
    Ok(())
}

/// The rows of the table of sweeps.
pub(super) fn sweeps(
    records: &[StoredRecord],
    ends: &Ends,
    take: Take<'_>,
) -> Result<(), ExportError> {
    each_sweep(records, |stored, sweep| take(&of_sweep(sweep, ends, stored)))
}

/// The row of a sweep. Columns that do not apply are empty.
pub(super) fn of_sweep<'a>(
    sweep: &'a Sweep,
    ends: &Ends,
    stored: &StoredRecord,
) -> [TableValue<'a>; 22] {
    let (direction, angle) = pose(sweep.pose);
    let (outcome, found, reason) = match &sweep.outcome {
        SweepOutcome::Accepted { resonance_hz, sigma_hz, effective_time_s, circuit, .. } => {
            ("accepted", Some((*resonance_hz, *sigma_hz, *effective_time_s, *circuit)), None)
        }
        SweepOutcome::Refused { reason } => ("refused", None, Some(reason.as_str())),
    };
    let [resonance, sigma] = found
        .map_or([TableValue::Empty; 2], |(resonance_hz, sigma_hz, ..)| {
            TableValue::with_sigma(resonance_hz, sigma_hz)
        });
    let moment = found.and_then(|(_, _, effective_time_s, _)| effective_time_s);
    let circuit = found.and_then(|(.., circuit)| circuit);
    // Six digits are more than any sweep gives.
    let of = |value: fn(Circuit) -> f64| {
        TableValue::of(circuit.map(value), |value| TableValue::Digits(value, 6))
    };
    let sigma_of = |sigma: fn(Circuit) -> Option<f64>| {
        TableValue::of(circuit.and_then(sigma), |sigma| TableValue::Digits(sigma, 3))
    };
    let loss = circuit.map(|circuit| (circuit.loss_tangent, circuit.loss_tangent_sigma));
    let [loss, loss_sigma] = match loss {
        Some((loss, Some(sigma))) => TableValue::with_sigma(loss, sigma),
        Some((loss, None)) => [TableValue::Digits(loss, 6), TableValue::Empty],
        None => [TableValue::Empty; 2],
    };
    let [clock, is_simulated] = ends.at(stored);
    [
        TableValue::Whole(sweep.number),
        TableValue::Text(sweep.purpose.name()),
        TableValue::of(sweep.step.as_deref(), TableValue::Text),
        direction,
        angle,
        TableValue::of(sweep.level_v, TableValue::Exact),
        TableValue::Whole(sweep.readings.len() as u64),
        TableValue::Text(outcome),
        resonance,
        sigma,
        TableValue::of(moment, |effective_time_s| TableValue::Decimals(effective_time_s, 6)),
        of(|circuit| circuit.quality_factor),
        sigma_of(|circuit| circuit.quality_factor_sigma),
        of(|circuit| circuit.static_capacitance_f),
        sigma_of(|circuit| circuit.static_capacitance_sigma_f),
        of(|circuit| circuit.capacitance_ratio),
        sigma_of(|circuit| circuit.capacitance_ratio_sigma),
        loss,
        loss_sigma,
        TableValue::of(reason, TableValue::Text),
        clock,
        is_simulated,
    ]
}

/// The rows of the table of readings.
pub(super) fn readings(
    records: &[StoredRecord],
    ends: &Ends,
    take: Take<'_>,
) -> Result<(), ExportError> {
    each_sweep(records, |stored, sweep| {
        for (index, one) in sweep.readings.iter().enumerate() {
            let head = [
                TableValue::Whole(sweep.number),
                TableValue::Text(sweep.purpose.name()),
                TableValue::of(sweep.step.as_deref(), TableValue::Text),
                TableValue::Whole(index as u64 + 1),
            ];
            let (reading, fit) = (reading(one), fit(sweep, index));
            take(&[&head[..], &reading, &fit, &ends.at(stored)].concat())?;
        }
        Ok(())
    })
}

/// The readings of one sweep, with the columns of [`readings`] except those that name the sweep.
pub(super) fn of_one_sweep(sweep: &Sweep, take: Take<'_>) -> Result<(), ExportError> {
    let rows = sweep.readings.iter().enumerate();
    rows.map(|(index, one)| [&reading(one)[..], &fit(sweep, index)].concat())
        .try_for_each(|row| take(&row))
}

/// The rows of the table of searches.
pub(super) fn searches(
    records: &[StoredRecord],
    ends: &Ends,
    take: Take<'_>,
) -> Result<(), ExportError> {
    let is_search = |stored: &&StoredRecord| stored.kind.starts_with("surface_");
    for stored in records.iter().filter(is_search) {
        let nowhere = [TableValue::Empty; 2];
        let (step, purpose, at, place, trail): (_, _, _, _, Vec<SurfaceReading>) = match stored
            .record()?
        {
            Record::SurfaceFound(found) => {
                let place = TableValue::with_sigma(found.position_mm, found.sigma_mm);
                (found.step, "search", found.pose, place, found.trail)
            }
            Record::SurfaceNotFound(lost) => (lost.step, "search", lost.pose, nowhere, lost.trail),
            Record::SurfaceChecked(checked) => {
                (checked.step, "check", checked.pose, nowhere, checked.trail)
            }
            _ => continue,
        };
        let (direction, angle) = pose(Some(at));
        for (index, tried) in trail.iter().enumerate() {
            let head = [
                TableValue::Text(&step),
                TableValue::Text(purpose),
                direction,
                angle,
                place[0],
                place[1],
                TableValue::Whole(index as u64 + 1),
                TableValue::Decimals(tried.position_mm, POSITION_DECIMALS),
            ];
            take(&[&head[..], &reading(&tried.reading), &ends.at(stored)].concat())?;
        }
    }
    Ok(())
}

pub(super) fn reading(reading: &ReadingRecord) -> [TableValue<'static>; 7] {
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

fn fit(sweep: &Sweep, reading: usize) -> [TableValue<'static>; 21] {
    let fit = sweep.fit;
    let noise = fit.and_then(|fit| fit.noise);
    let near = fit.and_then(|fit| fit.near);
    let bench = fit.and_then(|fit| fit.bench);
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
        TableValue::of(bench, |bench| TableValue::Exact(bench.phase_rad)),
        TableValue::of(bench, |bench| TableValue::Exact(bench.phase_sigma_rad)),
        TableValue::of(bench, |bench| TableValue::Exact(bench.first_gap_s)),
        TableValue::of(bench, |bench| TableValue::Exact(bench.dispersion_f)),
        TableValue::of(bench, |bench| TableValue::Exact(bench.dispersion_sigma_f)),
        TableValue::of(bench, |bench| TableValue::Exact(bench.mode_sigma)),
        TableValue::of(bench, |bench| TableValue::Exact(bench.surveyed_hz[0])),
        TableValue::of(bench, |bench| TableValue::Exact(bench.surveyed_hz[1])),
    ]
}

/// Direction and contact angle.
fn pose(pose: Option<Pose>) -> (TableValue<'static>, TableValue<'static>) {
    let direction = TableValue::of(pose, |pose| TableValue::Text(pose.direction.name()));
    (direction, TableValue::of(pose, |pose| TableValue::Exact(pose.angle_deg)))
}
