//! `rig-study models`: cost, agreement and limits of each tier.

mod agreement;
mod cost;
mod effects;
mod failures;
pub(crate) mod readout;
mod tiers;
mod variant;

use std::{io::Write, path::PathBuf};

use crate::{files::Folder, outcome::StudyError, page::Page};
use cost::{Costs, ImpedanceCosts};

/// Cost against agreement for every tier, the size of each effect, and maps of the failures of tiers.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder for `models.md`, `models.html`, and the tables and charts in `models`.
    #[arg(long, default_value = "target/study")]
    out: PathBuf,
    /// Measure the costs on this machine instead of using the stored ones. Only ratios within one
    /// run are meaningful.
    #[arg(long)]
    measure: bool,
}

pub(crate) fn run(args: &Args, out: &mut impl Write) -> Result<(), StudyError> {
    let folder = Folder::at(&args.out)?;
    let (costs, of_impedance) = if args.measure {
        (cost::measure(), cost::measure_impedance())
    } else {
        (cost::stored(), cost::stored_impedance())
    };
    page(args.measure, &costs, &of_impedance).write(&folder, "models", out)
}

fn page(is_measured: bool, costs: &Costs, of_impedance: &ImpedanceCosts) -> Page {
    let title = "Models: cost, agreement and limits".to_owned();
    let mut page = Page { title, parts: Vec::new() };
    page.text(introduction(is_measured));
    tiers::add(&mut page, costs, of_impedance);
    agreement::add(&mut page, costs);
    effects::add(&mut page);
    failures::add(&mut page);
    page.heading("Costs");
    page.text("Each cost is the shortest of several runs on one core, all in one session.");
    page.data("cost.csv", cost::csv(costs));
    page.data("impedance.csv", cost::impedance_csv(of_impedance));
    page
}

fn introduction(is_measured: bool) -> String {
    let costs = if is_measured {
        "The costs were measured in the run that wrote this page."
    } else {
        "The costs were measured once and are stored apart, so that the rest of the page is the \
         same on every computer; `--measure` measures them again."
    };
    format!(
        "This page is written by `cargo run --release -p rig-study -- models --out docs/studies`. \
         It compares the models of the sensor by cost, agreement and limits, for the reference \
         sensor: 35 mm long, with a ball of 0.5 mm at the end of an arm of 8 mm. {costs}"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_document_is_what_the_models_say_today() {
        let page = page(false, &cost::stored(), &cost::stored_impedance());
        assert_eq!(page.markdown("models"), include_str!("../../../docs/studies/models.md"));
    }
}
