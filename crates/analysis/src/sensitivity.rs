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

/// The sensitivity from samples of known stiffness, in any order. `shared_hz2` is the covariance of the shifts of two
/// different points, Hz²: what they share goes out of a slope.
///
/// # Errors
/// [`SensitivityError`] for fewer than two different stiffnesses or a number that is not finite.
///
/// # Source
/// Sensors 2020, 20, 6607, section 3.1.1: 134.11 Hz/MPa from 0.045 MPa to 0.649 MPa.
pub fn sensitivity(
    points: &[SampleShift],
    shared_hz2: impl Fn(usize, usize) -> f64,
) -> Result<Sensitivity, SensitivityError> {
    let is_finite = |point: &SampleShift| {
        [point.stiffness_mpa, point.shift_hz, point.sigma_hz].iter().all(|x| x.is_finite())
    };
    if let Some(index) = points.iter().position(|point| !is_finite(point)) {
        return Err(SensitivityError::NotFinite { index });
    }
    let softness =
        |a: &usize, b: &usize| points[*a].stiffness_mpa.total_cmp(&points[*b].stiffness_mpa);
    let ends = (0..points.len()).min_by(softness).zip((0..points.len()).max_by(softness));
    let (softest, stiffest) = ends.ok_or(SensitivityError::NoRange)?;
    let (soft, stiff) = (points[softest], points[stiffest]);
    let range = stiff.stiffness_mpa - soft.stiffness_mpa;
    if range <= 0.0 {
        return Err(SensitivityError::NoRange);
    }
    let apart_hz2 =
        soft.sigma_hz.powi(2) + stiff.sigma_hz.powi(2) - 2.0 * shared_hz2(softest, stiffest);
    let chord = Slope {
        hz_per_mpa: (stiff.shift_hz - soft.shift_hz) / range,
        sigma_hz_per_mpa: apart_hz2.max(0.0).sqrt() / range,
    };

    let n = points.len() as f64;
    let mean_mpa = points.iter().map(|point| point.stiffness_mpa).sum::<f64>() / n;
    let mean_hz = points.iter().map(|point| point.shift_hz).sum::<f64>() / n;
    let sxx: f64 = points.iter().map(|point| (point.stiffness_mpa - mean_mpa).powi(2)).sum();
    let weight = |point: &SampleShift| (point.stiffness_mpa - mean_mpa) / sxx;
    let slope: f64 = points.iter().map(|point| weight(point) * (point.shift_hz - mean_hz)).sum();
    let own: f64 = points.iter().map(|point| (weight(point) * point.sigma_hz).powi(2)).sum();
    let all = || points.iter().enumerate();
    let pairs = all().flat_map(|a| all().filter(move |b| b.0 != a.0).map(move |b| (a, b)));
    let shared = pairs.map(|((i, a), (j, b))| weight(a) * weight(b) * shared_hz2(i, j));
    let variance = (own + shared.sum::<f64>()).max(0.0);
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

    /// Of points that share nothing.
    fn alone(points: &[SampleShift]) -> Result<Sensitivity, SensitivityError> {
        sensitivity(points, |_, _| 0.0)
    }

    /// Of each variance of 0.01 Hz², 0.0075 Hz² are common: what is left is half of the standard deviation.
    #[test]
    fn what_the_samples_share_goes_out_of_a_slope() {
        let points = points(|mpa| 2.0 + 134.11 * mpa);
        let (alone, sharing) =
            (alone(&points).unwrap(), sensitivity(&points, |_, _| 0.0075).unwrap());
        for (alone, sharing) in [(alone.chord, sharing.chord), (alone.line, sharing.line)] {
            assert_eq!(alone.hz_per_mpa, sharing.hz_per_mpa);
            let ratio = sharing.sigma_hz_per_mpa / alone.sigma_hz_per_mpa;
            assert!((ratio - 0.5).abs() < 1e-9, "{ratio}");
        }
    }

    #[test]
    fn a_straight_line_gives_its_slope_both_ways() {
        let found = alone(&points(|mpa| 2.0 + 134.11 * mpa)).unwrap();
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
        let found = alone(&points).unwrap();
        assert!((found.chord.hz_per_mpa - 81.01 / 0.604).abs() < 1e-10, "{found:?}");
        assert!((found.line.hz_per_mpa - 133.02948588575595).abs() < 1e-8, "{found:?}");
        assert!((found.intercept_hz - 4.378221119314444).abs() < 1e-8, "{found:?}");
        assert!((found.max_deviation_hz - 2.462343397243657).abs() < 1e-8, "{found:?}");
    }

    #[test]
    fn the_order_of_the_samples_does_not_matter() {
        let mut shuffled = points(|mpa| 100.0 * mpa.sqrt());
        let ordered = alone(&shuffled).unwrap();
        shuffled.rotate_left(3);
        let found = alone(&shuffled).unwrap();
        assert_eq!(found.chord, ordered.chord);
        assert!((found.line.hz_per_mpa - ordered.line.hz_per_mpa).abs() < 1e-11);
    }

    #[test]
    fn points_without_a_range_are_refused() {
        let same = [points(|mpa| mpa)[0]; 3];
        assert_eq!(alone(&same), Err(SensitivityError::NoRange));
        assert_eq!(alone(&same[..1]), Err(SensitivityError::NoRange));
        assert_eq!(alone(&[]), Err(SensitivityError::NoRange));
        let mut one_bad = points(|mpa| mpa);
        one_bad[3].shift_hz = f64::NAN;
        assert_eq!(alone(&one_bad), Err(SensitivityError::NotFinite { index: 3 }));
    }
}
