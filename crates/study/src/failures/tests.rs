use rig_resonance::Estimator;

use super::{axis::SENSORS, judge::others, power::Power, *};

/// One cell, for one seed.
fn cell(axis: Axis, path: Path, value: f64, trials: u32) -> Cell {
    let point = axis.values().iter().position(|one| *one == value).unwrap();
    judge::judge((axis, path), point, trials, 13..14).unwrap()
}

fn counts_of(estimator: Estimator, cells: &[Cell]) -> Counts {
    let index = others().position(|one| one == estimator).unwrap();
    let of = cells.iter().filter_map(|cell| cell.others.get(index));
    of.fold(Counts::default(), |sum, one| sum.plus(*one))
}

/// Some axes on which neither path has ever been found silently wrong. The page has the others.
#[test]
fn fit_and_planner_are_not_silently_wrong_and_a_peak_pick_often() {
    let axes = [Axis::Noise, Axis::WindowOffset, Axis::Target, Axis::Drift, Axis::SettlingUnknown];
    let cells = judge_all(&axes, 1, 1, 11..12);
    let wrong = document::where_wrong(cells.iter());
    assert!(wrong.is_empty(), "{wrong:?}");
    for path in Path::ALL {
        let all = counts(path, &cells);
        assert!(all.sweeps() > 150 && all.right > 100, "{path:?}: {all:?}");
    }
    let peak = counts_of(Estimator::MagnitudeMinimum, &cells);
    assert!(2 * peak.wrong > peak.sweeps(), "{peak:?}");
}

#[test]
fn the_same_seed_gives_the_same_bytes_on_any_number_of_cores() {
    let bytes = |threads, seed| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let cells = pool.install(|| judge_all(&[Axis::SecondModeLarge], 1, 1, seed..seed + 1));
        let map = maps::map(Axis::SecondModeLarge, &cells).file().unwrap();
        (coverage::table(&cells), reasons::table(&cells), gate::table(&cells, seed), map)
    };
    assert_eq!(bytes(1, 3), bytes(3, 3));
    assert_ne!(bytes(1, 3).0, bytes(1, 4).0);
}

/// Each boundary from both sides: a value at which nearly every sweep is answered, and one at which the
/// cause is named, modelled, or refused.
#[test]
fn harmless_sweeps_are_answered_and_hopeless_ones_are_detected() {
    for (axis, path, harmless, hopeless) in [
        (Axis::FigureOfMerit, Path::Fit, 1.0, 0.0),
        (Axis::WindowOffset, Path::Fit, 0.95, 1.05),
        (Axis::DriftBothWays, Path::Fit, 0.01, 2.0),
        (Axis::SecondMode, Path::Fit, 0.2, 10.0),
        (Axis::Outliers, Path::Fit, 0.0, 50.0),
        (Axis::DriveLevelStep, Path::Fit, 0.0, 0.5),
        (Axis::Settling, Path::Fit, 10.0, 0.5),
        (Axis::CapacitanceDrift, Path::Fit, 0.01, 5.0),
        (Axis::NoiseStated, Path::Fit, 1.0, 2.0),
        (Axis::AnalyzerPhase, Path::Fit, 0.0, 5.0),
        (Axis::NoiseStated, Path::Planner, 1.0, 3.0),
        (Axis::WindowOffset, Path::Planner, 0.0, 1.5),
        (Axis::Drift, Path::Planner, 0.0, 5.0),
        (Axis::SecondMode, Path::Planner, 0.0, 30.0),
    ] {
        let answered = cell(axis, path, harmless, 4).counts();
        // The planner gives up a few more.
        let least = if path == Path::Fit { 23 } else { 19 };
        assert!(answered.right >= least, "{axis:?}, {path:?} at {harmless}: {answered:?}");
        let Power { named, modelled, refused, .. } = Power::of(&cell(axis, path, hopeless, 4));
        let seen = named + modelled + refused;
        assert!(seen > 90.0, "{axis:?}, {path:?} at {hopeless}: {seen} %");
    }
}

/// In one direction a drift changes only the effective time of the result.
#[test]
fn drift_is_invisible_in_one_direction_and_seen_in_two() {
    let rising = cell(Axis::Drift, Path::Fit, 1.0, 4);
    assert_eq!(rising.counts().right, 24);
    assert_eq!(Power::of(&rising).modelled, 0.0);
    assert!(counts_of(Estimator::ConductanceLorentzian, &[rising]).wrong > 12);
    let both_ways = Power::of(&cell(Axis::DriftBothWays, Path::Fit, 1.0, 4));
    assert!(both_ways.modelled > 50.0 && both_ways.wrong == 0.0);
}

