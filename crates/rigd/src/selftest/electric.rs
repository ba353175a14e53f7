//! The analyzer with what is at its terminals: noise near the mains and its multiples, and one impedance at
//! two levels.

use rig_analyzer::{Analyzer, AnalyzerError};
use rig_files::rig_file::RigFile;
use rig_link::StopSignal;
use rig_model::{DriveLevel, SweepPoint, with_causes};

use super::{Check, NO_ANSWER, Quantity};

/// Multiples of the mains of 50 and 60 Hz, and two frequencies beside them.
const FREQUENCIES_HZ: [f64; 6] = [100.0, 110.0, 120.0, 150.0, 165.0, 180.0];

/// Readings at each frequency.
const READINGS: usize = 20;

/// Waiting after each change of the frequency or the level, s. The motion of a sensor decays with the time constant
/// Q/(π f), 0.7 s for Q 300 at 140 Hz; after 6 s, 0.02 % of it is left. A shorter wait has the decay among the noise.
const SETTLE_S: f64 = 6.0;

/// The capacitance at a frequency differs from the median of all by more than this part of it where the sensor
/// moves. That of a capacitor is the same at all frequencies; that of a sensor whose resonance is 140 Hz and whose motional
/// capacitance is 0.04 of the static one differs by a quarter at 150 Hz.
const MOVING_PART: f64 = 0.2;

/// Advice for noise where what is at the terminals does not move.
const NOISE_AT_REST: &str = "where it is larger at multiples of the mains than beside them, look for a ground loop and \
                             for motor cables beside that of the sensor; elsewhere look at the clamps and the fixture";

/// Advice for noise near a resonance.
const NOISE_OF_MOTION: &str = "the sensor moves at this frequency, so that noise of its motion cannot be told from noise of the mains \
                               or of the analyzer; repeat with a capacitor of 27 nF in its place";

/// Cycles of a reading.
const CYCLES: u32 = 10;

/// The noise of a reading of ten cycles at 1 V, with a sensor at rest, percent.
const NOISE_LIMIT_PERCENT: f64 = 1.0;

/// The difference of one impedance at a level and at half of it, percent.
const LINEARITY_LIMIT_PERCENT: f64 = 1.0;

/// The level of the checks, V; less where the rig allows less.
const LEVEL_V: f64 = 1.0;

/// Mean and standard deviation of magnitudes.
#[derive(Debug, Clone, Copy)]
struct Spread {
    mean: f64,
    sigma: f64,
}

pub(super) async fn checks(analyzer: &mut Analyzer, rig: &RigFile) -> Vec<Check> {
    match measure(analyzer, rig).await {
        Ok(checks) => checks,
        Err(error) => vec![Check::problem("analyzer", "readings", with_causes(&error), NO_ANSWER)],
    }
}

async fn measure(analyzer: &mut Analyzer, rig: &RigFile) -> Result<Vec<Check>, AnalyzerError> {
    let (low_hz, high_hz) = rig.limits.analyzer.frequency_hz;
    let volt = LEVEL_V.min(rig.limits.analyzer.max_level_v);
    analyzer.configure(DriveLevel { volt }).await?;
    let (mut checks, mut flagged, mut spreads) = (Vec::new(), 0, Vec::new());
    let is_allowed = |hz: &f64| low_hz <= *hz && *hz <= high_hz;
    if !FREQUENCIES_HZ.iter().any(is_allowed) {
        let [first, .., last] = FREQUENCIES_HZ;
        let text = format!(
            "not measured: frequency_hz of [analyzer] is {low_hz} Hz to {high_hz} Hz, and the check needs one of {first} Hz to \
             {last} Hz"
        );
        let advice = "widen frequency_hz in the rig file";
        return Ok(vec![Check::problem("analyzer", "noise and linearity", text, advice)]);
    }
    for frequency_hz in FREQUENCIES_HZ.into_iter().filter(is_allowed) {
        let (found, flags) = spread(analyzer, frequency_hz).await?;
        flagged += flags;
        spreads.extend(found.map(|spread| (frequency_hz, spread)));
    }
    checks.extend(noise(&spreads));
    if let Some(&(frequency_hz, full)) = spreads.first() {
        analyzer.configure(DriveLevel { volt: 0.5 * volt }).await?;
        let (half, flags) = spread(analyzer, frequency_hz).await?;
        flagged += flags;
        if let Some(half) = half {
            let count = READINGS as f64;
            let relative = |spread: Spread| spread.sigma / spread.mean / count.sqrt();
            let quantity = Quantity {
                value: 100.0 * (half.mean / full.mean - 1.0).abs(),
                uncertainty: Some(100.0 * relative(half).hypot(relative(full))),
                limit: LINEARITY_LIMIT_PERCENT,
                unit: "%",
            };
            let advice = "measure nearer to the level of the protocol, and look for an overload at the display";
            let check = format!("impedance at {} V against {volt} V", 0.5 * volt);
            checks.push(Check::quantity("analyzer", check, quantity, advice));
        }
    }
    let quantity =
        Quantity { value: flagged as f64, uncertainty: None, limit: 0.0, unit: "readings" };
    let advice = "connect the sensor or a capacitor of 27 nF to the terminals";
    checks.push(Check::quantity("analyzer", "overload or low signal", quantity, advice));
    Ok(checks)
}

