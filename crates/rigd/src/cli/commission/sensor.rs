//! `rigd commission sensor`: the free sensor, by sweeps that this command makes.

use std::path::Path;

use clap::Args;
use rig_commission::{
    Kind, holding,
    sensor::{FreeSweep, SensorSweeps, judge},
};
use rig_model::{AnalyzerRange, DriveLevel, SweepMethod, SweepRequest, Window};
use rig_store::SweepOutcome;

use super::{CommissionFailure, blocks::rows, judged};
use crate::{
    calibrations::{self, Witness},
    cli::{
        Failure,
        args::BenchArgs,
        measure,
        screen::say,
        session::{LeftInContact, Session, with_rig},
        table::{facts, print},
    },
    sweep_form::{SweepFaults, checked},
};

/// Levels of the drive of a round, as parts of the highest one.
const LEVELS: [f64; 3] = [0.1, 0.4, 1.0];

/// The highest level, V; less where the rig allows less.
pub(in crate::cli) const LEVEL_V: f64 = 5.0;

/// Fewest rounds.
const ROUNDS: usize = 6;

/// What each sweep has to reach, Hz, and the time for it, s.
const SIGMA_HZ: f64 = 0.05;
const SWEEP_S: f64 = 30.0;

/// A survey of the bench in each round, s: it finds second modes.
const SURVEY_S: u32 = 60;

/// Measures the free sensor: resonance, quality, coupling, capacitance and loss, their change against the record before, the
/// drift, the linearity with the level of the drive, and second modes. The probe stays clear, and no sample is needed
#[derive(Debug, Args)]
pub(super) struct SensorArgs {
    /// Time for which the sensor is watched, by the clock of the rig; a drift shows in ten minutes, and a warm-up in two hours
    #[arg(long, value_name = "MIN", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=1440))]
    minutes: u32,
    #[command(flatten)]
    free: FreeArgs,
    #[command(flatten)]
    bench: BenchArgs,
    /// Temperature at the bench, for the record
    #[arg(long, value_name = "°C", allow_negative_numbers = true)]
    temperature: Option<f64>,
}

/// Where the free resonance is.
#[derive(Debug, Clone, Args)]
pub(in crate::cli) struct FreeArgs {
    /// Lower end of the window of the free resonance
    #[arg(long, value_name = "HZ", default_value_t = 125.0)]
    min_hz: f64,
    /// Upper end of that window
    #[arg(long, value_name = "HZ", default_value_t = 160.0)]
    max_hz: f64,
}

impl FreeArgs {
    fn request(
        &self,
        volt: f64,
        method: SweepMethod,
        range: &AnalyzerRange,
    ) -> Result<SweepRequest, SweepFaults> {
        let request = SweepRequest {
            window: Window { min_hz: self.min_hz, max_hz: self.max_hz },
            method,
            target_sigma_hz: SIGMA_HZ,
            time_limit_s: SWEEP_S,
            cycles: 10,
            settle_s: 0.5,
            level: DriveLevel { volt },
        };
        checked(request, range)
    }
}

pub(super) fn sensor(args: &SensorArgs) -> Result<(), Failure> {
    let (data, operator) = (args.bench.data.dir(), args.bench.operator.name());
    let rig = args.bench.rig.load()?;
    let (basis, range) = (rig.basis(), rig.file.limits.analyzer);
    let level_v = LEVEL_V.min(range.max_level_v);
    // What cannot be asked for is told before anything is opened.
    args.free.request(level_v, SweepMethod::Adaptive, &range)?;
    let records = calibrations::read(&data).map_err(CommissionFailure::from)?;
    let (watched, session) =
        with_rig(rig, &data, &operator, LeftInContact::Refuse, async |session| {
            let watched =
                watch(session, &args.free, args.minutes, (level_v, &range), &data).await?;
            Ok((watched, session.status.borrow().session.to_string()))
        })?;
    let now_s = jiff::Timestamp::now().as_second();
    let before = holding(Kind::Sensor, &records, &basis, now_s).ok();
    let finding = judge(&watched, before).map_err(CommissionFailure::from)?;
    let witness = Witness {
        person: operator.as_str().to_owned(),
        journal: vec![session],
        temperature_c: args.temperature,
    };
    let path = calibrations::write(&basis, &data, (Kind::Sensor, finding.clone()), witness)
        .map_err(CommissionFailure::from)?;
    print(&facts(&rows(&finding)))?;
    say(&format!("Record: {}", path.display()));
    judged(Kind::Sensor, finding.verdict)
}

/// Sweeps of the free sensor at each level, and surveys, in rounds until the time is over.
pub(in crate::cli) async fn watch(
    session: &mut Session,
    free: &FreeArgs,
    minutes: u32,
    (level_v, range): (f64, &AnalyzerRange),
    data: &Path,
) -> Result<SensorSweeps, Failure> {
    let begun = session.status.borrow().now;
    let mut all = SensorSweeps::default();
    for round in 0.. {
        let now = session.status.borrow().now;
        let is_over = now.since(begun).as_secs() >= 60 * u64::from(minutes);
        if is_over && round >= ROUNDS {
            break;
        }
        for part in LEVELS {
            let request = free.request(part * level_v, SweepMethod::Adaptive, range)?;
            match free_sweep(
                &measure::sweep(session, request, data).await?.sweep.outcome,
                part * level_v,
            ) {
                Some(sweep) => all.sweeps.push(sweep),
                None => all.refused += 1,
            }
        }
        let survey = free.request(level_v, SweepMethod::Survey { seconds: SURVEY_S }, range)?;
        let surveyed = measure::sweep(session, survey, data).await?.sweep.outcome;
        all.surveys.extend(free_sweep(&surveyed, level_v));
        if let SweepOutcome::Refused { reason } = surveyed {
            all.survey_refused.get_or_insert(reason);
        }
    }
    Ok(all)
}

/// What an accepted sweep with a circuit and a time says of the free sensor.
fn free_sweep(outcome: &SweepOutcome, level_v: f64) -> Option<FreeSweep> {
    let SweepOutcome::Accepted { resonance_hz, circuit, effective_time_s, .. } = *outcome else {
        return None;
    };
    let circuit = circuit?;
    Some(FreeSweep {
        at_s: effective_time_s?,
        level_v,
        resonance_hz,
        quality_factor: circuit.quality_factor,
        capacitance_ratio: circuit.capacitance_ratio,
        capacitance_f: circuit.static_capacitance_f,
        loss_tangent: circuit.loss_tangent,
    })
}
