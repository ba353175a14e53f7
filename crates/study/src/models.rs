//! `rig-study models`: what each tier costs, how wrong it is, and where it fails.

mod cost;
mod effects;
mod errors;
mod failures;
pub(crate) mod readout;

use std::{io::Write, path::PathBuf};

use crate::{files::Folder, outcome::StudyError};

/// Cost against error for every tier, the size of each effect, and maps of where tiers fail.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder for the tables and charts.
    #[arg(long, default_value = "target/study/models")]
    out: PathBuf,
    /// Measure the costs on this machine now, instead of taking those measured once. Only ratios
    /// of one run mean anything.
    #[arg(long)]
    measure: bool,
}

pub(crate) fn run(args: &Args, out: &mut impl Write) -> Result<(), StudyError> {
    let folder = Folder::at(&args.out)?;
    let costs = if args.measure {
        let (points_us, circuit_us) = cost::measure_impedance();
        writeln!(out, "impedance at 201 points: {points_us:.2} µs")?;
        writeln!(out, "the circuit that they come from: {circuit_us:.2} µs")?;
        cost::measure()
    } else {
        cost::stored()
    };
    folder.write("cost.csv", &cost::csv(&costs))?;
    errors::write(&folder, &costs)?;
    effects::write(&folder)?;
    failures::write(&folder)
}
