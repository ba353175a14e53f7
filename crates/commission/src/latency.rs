//! The latency between stage and analyzer, from touches that go down at two speeds.
//!
//! ```text
//!   surface     latency as it is        latency too small
//!     │                                   ·   ·   ·   ·        fast
//!     │          · · · · · · · ·
//!     │                                     ·   ·   ·   ·      slow
//!     └───────────────────────────────────────────────── number of the touch
//! ```
//!
//! Where an analyzer integrates later than its readings say, the probe is deeper than it seems when they show a contact: the
//! surface is found too high by latency times speed. Each descent says how its surface changes with the latency. Least squares
//! find the latency with which slow and fast touches find the same surface; a straight line over the number of the touch takes
//! a drift of the bench.

use crate::{Change, Finding, Value, Verdict, finding::rounded, metrology::Cholesky};

/// Fewest touches at each speed.
const LEAST: usize = 5;

/// The fast touches go down at least so many times as fast as the slow ones.
const RATIO: f64 = 2.0;

/// Largest standard uncertainty that is accepted, s: what a rig file states of a latency that nobody has measured.
const SIGMA_S: f64 = 0.003;

/// A latency of the rig file that is off by so many standard deviations is another one.
const CERTAIN: f64 = 2.58;

/// The model of the onset is no truer than this, mm.
///
/// # Source
/// `cargo test -p rig-resonance --test onset`: the bias of its surfaces at any stiffness of the shipped bench.
const MODEL_MM: f64 = 0.001;

/// A surface that a descent has found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DescentTouch {
    /// Speed downwards, mm/s.
    pub speed_mm_per_s: f64,
    /// Position of the linear stage at the surface, mm.
    pub surface_mm: f64,
    /// The latency with which that surface was found, s.
    pub latency_s: f64,
    /// Change of the surface for each second of latency beyond that one, mm/s.
    pub mm_per_latency_s: f64,
}

/// What the rig file states, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StatedLatency {
    /// `analyzer.latency_s`.
    pub latency_s: f64,
    /// `analyzer.latency_sigma_s`.
    pub sigma_s: f64,
}

/// Touches that show no latency.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum NoLatency {
    /// Too few.
    #[error(
        "{slow} touches found by a descent at the lower speed and {fast} at the higher one; at least {LEAST} of each are needed"
    )]
    TooFew {
        /// Number of slow touches.
        slow: usize,
        /// Number of fast touches.
        fast: usize,
    },
    /// The speeds are nearly the same.
    #[error(
        "descents at {slow_mm_per_s:.2} and {fast_mm_per_s:.2} mm/s; the higher speed must be at least {RATIO} times the lower one"
    )]
    Alike {
        /// The lower speed, mm/s.
        slow_mm_per_s: f64,
        /// The higher speed, mm/s.
        fast_mm_per_s: f64,
    },
}

/// Judges touches at one place, in the order in which they were made. The values are the latency and the scatter of a touch.
///
/// # Errors
/// [`NoLatency`].
pub fn latency(touches: &[DescentTouch], stated: StatedLatency) -> Result<Finding, NoLatency> {
    let speeds = || touches.iter().map(|touch| touch.speed_mm_per_s);
    let (slow_mm_per_s, fast_mm_per_s) =
        (speeds().fold(f64::INFINITY, f64::min), speeds().fold(0.0, f64::max));
    let middle = (slow_mm_per_s * fast_mm_per_s).sqrt();
    let slow = speeds().filter(|speed| *speed < middle).count();
    let fast = touches.len() - slow;
    if slow.min(fast) < LEAST {
        return Err(NoLatency::TooFew { slow, fast });
    }
    // NaN is refused too.
    let is_apart = RATIO * slow_mm_per_s <= fast_mm_per_s;
    let line = Line::through(touches).filter(|_| is_apart);
    let Some(line) = line else { return Err(NoLatency::Alike { slow_mm_per_s, fast_mm_per_s }) };
    let model_s = MODEL_MM / (fast_mm_per_s - slow_mm_per_s);
    let sigma_s = line.sigma_s.hypot(model_s);
    let scatter = Value {
        name: "latency.scatter",
        value: line.scatter_mm,
        // Of a standard deviation with this many degrees of freedom.
        standard_uncertainty: line.scatter_mm / (2.0 * line.freedom).sqrt(),
        unit: "mm",
    };
    let found = Value {
        name: "analyzer.latency_s",
        value: line.latency_s,
        standard_uncertainty: sigma_s,
        unit: "s",
    };
    let changes = changes(line.latency_s, sigma_s, stated);
    let finding = Finding::of(vec![found, scatter], changes);
    let is_known = sigma_s <= SIGMA_S;
    Ok(if is_known {
        finding
    } else {
        let why = format!(
            "the latency is known to ± {:.1} ms, where at most {:.1} ms are allowed: a touch scatters by {:.1} µm",
            1e3 * sigma_s,
            1e3 * SIGMA_S,
            1e3 * line.scatter_mm
        );
        Finding { verdict: Verdict::Failed(why), ..finding }
    })
}

