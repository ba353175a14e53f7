//! A run as files that other programs read.
//!
//! Each function writes one file from the records of a run. The same records give the same bytes,
//! and neither wall time nor the id of the run is in them: two runs of the same protocol with the
//! same seed give the same files. The table of touches needs the analysis of a run and is left to
//! `rigd`, which writes it as a [`Table`] too.

mod table;

use std::io::{self, Write};

use rig_record::{
    Circuit, Pose, Reading, Record, StoredRecord, Sweep, SweepVerdict, UnreadableRecord,
};
pub use table::{Cell, Table};

/// Why a run could not be written.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The file cannot be written.
    #[error("export")]
    Io(#[from] io::Error),
    /// A record cannot be understood.
    #[error("export")]
    Record(#[from] UnreadableRecord),
}

/// Every record in order, one JSON object a line: `seq`, `rig_us`, `digest` and the `record`.
///
/// # Errors
/// What writing reports.
pub fn jsonl(records: &[StoredRecord], out: &mut impl Write) -> Result<(), ExportError> {
    for StoredRecord { seq, rig_us, digest, payload, .. } in records {
        writeln!(
            out,
            r#"{{"seq":{seq},"rig_us":{rig_us},"digest":"{digest}","record":{payload}}}"#
        )?;
    }
    Ok(())
}

/// One row for each sweep: what it was for and what was made of it. Columns that do not apply are
/// empty.
///
/// # Errors
/// What writing reports, or a record that cannot be understood.
pub fn sweeps_csv(records: &[StoredRecord], out: &mut impl Write) -> Result<(), ExportError> {
    let columns = [
        "sweep",
        "purpose",
        "step",
        "direction",
        "angle_deg",
        "readings",
        "verdict",
        "resonance_hz",
        "sigma_hz",
        "moment_s",
        "quality_factor",
        "static_capacitance_f",
        "capacitance_ratio",
        "loss_tangent",
        "loss_tangent_sigma",
        "reason",
        "is_simulated",
    ];
    let is_simulated = is_simulated(records);
    let mut table = Table::new(&columns, out)?;
    for stored in records.iter().filter(|stored| stored.kind == "sweep") {
        let Record::Sweep(sweep) = stored.record()? else { continue };
        let (direction, angle) = pose(sweep.pose);
        let (verdict, found, reason) = match &sweep.verdict {
            SweepVerdict::Accepted { resonance_hz, sigma_hz, moment_s, circuit } => {
                ("accepted", Some((*resonance_hz, *sigma_hz, *moment_s, *circuit)), None)
            }
            SweepVerdict::Refused { reason } => ("refused", None, Some(reason.as_str())),
        };
        let [resonance, sigma] = found.map_or([Cell::Empty; 2], |(resonance_hz, sigma_hz, ..)| {
            Cell::with_sigma(resonance_hz, sigma_hz)
        });
        let moment = found.and_then(|(_, _, moment_s, _)| moment_s);
        let circuit = found.and_then(|(.., circuit)| circuit);
        // Their uncertainty is not in the journal; no sweep knows them better than this.
        let of = |value: fn(Circuit) -> f64| Cell::of(circuit.map(value), |v| Cell::Digits(v, 6));
        let loss = circuit.map(|circuit| (circuit.loss_tangent, circuit.loss_tangent_sigma));
        let [loss, loss_sigma] = match loss {
            Some((loss, Some(sigma))) => Cell::with_sigma(loss, sigma),
            Some((loss, None)) => [Cell::Digits(loss, 6), Cell::Empty],
            None => [Cell::Empty; 2],
        };
        table.row([
            Cell::Whole(sweep.number),
            Cell::Text(sweep.purpose.name()),
            Cell::of(sweep.step.as_deref(), Cell::Text),
            direction,
            angle,
            Cell::Whole(sweep.readings.len() as u64),
            Cell::Text(verdict),
            resonance,
            sigma,
            Cell::of(moment, |moment_s| Cell::Decimals(moment_s, 6)),
            of(|circuit| circuit.quality_factor),
            of(|circuit| circuit.static_capacitance_f),
            of(|circuit| circuit.capacitance_ratio),
            loss,
            loss_sigma,
            Cell::of(reason, Cell::Text),
            Cell::Flag(is_simulated),
        ])?;
    }
    table.finish()
}

/// One row for each impedance reading of each sweep, with all of its digits and with what the fit was
/// told: `rigd fit` finds in the file what was found in the run.
///
/// # Errors
/// What writing reports, or a record that cannot be understood.
pub fn readings_csv(records: &[StoredRecord], out: &mut impl Write) -> Result<(), ExportError> {
    let columns = ["sweep", "purpose", "step", "reading"];
    let is_simulated = is_simulated(records);
    let columns = [&columns[..], &READING, &OF_SWEEP, &["is_simulated"]].concat();
    let mut table = Table::new(&columns, out)?;
    for stored in records.iter().filter(|stored| stored.kind == "sweep") {
        let Record::Sweep(sweep) = stored.record()? else { continue };
        for (index, one) in sweep.readings.iter().enumerate() {
            let head = [
                Cell::Whole(sweep.number),
                Cell::Text(sweep.purpose.name()),
                Cell::of(sweep.step.as_deref(), Cell::Text),
                Cell::Whole(index as u64 + 1),
            ];
            let cells = head.into_iter().chain(reading(one)).chain(of_sweep(&sweep, index));
            table.row(cells.chain([Cell::Flag(is_simulated)]))?;
        }
    }
    table.finish()
}

/// One row for each reading of a sweep, with the same columns, but for those that tell sweeps apart.
///
/// # Errors
/// What writing reports.
pub fn sweep_csv(sweep: &Sweep, out: &mut impl Write) -> Result<(), ExportError> {
    let mut table = Table::new(&[&READING[..], &OF_SWEEP].concat(), out)?;
    for (index, one) in sweep.readings.iter().enumerate() {
        table.row(reading(one).into_iter().chain(of_sweep(sweep, index)))?;
    }
    table.finish()
}

/// One row for each reading on the way to a surface; those of a surface that was not found have none.
///
/// # Errors
/// What writing reports, or a record that cannot be understood.
pub fn searches_csv(records: &[StoredRecord], out: &mut impl Write) -> Result<(), ExportError> {
    let columns =
        ["step", "direction", "angle_deg", "surface_mm", "surface_sigma_mm", "try", "position_mm"];
    let is_simulated = is_simulated(records);
    let mut table = Table::new(&[&columns[..], &READING, &["is_simulated"]].concat(), out)?;
    let is_search = |stored: &&StoredRecord| stored.kind.starts_with("surface_");
    for stored in records.iter().filter(is_search) {
        let (step, at, [position, sigma], trail) = match stored.record()? {
            Record::SurfaceFound(found) => {
                let place = Cell::with_sigma(found.position_mm, found.sigma_mm);
                (found.step, found.pose, place, found.trail)
            }
            Record::SurfaceNotFound(lost) => (lost.step, lost.pose, [Cell::Empty; 2], lost.trail),
            _ => continue,
        };
        let (direction, angle) = pose(Some(at));
        for (index, tried) in trail.iter().enumerate() {
            let head = [
                Cell::Text(&step),
                direction,
                angle,
                position,
                sigma,
                Cell::Whole(index as u64 + 1),
                Cell::Decimals(tried.position_mm, POSITION_DECIMALS),
            ];
            let cells = head.into_iter().chain(reading(&tried.reading));
            table.row(cells.chain([Cell::Flag(is_simulated)]))?;
        }
    }
    table.finish()
}

/// A drive knows its position to a tenth of a micrometre, or of a millidegree, at best.
pub const POSITION_DECIMALS: usize = 4;

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

fn reading(reading: &Reading) -> [Cell<'static>; 7] {
    [
        Cell::Exact(reading.frequency_hz),
        Cell::of(reading.resistance_ohm, Cell::Exact),
        Cell::of(reading.reactance_ohm, Cell::Exact),
        Cell::Exact(reading.started_s),
        Cell::Exact(reading.settle_s),
        Cell::Exact(reading.integration_s),
        Cell::Text(reading.flag.name()),
    ]
}

/// What the fit made of a reading, and what it was told besides the readings.
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

fn of_sweep(sweep: &Sweep, reading: usize) -> [Cell<'static>; 13] {
    let fit = sweep.fit;
    let noise = fit.and_then(|fit| fit.noise);
    let near = fit.and_then(|fit| fit.near);
    [
        Cell::Flag(reading >= sweep.looks && sweep.readings[reading].is_normal()),
        Cell::of(fit, |fit| Cell::Exact(fit.window_hz[0])),
        Cell::of(fit, |fit| Cell::Exact(fit.window_hz[1])),
        Cell::of(noise, |noise| Cell::Exact(noise.at_ten_cycles)),
        Cell::of(noise, |noise| Cell::Exact(noise.degrees_of_freedom)),
        Cell::of(fit, |fit| Cell::Text(fit.timing.name())),
        Cell::of(fit, |fit| Cell::Flag(fit.always_loss)),
        Cell::of(fit.and_then(|fit| fit.target_sigma_hz), Cell::Exact),
        Cell::of(near, |near| Cell::Exact(near.resonance_hz)),
        Cell::of(near, |near| Cell::Exact(near.circuit.quality_factor)),
        Cell::of(near, |near| Cell::Exact(near.circuit.static_capacitance_f)),
        Cell::of(near, |near| Cell::Exact(near.circuit.capacitance_ratio)),
        Cell::of(near, |near| Cell::Exact(near.circuit.loss_tangent)),
    ]
}

/// Whether no real device took part in the run. No, where its first record is missing.
fn is_simulated(records: &[StoredRecord]) -> bool {
    let first = records.first().map(StoredRecord::record);
    matches!(first, Some(Ok(Record::RunStarted(started))) if started.is_simulated())
}

/// Direction and contact angle.
fn pose(pose: Option<Pose>) -> (Cell<'static>, Cell<'static>) {
    let direction = Cell::of(pose, |pose| Cell::Text(pose.direction.name()));
    (direction, Cell::of(pose, |pose| Cell::Exact(pose.angle_deg)))
}