/// A planned sweep takes a time of its own on the rig; the fitted ones have none.
#[test]
fn planned_sweeps_take_time_and_weak_sensors_more() {
    let planned = cell(Axis::Noise, Path::Planner, 0.5, 2);
    let median_s = |sensor: (f64, f64)| {
        let index = SENSORS.iter().position(|one| *one == sensor).unwrap();
        let of = planned.results.iter().filter(|result| result.id.sensor == index);
        of.filter_map(|result| result.time_s).sum::<f64>() / 2.0
    };
    assert!((0.3..1.5).contains(&median_s((100.0, 0.1))), "{}", median_s((100.0, 0.1)));
    assert!(median_s((10.0, 0.1)) > 2.0 * median_s((30.0, 0.1)));
    let fitted = cell(Axis::Noise, Path::Fit, 0.5, 1);
    assert!(fitted.results.iter().all(|result| result.time_s.is_none()));
}

#[test]
fn an_axis_that_does_not_exist_is_refused_with_those_that_do() {
    let folder = tempfile::tempdir().unwrap();
    let args = Args {
        out: folder.path().to_owned(),
        seed: 1,
        seeds: 1,
        trials: 1,
        planned: 1,
        axis: Some("noises".to_owned()),
        check: false,
        chunks: ChunkArgs::default(),
    };
    let error = run(&args, &mut Vec::new()).unwrap_err();
    let message = rig_model::with_causes(&error);
    assert!(message.contains("axis noises") && message.contains("second-mode-20"), "{message}");
}

/// Every file of a folder and its folders, with its bytes.
fn contents(folder: &std::path::Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(contents(&path));
        } else {
            files.push((path.clone(), std::fs::read(&path).unwrap()));
        }
    }
    files.sort();
    files
}

#[test]
fn the_page_of_chunks_has_the_bytes_of_that_of_one_process() {
    let [alone, parts, merged] = [(); 3].map(|()| tempfile::tempdir().unwrap());
    let args = |out: &tempfile::TempDir, words: &[&str]| {
        #[derive(clap::Parser)]
        struct Cli {
            #[command(flatten)]
            args: Args,
        }
        let of_study = ["failures", "--seeds", "1", "--trials", "1", "--planned", "1"];
        let axis = ["--axis", "second-mode-20", "--out", out.path().to_str().unwrap()];
        let words = of_study.iter().chain(&axis).chain(words);
        <Cli as clap::Parser>::try_parse_from(words).unwrap().args
    };
    let mut said = Vec::new();
    run(&args(&alone, &[]), &mut said).unwrap();
    for chunk in ["1/3", "2/3", "3/3"] {
        run(&args(&parts, &["--chunk", chunk]), &mut Vec::new()).unwrap();
    }
    let paths =
        [3, 1, 2, 1].map(|number| parts.path().join(format!("failures-{number}-of-3.json")));
    let paths = paths.each_ref().map(|path| path.to_str().unwrap());
    let merge = [&["--merge"], &paths[..]].concat();
    let mut said_of_merged = Vec::new();
    run(&args(&merged, &merge), &mut said_of_merged).unwrap();

    let relative = |folder: &tempfile::TempDir| -> Vec<(PathBuf, Vec<u8>)> {
        let of = |(path, bytes): (PathBuf, Vec<u8>)| {
            (path.strip_prefix(folder.path()).unwrap().to_owned(), bytes)
        };
        contents(folder.path()).into_iter().map(of).collect()
    };
    let (one, other) = (relative(&alone), relative(&merged));
    assert!(one.len() > 8, "{} files", one.len());
    for (one, other) in one.iter().zip(&other) {
        assert_eq!(one, other);
    }
    assert_eq!(one.len(), other.len());
    let counts = |said: Vec<u8>| {
        let said = String::from_utf8(said).unwrap();
        said.lines()
            .filter(|line| line.contains("silently wrong"))
            .map(str::to_owned)
            .collect::<Vec<_>>()
    };
    assert_eq!(counts(said), counts(said_of_merged));

    // The arguments are a part of what a chunk is.
    let wrong = Args { trials: 2, ..args(&merged, &merge) };
    let message = rig_model::with_causes(&run(&wrong, &mut Vec::new()).unwrap_err());
    assert!(message.contains("--trials 1") && message.contains("--trials 2"), "{message}");
}