fn changes(latency_s: f64, sigma_s: f64, stated: StatedLatency) -> Vec<Change> {
    if (latency_s - stated.latency_s).abs() <= CERTAIN * sigma_s.hypot(stated.sigma_s) {
        return Vec::new();
    }
    let change = |key, from: f64, to: f64| Change { key, from, to: rounded(to, 2) };
    vec![
        change("analyzer.latency_s", stated.latency_s, latency_s),
        change("analyzer.latency_sigma_s", stated.sigma_s, sigma_s),
    ]
}

/// Surface, latency and drift by least squares.
struct Line {
    latency_s: f64,
    sigma_s: f64,
    /// Standard deviation of a touch, mm.
    scatter_mm: f64,
    freedom: f64,
}

impl Line {
    /// `None` if the touches do not tell the unknowns apart.
    fn through(touches: &[DescentTouch]) -> Option<Self> {
        let count = touches.len() as f64;
        // surface - g L₀ = level + drift · number - g L, with g the change of the surface with the latency.
        let row = |(index, touch): (usize, &DescentTouch)| {
            let number = 2.0 * index as f64 / (count - 1.0) - 1.0;
            let gain = touch.mm_per_latency_s;
            (
                [1.0, number, -gain],
                touch.surface_mm - touches[0].surface_mm - gain * touch.latency_s,
            )
        };
        let rows: Vec<([f64; 3], f64)> = touches.iter().enumerate().map(row).collect();
        let mut normal = [[0.0; 3]; 3];
        let mut right = [0.0; 3];
        for (row, value) in &rows {
            for (index, one) in row.iter().enumerate() {
                right[index] += one * value;
                for (column, other) in row.iter().enumerate() {
                    normal[index][column] += one * other;
                }
            }
        }
        let factor = Cholesky::new(3, |row, column| normal[row][column])?;
        let solved = |right: &[f64]| factor.back(&factor.whiten(right));
        let unknowns = solved(&right);
        let off = |(row, value): &([f64; 3], f64)| {
            let expected: f64 = row.iter().zip(&unknowns).map(|(one, unknown)| one * unknown).sum();
            (value - expected).powi(2)
        };
        let freedom = count - 3.0;
        let variance = rows.iter().map(off).sum::<f64>() / freedom;
        Some(Self {
            latency_s: unknowns[2],
            sigma_s: (variance * solved(&[0.0, 0.0, 1.0])[2]).sqrt(),
            scatter_mm: variance.sqrt(),
            freedom,
        })
    }
}

#[cfg(test)]
mod tests {
    use rig_model::random::Stream;

    use super::*;

    const STATED: StatedLatency = StatedLatency { latency_s: 0.0, sigma_s: 0.003 };

    /// Twenty touches whose surfaces a fit with a latency of zero has found, in turn at both speeds, of a bench with this
    /// latency, s, scatter, mm, and drift from touch to touch, mm.
    fn series(seed: u64, latency_s: f64, scatter_mm: f64, drift_mm: f64) -> Vec<DescentTouch> {
        let mut stream = Stream::new(seed, 162);
        let mut touch = |index: usize| {
            let speed_mm_per_s = [1.0, 0.1][index % 2];
            // What the readings at rest know of the latency makes the surface change by less than the speed.
            let mm_per_latency_s = -0.9 * speed_mm_per_s;
            let moved_mm = scatter_mm * stream.normal() + drift_mm * index as f64;
            DescentTouch {
                speed_mm_per_s,
                surface_mm: 10.03 + moved_mm - mm_per_latency_s * latency_s,
                latency_s: 0.0,
                mm_per_latency_s,
            }
        };
        (0..20).map(&mut touch).collect()
    }

