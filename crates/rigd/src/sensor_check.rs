//! The check of the free sensor: the sweeps that it makes, and its record. A command of the terminal makes it, and clients
//! of a daemon.

mod remote;

use std::{
    ops::RangeInclusive,
    path::{Path, PathBuf},
};

use rig_commission::{
    Basis, Finding, Kind, last_accepted,
    sensor::{FreeSweep, NoSensor, SensorSweeps, judge},
};
use rig_model::{AnalyzerRange, DriveLevel, RigTime, SweepMethod, SweepRequest, Window};
use rig_store::{Sweep, SweepOutcome};

use crate::{
    calibrations::{self, CalibrationsError, Witness},
    sweep_form::{SweepFaults, checked},
};
pub(crate) use remote::{SensorCheckRefusal, SensorWatch};

/// The window in which the free resonance is looked for, Hz, unless another one is asked for.
pub(crate) const WINDOW: Window = Window { min_hz: 125.0, max_hz: 160.0 };

/// Time for which the sensor is watched, minutes, unless another one is asked for: it shows a drift.
pub(crate) const MINUTES: u32 = 10;

/// The times that may be asked for, minutes.
pub(crate) const MINUTES_RANGE: RangeInclusive<u32> = 1..=1440;

/// The highest level, V; less where the rig allows less.
const LEVEL_V: f64 = 5.0;

/// Levels of the drive of a round, as parts of the highest one.
const LEVELS: [f64; 3] = [0.1, 0.4, 1.0];

/// Fewest rounds.
const ROUNDS: usize = 6;

/// Standard deviation that each sweep has to reach, Hz, and the time for it, s.
const SIGMA_HZ: f64 = 0.05;
const SWEEP_S: f64 = 30.0;

/// A survey of the bench in each round, s: it finds second modes.
const SURVEY_S: u32 = 60;

/// The sweeps of a check, for a bench whose analyzer can make them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SensorCheck {
    window: Window,
    /// The highest level, V.
    highest_v: f64,
    minutes: u32,
}

/// A rig whose probe is clear, and which makes one sweep after the other.
pub(crate) trait FreeSensor: Send {
    /// What ends the check.
    type Trouble: Send;

    /// The time by the clock of the rig.
    fn now(&self) -> RigTime;

    /// Makes a sweep and waits for its end.
    fn sweep(
        &mut self,
        request: SweepRequest,
    ) -> impl Future<Output = Result<Sweep, Self::Trouble>> + Send;

    /// The sweeps so far, after each one.
    fn measured(&mut self, _so_far: &SensorSweeps) {}
}

/// A check without a record.
#[derive(Debug, thiserror::Error)]
pub(crate) enum NoRecord {
    #[error(transparent)]
    Calibrations(#[from] CalibrationsError),
    #[error(transparent)]
    NoSensor(#[from] NoSensor),
}

impl SensorCheck {
    /// A check of so many minutes with a resonance in this window.
    ///
    /// # Errors
    /// [`SweepFaults`] of the window with this analyzer.
    pub(crate) fn new(
        window: Window,
        minutes: u32,
        range: &AnalyzerRange,
    ) -> Result<Self, SweepFaults> {
        let check = Self { window, highest_v: LEVEL_V.min(range.max_level_v), minutes };
        for request in check.levels().into_iter().chain([check.survey()]) {
            checked(request, range)?;
        }
        Ok(check)
    }

    fn levels(&self) -> [SweepRequest; 3] {
        LEVELS.map(|part| self.request(part * self.highest_v, SweepMethod::Adaptive))
    }

    fn survey(&self) -> SweepRequest {
        self.request(self.highest_v, SweepMethod::Survey { seconds: SURVEY_S })
    }

    const fn request(&self, volt: f64, method: SweepMethod) -> SweepRequest {
        SweepRequest {
            window: self.window,
            method,
            target_sigma_hz: SIGMA_HZ,
            time_limit_s: SWEEP_S,
            cycles: 10,
            settle_s: 0.5,
            level: DriveLevel { volt },
        }
    }

    /// Makes the sweeps at each level, and surveys, in rounds until the time is over.
    ///
    /// # Errors
    /// Those of the sensor; the sweeps so far are in the journal.
    pub(crate) async fn watch<S: FreeSensor>(
        &self,
        sensor: &mut S,
    ) -> Result<SensorSweeps, S::Trouble> {
        let begun = sensor.now();
        let mut all = SensorSweeps::default();
        for round in 0.. {
            let is_over = sensor.now().since(begun).as_secs() >= 60 * u64::from(self.minutes);
            if is_over && round >= ROUNDS {
                break;
            }
            for request in self.levels() {
                let volt = request.level.volt;
                match free_sweep(&sensor.sweep(request).await?, volt) {
                    Some(sweep) => all.sweeps.push(sweep),
                    None => all.refused += 1,
                }
                sensor.measured(&all);
            }
            let surveyed = sensor.sweep(self.survey()).await?;
            all.surveys.extend(free_sweep(&surveyed, self.highest_v));
            if let SweepOutcome::Refused { reason } = surveyed.outcome {
                all.survey_refused.get_or_insert(reason);
            }
            sensor.measured(&all);
        }
        Ok(all)
    }
}

/// Judges the sweeps against the record before, keeps the new record, and returns both. A record that is not accepted is
/// kept as well.
///
/// # Errors
/// [`NoRecord`].
pub(crate) fn keep(
    watched: &SensorSweeps,
    basis: &Basis,
    data: &Path,
    witness: Witness,
) -> Result<(Finding, PathBuf), NoRecord> {
    let records = calibrations::read(data)?;
    let finding = judge(watched, last_accepted(Kind::Sensor, &records, basis))?;
    let path = calibrations::write(basis, data, (Kind::Sensor, finding.clone()), witness)?;
    Ok((finding, path))
}

/// What an accepted sweep with a circuit says of the free sensor.
fn free_sweep(sweep: &Sweep, level_v: f64) -> Option<FreeSweep> {
    let SweepOutcome::Accepted { resonance_hz, circuit, effective_time_s, .. } = sweep.outcome
    else {
        return None;
    };
    let circuit = circuit?;
    // Few readings do not say for which time the resonance holds. A drift that is accepted changes it by 10⁻⁴ Hz meanwhile.
    let (first, last) = (sweep.readings.first()?, sweep.readings.last()?);
    let middle_s = 0.5 * (first.started_s + last.started_s);
    Some(FreeSweep {
        at_s: effective_time_s.unwrap_or(middle_s),
        level_v,
        resonance_hz,
        quality_factor: circuit.quality_factor,
        capacitance_ratio: circuit.capacitance_ratio,
        capacitance_f: circuit.static_capacitance_f,
        loss_tangent: circuit.loss_tangent,
    })
}
