//! `rig-study inverses`: how well a stiffness can be known, by angle, by protocol and by stiffness.
//!
//! What this is worth over many random touches is the business of `rig-study compensation`.

mod known;
mod protocols;
mod range;

use std::{io::Write, path::PathBuf};

use crate::{files::Folder, outcome::StudyError, page::Page, simulate::Nuisances};

/// Uncertainty of a stiffness from one touch, from several, and from 0.005 to 3 MPa.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder for `inverses.md`, `inverses.html` and the charts.
    #[arg(long, default_value = "target/study")]
    out: PathBuf,
}

pub(crate) fn run(args: &Args, out: &mut impl Write) -> Result<(), StudyError> {
    let folder = Folder::at(&args.out)?;
    page().write(&folder, "inverses")?;
    writeln!(out, "{}", folder.path("inverses.md").display())?;
    Ok(())
}

fn page() -> Page {
    let mut page = Page { title: "What inverses know".to_owned(), parts: Vec::new() };
    let Nuisances { shift_hz, depth_mm, angle_deg, .. } = Nuisances::BENCH;
    page.text(format!(
        "This page is written by `cargo run --release -p rig-study -- inverses --out docs`. \
         The sensor is the reference sensor; unless a row says otherwise a touch has errors of \
         {shift_hz} Hz of its shift, {depth_mm} mm of the depth at which the surface was found, and \
         {angle_deg}° of its angle. What this is worth over many random touches, \
         [compensation.md](compensation.md) says."
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
        assert_eq!(page().markdown("inverses"), include_str!("../../../docs/inverses.md"));
    }
}
