//! Sensitivity: the slope of the shift over the stiffness.
//!
//! The paper defines the sensitivity as "the ratio between the resonant frequency shift and the
//! change in stiffness" and gives one number for its whole range. That is the chord between the
//! softest and the stiffest sample. The shift is concave in stiffness, so that the slope of the
//! least-squares line differs from the chord, and both depend on the choice of samples. The largest
//! distance from the line shows the limits of a single slope.

/// A sample of known stiffness and its shift.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SampleShift {
    /// Known Young's modulus, MPa.
    pub stiffness_mpa: f64,
    /// Frequency shift, Hz.
    pub shift_hz: f64,
    /// Standard deviation of the shift, Hz.
    pub sigma_hz: f64,
}

/// A slope with its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slope {
    /// Slope of the shift over the stiffness, Hz/MPa.
    pub hz_per_mpa: f64,
    /// Standard deviation of the slope from those of the shifts, Hz/MPa.
    pub sigma_hz_per_mpa: f64,
}

/// The sensitivity over the range of the samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensitivity {
    /// Slope between the softest and the stiffest sample.
    pub chord: Slope,
    /// Slope of the least-squares line through all samples.
    pub line: Slope,
    /// Shift of that line at zero stiffness, Hz.
    pub intercept_hz: f64,
    /// The largest distance of a sample from that line, Hz.
    pub max_deviation_hz: f64,
}

/// A refused sensitivity.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum SensitivityError {
    /// A number is infinite or not a number.
    #[error("sensitivity: point {index} is not finite")]
    NotFinite {
        /// Index of the point.
        index: usize,
    },
    /// There are fewer than two different stiffnesses.
    #[error("sensitivity: all points have the same stiffness, or there are fewer than two")]
    NoRange,
}

/// The sensitivity from samples of known stiffness, in any order.
///
/// # Errors
/// [`SensitivityError`] for fewer than two different stiffnesses or a number that is not finite.
///
/// # Source
/// Sensors 2020, 20, 6607, section 3.1.1: 134.11 Hz/MPa from 0.045 MPa to 0.649 MPa.
pub fn sensitivity(points: &[SampleShift]) -> Result<Sensitivity, SensitivityError> {
    let is_finite = |point: &SampleShift| {
        [point.stiffness_mpa, point.shift_hz, point.sigma_hz].iter().all(|x| x.is_finite())
    };
    if let Some(index) = points.iter().position(|point| !is_finite(point)) {
        return Err(SensitivityError::NotFinite { index });
    }
    let softness = |a: &&SampleShift, b: &&SampleShift| a.stiffness_mpa.total_cmp(&b.stiffness_mpa);
    let ends = points.iter().min_by(softness).zip(points.iter().max_by(softness));
    let (soft, stiff) = ends.ok_or(SensitivityError::NoRange)?;
    let range = stiff.stiffness_mpa - soft.stiffness_mpa;
    if range <= 0.0 {
        return Err(SensitivityError::NoRange);
    }
    let chord = Slope {
        hz_per_mpa: (stiff.shift_hz - soft.shift_hz) / range,
        sigma_hz_per_mpa: soft.sigma_hz.hypot(stiff.sigma_hz) / range,
    };

    let n = points.len() as f64;
    let mean_mpa = points.iter().map(|point| point.stiffness_mpa).sum::<f64>() / n;
    let mean_hz = points.iter().map(|point| point.shift_hz).sum::<f64>() / n;
    let sxx: f64 = points.iter().map(|point| (point.stiffness_mpa - mean_mpa).powi(2)).sum();
    let weight = |point: &SampleShift| (point.stiffness_mpa - mean_mpa) / sxx;
    let slope: f64 = points.iter().map(|point| weight(point) * (point.shift_hz - mean_hz)).sum();
    let variance: f64 = points.iter().map(|point| (weight(point) * point.sigma_hz).powi(2)).sum();
    let intercept_hz = mean_hz - slope * mean_mpa;
    let deviation =
        |point: &SampleShift| (point.shift_hz - intercept_hz - slope * point.stiffness_mpa).abs();
    Ok(Sensitivity {
        chord,
        line: Slope { hz_per_mpa: slope, sigma_hz_per_mpa: variance.sqrt() },
        intercept_hz,
        max_deviation_hz: points.iter().map(deviation).fold(0.0, f64::max),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const STIFFNESS_MPA: [f64; 5] = [0.045, 0.104, 0.235, 0.320, 0.649];

    fn points(shift_hz: impl Fn(f64) -> f64) -> Vec<SampleShift> {
        let point = |stiffness_mpa| SampleShift {
            stiffness_mpa,
            shift_hz: shift_hz(stiffness_mpa),
            sigma_hz: 0.1,
        };
        STIFFNESS_MPA.map(point).to_vec()
    }

    #[test]
    fn a_straight_line_gives_its_slope_both_ways() {
        let found = sensitivity(&points(|mpa| 2.0 + 134.11 * mpa)).unwrap();
        assert!((found.chord.hz_per_mpa - 134.11).abs() < 1e-10, "{found:?}");
        assert!((found.line.hz_per_mpa - 134.11).abs() < 1e-10, "{found:?}");
        assert!((found.intercept_hz - 2.0).abs() < 1e-11, "{found:?}");
        assert!(found.max_deviation_hz < 1e-11, "{found:?}");
        assert!((found.chord.sigma_hz_per_mpa - 0.1 * 2.0_f64.sqrt() / 0.604).abs() < 1e-12);
    }

    #[test]
    fn a_concave_curve_has_a_chord_a_line_and_a_distance_between_them() {
        // Reference: the normal equations of these five points in exact fractions.
        let shifts = [7.98, 17.82, 37.68, 49.41, 88.99];
        let points: Vec<SampleShift> = STIFFNESS_MPA
            .iter()
            .zip(shifts)
            .map(|(&stiffness_mpa, shift_hz)| SampleShift {
                stiffness_mpa,
                shift_hz,
                sigma_hz: 0.1,
            })
            .collect();
        let found = sensitivity(&points).unwrap();
        assert!((found.chord.hz_per_mpa - 81.01 / 0.604).abs() < 1e-10, "{found:?}");
        assert!((found.line.hz_per_mpa - 133.02948588575595).abs() < 1e-8, "{found:?}");
        assert!((found.intercept_hz - 4.378221119314444).abs() < 1e-8, "{found:?}");
        assert!((found.max_deviation_hz - 2.462343397243657).abs() < 1e-8, "{found:?}");
    }

    #[test]
    fn the_order_of_the_samples_does_not_matter() {
        let mut shuffled = points(|mpa| 100.0 * mpa.sqrt());
        let ordered = sensitivity(&shuffled).unwrap();
        shuffled.rotate_left(3);
        let found = sensitivity(&shuffled).unwrap();
        assert_eq!(found.chord, ordered.chord);
        assert!((found.line.hz_per_mpa - ordered.line.hz_per_mpa).abs() < 1e-11);
    }

    #[test]
    fn points_without_a_range_are_refused() {
        let same = [points(|mpa| mpa)[0]; 3];
        assert_eq!(sensitivity(&same), Err(SensitivityError::NoRange));
        assert_eq!(sensitivity(&same[..1]), Err(SensitivityError::NoRange));
        assert_eq!(sensitivity(&[]), Err(SensitivityError::NoRange));
        let mut one_bad = points(|mpa| mpa);
        one_bad[3].shift_hz = f64::NAN;
        assert_eq!(sensitivity(&one_bad), Err(SensitivityError::NotFinite { index: 3 }));
    }
}
