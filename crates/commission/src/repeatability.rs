//! How well touches on a hard block repeat, from a series of touches at one place.
//!
//! ```text
//!   height
//!     │  ·     ·        ·      ─┐ range: at most two fine steps, and 25 µm
//!     │─────·──────·──────·──   │ trend: the straight line through them, first to last
//!     │        ·      ·        ─┘ scatter: about that line
//!     └──────────────────────── number of the touch
//! ```
//!
//! The error of the screw is the same for all of them, and is not in the scatter.

use crate::{Finding, Value, Verdict};

/// Fewest touches: the scatter of ten is known to a quarter of itself.
const LEAST: usize = 10;

/// Largest range of the heights, mm: with more, a probe or a clamp is loose.
///
/// # Source
/// The limit of Klipper's `PROBE_ACCURACY` for a probe that is fit for use.
const RANGE_MM: f64 = 0.025;

/// Largest range in fine steps of the search: a bracket that lies one step higher or lower.
const RANGE_STEPS: f64 = 2.0;

/// A trend of so many of its standard deviations is none by chance: one in some thousand series of ten touches shows it.
const CERTAIN: f64 = 5.0;

/// The height of a touch on the level block.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LevelTouch {
    /// Position of the linear stage at the surface, mm.
    pub height_mm: f64,
    /// Its standard deviation by the search, mm: the fine step over √12.
    pub sigma_mm: f64,
}

/// Touches that show no repeatability.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{} on the level block; at least {LEAST} are needed", rig_model::counted(*found, "touch"))]
pub struct TooFewTouches {
    found: usize,
}

/// Judges touches at one place, in the order in which they were made. The values are the mean height, the trend from the
/// first touch to the last, and the scatter of one touch; their errors are independent.
///
/// # Errors
/// [`TooFewTouches`].
pub fn repeatability(touches: &[LevelTouch]) -> Result<Finding, TooFewTouches> {
    let found = touches.len();
    if found < LEAST {
        return Err(TooFewTouches { found });
    }
    let line = Line::through(touches);
    let sigmas = [
        line.scatter_mm / line.count.sqrt(),
        line.scatter_mm * line.way() / line.squares.sqrt(),
        // Of a standard deviation with n − 2 degrees of freedom.
        line.scatter_mm / (2.0 * line.freedom()).sqrt(),
    ];
    let found_mm = [line.mean_mm, line.slope_mm * line.way(), line.scatter_mm];
    let names = ["touches.height", "touches.trend", "touches.scatter"];
    let value = |((name, value), standard_uncertainty)| Value {
        name,
        value,
        standard_uncertainty,
        unit: "mm",
    };
    let values = names.into_iter().zip(found_mm).zip(sigmas).map(value).collect();
    let variance =
        |row: usize, column: usize| if row == column { sigmas[row].powi(2) } else { 0.0 };
    let covariance = (0..3).map(|row| (0..3).map(|column| variance(row, column)).collect());
    let finding = Finding::of(values, Vec::new()).with_covariance(covariance.collect());
    Ok(match refused(touches, &line, sigmas[1]) {
        Some(why) => Finding { verdict: Verdict::Failed(why), ..finding },
        None => finding,
    })
}

/// The straight line through heights over the number of the touch.
struct Line {
    count: f64,
    mean_mm: f64,
    /// Change from one touch to the next, mm.
    slope_mm: f64,
    /// Standard deviation about the line, mm.
    scatter_mm: f64,
    /// Sum of the squares of the numbers about their mean.
    squares: f64,
}

impl Line {
    fn through(touches: &[LevelTouch]) -> Self {
        let count = touches.len() as f64;
        let mean_mm = touches.iter().map(|touch| touch.height_mm).sum::<f64>() / count;
        let number = |index: usize| index as f64 - 0.5 * (count - 1.0);
        let numbered = || touches.iter().enumerate().map(|(index, touch)| (number(index), touch));
        let squares: f64 = numbered().map(|(number, _)| number * number).sum();
        let slope_mm =
            numbered().map(|(number, touch)| number * touch.height_mm).sum::<f64>() / squares;
        let off = |(number, touch): (f64, &LevelTouch)| {
            (touch.height_mm - mean_mm - slope_mm * number).powi(2)
        };
        let variance = numbered().map(off).sum::<f64>() / (count - 2.0);
        Self { count, mean_mm, slope_mm, scatter_mm: variance.sqrt(), squares }
    }

    /// From the first touch to the last, in touches.
    const fn way(&self) -> f64 {
        self.count - 1.0
    }

    const fn freedom(&self) -> f64 {
        self.count - 2.0
    }
}

