//! One sweep as Touchstone, the format of network analyzers.
//!
//! # Source
//! Touchstone File Format Specification, EIA/IBIS Open Forum, version 1.1: option line p. 4–6. Of the
//! parameters of one port, S is the one that every reader knows.

use std::io::Write;

use rig_record::Sweep;

use super::ExportError;

/// The reference resistance of the reflection coefficient, Ω.
const REFERENCE_OHM: f64 = 50.0;

/// The reflection coefficient at each frequency of a sweep, by rising frequency, with all digits: of
/// the last reading without a flag. The format has no times, and a fit takes the readings as settled; it
/// suits sweeps on a grid, not planned ones, which stay at few frequencies while the sensor rings.
///
/// # Errors
/// Errors of the writer.
pub fn touchstone(sweep: &Sweep, out: &mut impl Write) -> Result<(), ExportError> {
    let step = sweep.step.as_deref().unwrap_or("no step");
    writeln!(out, "! rigd: sweep {} ({}), {step}", sweep.number, sweep.purpose.name())?;
    writeln!(out, "# HZ S RI R {REFERENCE_OHM}")?;
    let normal = sweep.readings.iter().filter(|reading| reading.is_normal());
    let mut rows: Vec<_> = normal
        .filter_map(|reading| Some((reading.frequency_hz, reading.impedance_ohm()?)))
        .collect();
    // A frequency may be given once: the last reading is the most settled one.
    rows.reverse();
    rows.sort_by(|(one, _), (other, _)| one.total_cmp(other));
    rows.dedup_by_key(|(frequency_hz, _)| *frequency_hz);
    for (frequency_hz, (resistance_ohm, reactance_ohm)) in rows {
        let (below, above) = (resistance_ohm - REFERENCE_OHM, resistance_ohm + REFERENCE_OHM);
        let size = above.mul_add(above, reactance_ohm * reactance_ohm);
        let real = below.mul_add(above, reactance_ohm * reactance_ohm) / size;
        let imaginary = 2.0 * REFERENCE_OHM * reactance_ohm / size;
        writeln!(out, "{frequency_hz:?} {real:?} {imaginary:?}")?;
    }
    Ok(())
}
