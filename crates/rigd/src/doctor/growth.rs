//! How fast the data directory grows, from its runs so far, and how long the disk lasts.

use std::path::Path;

use jiff::Timestamp;
use rig_model::counted;
use rig_store::{Reader, StoreError};

use super::Findings;
use crate::run_files;

/// The latest runs that count: enough for some weeks, and read within a second or two.
const RUNS_MAX: usize = 50;
/// Fewer runs, or a shorter time, say nothing about a year.
const RUNS_MIN: usize = 2;
const DAYS_MIN: f64 = 1.0;
const DAYS_OF_YEAR: f64 = 365.25;
const S_OF_DAY: f64 = 86_400.0;

/// A run that is in the data directory as a whole.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Past {
    /// When it began, s since 1970.
    began_s: f64,
    touches: u32,
    /// Size of its records and of its folder, bytes.
    bytes: u64,
}

/// The least and the most bytes a day, and what they rest on.
#[derive(Debug, Clone, PartialEq)]
struct Growth {
    bytes_a_day: [f64; 2],
    runs: usize,
    touches: u32,
    days: f64,
}

/// Says nothing without a history, or where it cannot be read: other findings say why.
pub(super) fn finding(findings: &mut Findings, data: &Path, free_bytes: u64) {
    let Ok(past) = Reader::open(data).and_then(|reader| past(&reader, data)) else { return };
    if let Some(growth) = growth(&past, Timestamp::now().as_millisecond() as f64 / 1e3) {
        say(findings, &growth, free_bytes);
    }
}

fn past(reader: &Reader, data: &Path) -> Result<Vec<Past>, StoreError> {
    let mut past = Vec::new();
    for run in reader.latest_runs(Some(RUNS_MAX), None)? {
        // The size of one whose readings are elsewhere is not what a run adds.
        if reader.archive_of(run.id)?.is_some() {
            continue;
        }
        let Ok(began) = run.started_at.parse::<Timestamp>() else { continue };
        let touches = reader.unchecked(run.id, &["touch_result", "touch_refused"])?.len();
        let folder = run_files::size_of_folder(&run_files::folder(data, &run));
        past.push(Past {
            began_s: began.as_millisecond() as f64 / 1e3,
            touches: u32::try_from(touches).unwrap_or(u32::MAX),
            bytes: reader.bytes_of(run.id)?.saturating_add(folder),
        });
    }
    Ok(past)
}

/// The range spans the bytes a touch of the earlier and the later half of the runs, and the touches a day
/// of the earlier and the later half of the time. `None` without enough of them.
fn growth(past: &[Past], now_s: f64) -> Option<Growth> {
    let mut past: Vec<Past> = past.iter().filter(|run| run.touches > 0).copied().collect();
    past.sort_by(|a, b| a.began_s.total_cmp(&b.began_s));
    let days = (now_s - past.first()?.began_s) / S_OF_DAY;
    if past.len() < RUNS_MIN || days < DAYS_MIN {
        return None;
    }
    let touches_of = |runs: &[Past]| runs.iter().map(|run| run.touches).sum::<u32>();
    let bytes_a_touch = |runs: &[Past]| {
        runs.iter().map(|run| run.bytes).sum::<u64>() as f64 / f64::from(touches_of(runs))
    };
    let (earlier, later) = past.split_at(past.len() / 2);
    let sizes = [bytes_a_touch(earlier), bytes_a_touch(later)];
    let middle_s = past[0].began_s + days * S_OF_DAY / 2.0;
    let (earlier, later) = past.split_at(past.partition_point(|run| run.began_s < middle_s));
    let rates = [earlier, later].map(|runs| f64::from(touches_of(runs)) / (days / 2.0));
    let least = |[a, b]: [f64; 2]| a.min(b);
    let most = |[a, b]: [f64; 2]| a.max(b);
    let bytes_a_day = [least(sizes) * least(rates), most(sizes) * most(rates)];
    Some(Growth { bytes_a_day, runs: past.len(), touches: touches_of(&past), days })
}

