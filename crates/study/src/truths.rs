//! `rig-study truths`: what the analysis of a run makes of truths that it was not made for.
//!
//! Each run touches the paper's samples by the paper's protocol. Its shifts are those of a truth by the
//! reference model, with the nuisances of the bench; its analysis is that of a run of the daemon, once
//! with the model of the rig file and once with the model learnt from the main touches.

mod budget;
mod document;
mod summary;
mod trial;
mod truth;

use std::{
    fs,
    io::Write,
    path::{Path, PathBuf},
};

use rayon::prelude::*;
use rig_analysis::model::ModelSource;

use crate::{files::Folder, outcome::StudyError, progress};
use summary::Summary;
use trial::Analysis;
use truth::{RunOfTruth, Truth};

/// Coverage, recognition and verdicts under truths that differ from the described model.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Runs of each truth.
    #[arg(long, default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    runs: u32,
    /// Random seed.
    #[arg(long, default_value_t = 2020)]
    seed: u64,
    /// Folder for `truths.md` and, in `truths/`, the table and the charts.
    #[arg(long, default_value = "target/study")]
    out: PathBuf,
    /// Compute three truths again and compare them with the table in the folder.
    #[arg(long)]
    check: bool,
}

/// The truths that `--check` computes: one that is matched, one that is noticed, one of two depths.
const CHECKED: [&str; 3] = ["nothing", "slip beyond 8.5°", "stiffer with depth"];

/// The runs do not give what the page says.
#[derive(Debug, thiserror::Error)]
#[error("{}: no row is \"{row}\", which the runs give now: write the page again", path.display())]
struct Differs {
    path: PathBuf,
    row: String,
}

pub(crate) fn run(args: &Args, out: &mut impl Write) -> Result<(), StudyError> {
    let folder = Folder::at(&args.out)?;
    if args.check {
        return check(args, &folder.path("truths").join(document::TABLE), out);
    }
    let truths = try_all(args, |_| true);
    document::page(args, &truths, &budget::try_all(args)).write(&folder, "truths", out)
}

fn check(args: &Args, path: &Path, out: &mut impl Write) -> Result<(), StudyError> {
    let file = |source| StudyError::File { path: path.to_owned(), source };
    let written = fs::read_to_string(path).map_err(file)?;
    let found = document::csv(&try_all(args, |truth| CHECKED.contains(&truth.name)));
    let rows = || found.lines();
    if let Some(row) = rows().find(|row| !written.lines().any(|line| line == *row)) {
        return Err(StudyError::refused(Differs { path: path.to_owned(), row: row.to_owned() }));
    }
    Ok(writeln!(out, "{}: {} rows are what the runs give", path.display(), rows().count() - 1)?)
}

/// The runs of one truth.
struct TruthRuns {
    truth: Truth,
    /// With the model of the rig file.
    described: Summary,
    /// With the learnt model.
    learnt: Summary,
    /// With the learnt model, from touches that are measured halfway too.
    halfway: Summary,
    /// The chance of the best test to notice the truth, as described, learnt, and learnt from two depths.
    at_most: [f64; 3],
}

