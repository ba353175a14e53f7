//! `rigd commission latency`: the latency between stage and analyzer by the touches of a run, as the journal has them.

use clap::Args;
use rig_commission::Kind;
use rig_store::Reader;

use super::{CommissionFailure, tell};
use crate::{
    block_runs::{Bench, keep_latency},
    cli::{
        Failure,
        args::{BenchArgs, temperature},
    },
};

/// Finds how much later than its readings say the analyzer integrates, by a run whose descents have two speeds in turn, such as
/// one of `config/protocols/latency.toml`
#[derive(Debug, Args)]
pub(super) struct LatencyArgs {
    /// Run: its name such as `latency-1`, its id, or `latest`
    run: String,
    #[command(flatten)]
    bench: BenchArgs,
    /// Temperature at the bench, for the record
    #[arg(long, value_name = "°C", allow_negative_numbers = true, value_parser = temperature)]
    temperature: Option<f64>,
}

pub(super) fn latency(args: &LatencyArgs) -> Result<(), Failure> {
    let data = args.bench.data.dir();
    let rig = args.bench.rig.load()?;
    let reader =
        Reader::open(&data).map_err(|source| Failure::Data { data: data.clone(), source })?;
    let run = reader.find(&args.run)?;
    let (person, stated) =
        (args.bench.operator.name().as_str().to_owned(), rig.file.limits.analyzer.stream);
    let bench = Bench { rig: &rig.file.name, basis: &rig.basis(), data: &data };
    let kept = keep_latency((&reader, &run), stated, bench, (person, args.temperature));
    let (finding, path) = kept.map_err(CommissionFailure::from)?;
    tell((Kind::Latency, finding), None, &path)
}