/// The checks of the noise, from the spread at each frequency in Hz.
fn noise(spreads: &[(f64, Spread)]) -> Vec<Check> {
    // Proportional to the capacitance.
    let capacitance = |&(frequency_hz, spread): &(f64, Spread)| 1.0 / (frequency_hz * spread.mean);
    let mut sorted: Vec<f64> = spreads.iter().map(capacitance).collect();
    sorted.sort_by(f64::total_cmp);
    let median = sorted.get(sorted.len() / 2).copied().unwrap_or_default();
    let check = |seen: &(f64, Spread)| {
        let (frequency_hz, Spread { mean, sigma }) = *seen;
        let noise = 100.0 * sigma / mean;
        let quantity = Quantity {
            value: noise,
            uncertainty: Some(noise / (2.0 * (READINGS as f64 - 1.0)).sqrt()),
            limit: NOISE_LIMIT_PERCENT,
            unit: "%",
        };
        let is_moving = (capacitance(seen) / median - 1.0).abs() > MOVING_PART;
        let advice = if is_moving { NOISE_OF_MOTION } else { NOISE_AT_REST };
        Check::quantity("analyzer", format!("noise at {frequency_hz} Hz"), quantity, advice)
    };
    spreads.iter().map(check).collect()
}

/// The spread of the magnitudes at a frequency, and the number of flagged readings. None if fewer than two
/// readings have a value.
async fn spread(
    analyzer: &mut Analyzer,
    frequency_hz: f64,
) -> Result<(Option<Spread>, usize), AnalyzerError> {
    // The first one settles; the others follow at the same frequency.
    let settle_s = |n| if n == 0 { SETTLE_S } else { 0.0 };
    let point = |n| SweepPoint { frequency_hz, settle_s: settle_s(n), cycles: CYCLES };
    let points: Vec<_> = (0..READINGS).map(point).collect();
    let readings = analyzer.measure(&points, &StopSignal::new()).await?;
    let flagged = readings.iter().filter(|reading| reading.flag().is_some()).count();
    let sound = readings.iter().filter(|reading| reading.flag().is_none());
    let all: Vec<f64> =
        sound.filter_map(|reading| Some(reading.impedance()?.magnitude_ohm())).collect();
    let count = all.len() as f64;
    let mean = all.iter().sum::<f64>() / count;
    let variance = all.iter().map(|ohm| (ohm - mean).powi(2)).sum::<f64>() / (count - 1.0);
    let spread = (all.len() >= 2 && mean > 0.0).then(|| Spread { mean, sigma: variance.sqrt() });
    Ok((spread, flagged))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mains_are_not_named_for_noise_where_the_sensor_moves() {
        // The magnitudes of 27 nF, and half of the capacitance near the resonance.
        let ohm = |hz: f64, part: f64| 1.0 / (std::f64::consts::TAU * hz * 27e-9 * part);
        let at = |hz: f64, part: f64| {
            let mean = ohm(hz, part);
            (hz, Spread { mean, sigma: 0.02 * mean })
        };
        let advice = |part: f64| -> Vec<Option<&str>> {
            let spreads = FREQUENCIES_HZ.map(|hz| at(hz, if hz == 150.0 { part } else { 1.0 }));
            noise(&spreads).iter().map(|check| check.advice).collect()
        };
        let [rest, motion] = [Some(NOISE_AT_REST), Some(NOISE_OF_MOTION)];
        assert_eq!(advice(1.0), [rest; 6]);
        assert_eq!(advice(0.5), [rest, rest, rest, motion, rest, rest]);
        assert!(noise(&[]).is_empty());
    }
}
