//! `rigd check-bench`: the daily check of a bench.

use std::path::PathBuf;

use clap::Args;
use rig_commission::{
    check::{CheckVerdict, Quantity},
    control::{AVERAGE_LIMIT, SCORE_LIMIT},
};
use rig_store::{Reader, Run};
use serde::Serialize;

use super::{
    Failure,
    args::{BenchArgs, OutputArgs, temperature},
    commission::CommissionFailure,
    run::{BenchKind, replay_protocol},
    session::{LeftInContact, with_rig},
    table::{columns, concluded, note, print, print_json},
};
use crate::{
    bench_check::{self, KeptCheck},
    calibrations::Witness,
    loaded_rig::LoadedRig,
    run_files,
};

/// Touches a hard block level and at 45° to both sides, and two reference samples, and compares them with the checks before,
/// each quantity on a chart of its own. It says accepted, look, or not to be trusted; the reports of the runs that follow
/// cite it. The charts begin after ten checks
#[derive(Debug, Args)]
pub(super) struct CheckBenchArgs {
    /// Protocol of the touches on the block [default: the shipped config/protocols/check-block.toml]
    #[arg(long, value_name = "PROTOCOL")]
    block: Option<PathBuf>,
    /// Protocol of the touches on the two reference samples [default: the shipped config/protocols/check-references.toml]
    #[arg(long, value_name = "PROTOCOL")]
    references: Option<PathBuf>,
    /// Judge two runs of these protocols that no check has used, the one on the references begun within 12 h of the end of the
    /// other, and move nothing
    #[arg(long, num_args = 2, value_names = ["BLOCK", "REFERENCES"], conflicts_with_all = ["block", "references"])]
    runs: Vec<String>,
    #[command(flatten)]
    bench: BenchArgs,
    /// Temperature at the bench, for the record
    #[arg(long, value_name = "°C", allow_negative_numbers = true, value_parser = temperature)]
    temperature: Option<f64>,
    #[command(flatten)]
    output: OutputArgs,
}

/// A check, for a program.
#[derive(Debug, Serialize)]
struct CheckView {
    /// `accepted`, `look` or `not to be trusted`.
    verdict: &'static str,
    reason: Option<String>,
    /// Number of checks since the bench was changed.
    checks: usize,
    quantities: Vec<QuantityView>,
    record: PathBuf,
    /// The page with the charts.
    trend: PathBuf,
}

/// A quantity of a check, for a program.
#[derive(Debug, Serialize)]
struct QuantityView {
    name: &'static str,
    unit: &'static str,
    value: f64,
    /// Mean and standard deviation of the checks before; none for the first ones.
    mean: Option<f64>,
    sigma: Option<f64>,
    score: Option<f64>,
    average: Option<f64>,
    is_alarm: bool,
}

pub(super) fn check_bench(args: &CheckBenchArgs) -> Result<(), Failure> {
    let (data, rig) = (args.bench.data.dir(), args.bench.rig.load()?);
    let (name, basis) = (rig.file.name.clone(), rig.basis());
    let names = match args.runs.as_slice() {
        [block, references] => [block.clone(), references.clone()],
        _ => measure(args, rig)?,
    };
    let reader =
        Reader::open(&data).map_err(|source| Failure::Data { data: data.clone(), source })?;
    let runs: [Run; 2] = [reader.find(&names[0])?, reader.find(&names[1])?];
    let witness = Witness {
        person: args.bench.operator.name().as_str().to_owned(),
        journal: runs.iter().map(|run| run.id.to_string()).collect(),
        temperature_c: args.temperature,
    };
    let [block, references] = &runs;
    let kept = bench_check::keep((&name, &basis), &data, &reader, [block, references], witness)
        .map_err(CommissionFailure::from)?;
    let verdict = match kept.judged.verdict {
        CheckVerdict::Accepted => Ok(()),
        verdict => Err(Failure::NotAccepted { verdict: verdict.name() }),
    };
    concluded(say(&kept, args.output.json), verdict)
}

/// What is said before the touches on the block.
const BLOCK_PART: &str = "Touches on the block: only the surfaces that they find are used. Its sweeps are not, and the report of \
                          that run may have them as refused.";

/// Makes both runs of a check, and returns their ids.
fn measure(args: &CheckBenchArgs, rig: LoadedRig) -> Result<[String; 2], Failure> {
    let data = args.bench.data.dir();
    let files = [args.block.as_deref(), args.references.as_deref()];
    let protocols = bench_check::protocols(files, &rig.facts().with_data(&data))?;
    let (kind, operator) = (BenchKind::of(&rig), args.bench.operator.name());
    let touches = args.output.touches(&data);
    with_rig(rig, &data, &operator, LeftInContact::Refuse, async |session| {
        let [on_block, on_references] = protocols;
        if !args.output.json {
            note(BLOCK_PART);
        }
        // A refused sweep on the block is no failure of the check.
        let block = replay_protocol(session, on_block, kind, None).await?;
        run_files::write(&data, block)?;
        let references = replay_protocol(session, on_references, kind, touches).await?;
        run_files::write(&data, references)?;
        Ok([block.to_string(), references.to_string()])
    })
}

fn say(kept: &KeptCheck, is_json: bool) -> Result<(), Failure> {
    let KeptCheck { values, judged, record, trend } = kept;
    let against = |index: usize| judged.charts.get(index)?.last()?.against;
    let of = |(index, quantity): (usize, Quantity)| {
        let against = against(index);
        QuantityView {
            name: quantity.name(),
            unit: quantity.unit(),
            value: values.get(quantity),
            mean: against.map(|against| against.mean),
            sigma: against.map(|against| against.sigma),
            score: against.map(|against| against.score),
            average: against.map(|against| against.average),
            is_alarm: against.is_some_and(|against| against.is_alarm()),
        }
    };
    let quantities: Vec<_> = Quantity::ALL.into_iter().enumerate().map(of).collect();
    let reason = judged.reason();
    if is_json {
        return print_json(&CheckView {
            verdict: judged.verdict.name(),
            reason,
            checks: judged.count,
            quantities,
            record: record.clone(),
            trend: trend.clone(),
        });
    }
    let number = |value: Option<f64>, decimals: usize| {
        value.map_or_else(|| "–".to_owned(), |value| format!("{value:.decimals$}"))
    };
    let row = |(quantity, view): (Quantity, &QuantityView)| {
        vec![
            match quantity.unit() {
                "1" => quantity.text().to_owned(),
                unit => format!("{}, {unit}", quantity.text()),
            },
            format!("{:.4}", view.value),
            number(view.mean, 4),
            number(view.sigma, 4),
            number(view.score, 1),
            number(view.average, 2),
        ]
    };
    let rows: Vec<_> = Quantity::ALL.into_iter().zip(&quantities).map(row).collect();
    print(&columns(&["quantity", "value", "mean", "sigma", "score", "average"], &rows))?;
    print(&format!("limits: score {SCORE_LIMIT}, average of the scores {AVERAGE_LIMIT:.2}"))?;
    print(&format!("\ncheck {}: {}", judged.count, judged.verdict.name()))?;
    for alarm in &judged.alarms {
        note(&format!("→ {}: {}", alarm.quantity.text(), alarm.quantity.advice()));
    }
    if let Some(reason) = reason.filter(|_| judged.alarms.is_empty()) {
        note(&reason);
    }
    note(&format!("record: {}\ntrend:  {}", record.display(), trend.display()));
    Ok(())
}
