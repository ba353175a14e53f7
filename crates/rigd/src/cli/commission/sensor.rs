//! `rigd commission sensor`: the free sensor, by sweeps that this command makes.

use std::path::Path;

use clap::Args;
use rig_commission::Kind;
use rig_model::{AnalyzerRange, RigTime, SweepRequest, Window};
use rig_store::Sweep;

use super::{CommissionFailure, tell};
use crate::{
    calibrations::Witness,
    cli::{
        Failure,
        args::{BenchArgs, temperature},
        measure,
        session::{LeftInContact, Session, with_rig},
    },
    sensor_check::{self, FreeSensor, MINUTES, SensorCheck, WINDOW},
    sweep_form::SweepFaults,
};

/// Measures the free sensor: resonance, quality, coupling, capacitance and loss, their change against the record before, the
/// drift, the linearity with the level of the drive, and second modes. The probe stays clear, and no sample is needed
#[derive(Debug, Args)]
pub(super) struct SensorArgs {
    /// Time for which the sensor is watched, by the clock of the rig; a drift shows in ten minutes, and a warm-up in two hours
    #[arg(long, value_name = "MIN", default_value_t = MINUTES, value_parser = clap::value_parser!(u32).range(1..=1440))]
    minutes: u32,
    #[command(flatten)]
    free: FreeArgs,
    #[command(flatten)]
    bench: BenchArgs,
    /// Temperature at the bench, for the record
    #[arg(long, value_name = "°C", allow_negative_numbers = true, value_parser = temperature)]
    temperature: Option<f64>,
}

/// Where the free resonance is.
#[derive(Debug, Clone, Args)]
pub(in crate::cli) struct FreeArgs {
    /// Lower end of the window of the free resonance
    #[arg(long, value_name = "HZ", default_value_t = WINDOW.min_hz)]
    min_hz: f64,
    /// Upper end of that window
    #[arg(long, value_name = "HZ", default_value_t = WINDOW.max_hz)]
    max_hz: f64,
}

impl FreeArgs {
    /// The check of a sensor in this window.
    ///
    /// # Errors
    /// [`SweepFaults`].
    pub(in crate::cli) fn check(
        &self,
        minutes: u32,
        range: &AnalyzerRange,
    ) -> Result<SensorCheck, SweepFaults> {
        let Self { min_hz, max_hz } = *self;
        SensorCheck::new(Window { min_hz, max_hz }, minutes, range)
    }
}

/// The free sensor of a rig that is open during this command.
pub(in crate::cli) struct SensorOfSession<'a> {
    pub(in crate::cli) session: &'a mut Session,
    pub(in crate::cli) data: &'a Path,
}

impl FreeSensor for SensorOfSession<'_> {
    type Trouble = Failure;

    fn now(&self) -> RigTime {
        self.session.status.borrow().now
    }

    async fn sweep(&mut self, request: SweepRequest) -> Result<Sweep, Failure> {
        Ok(measure::sweep(self.session, request, self.data).await?.sweep)
    }
}

pub(super) fn sensor(args: &SensorArgs) -> Result<(), Failure> {
    let (data, operator) = (args.bench.data.dir(), args.bench.operator.name());
    let rig = args.bench.rig.load()?;
    let basis = rig.basis();
    // What cannot be asked for is told before anything is opened.
    let check = args.free.check(args.minutes, &rig.file.limits.analyzer)?;
    let (watched, session) =
        with_rig(rig, &data, &operator, LeftInContact::Refuse, async |session| {
            let watched = check.watch(&mut SensorOfSession { session, data: &data }).await?;
            Ok((watched, session.status.borrow().session.to_string()))
        })?;
    let witness = Witness {
        person: operator.as_str().to_owned(),
        journal: vec![session],
        temperature_c: args.temperature,
    };
    let kept = sensor_check::keep(&watched, &basis, &data, witness);
    let (finding, path) = kept.map_err(CommissionFailure::from)?;
    tell((Kind::Sensor, finding), None, &path)
}
