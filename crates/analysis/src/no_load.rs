//! The resonance with the probe clear, over a run.

/// One measurement of the resonance with the probe clear.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reference {
    /// When, s.
    pub time_s: f64,
    /// Resonance, Hz.
    pub frequency_hz: f64,
    /// Its standard deviation, Hz.
    pub sigma_hz: f64,
}

/// What the references of a run have in common.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoLoad {
    /// Mean, Hz.
    pub mean_hz: f64,
    /// Standard deviation of the references about it, Hz, when there are several: mostly drift.
    pub spread_hz: Option<f64>,
    /// Lowest reference, Hz.
    pub min_hz: f64,
    /// Highest reference, Hz.
    pub max_hz: f64,
    /// Slope of the least-squares line over time, when there is one.
    pub drift: Option<Drift>,
    /// How many references there were.
    pub count: usize,
}

/// A slow change of the reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drift {
    /// Hz per hour.
    pub hz_per_hour: f64,
    /// Standard deviation of that, Hz per hour, from the scatter about the line.
    pub sigma_hz_per_hour: f64,
}

/// Sums up the references of a run; none when there are none.
pub fn summarize(references: &[Reference]) -> Option<NoLoad> {
    let first = references.first()?;
    let n = references.len() as f64;
    let frequencies = || references.iter().map(|reference| reference.frequency_hz);
    let mean_hz = frequencies().sum::<f64>() / n;
    let squares: f64 = frequencies().map(|frequency| (frequency - mean_hz).powi(2)).sum();
    Some(NoLoad {
        mean_hz,
        spread_hz: (references.len() > 1).then(|| (squares / (n - 1.0)).sqrt()),
        min_hz: frequencies().fold(first.frequency_hz, f64::min),
        max_hz: frequencies().fold(first.frequency_hz, f64::max),
        drift: drift(references),
        count: references.len(),
    })
}

/// The line through at least three references that are not all of one time.
fn drift(references: &[Reference]) -> Option<Drift> {
    const SECONDS_PER_HOUR: f64 = 3600.0;
    if references.len() < 3 {
        return None;
    }
    let n = references.len() as f64;
    let mean_s = references.iter().map(|reference| reference.time_s).sum::<f64>() / n;
    let mean_hz = references.iter().map(|reference| reference.frequency_hz).sum::<f64>() / n;
    let about_mean = || references.iter().map(|r| (r.time_s - mean_s, r.frequency_hz - mean_hz));
    let sxx: f64 = about_mean().map(|(t, _)| t * t).sum();
    if sxx <= 0.0 {
        return None;
    }
    let slope = about_mean().map(|(t, f)| t * f).sum::<f64>() / sxx;
    let residual: f64 = about_mean().map(|(t, f)| (f - slope * t).powi(2)).sum();
    let sigma = (residual / (n - 2.0) / sxx).sqrt();
    Some(Drift {
        hz_per_hour: slope * SECONDS_PER_HOUR,
        sigma_hz_per_hour: sigma * SECONDS_PER_HOUR,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn references(frequency_hz: impl Fn(f64) -> f64) -> Vec<Reference> {
        let reference =
            |time_s| Reference { time_s, frequency_hz: frequency_hz(time_s), sigma_hz: 0.02 };
        [0.0, 600.0, 1200.0, 1800.0].map(reference).to_vec()
    }

    #[test]
    fn a_steady_drift_is_found_in_hertz_per_hour() {
        let found = summarize(&references(|time_s| 140.4 - 0.6 * time_s / 3600.0)).unwrap();
        let drift = found.drift.unwrap();
        assert!((drift.hz_per_hour + 0.6).abs() < 1e-9, "{drift:?}");
        assert!(drift.sigma_hz_per_hour < 1e-9, "{drift:?}");
        assert!((found.mean_hz - 140.25).abs() < 1e-12, "{found:?}");
        // Of 0, 1, 2 and 3 tenths of a hertz.
        assert!((found.spread_hz.unwrap() - (0.05_f64 / 3.0).sqrt()).abs() < 1e-12, "{found:?}");
        assert_eq!((found.min_hz, found.max_hz, found.count), (140.1, 140.4, 4));
    }

    #[test]
    fn scatter_about_the_line_makes_the_drift_uncertain() {
        let shifts = [0.0, 0.1, -0.1, 0.0];
        let mut scattered = references(|_| 140.0);
        for (reference, shift) in scattered.iter_mut().zip(shifts) {
            reference.frequency_hz += shift;
        }
        let drift = summarize(&scattered).unwrap().drift.unwrap();
        // By hand, in units of 600 s: slope -0.1/5 = -0.02, residual sum of squares 0.018.
        assert!((drift.hz_per_hour + 0.02 * 6.0).abs() < 1e-9, "{drift:?}");
        let expected = (0.018_f64 / 2.0 / 5.0).sqrt() * 6.0;
        assert!((drift.sigma_hz_per_hour - expected).abs() < 1e-9, "{drift:?}");
    }

    #[test]
    fn too_few_references_or_one_moment_have_no_drift() {
        assert_eq!(summarize(&[]), None);
        let all = references(|_| 140.0);
        assert_eq!(summarize(&all[..2]).unwrap().drift, None);
        assert_eq!(summarize(&[all[0]; 4]).unwrap().drift, None);
    }
}
