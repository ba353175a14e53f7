//! `rigd commission touches`: how well touches on a hard block repeat, as the journal has them.

use clap::Args;
use rig_commission::Kind;
use rig_store::Reader;

use super::{CommissionFailure, tell};
use crate::{
    block_runs::{Bench, keep_repeatability},
    cli::{
        Failure,
        args::{BenchArgs, temperature},
    },
};

/// Judges how well the level touches of a run on a hard block repeat, such as one of `config/protocols/touches.toml`: ten
/// of them range over at most two fine steps of the search and 25 µm, and do not drift
#[derive(Debug, Args)]
pub(super) struct TouchesArgs {
    /// Run on the block: its name such as `touches-1`, its id, or `latest`
    run: String,
    #[command(flatten)]
    bench: BenchArgs,
    /// Temperature at the bench, for the record
    #[arg(long, value_name = "°C", allow_negative_numbers = true, value_parser = temperature)]
    temperature: Option<f64>,
}

pub(super) fn touches(args: &TouchesArgs) -> Result<(), Failure> {
    let data = args.bench.data.dir();
    let rig = args.bench.rig.load()?;
    let reader =
        Reader::open(&data).map_err(|source| Failure::Data { data: data.clone(), source })?;
    let run = reader.find(&args.run)?;
    let person = args.bench.operator.name().as_str().to_owned();
    let bench = Bench { rig: &rig.file.name, basis: &rig.basis(), data: &data };
    let kept = keep_repeatability((&reader, &run), bench, (person, args.temperature));
    let (finding, path) = kept.map_err(CommissionFailure::from)?;
    tell((Kind::Touches, finding), None, &path)
}
