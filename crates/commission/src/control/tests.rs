//! Run lengths by simulation of many sequences.

use rig_model::random::Stream;

use super::*;

/// The number of checks up to the first alarm of a chart, with a change by so many standard deviations after `before`
/// checks; `None` for an alarm before the change.
fn run_length(seed: u64, before: usize, change: f64) -> Option<usize> {
    const LONGEST: usize = 5000;
    let mut stream = Stream::new(seed, 150);
    let mut chart = Chart::new(0.0);
    for check in 0..before + LONGEST {
        let shift = if check < before { 0.0 } else { change };
        let value = 5.0 + 0.3 * (stream.normal() + shift);
        if chart.take(value).against.is_some_and(|against| against.is_alarm()) {
            return (check >= before).then(|| check - before + 1);
        }
    }
    Some(LONGEST)
}

/// `cargo test -p rig-commission run_lengths -- --nocapture` prints the table of docs/check-bench.md.
#[test]
fn the_run_lengths_are_those_that_are_stated() {
    println!(
        "checks before the change, change in standard deviations: mean, tenth part, median, nine tenths"
    );
    for (before, change, least, most) in [
        (BASELINE, 0.0, 1000.0, 2500.0),
        (COMPARED, 0.0, 900.0, 2500.0),
        (12, 3.0, 300.0, 1500.0),
        (20, 3.0, 3.0, 10.0),
        (COMPARED, 1.0, 18.0, 40.0),
        (COMPARED, 2.0, 4.0, 6.5),
        (COMPARED, 3.0, 2.0, 3.2),
        (COMPARED, 5.0, 1.0, 1.4),
    ] {
        let mut lengths: Vec<_> =
            (0..400).filter_map(|seed| run_length(seed, before, change)).collect();
        lengths.sort_unstable();
        let part = |tenths: usize| lengths[(lengths.len() - 1) * tenths / 10];
        let mean = lengths.iter().sum::<usize>() as f64 / lengths.len() as f64;
        println!("{before:4} {change:3}: {mean:7.1} {:5} {:5} {:5}", part(1), part(5), part(9));
        assert!((least..most).contains(&mean), "{before}, {change}: {mean}");
    }
}

#[test]
fn a_scatter_smaller_than_matters_counts_as_that_one() {
    let mut chart = Chart::new(0.001);
    for _ in 0..BASELINE {
        assert_eq!(chart.take(10.0).against, None);
    }
    let against = chart.take(10.002).against.unwrap();
    assert!(against.sigma == 0.001 && !against.is_alarm(), "{against:?}");
    assert!(chart.take(10.02).against.unwrap().is_alarm());
    // What had an alarm is not taken for the comparison.
    let against = chart.take(10.0).against.unwrap();
    assert!((against.mean - 10.0).abs() < 0.0005, "{against:?}");
}
