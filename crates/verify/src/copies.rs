//! Readings of one record that are those of another one.
//!
//! Noise makes no two readings the same to the last digit. Two records of one epoch that share several readings at
//! other times are a measurement and its copy. Only one epoch is looked at: a simulated bench that is started again has
//! the same noise again.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use crate::{
    finding::{Check, Findings},
    fit,
    record::{FitNoise, Reading, Record, Tried},
};

/// Two records with this many readings in common are no chance. A frozen analyzer gives one impedance again and again,
/// so that only different ones count.
const SHARED: usize = 3;
/// A reading is looked for in this many records that have it: of a frozen analyzer all have it.
const HOLDERS_MAX: usize = 8;
/// The noise that is assumed before any readings, relative, and its degrees of freedom.
const ASSUMED: FitNoise = FitNoise { at_ten_cycles: 0.005, degrees_of_freedom: 4.0 };
/// The variance is known to be that of readings if it is this many times what is left of the assumed one.
const KNOWN: f64 = 4.0;
/// And the noise if it is this large, relative: many times the last digit of an analyzer.
const NOISE_MIN: f64 = 1e-3;

/// Frequency, resistance and reactance of a reading, bit by bit.
type Key = [u64; 3];

/// The readings of an epoch so far.
#[derive(Debug, Default)]
pub(crate) struct Copies {
    epoch: u64,
    /// The records that have a reading, each with the time at which it began, s.
    holders: HashMap<Key, Vec<(u64, f64)>>,
    /// The different impedances that two records share.
    shared: BTreeMap<[u64; 2], BTreeSet<[u64; 2]>>,
    /// The stated noise with the most degrees of freedom.
    noise: Option<FitNoise>,
}

impl Copies {
    /// Takes in the readings of a record.
    pub(crate) fn take(
        &mut self,
        (seq, epoch): (u64, u64),
        record: &Record,
        findings: &mut Findings,
    ) {
        if epoch != self.epoch {
            self.end(findings);
            self.epoch = epoch;
        }
        match record {
            Record::Sweep(sweep) => {
                self.know(sweep.fit.as_ref().and_then(|fit| fit.noise));
                self.add(seq, sweep.readings.iter());
            }
            Record::Descended(descended) => self.add(seq, descended.readings.iter()),
            Record::SurfaceFound(found) => self.add_trail(seq, &found.trail),
            Record::SurfaceNotFound(of) | Record::SurfaceChecked(of) => {
                self.add_trail(seq, &of.trail);
            }
            _ => {}
        }
    }

    fn know(&mut self, noise: Option<FitNoise>) {
        let known = self.noise.map_or(0.0, |noise| noise.degrees_of_freedom);
        self.noise = noise.filter(|noise| noise.degrees_of_freedom > known).or(self.noise);
    }

    fn add_trail(&mut self, seq: u64, trail: &[Tried]) {
        self.add(seq, trail.iter().map(|tried| &tried.reading));
    }

    fn add<'a>(&mut self, seq: u64, readings: impl Iterator<Item = &'a Reading>) {
        for reading in readings.filter(|reading| fit::is_usable(reading)) {
            let (Some(re), Some(im)) = (reading.resistance_ohm, reading.reactance_ohm) else {
                continue;
            };
            let impedance = [re.to_bits(), im.to_bits()];
            let key = [reading.frequency_hz.to_bits(), impedance[0], impedance[1]];
            let (begin_s, holders) = (reading.begin_s(), self.holders.entry(key).or_default());
            // The same reading in two records is no copy.
            for (other, _) in holders.iter().filter(|(of, at_s)| *of != seq && *at_s != begin_s) {
                self.shared.entry([*other, seq]).or_default().insert(impedance);
            }
            if holders.len() < HOLDERS_MAX {
                holders.push((seq, begin_s));
            }
        }
    }

    /// The records of the epoch are complete: with its noise known, those that share readings are copies.
    pub(crate) fn end(&mut self, findings: &mut Findings) {
        let Self { shared, noise, .. } = std::mem::take(self);
        if !noise.is_some_and(is_known) {
            return;
        }
        for ([first, seq], impedances) in shared {
            let count = impedances.len();
            if count >= SHARED {
                let what = format!("readings that are those of record {first} to the last digit");
                let limit = Some((SHARED - 1).to_string());
                findings.within(Check::Distinct, seq, what, "other noise", count, limit);
            }
        }
    }
}

