//! `rigd commission blocks`: the geometry of a bench from touches on hard blocks, as the journal has them.

use std::str::FromStr;

use clap::Args;
use rig_commission::Kind;
use rig_model::counted;
use rig_store::Reader;

use super::{CommissionFailure, tell};
use crate::{
    block_geometry::keep_geometry,
    block_runs::Bench,
    cli::{
        Failure,
        args::{BenchArgs, temperature},
    },
};

/// Fits surface, rotary axis, probe and the zero of the rotary stage to the touches of a run on a hard flat block, such as
/// one of `config/protocols/block.toml`, together with the error of the linear screw. Touches do not find the sign of the
/// rotary stage, nor the radius of the ball. Runs with other scales and zeros of the axes in the rig file are refused
#[derive(Debug, Args)]
pub(super) struct BlocksArgs {
    /// Run on the block: its name such as `block-1`, its id, or `latest`
    run: String,
    /// Run on a second block, and by how much it is higher, mm: it finds the zero of the rotary stage ten times better
    #[arg(long, value_name = "RUN=MM")]
    raised: Vec<Raised>,
    #[command(flatten)]
    bench: BenchArgs,
    /// Temperature at the bench, for the record
    #[arg(long, value_name = "°C", allow_negative_numbers = true, value_parser = temperature)]
    temperature: Option<f64>,
}

/// A run on a higher block.
#[derive(Debug, Clone)]
struct Raised {
    run: String,
    by_mm: f64,
}

impl FromStr for Raised {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let parts = text.rsplit_once('=').and_then(|(run, by)| Some((run, by.parse().ok()?)));
        match parts {
            Some((run, by_mm)) if f64::is_finite(by_mm) => Ok(Self { run: run.to_owned(), by_mm }),
            _ => Err("a run and a height in mm, such as block-2=10"),
        }
    }
}

pub(super) fn blocks(args: &BlocksArgs) -> Result<(), Failure> {
    let data = args.bench.data.dir();
    let rig = args.bench.rig.load()?;
    let reader =
        Reader::open(&data).map_err(|source| Failure::Data { data: data.clone(), source })?;
    let mut runs = vec![(reader.find(&args.run)?, 0.0)];
    for raised in &args.raised {
        runs.push((reader.find(&raised.run)?, raised.by_mm));
    }
    let person = (args.bench.operator.name().as_str().to_owned(), args.temperature);
    let stated = (&rig.file.limits, rig.file.rotary.scale.zero.value());
    let bench = Bench { rig: &rig.file.name, basis: &rig.basis(), data: &data };
    let kept = keep_geometry(&reader, &runs, stated, bench, person);
    let kept = kept.map_err(CommissionFailure::from)?;
    let from = format!("From {}.", counted(kept.touches, "touch"));
    tell((Kind::Blocks, kept.finding), Some(&from), &kept.path)
}