/// Why a series is not accepted.
fn refused(touches: &[LevelTouch], line: &Line, trend_sigma_mm: f64) -> Option<String> {
    let heights = || touches.iter().map(|touch| touch.height_mm);
    let (low, high) =
        (heights().fold(f64::INFINITY, f64::min), heights().fold(f64::NEG_INFINITY, f64::max));
    let squares: f64 = touches.iter().map(|touch| touch.sigma_mm.powi(2)).sum();
    let fine_step_mm = (12.0 * squares / line.count).sqrt();
    let limit_mm = (RANGE_STEPS * fine_step_mm).min(RANGE_MM);
    let range_mm = high - low;
    if range_mm > limit_mm {
        return Some(format!(
            "the heights range over {:.1} µm, where two fine steps of {:.1} µm, and at most {:.0} µm, are allowed",
            1e3 * range_mm,
            1e3 * fine_step_mm,
            1e3 * RANGE_MM
        ));
    }
    let trend_mm = line.slope_mm * line.way();
    let is_trend = trend_mm.abs() > CERTAIN * trend_sigma_mm && trend_mm.abs() > fine_step_mm;
    is_trend.then(|| {
        format!(
            "the heights change by {:+.1} µm from the first touch to the last, where one fine step of {:.1} µm is allowed",
            1e3 * trend_mm,
            1e3 * fine_step_mm
        )
    })
}

#[cfg(test)]
mod tests {
    use rig_model::random::Stream;

    use super::*;

    const FINE_MM: f64 = 0.004;

    /// Touches of a bench with this scatter and trend from touch to touch, mm, found by a search with the fine step.
    fn series(seed: u64, scatter_mm: f64, slope_mm: f64) -> Vec<LevelTouch> {
        let mut stream = Stream::new(seed, 133);
        let mut touch = |index: usize| {
            let surface_mm = 10.03 + scatter_mm * stream.normal() + slope_mm * index as f64;
            // The brackets begin where the coarse step has ended.
            let begin_mm = FINE_MM * stream.uniform();
            let steps = ((surface_mm - begin_mm) / FINE_MM).floor();
            LevelTouch {
                height_mm: begin_mm + FINE_MM * (steps + 0.5),
                sigma_mm: FINE_MM / 12.0_f64.sqrt(),
            }
        };
        (0..10).map(&mut touch).collect()
    }

    /// Share of series that are accepted, and of those whose values lie within 1.96 of their uncertainty.
    fn shares(scatter_mm: f64, slope_mm: f64) -> (f64, [f64; 3]) {
        const SERIES: u64 = 2000;
        let truth = [
            10.03 + 4.5 * slope_mm,
            9.0 * slope_mm,
            (scatter_mm.powi(2) + FINE_MM.powi(2) / 12.0).sqrt(),
        ];
        let (mut accepted, mut covered) = (0.0, [0.0; 3]);
        for seed in 0..SERIES {
            let finding = repeatability(&series(seed, scatter_mm, slope_mm)).unwrap();
            accepted += f64::from(u8::from(finding.verdict == Verdict::Accepted));
            for (index, value) in finding.values.iter().enumerate() {
                let off = (value.value - truth[index]).abs() / value.standard_uncertainty;
                covered[index] += f64::from(u8::from(off < 1.96));
            }
        }
        let share = |count: f64| count / SERIES as f64;
        (share(accepted), covered.map(share))
    }

    /// `cargo test -p rig-commission repeatability -- --nocapture` prints the shares.
    #[test]
    fn a_bench_that_repeats_is_accepted_and_a_loose_or_drifting_one_is_not() {
        let rows = [
            ("as fine as its search", 0.0005, 0.0, 0.99..=1.0),
            ("scatter of a fine step", 0.004, 0.0, 0.0..=0.2),
            ("scatter of 20 µm", 0.02, 0.0, 0.0..=0.001),
            ("drift of 7 µm", 0.0, 0.000_8, 0.0..=0.5),
            ("drift of 20 µm", 0.0, 0.002_2, 0.0..=0.01),
        ];
        for (what, scatter_mm, slope_mm, expected) in rows {
            let (accepted, covered) = shares(scatter_mm, slope_mm);
            println!("{what}: accepted {accepted:.3}, within 1.96: {covered:.3?}");
            assert!(expected.contains(&accepted), "{what}: {accepted}");
            // Student's distribution with eight degrees of freedom has 91 % there.
            assert!(covered.iter().all(|share| *share > 0.86), "{what}: {covered:?}");
        }
    }

    #[test]
    fn a_refusal_names_what_was_found_and_the_limit() {
        let why = |touches: &[LevelTouch]| match repeatability(touches).unwrap().verdict {
            Verdict::Failed(why) => why,
            other => panic!("{other:?}"),
        };
        let mut loose = series(1, 0.0, 0.0);
        loose[3].height_mm += 0.02;
        let said = why(&loose);
        assert!(said.contains("range over") && said.contains("4.0 µm"), "{said}");
        let few = repeatability(&loose[..9]).unwrap_err().to_string();
        assert_eq!(few, "9 touches on the level block; at least 10 are needed");
    }
}
