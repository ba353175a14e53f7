//! The free sensor: its circuit, its drift, whether it is linear with the level of the drive, and whether it has a second
//! mode, from sweeps without contact.
//!
//! Least squares of `f = f₀ + drift · t + slope · V²` over all sweeps tell drift and level apart, because each round has
//! every level. The residuals give the uncertainties.

use crate::{Calibration, Finding, Value, Verdict};

/// Fewest sweeps, and levels: the line has three unknowns.
const LEAST: usize = 9;

/// Fewest surveys whose circuit is taken.
const LEAST_SURVEYS: usize = 3;

/// Share of sweeps that may be refused.
const REFUSED: f64 = 0.2;

/// Largest drift that is accepted, Hz an hour.
pub const DRIFT_HZ_PER_H: f64 = 1.0;
/// Largest shift between the lowest and the highest level that is accepted, Hz.
pub const LEVEL_HZ: f64 = 0.2;

/// A drift or a shift of so many of its standard deviations is none by chance.
const CERTAIN: f64 = 3.0;

/// Largest relative changes against the record before.
const CHANGES: [(&str, f64); 5] = [
    ("sensor.resonance", 0.005),
    ("sensor.quality", 0.15),
    ("sensor.coupling", 0.05),
    ("sensor.capacitance", 0.03),
    ("sensor.loss", 0.2),
];

/// An accepted sweep of the free sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FreeSweep {
    /// The time for which it holds, s.
    pub at_s: f64,
    /// Level of the drive, V.
    pub level_v: f64,
    /// Series resonance, Hz.
    pub resonance_hz: f64,
    /// Its quality factor.
    pub quality_factor: f64,
    /// Motional capacitance in units of the static one.
    pub capacitance_ratio: f64,
    /// Static capacitance, F.
    pub capacitance_f: f64,
    /// Dielectric loss tangent.
    pub loss_tangent: f64,
}

/// All sweeps of a check.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SensorSweeps {
    /// The accepted ones, in their order.
    pub sweeps: Vec<FreeSweep>,
    /// Number of the others.
    pub refused: usize,
    /// The accepted surveys, which show the circuit better.
    pub surveys: Vec<FreeSweep>,
    /// Why a survey of the bench was refused, such as by a second mode.
    pub survey_refused: Option<String>,
}

/// Sweeps that show no sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NoSensor {
    /// Too few accepted ones.
    #[error("{found} accepted sweeps of the free sensor; at least {LEAST} are needed")]
    TooFew {
        /// Their number.
        found: usize,
    },
    /// One level, or one moment.
    #[error("the sweeps have one level or one time, and tell drift and level not apart")]
    Alike,
}

/// Judges the sweeps, against an earlier record of the same sensor if there is one.
///
/// # Errors
/// [`NoSensor`].
pub fn judge(all: &SensorSweeps, before: Option<&Calibration>) -> Result<Finding, NoSensor> {
    let SensorSweeps { sweeps, refused, surveys, survey_refused } = all;
    let found = sweeps.len();
    if found < LEAST {
        // Where the others were refused, that is what was found of the sensor.
        let many = too_many(*refused, found).filter(|_| LEAST <= found + refused);
        return many.map(Finding::failed).ok_or(NoSensor::TooFew { found });
    }
    let Some(line) = Line::through(sweeps) else {
        return too_many(*refused, found).map(Finding::failed).ok_or(NoSensor::Alike);
    };
    let mean = |name, unit, of: fn(&FreeSweep) -> f64| {
        let shown = if surveys.len() < LEAST_SURVEYS { sweeps } else { surveys };
        let count = shown.len() as f64;
        let value = shown.iter().map(of).sum::<f64>() / count;
        let squares: f64 = shown.iter().map(|sweep| (of(sweep) - value).powi(2)).sum();
        let standard_uncertainty = (squares / (count - 1.0) / count).sqrt();
        Value { name, value, standard_uncertainty, unit }
    };
    let of_line = |name, unit, index: usize, scale: f64| Value {
        name,
        value: line.found[index] * scale,
        standard_uncertainty: line.sigmas[index] * scale.abs(),
        unit,
    };
    let values = vec![
        of_line("sensor.resonance", "Hz", 0, 1.0),
        of_line("sensor.drift", "Hz/h", 1, 1.0),
        of_line("sensor.level", "Hz", 2, line.span_v2),
        mean("sensor.quality", "1", |sweep| sweep.quality_factor),
        mean("sensor.coupling", "1", |sweep| {
            sweep.capacitance_ratio / (1.0 + sweep.capacitance_ratio)
        }),
        mean("sensor.capacitance", "nF", |sweep| 1e9 * sweep.capacitance_f),
        mean("sensor.loss", "1", |sweep| sweep.loss_tangent),
    ];
    // A sensor that drifts or softens also has sweeps that are refused: the cause comes first.
    let why = beyond(&values[1], DRIFT_HZ_PER_H)
        .or_else(|| beyond(&values[2], LEVEL_HZ))
        .or_else(|| changed(&values, before?))
        .or_else(|| Some(format!("the survey was refused: {}", survey_refused.as_ref()?)))
        .or_else(|| too_many(*refused, found));
    let finding = Finding::of(values, Vec::new());
    Ok(match why {
        Some(why) => Finding { verdict: Verdict::Failed(why), ..finding },
        None => finding,
    })
}

