//! How well an axis comes back after its drive was without power, from the readings of a test indicator.
//!
//! ```text
//!   reading
//!     │  0   ·     ·        ·   ─┐ range: at most 5 µm at the carriage, 7 µm at the table
//!     │────·────────────·────·── │ scatter: about the mean
//!     │  │    ·        ·        ─┘
//!     └──┴───────────────────── number of the homing; 0 before the first
//! ```

use crate::{Finding, Value, Verdict};

/// Largest range of the readings, mm: at the carriage, and at the edge of the table.
const RANGE_MM: [f64; 2] = [0.005, 0.007];

/// Where the indicator of the table stands, mm from its axis.
pub(crate) const EDGE_MM: f64 = 20.0;

/// Standard deviation of a reading by the divisions of the indicator, mm.
const DIVISION_MM: f64 = 0.001 / 3.464_101_615_137_754_5;

/// The readings at one axis, the first of them before the power went.
#[derive(Debug, Clone, Copy)]
pub struct Kept<'a> {
    /// Readings of the test indicator, mm.
    pub readings_mm: &'a [f64],
    /// Whether the drive forgets its place, and finds its zero.
    pub is_homing: bool,
}

/// Judges the linear and the rotary stage. The values are the standard deviation of a place to which an axis comes back, and
/// whether its drive homes (1) or keeps its place (0).
pub fn judge(axes: [Kept<'_>; 2]) -> Finding {
    let [linear, rotary] = axes;
    let scatter = |name, kept: Kept<'_>, per_mm: f64, unit| {
        let count = kept.readings_mm.len() as f64;
        let mean = kept.readings_mm.iter().sum::<f64>() / count;
        let squares: f64 = kept.readings_mm.iter().map(|reading| (reading - mean).powi(2)).sum();
        let sigma_mm = (squares / (count - 1.0).max(1.0)).sqrt();
        // Of a standard deviation with n − 1 degrees of freedom, and of the divisions.
        let uncertainty_mm = (sigma_mm / (2.0 * (count - 1.0).max(1.0)).sqrt()).hypot(DIVISION_MM);
        Value {
            name,
            value: sigma_mm * per_mm,
            standard_uncertainty: uncertainty_mm * per_mm,
            unit,
        }
    };
    let homes = |name, kept: Kept<'_>| Value {
        name,
        value: f64::from(u8::from(kept.is_homing)),
        standard_uncertainty: 0.0,
        unit: "1",
    };
    let values = vec![
        scatter("linear.homing", linear, 1.0, "mm"),
        homes("linear.homes", linear),
        scatter("rotary.homing", rotary, (1.0 / EDGE_MM).to_degrees(), "°"),
        homes("rotary.homes", rotary),
    ];
    let finding = Finding::of(values, Vec::new());
    let why = [("carriage", linear, RANGE_MM[0]), ("table", rotary, RANGE_MM[1])]
        .into_iter()
        .find_map(refused);
    match why {
        Some(why) => Finding { verdict: Verdict::Failed(why), ..finding },
        None => finding,
    }
}

/// Why an axis is not accepted.
fn refused((name, kept, limit_mm): (&str, Kept<'_>, f64)) -> Option<String> {
    let readings = || kept.readings_mm.iter().copied();
    let (low, high) =
        (readings().fold(f64::INFINITY, f64::min), readings().fold(f64::NEG_INFINITY, f64::max));
    let range_mm = high - low;
    // A reading has three decimals; the sum of two of them has more.
    (range_mm > limit_mm + 1e-9).then(|| {
        format!(
            "the indicator at the {name} ranges over {:.0} µm, where {:.0} µm are allowed",
            1e3 * range_mm,
            1e3 * limit_mm
        )
    })
}

#[cfg(test)]
mod tests {
    use rig_model::random::Stream;

    use super::*;

    /// Readings of an axis whose homing scatters, with divisions of 1 µm.
    fn readings(seed: u64, scatter_mm: f64) -> Vec<f64> {
        let mut stream = Stream::new(seed, 117);
        let mut read = |_| ((scatter_mm * stream.normal()) / 0.001).round() * 0.001;
        // The indicator is set to zero after a homing as good as the others.
        let first = read(0);
        (0..11).map(|index| if index == 0 { 0.0 } else { read(index) - first }).collect()
    }

    /// `cargo test -p rig-commission homing -- --nocapture` prints the shares.
    #[test]
    fn an_axis_that_comes_back_is_accepted_and_a_loose_one_is_not() {
        const SERIES: u64 = 2000;
        for (what, scatter_mm, accepted) in [
            ("0.5 µm", 0.000_5, 0.99..=1.0),
            ("1 µm", 0.001, 0.8..=1.0),
            ("3 µm", 0.003, 0.0..=0.05),
            ("10 µm", 0.01, 0.0..=0.001),
        ] {
            let (mut passed, mut covered) = (0.0, 0.0);
            for seed in 0..SERIES {
                let series = readings(seed, scatter_mm);
                let kept = Kept { readings_mm: &series, is_homing: true };
                let still = Kept { readings_mm: &[0.0; 4], is_homing: false };
                let finding = judge([kept, still]);
                passed += f64::from(u8::from(finding.verdict == Verdict::Accepted));
                let Value { value, standard_uncertainty, .. } = finding.values[0];
                let is_within = (value - scatter_mm).abs() < 1.96 * standard_uncertainty;
                covered += f64::from(u8::from(is_within));
            }
            let (passed, covered) = (passed / SERIES as f64, covered / SERIES as f64);
            println!("{what}: accepted {passed:.3}, within 1.96: {covered:.3}");
            assert!(accepted.contains(&passed), "{what}: {passed}");
            assert!(covered > 0.86, "{what}: {covered}");
        }
    }

    #[test]
    fn a_refusal_names_axis_range_and_limit() {
        let still = Kept { readings_mm: &[0.0, 0.001, 0.0, 0.0], is_homing: false };
        let moved = Kept { readings_mm: &[0.0, 0.012, 0.011], is_homing: false };
        assert_eq!(judge([still, still]).verdict, Verdict::Accepted);
        let why = "the indicator at the table ranges over 12 µm, where 7 µm are allowed";
        assert_eq!(judge([still, moved]).verdict, Verdict::Failed(why.to_owned()));
    }
}
