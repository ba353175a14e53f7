//! A run as files that other programs read.
//!
//! Each function writes one file from the records of a run. The same records give the same bytes,
//! and neither wall time nor the id of the run is in them: two runs of the same protocol with the
//! same seed give the same files. Numbers are written with the fewest digits from which the same
//! number is read again.

use std::io::{self, Write};

use crate::{Reading, Record, StoreError, StoredRecord, SweepVerdict};

/// Why a run could not be written.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The file cannot be written.
    #[error("export")]
    Io(#[from] io::Error),
    /// A record cannot be understood.
    #[error("export")]
    Store(#[from] StoreError),
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

/// One row for each touch.
///
/// # Errors
/// What writing reports, or a record that cannot be understood.
pub fn touches_csv(records: &[StoredRecord], out: &mut impl Write) -> Result<(), ExportError> {
    out.write_all(
        b"step,phase,sample,direction,angle_deg,repeat,no_load_sweep,no_load_hz,no_load_sigma_hz,\
          sweep,resonance_hz,sigma_hz,shift_hz,shift_sigma_hz,surface_mm,surface_sigma_mm,\
          indentation_mm\n",
    )?;
    for stored in records.iter().filter(|stored| stored.kind == "touch_result") {
        let Record::TouchResult(result) = stored.record()? else { continue };
        let touch = &result.touch;
        let (step, phase, sample) = (text(&touch.step), touch.phase.name(), text(&touch.sample));
        let (direction, angle) = (touch.pose.direction.name(), touch.pose.angle_deg);
        write!(out, "{step},{phase},{sample},{direction},{angle},{},", touch.repeat)?;
        let (number, hz, sigma) =
            (result.no_load_sweep, result.no_load_hz, result.no_load_sigma_hz);
        write!(out, "{number},{hz},{sigma},")?;
        let (number, hz, sigma) = (result.sweep, result.resonance_hz, result.sigma_hz);
        write!(out, "{number},{hz},{sigma},{},{},", result.shift_hz, result.shift_sigma_hz)?;
        let (surface, sigma) = (result.surface_mm, result.surface_sigma_mm);
        writeln!(out, "{surface},{sigma},{}", result.indentation_mm)?;
    }
    Ok(())
}

/// One row for each sweep: what it was for and what was made of it. Columns that do not apply are
/// empty.
///
/// # Errors
/// What writing reports, or a record that cannot be understood.
pub fn sweeps_csv(records: &[StoredRecord], out: &mut impl Write) -> Result<(), ExportError> {
    out.write_all(
        b"sweep,purpose,step,direction,angle_deg,readings,verdict,resonance_hz,sigma_hz,\
          moment_s,quality_factor,static_capacitance_f,capacitance_ratio,loss_tangent,reason\n",
    )?;
    for stored in records.iter().filter(|stored| stored.kind == "sweep") {
        let Record::Sweep(sweep) = stored.record()? else { continue };
        let step = text(sweep.step.as_deref().unwrap_or_default());
        write!(out, "{},{},{step},", sweep.number, sweep.purpose.name())?;
        match sweep.pose {
            Some(pose) => write!(out, "{},{},", pose.direction.name(), pose.angle_deg)?,
            None => out.write_all(b",,")?,
        }
        write!(out, "{},", sweep.readings.len())?;
        match &sweep.verdict {
            SweepVerdict::Accepted { resonance_hz, sigma_hz, moment_s, circuit } => {
                let moment = moment_s.map_or_else(String::new, |moment_s| moment_s.to_string());
                write!(out, "accepted,{resonance_hz},{sigma_hz},{moment},")?;
                if let Some(circuit) = circuit {
                    let (q, c0) = (circuit.quality_factor, circuit.static_capacitance_f);
                    let (ratio, loss) = (circuit.capacitance_ratio, circuit.loss_tangent);
                    writeln!(out, "{q},{c0},{ratio},{loss},")?;
                } else {
                    out.write_all(b",,,,\n")?;
                }
            }
            SweepVerdict::Refused { reason } => writeln!(out, "refused,,,,,,,,{}", text(reason))?,
        }
    }
    Ok(())
}

/// One row for each impedance reading of each sweep.
///
/// # Errors
/// What writing reports, or a record that cannot be understood.
pub fn readings_csv(records: &[StoredRecord], out: &mut impl Write) -> Result<(), ExportError> {
    out.write_all(
        b"sweep,purpose,step,reading,frequency_hz,resistance_ohm,reactance_ohm,started_s,settle_s,\
          integration_s,flag,is_used\n",
    )?;
    for stored in records.iter().filter(|stored| stored.kind == "sweep") {
        let Record::Sweep(sweep) = stored.record()? else { continue };
        let step = text(sweep.step.as_deref().unwrap_or_default());
        for (index, reading) in sweep.readings.iter().enumerate() {
            write!(out, "{},{},{step},{},", sweep.number, sweep.purpose.name(), index + 1)?;
            write_reading(reading, out)?;
            writeln!(out, ",{}", index >= sweep.looks)?;
        }
    }
    Ok(())
}

/// One row for each place that was tried on the way to a surface, with the reading there.
///
/// # Errors
/// What writing reports, or a record that cannot be understood.
pub fn searches_csv(records: &[StoredRecord], out: &mut impl Write) -> Result<(), ExportError> {
    out.write_all(
        b"step,direction,angle_deg,surface_mm,surface_sigma_mm,try,position_mm,frequency_hz,\
          resistance_ohm,reactance_ohm,started_s,settle_s,integration_s,flag\n",
    )?;
    for stored in records.iter().filter(|stored| stored.kind == "surface_found") {
        let Record::SurfaceFound(surface) = stored.record()? else { continue };
        let (step, direction) = (text(&surface.step), surface.pose.direction.name());
        let (angle, position, sigma) =
            (surface.pose.angle_deg, surface.position_mm, surface.sigma_mm);
        for (index, tried) in surface.trail.iter().enumerate() {
            write!(out, "{step},{direction},{angle},{position},{sigma},{},", index + 1)?;
            write!(out, "{},", tried.position_mm)?;
            write_reading(&tried.reading, out)?;
            out.write_all(b"\n")?;
        }
    }
    Ok(())
}

/// The columns of a reading.
fn write_reading(reading: &Reading, out: &mut impl Write) -> io::Result<()> {
    let (resistance, reactance) = (reading.resistance_ohm, reading.reactance_ohm);
    write!(out, "{},{resistance},{reactance},", reading.frequency_hz)?;
    let (started, settle) = (reading.started_s, reading.settle_s);
    write!(out, "{started},{settle},{},{}", reading.integration_s, reading.flag.name())
}

/// A text as a CSV field, in quotes where it needs them (RFC 4180, section 2).
fn text(field: &str) -> String {
    if field.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", field.replace('"', "\"\""))
    } else {
        field.to_owned()
    }
}
