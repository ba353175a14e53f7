//! `rig-study paper`: the computations of the paper, repeated and judged.

mod bench;
mod claims;
mod clustering;
mod figures;
mod joint;
mod lattice;
mod lumps;
mod search;
mod tables;

use std::{io::Write, path::PathBuf};

use rig_contact::{ContactLaw, Models, Sensor, SensorDesign};

use crate::{
    files::Folder,
    outcome::StudyError,
    page::{Page, Part},
};

/// The paper's figures, tables and claims, beside the results of this project.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder for `paper.md`, `paper.html` and the charts.
    #[arg(long, default_value = "target/study")]
    out: PathBuf,
    /// Run the protocol on the simulated bench, for Figures 11 to 13.
    #[arg(long)]
    bench: bool,
    /// The rig file of that bench.
    #[arg(long, default_value = "config/rigs/simulated.toml")]
    rig: PathBuf,
    /// The protocol of that run.
    #[arg(long, default_value = "config/protocols/three-direction.toml")]
    protocol: PathBuf,
    /// Number of repeats of each random experiment.
    #[arg(long, default_value_t = 400, value_parser = clap::value_parser!(u32).range(10..=100_000))]
    repeats: u32,
    /// Random seed.
    #[arg(long, default_value_t = 2020)]
    seed: u64,
}

/// A sensor in the paper's comparison.
struct Compared {
    name: &'static str,
    length_mm: f64,
    radius_mm: f64,
    models: Models,
}

/// The paper's sensor and the two that it is compared with, in the order of Figure 8.
fn compared(law: ContactLaw) -> [Compared; 3] {
    [("L 35, R 0.5", 35.0, 0.5), ("L 35, R 1", 35.0, 1.0), ("L 20, R 0.5", 20.0, 0.5)].map(
        |(name, length_mm, radius_mm)| {
            let design =
                SensorDesign { length_mm, probe_radius_mm: radius_mm, ..SensorDesign::reference() };
            let sensor = Sensor::new(design).expect("the paper's sensors can be built");
            Compared { name, length_mm, radius_mm, models: Models::new(&sensor, law) }
        },
    )
}

pub(crate) fn run(args: &Args, out: &mut impl Write) -> Result<(), StudyError> {
    let folder = Folder::at(&args.out)?;
    let mut page = Page {
        title: "The paper, recomputed and judged".to_owned(),
        parts: introduction(args).into_iter().map(Part::Text).collect(),
    };
    deterministic(&mut page);
    lattice::add(&mut page, args.repeats, args.seed);
    joint::add(&mut page);
    search::add(&mut page, args.seed);
    lumps::add(&mut page, args.repeats, args.seed);
    clustering::add(&mut page, args.repeats, args.seed);
    bench::add(&mut page, args)?;
    page.write(&folder, "paper", out)
}

/// The parts without random numbers and without the daemon.
fn deterministic(page: &mut Page) {
    claims::add(page);
    tables::add(page);
    figures::add(page);
}

fn introduction(args: &Args) -> Vec<String> {
    let with_bench = if args.bench { " --bench" } else { "" };
    vec![
        format!(
            "This page is written by `cargo run --release -p rig-study -- paper --out \
             docs/studies{with_bench}`, in half a minute on two cores. It repeats the computations \
             of \"A Piezoelectric Tactile Sensor for Tissue Stiffness Detection with Arbitrary \
             Contact Angle\" (Sensors 20 (2020) 6607) and judges each claim. Only printed numbers \
             of the paper are compared; its figures give no numbers. The same arguments give the \
             same bytes."
        ),
        "Our numbers are for one sensor with the two facts that the paper prints, 140.4 Hz without \
         contact and 134.11 Hz/MPa: 35 mm long, 5.888 mm wide, two layers of PZT-5A and one of \
         carbon of 0.2 mm each, a tip of 0.418 g, a ball of 0.5 mm at the end of an arm of 8 mm \
         across the bimorph. Length, ball and materials are those of the paper. Width and mass \
         follow from the two facts. Layers, arm and losses are assumed; other arms with other \
         widths give the same two facts. Unless a row says otherwise, the contact follows Sneddon, \
         sticks, and is held at its indentation, and the model is the reference of sixteen \
         elements, which includes the static force of the contact. The two facts were fitted without \
         that force; with it the sensitivity is 0.3 % higher. Simulator and analysis of a study are \
         both ours, so that agreement between them is no accuracy."
            .to_owned(),
        "Models come in tiers: T0 is equation (7) itself; T0b is the same with the frequency of the \
         loaded sensor; T1 is one mass between two springs; T2 adds tilt, tangential stiffness and \
         arm to T1; E1 is one beam element under the static force of the contact, and E1s the same \
         where the stage holds the depth, so that the sensor deflects; the reference has sixteen \
         elements in space, losses and electrodes. [models.md](models.md) compares them by cost, \
         agreement and limits."
            .to_owned(),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The random parts and the run of the daemon take too long for a test.
    #[test]
    fn the_document_holds_what_the_models_say_today() {
        const HEAD: &str = "# \n";
        let mut page = Page::default();
        deterministic(&mut page);
        let markdown = page.markdown("paper");
        let document = include_str!("../../../docs/studies/paper.md");
        for line in markdown.trim_start_matches(HEAD).lines() {
            assert!(document.contains(line), "docs/studies/paper.md is out of date: {line}");
        }
    }
}