fn too_many(refused: usize, found: usize) -> Option<String> {
    let all = refused + found;
    (refused as f64 > REFUSED * all as f64)
        .then(|| format!("{refused} of {all} sweeps of the free sensor were refused"))
}

/// A drift or a shift that is larger than allowed, or not known well enough to say that it is not.
fn beyond(value: &Value, limit: f64) -> Option<String> {
    let Value { name, value, standard_uncertainty: sigma, unit } = value;
    if value.abs() > limit && value.abs() > CERTAIN * sigma {
        return Some(format!(
            "{name} is {value:+.3} ± {sigma:.3} {unit}, where {limit} {unit} are allowed"
        ));
    }
    (*sigma > limit).then(|| {
        format!("{name} is known to ± {sigma:.3} {unit} only, where {limit} {unit} are allowed: measure for longer")
    })
}

/// A quantity that is not that of the record before.
fn changed(values: &[Value], before: &Calibration) -> Option<String> {
    CHANGES.into_iter().find_map(|(name, limit)| {
        let now = values.iter().find(|value| value.name == name)?;
        let then = before.values.iter().find(|value| value.name == name)?;
        let sigma = now.standard_uncertainty.hypot(then.standard_uncertainty);
        let change = now.value - then.value;
        let is_changed =
            change.abs() > limit * then.value.abs() && change.abs() > CERTAIN * sigma;
        is_changed.then(|| {
            format!(
                "{name} was {:.4} {unit} on {}, and is {:.4} {unit}: a change of {:.1} % where {:.1} % is allowed",
                then.value,
                before.made(),
                now.value,
                100.0 * change.abs() / then.value.abs(),
                100.0 * limit,
                unit = now.unit,
            )
        })
    })
}

/// Resonance over time and level by least squares.
struct Line {
    /// The resonance in the middle of the time at the lowest level, Hz; its change an hour; and for a V².
    found: [f64; 3],
    sigmas: [f64; 3],
    /// From the lowest to the highest level, V².
    span_v2: f64,
}

impl Line {
    /// `None` if time or level is the same for all.
    fn through(sweeps: &[FreeSweep]) -> Option<Self> {
        let squares = || sweeps.iter().map(|sweep| sweep.level_v.powi(2));
        let (low, high) =
            (squares().fold(f64::INFINITY, f64::min), squares().fold(f64::NEG_INFINITY, f64::max));
        let count = sweeps.len() as f64;
        let middle_s = sweeps.iter().map(|sweep| sweep.at_s).sum::<f64>() / count;
        let row = |sweep: &FreeSweep| {
            [1.0, (sweep.at_s - middle_s) / 3600.0, sweep.level_v.powi(2) - low]
        };
        // The resonance is some hundred times its changes; a part of it is taken off.
        let origin_hz = sweeps[0].resonance_hz;
        let (mut normal, mut right) = ([[0.0; 3]; 3], [0.0; 3]);
        for sweep in sweeps {
            let row = row(sweep);
            for (i, part) in row.iter().enumerate() {
                right[i] += part * (sweep.resonance_hz - origin_hz);
                for (j, other) in row.iter().enumerate() {
                    normal[i][j] += part * other;
                }
            }
        }
        let inverse = inverse(normal)?;
        let dot = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let mut found = inverse.map(|row| dot(row, right));
        let residuals = sweeps
            .iter()
            .map(|sweep| (sweep.resonance_hz - origin_hz - dot(row(sweep), found)).powi(2));
        let variance = residuals.sum::<f64>() / (count - 3.0);
        let sigmas = [0, 1, 2].map(|index| (variance * inverse[index][index]).sqrt());
        found[0] += origin_hz;
        Some(Self { found, sigmas, span_v2: high - low })
    }
}

/// The inverse of a symmetric matrix, by its cofactors.
fn inverse(m: [[f64; 3]; 3]) -> Option<[[f64; 3]; 3]> {
    let cofactor = |i: usize, j: usize| {
        let (a, b, c, d) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
        m[a][c] * m[b][d] - m[a][d] * m[b][c]
    };
    let determinant: f64 = (0..3).map(|j| m[0][j] * cofactor(0, j)).sum();
    let size = m[0][0] * m[1][1] * m[2][2];
    // Times or levels that are the same leave rounding alone.
    (determinant > 1e-9 * size)
        .then(|| [0, 1, 2].map(|i| [0, 1, 2].map(|j| cofactor(i, j) / determinant)))
}

#[cfg(test)]
mod tests {
    use rig_model::random::Stream;

    use super::*;

