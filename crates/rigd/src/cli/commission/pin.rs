//! `rigd commission pin`: the radius of the ball from touches on a pin, as the journal has them.

use clap::Args;
use rig_commission::Kind;
use rig_model::counted;
use rig_store::Reader;

use super::{CommissionFailure, tell};
use crate::{
    block_runs::{Bench, keep_probe_radius},
    cli::{
        Failure,
        args::{BenchArgs, temperature},
    },
};

/// Fits the radius of the ball to the touches of a run on a cylindrical pin, such as one of `config/protocols/pin.toml`.
/// The pin lies in place of the sample with its axis along the rotary axis, and the rig file of that run has
/// `pin_radius_mm`. The last accepted record of `rigd commission blocks` says where the rotary axis and the probe are
#[derive(Debug, Args)]
pub(super) struct PinArgs {
    /// Run on the pin: its name such as `pin-1`, its id, or `latest`
    run: String,
    /// Radius of the pin, half of its diameter
    #[arg(long, value_name = "MM", value_parser = radius)]
    pin_radius_mm: f64,
    #[command(flatten)]
    bench: BenchArgs,
    /// Temperature at the bench, for the record
    #[arg(long, value_name = "°C", allow_negative_numbers = true, value_parser = temperature)]
    temperature: Option<f64>,
}

fn radius(text: &str) -> Result<f64, &'static str> {
    match text.parse() {
        Ok(mm) if 0.0 < mm && f64::is_finite(mm) => Ok(mm),
        _ => Err("a radius above 0 mm"),
    }
}

pub(super) fn pin(args: &PinArgs) -> Result<(), Failure> {
    let data = args.bench.data.dir();
    let rig = args.bench.rig.load()?;
    let bench = Bench { rig: &rig.file.name, basis: &rig.basis(), data: &data };
    let reader =
        Reader::open(&data).map_err(|source| Failure::Data { data: data.clone(), source })?;
    let run = reader.find(&args.run)?;
    let witness = (args.bench.operator.name().as_str().to_owned(), args.temperature);
    let (pin_mm, limits) = (args.pin_radius_mm, &rig.file.limits);
    let kept = keep_probe_radius((&reader, &run), pin_mm, limits, bench, witness)
        .map_err(CommissionFailure::from)?;
    let axis = match &kept.blocks {
        Some(made) => format!("the rotary axis by the blocks of {made}"),
        None => "the rotary axis by a rule: no record of blocks holds".to_owned(),
    };
    let from = format!("From {}; {axis}.", counted(kept.touches, "touch"));
    tell((Kind::Pin, kept.finding), Some(&from), &kept.path)
}
