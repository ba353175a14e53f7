//! `rig-study inverses`: the uncertainty of an inferred stiffness by angle, protocol and stiffness.
//!
//! `rig-study compensation` tests the inference on many random touches.

mod known;
mod protocols;
mod range;

use std::{io::Write, path::PathBuf};

use crate::{files::Folder, outcome::StudyError, page::Page, simulate::Nuisances};

/// Uncertainty of a stiffness from one touch, from several, and from 0.001 to 30 MPa.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder for `inverses.md`, `inverses.html` and the charts.
    #[arg(long, default_value = "target/study")]
    out: PathBuf,
}

pub(crate) fn run(args: &Args, out: &mut impl Write) -> Result<(), StudyError> {
    let folder = Folder::at(&args.out)?;
    page().write(&folder, "inverses", out)
}

fn page() -> Page {
    let mut page =
        Page { title: "Uncertainty of the inferred stiffness".to_owned(), parts: Vec::new() };
    let Nuisances { shift_hz, depth_mm, angle_deg, .. } = Nuisances::BENCH;
    page.text(format!(
        "This page is written by `cargo run --release -p rig-study -- inverses --out \
         docs/studies`. The sensor is the reference sensor. Unless a row says otherwise, the \
         standard deviations of a touch are {shift_hz} Hz for its shift, {depth_mm} mm for the \
         surface found, and {angle_deg}° for its angle. [compensation.md](compensation.md) tests \
         the inference on many random touches. Truth and inference have the same model here; \
         [truths.md](truths.md) has truths that differ."
    ));
    known::add(&mut page);
    protocols::add(&mut page);
    range::add(&mut page);
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_document_is_what_the_models_say_today() {
        assert_eq!(page().markdown("inverses"), include_str!("../../../docs/studies/inverses.md"));
    }
}