fn say(findings: &mut Findings, growth: &Growth, free_bytes: u64) {
    let Growth { bytes_a_day: [low, high], runs, touches, days } = growth;
    let year_mib = |bytes_a_day: f64| bytes_a_day * DAYS_OF_YEAR / f64::from(1 << 20);
    let lasts_years = |bytes_a_day: f64| free_bytes as f64 / (bytes_a_day * DAYS_OF_YEAR);
    let longest = if *low > 0.0 && lasts_years(*low) < 100.0 {
        format!("{:.1}", lasts_years(*low))
    } else {
        "more than 100".to_owned()
    };
    let shortest = lasts_years(*high).min(100.0);
    let text = format!(
        "{:.0} to {:.0} MiB a year; the free space lasts {shortest:.1} to {longest} years; from \
         {} in {} within {days:.0} days",
        year_mib(*low),
        year_mib(*high),
        counted(*touches, "touch"),
        counted(*runs, "run"),
    );
    if shortest < 1.0 {
        let advice = "`rigd archive DIR --older-than 90d` moves old runs elsewhere";
        findings.warning("growth", text, advice);
    } else {
        findings.ok("growth", text);
    }
}

#[cfg(test)]
mod tests {
    use super::{super::Level, *};

    fn run(day: f64, touches: u32, bytes: u64) -> Past {
        Past { began_s: day * S_OF_DAY, touches, bytes }
    }

    #[test]
    fn without_a_history_nothing_is_foretold() {
        assert_eq!(growth(&[], 0.0), None);
        assert_eq!(growth(&[run(0.0, 10, 1000)], 20.0 * S_OF_DAY), None, "one run");
        let short = [run(0.0, 10, 1000), run(0.1, 10, 1000)];
        assert_eq!(growth(&short, 0.5 * S_OF_DAY), None, "half a day");
        let untouched = [run(0.0, 0, 1000), run(1.0, 0, 1000), run(2.0, 5, 1000)];
        assert_eq!(growth(&untouched, 3.0 * S_OF_DAY), None, "one run with touches");
    }

    #[test]
    fn the_range_holds_both_halves_of_the_history() {
        // Ten touches a day of 100 bytes each.
        let even: Vec<Past> = (0..10).map(|day| run(f64::from(day), 10, 1000)).collect();
        let found = growth(&even, 10.0 * S_OF_DAY).unwrap();
        assert_eq!((found.runs, found.touches, found.bytes_a_day), (10, 100, [1000.0, 1000.0]));
        // Later, twice as many, of twice the size.
        let faster: Vec<Past> = even
            .iter()
            .enumerate()
            .map(
                |(day, past)| {
                    if day < 5 { *past } else { Past { touches: 20, bytes: 4000, ..*past } }
                },
            )
            .collect();
        let found = growth(&faster, 10.0 * S_OF_DAY).unwrap();
        assert_eq!(found.bytes_a_day, [1000.0, 4000.0]);
        // The order does not count.
        let mut back = faster.clone();
        back.reverse();
        assert_eq!(growth(&back, 10.0 * S_OF_DAY), Some(found));
    }

    #[track_caller]
    fn check(bytes_a_day: [f64; 2], free_bytes: u64, level: Level, says: &str) {
        let growth = Growth { bytes_a_day, runs: 3, touches: 30, days: 7.0 };
        let mut findings = Findings::of("data directory");
        say(&mut findings, &growth, free_bytes);
        assert_eq!(findings.all[0].level, level, "{says}");
        assert!(findings.all[0].text.contains(says), "{}", findings.all[0].text);
    }

    #[test]
    fn a_disk_that_fills_within_a_year_is_a_warning() {
        let mib_a_day = |mib: f64| mib * f64::from(1 << 20);
        let range = [mib_a_day(1.0), mib_a_day(2.0)];
        check(range, 730 << 20, Level::Warning, "365 to 730 MiB a year");
        check(range, 7305 << 20, Level::Ok, "lasts 10.0 to 20.0 years; from 30 touches in 3 runs");
        check([0.0, mib_a_day(2.0)], 7305 << 20, Level::Ok, "10.0 to more than 100 years");
        check(range, 1 << 60, Level::Ok, "lasts 100.0 to more than 100 years");
    }
}