    /// `cargo test -p rig-commission latency -- --nocapture` prints the shares.
    #[test]
    fn the_latency_is_found_within_its_uncertainty_and_not_taken_for_a_drift() {
        const SERIES: u64 = 2000;
        let rows = [
            ("4 ms, scatter of 2 µm", 0.004, 0.002, 0.0, 1.0..=1.0),
            ("0, scatter of 2 µm, drift of 20 µm", 0.0, 0.002, 0.001, 1.0..=1.0),
            ("20 ms, scatter of 5 µm", 0.02, 0.005, 0.0, 0.4..=0.95),
            ("0, scatter of 20 µm", 0.0, 0.02, 0.0, 0.0..=0.01),
        ];
        for (what, latency_s, scatter_mm, drift_mm, known) in rows {
            let (mut covered, mut squares, mut is_known) = (0.0, 0.0, 0.0);
            for seed in 0..SERIES {
                let touches = series(seed, latency_s, scatter_mm, drift_mm);
                let finding = latency(&touches, STATED).unwrap();
                let Value { value, standard_uncertainty, .. } = finding.values[0];
                covered +=
                    f64::from(u8::from((value - latency_s).abs() < 1.96 * standard_uncertainty));
                squares += (value - latency_s).powi(2);
                is_known += f64::from(u8::from(!matches!(finding.verdict, Verdict::Failed(_))));
            }
            let share = |count: f64| count / SERIES as f64;
            println!(
                "{what}: error {:.2} ms rms, within 1.96: {:.3}, known to 3 ms: {:.3}",
                1e3 * share(squares).sqrt(),
                share(covered),
                share(is_known)
            );
            assert!(share(covered) > 0.92, "{what}");
            assert!(known.contains(&share(is_known)), "{what}");
        }
    }

    #[test]
    fn a_latency_that_is_not_that_of_the_rig_file_says_what_to_put_there() {
        let verdict =
            |latency_s: f64| latency(&series(3, latency_s, 0.001, 0.0), STATED).unwrap().verdict;
        assert_eq!(verdict(0.004), Verdict::Accepted);
        let Verdict::RigFile(changes) = verdict(0.02) else { panic!() };
        assert_eq!(changes[0].key, "analyzer.latency_s");
        assert!((changes[0].to - 0.02).abs() < 0.002, "{changes:?}");
        assert_eq!((changes[1].key, changes[1].from), ("analyzer.latency_sigma_s", 0.003));
        assert!(changes[1].to < 0.003, "{changes:?}");
    }

    #[test]
    fn the_latency_with_which_the_surfaces_were_found_does_not_matter() {
        let touches = series(5, 0.01, 0.001, 0.0);
        let found = |touches: &[DescentTouch]| latency(touches, STATED).unwrap().values[0].value;
        let corrected = touches.iter().map(|touch| DescentTouch {
            surface_mm: touch.surface_mm + 0.007 * touch.mm_per_latency_s,
            latency_s: 0.007,
            ..*touch
        });
        let corrected: Vec<DescentTouch> = corrected.collect();
        assert!((found(&touches) - found(&corrected)).abs() < 1e-9);
    }

    #[test]
    fn one_speed_and_few_touches_show_no_latency() {
        let touches = series(1, 0.0, 0.001, 0.0);
        let said = |touches: &[DescentTouch]| latency(touches, STATED).unwrap_err().to_string();
        assert!(said(&touches[..9]).contains("at least 5 of each"), "{}", said(&touches[..9]));
        let alike: Vec<DescentTouch> = touches
            .iter()
            .map(|touch| DescentTouch {
                speed_mm_per_s: 0.9 + 0.1 * touch.speed_mm_per_s,
                ..*touch
            })
            .collect();
        assert!(said(&alike).contains("at least 2 times"), "{}", said(&alike));
        assert_eq!(latency(&[], STATED), Err(NoLatency::TooFew { slow: 0, fast: 0 }));
    }
}