    /// Sweeps of a sensor with this drift, Hz/h, and softening, Hz/V², in rounds of three levels over a quarter of an hour.
    fn sweeps(seed: u64, drift: f64, softening: f64) -> SensorSweeps {
        let mut stream = Stream::new(seed, 125);
        let mut sweep = |index: usize| {
            let level_v = [0.5, 2.0, 5.0][index % 3];
            let at_s = 30.0 * index as f64;
            let noise_hz = 0.02 * stream.normal();
            FreeSweep {
                at_s,
                level_v,
                resonance_hz: 140.4
                    + drift * at_s / 3600.0
                    + softening * level_v.powi(2)
                    + noise_hz,
                quality_factor: 33.0 * (1.0 + 0.003 * stream.normal()),
                capacitance_ratio: 0.08 * (1.0 + 0.002 * stream.normal()),
                capacitance_f: 27.4e-9 * (1.0 + 0.001 * stream.normal()),
                loss_tangent: 0.018,
            }
        };
        SensorSweeps { sweeps: (0..30).map(&mut sweep).collect(), ..SensorSweeps::default() }
    }

    /// `cargo test -p rig-commission sensor -- --nocapture` prints the shares.
    #[test]
    fn drift_and_level_are_told_apart_and_a_sensor_with_much_of_either_is_not_accepted() {
        const SERIES: u64 = 1000;
        for (what, drift, softening, accepted) in [
            ("neither", 0.0, 0.0, 0.99..=1.0),
            ("drift 0.3 Hz/h", 0.3, 0.0, 0.99..=1.0),
            ("drift 3 Hz/h", 3.0, 0.0, 0.0..=0.001),
            ("level −0.1 Hz", 0.0, -0.1 / 24.75, 0.99..=1.0),
            ("level −0.5 Hz", 0.0, -0.5 / 24.75, 0.0..=0.001),
            ("both", 3.0, -0.1 / 24.75, 0.0..=0.001),
        ] {
            let truths =
                [140.4 + drift * 435.0 / 3600.0 + softening * 0.25, drift, softening * 24.75];
            let (mut passed, mut covered) = (0.0, [0.0; 3]);
            for seed in 0..SERIES {
                let finding = judge(&sweeps(seed, drift, softening), None).unwrap();
                passed += f64::from(u8::from(finding.verdict == Verdict::Accepted));
                for ((value, truth), covered) in finding.values.iter().zip(truths).zip(&mut covered)
                {
                    let off = (value.value - truth).abs() / value.standard_uncertainty;
                    *covered += f64::from(u8::from(off < 1.96));
                }
            }
            let share = |count: f64| count / SERIES as f64;
            println!(
                "{what}: accepted {:.3}, within 1.96: {:.3?}",
                share(passed),
                covered.map(share)
            );
            assert!(accepted.contains(&share(passed)), "{what}: {}", share(passed));
            assert!(covered.iter().all(|count| share(*count) > 0.92), "{what}: {covered:?}");
        }
    }

    #[test]
    fn a_refusal_says_what_was_found() {
        let good = sweeps(1, 0.0, 0.0);
        let why = |all: &SensorSweeps| match judge(all, None).unwrap().verdict {
            Verdict::Failed(why) => why,
            other => panic!("{other:?}"),
        };
        let refused = SensorSweeps { refused: 10, ..good.clone() };
        assert_eq!(why(&refused), "10 of 40 sweeps of the free sensor were refused");
        let survey_refused = Some("a second mode".to_owned());
        let mode = SensorSweeps { survey_refused, ..good.clone() };
        assert_eq!(why(&mode), "the survey was refused: a second mode");
        let soft = why(&sweeps(1, 0.0, -0.04));
        assert!(
            soft.starts_with("sensor.level is -") && soft.ends_with("0.2 Hz are allowed"),
            "{soft}"
        );
        // A short time shows no drift.
        let mut short = good.clone();
        short.sweeps.iter_mut().for_each(|sweep| sweep.at_s *= 0.01);
        assert!(why(&short).ends_with("measure for longer"), "{}", why(&short));
        let few = SensorSweeps { sweeps: good.sweeps[..8].to_vec(), ..SensorSweeps::default() };
        assert_eq!(judge(&few, None), Err(NoSensor::TooFew { found: 8 }));
        let one = SensorSweeps { refused: 1, ..few.clone() };
        assert_eq!(judge(&one, None), Err(NoSensor::TooFew { found: 8 }));
        // What is mostly refused is found to be no good sensor, and not found to be nothing.
        let mostly = SensorSweeps { refused: 22, ..few };
        assert_eq!(why(&mostly), "22 of 30 sweeps of the free sensor were refused");
        let none = SensorSweeps { refused: 30, ..SensorSweeps::default() };
        assert_eq!(why(&none), "30 of 30 sweeps of the free sensor were refused");
        let mut low = SensorSweeps { refused: 20, ..good.clone() };
        low.sweeps.retain(|sweep| sweep.level_v < 1.0);
        assert_eq!(why(&low), "20 of 30 sweeps of the free sensor were refused");
        let mut one = good;
        one.sweeps.iter_mut().for_each(|sweep| sweep.level_v = 1.0);
        assert_eq!(judge(&one, None), Err(NoSensor::Alike));
    }
}