/// Whether readings have shown this noise: without any noise, what is stated is the rest of the assumed one.
fn is_known(noise: FitNoise) -> bool {
    let assumed = ASSUMED.at_ten_cycles.powi(2) * ASSUMED.degrees_of_freedom;
    let variance = noise.at_ten_cycles.powi(2);
    variance >= NOISE_MIN.powi(2) && variance * noise.degrees_of_freedom >= KNOWN * assumed
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sweep with these impedances, ohm, which begins at a time, s.
    fn sweep(started_s: f64, impedances: &[f64], at_ten_cycles: f64) -> Record {
        let reading = |ohm: &f64| {
            serde_json::json!({
                "frequency_hz": 140.0, "resistance_ohm": ohm, "reactance_ohm": -2.0 * ohm,
                "started_s": started_s, "settle_s": 0.1, "integration_s": 0.1,
            })
        };
        let readings: Vec<_> = impedances.iter().map(reading).collect();
        let noise =
            serde_json::json!({ "at_ten_cycles": at_ten_cycles, "degrees_of_freedom": 40.0 });
        let record = serde_json::json!({
            "kind": "sweep", "number": 1, "purpose": "touch", "readings": readings, "probe_readings": 0,
            "fit": { "window_hz": [130.0, 150.0], "timing": "any-phase", "noise": noise },
            "outcome": { "status": "refused", "reason": "the fit did not converge" },
        });
        serde_json::from_value(record).expect("a record")
    }

    fn found(second: &Record, epoch: u64) -> usize {
        let (mut copies, mut findings) = (Copies::default(), Findings::default());
        let first = sweep(1.0, &[1.0, 2.0, 3.0, 4.0], 0.006);
        copies.take((1, 1), &first, &mut findings);
        copies.take((2, epoch), second, &mut findings);
        copies.end(&mut findings);
        findings.0.len()
    }

    #[test]
    fn a_record_with_three_readings_of_another_one_is_a_copy() {
        assert_eq!(found(&sweep(5.0, &[9.0, 1.0, 2.0, 3.0], 0.006), 1), 1);
        assert_eq!(found(&sweep(5.0, &[9.0, 1.0, 2.0], 0.006), 1), 0);
        // A frozen analyzer.
        assert_eq!(found(&sweep(5.0, &[1.0, 1.0, 1.0, 2.0], 0.006), 1), 0);
        // The same readings, which two records tell.
        assert_eq!(found(&sweep(1.0, &[1.0, 2.0, 3.0, 4.0], 0.006), 1), 0);
        // A bench that was started again.
        assert_eq!(found(&sweep(5.0, &[1.0, 2.0, 3.0, 4.0], 0.006), 2), 0);
    }

    #[test]
    fn readings_without_known_noise_may_be_the_same() {
        let without = |at_ten_cycles| {
            let (mut copies, mut findings) = (Copies::default(), Findings::default());
            for (seq, started_s) in [(1, 1.0), (2, 5.0)] {
                let record = sweep(started_s, &[1.0, 2.0, 3.0, 4.0], at_ten_cycles);
                copies.take((seq, 1), &record, &mut findings);
            }
            copies.end(&mut findings);
            findings.0.len()
        };
        // What is left of the assumed noise after forty values without any.
        assert_eq!(without(0.0016), 0);
        assert_eq!(without(0.006), 1);
    }
}
