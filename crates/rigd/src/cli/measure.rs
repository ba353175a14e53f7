//! `rigd measure`: one sweep by hand, with the probe clear or at a given height.

use std::{
    io::{self, Write as _},
    path::Path,
};

use clap::Args;
use rig_engine::Command;
use rig_model::{Deg, Mm, Position, SweepRequest};
use rig_report::export;
use rig_store::{BenchSettings, Reader, ReadingRecord, Sweep};
use serde::Serialize;

use super::{
    Failure,
    args::BenchArgs,
    moves::{linear_target, positions, rotary_target},
    outcome::OutcomeView,
    session::{LeftInContact, Session, with_rig},
    table::{concluded, facts, print, print_json},
};
use crate::{
    rig::{RequestRefusal, Status},
    sweep_form::SweepForm,
    sweeps,
};

#[derive(Debug, Args)]
pub(super) struct MeasureArgs {
    #[command(flatten)]
    sweep: SweepForm,
    /// Lower the probe to this height for it, and retract it afterwards
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    at_mm: Option<f64>,
    /// Tilt the sample to this angle before
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    angle_deg: Option<f64>,
    /// Print the readings as CSV, which `rigd fit -` takes
    #[arg(long, conflicts_with = "json")]
    csv: bool,
    /// Print JSON for a program instead of text for a person
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    bench: BenchArgs,
}

/// The sweep, and the moves before it.
struct Order {
    sweep: SweepRequest,
    linear: Option<Position<Mm>>,
    rotary: Option<Position<Deg>>,
}

/// The sweep and the state of the rig after it.
pub(super) struct Measurement {
    pub(super) sweep: Sweep,
    status: Status,
}

/// A sweep for a program.
#[derive(Debug, Serialize)]
struct MeasureView {
    #[serde(flatten)]
    outcome: OutcomeView,
    #[serde(skip_serializing_if = "Option::is_none")]
    linear_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    rotary_deg: Option<f64>,
    /// What a survey says of the bench.
    #[serde(skip_serializing_if = "Option::is_none")]
    bench: Option<BenchSettings>,
    /// Number of first readings that only helped to find the resonance.
    probe_readings: usize,
    readings: Vec<ReadingRecord>,
}

pub(super) fn measure(args: &MeasureArgs) -> Result<(), Failure> {
    let rig = args.bench.rig.load()?;
    let limits = rig.file.limits;
    let order = Order {
        sweep: args.sweep.request(&limits.analyzer)?,
        linear: args.at_mm.map(|mm| linear_target(&limits, mm)).transpose()?,
        rotary: args.angle_deg.map(|deg| rotary_target(&limits, deg)).transpose()?,
    };
    let data = &args.bench.data.dir();
    let rest = limits.linear.rest_target().position();
    let operator = args.bench.operator.name();
    let measured = with_rig(rig, data, &operator, LeftInContact::Refuse, async |session| {
        if let Some(target) = order.rotary {
            session.carry_out(Command::MoveRotary(target)).await?;
        }
        let Some(target) = order.linear else { return sweep(session, order.sweep, data).await };
        session.carry_out(Command::MoveLinear(target)).await?;
        let measured = sweep(session, order.sweep, data).await?;
        session.carry_out(Command::MoveLinear(rest)).await?;
        Ok(measured)
    })?;
    show(args, measured)
}

/// Makes a sweep in a session, and finds it in the journal.
pub(super) async fn sweep(
    session: &mut Session,
    request: SweepRequest,
    data: &Path,
) -> Result<Measurement, Failure> {
    let number = session.handle.sweep(request, session.operator()).await?;
    let status = session.finished().await?;
    let found = sweeps::find(&Reader::open(data)?, status.session, number)?;
    let sweep = found.ok_or_else(|| RequestRefusal::Journal {
        reason: status.journal_error.clone().unwrap_or_else(|| "the sweep is missing".into()),
    })?;
    Ok(Measurement { sweep, status })
}

/// What a survey says of the bench, for a person.
fn of_bench(bench: &BenchSettings) -> [(&'static str, String); 4] {
    let BenchSettings { phase_rad, phase_sigma_rad, first_gap_s, mode_sigma, .. } = bench;
    let dispersion = format!(
        "{:+.1} ± {:.1} pF for each factor e of the frequency",
        1e12 * bench.dispersion_f,
        1e12 * bench.dispersion_sigma_f
    );
    let phase = format!("{:.4}° ± {:.4}°", phase_rad.to_degrees(), phase_sigma_rad.to_degrees());
    let first_gap = format!("{:+.2} ms beside the recorded time", 1e3 * first_gap_s);
    let modes = format!("none, ± {:.2} % of the first", 100.0 * mode_sigma);
    [
        ("analyzer phase", phase),
        ("first gap", first_gap),
        ("dispersion", dispersion),
        ("second modes", modes),
    ]
}

fn show(args: &MeasureArgs, measured: Measurement) -> Result<(), Failure> {
    let refusal = OutcomeView::from(&measured.sweep.outcome).refusal();
    concluded(print_all(args, measured), refusal.map_or(Ok(()), Err))
}

fn print_all(
    args: &MeasureArgs,
    Measurement { sweep, status }: Measurement,
) -> Result<(), Failure> {
    let outcome = OutcomeView::from(&sweep.outcome);
    let bench = sweep.fit.as_ref().and_then(|fit| fit.bench);
    if args.csv {
        let mut out = io::stdout();
        export::sweep_csv(&sweep, &mut out)?;
        out.flush().map_err(|source| Failure::System { what: "stdout", source })
    } else if args.json {
        print_json(&MeasureView {
            outcome,
            linear_mm: status.snapshot.linear.map(Position::value),
            rotary_deg: status.snapshot.rotary.map(Position::value),
            bench,
            probe_readings: sweep.probe_readings,
            readings: sweep.readings,
        })
    } else {
        let mut rows = outcome.rows();
        rows.push(("readings", sweep.readings.len().to_string()));
        rows.extend(bench.iter().flat_map(of_bench));
        rows.extend(positions(&status));
        print(&facts(&rows))
    }
}