/// The summaries of the truths that are asked for, in order.
fn try_all(args: &Args, is_asked: impl Fn(&Truth) -> bool) -> Vec<TruthRuns> {
    let truths: Vec<_> =
        Truth::all().into_iter().zip(0..).filter(|(one, _)| is_asked(one)).collect();
    let bar = progress::bar(truths.len() * args.runs as usize, "runs");
    let of_truth = |(truth, number): (Truth, u64)| {
        let (bench, quiet) = (truth.bench(), truth.without_nuisances().bench());
        let analysis = Analysis::new();
        let of_run = |touches: &RunOfTruth| {
            let once = touches.at_one_depth();
            let of = |touches, source| analysis.of(touches, source);
            [
                of(&once, ModelSource::Described),
                of(&once, ModelSource::Learnt),
                of(touches, ModelSource::Learnt),
            ]
        };
        let one = |run: u32| {
            bar.inc(1);
            of_run(&bench.run(args.seed, number, u64::from(run)))
        };
        let at_most = of_run(&quiet.run(args.seed, number, 0)).map(|found| found.noticed_at_most);
        let found: Vec<[_; 3]> = (0..args.runs).into_par_iter().map(one).collect();
        let [described, learnt, halfway] =
            [0, 1, 2].map(|index| Summary::of(found.iter().map(|of_run| &of_run[index])));
        TruthRuns { truth, described, learnt, halfway, at_most }
    };
    let all = truths.into_iter().map(of_truth).collect();
    bar.finish_and_clear();
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn runs(name: &str, runs: u64) -> (Summary, Summary, Summary) {
        let truth = Truth::all().into_iter().find(|truth| truth.name == name).unwrap();
        let (bench, analysis) = (truth.bench(), Analysis::new());
        let all: Vec<_> = (0..runs).map(|run| bench.run(1, 0, run)).collect();
        let once: Vec<_> = all.iter().map(RunOfTruth::at_one_depth).collect();
        let of = |all: &[RunOfTruth], source| {
            let found: Vec<_> = all.iter().map(|touches| analysis.of(touches, source)).collect();
            Summary::of(&found)
        };
        (
            of(&once, ModelSource::Described),
            of(&once, ModelSource::Learnt),
            of(&all, ModelSource::Learnt),
        )
    }

    /// Fewer runs than the page has; the bounds are four standard deviations wide.
    #[test]
    fn a_matched_truth_is_covered_and_left_alone() {
        let (described, learnt, halfway) = runs("nothing", 40);
        for summary in [described, learnt, halfway] {
            assert!((0.92..0.985).contains(&summary.coverage()), "{summary:?}");
            assert!(summary.recognition() > 0.995 && summary.noticed() < 0.12, "{summary:?}");
        }
    }

    #[test]
    fn a_frictionless_truth_is_rejected_as_described_and_covered_as_learnt() {
        let (described, learnt, _) = runs("frictionless", 20);
        assert!(described.noticed() == 1.0 && described.recognition() < 0.9, "{described:?}");
        assert!(learnt.recognition() > 0.985 && learnt.noticed() < 0.2, "{learnt:?}");
        assert!((0.91..0.99).contains(&learnt.coverage()), "{learnt:?}");
    }

    #[test]
    fn a_slip_is_noticed_and_its_intervals_are_wide_enough() {
        let (_, learnt, _) = runs("slip beyond 8.5°", 20);
        assert!(learnt.noticed() >= 0.9 && learnt.coverage() > 0.9, "{learnt:?}");
    }

    /// One depth tells a layered sample in less than half of the runs.
    #[test]
    fn a_layered_sample_is_noticed_by_a_measurement_halfway() {
        for name in ["stiffer with depth", "softer with depth"] {
            let (_, _, halfway) = runs(name, 20);
            assert!(halfway.noticed() >= 0.85, "{name}: {halfway:?}");
            assert_eq!(halfway.pattern().map(|(pattern, _)| pattern), Some("depth"), "{name}");
        }
    }

    /// Each part alone is as large as the budget says, within four standard deviations: of 1,000 touches, of the
    /// samples of 20 runs, or of their 20 factors.
    #[test]
    fn the_parts_of_a_budget_are_what_each_cause_alone_makes() {
        let is_of_its_law = |part: &budget::PartRuns| part.of != budget::OF_OTHER_LAW;
        for part in budget::validate(1, 20).into_iter().filter(is_of_its_law) {
            let draws: f64 = match (part.part, part.of) {
                (_, "sample") => 100.0,
                ("sensor" | "sensor and model", _) => 20.0,
                _ => 1000.0,
            };
            let ratio = part.found_rel / part.predicted_rel;
            assert!((ratio - 1.0).abs() < 4.0 / (2.0 * draws).sqrt(), "{part:?}");
        }
    }
}
