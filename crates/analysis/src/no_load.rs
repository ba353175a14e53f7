//! The no-load resonance over a run.

/// One measurement of the no-load resonance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoLoadMeasurement {
    /// Start of the measurement, s.
    pub time_s: f64,
    /// No-load resonance, Hz.
    pub frequency_hz: f64,
    /// Standard deviation of the resonance, Hz.
    pub sigma_hz: f64,
}

/// The no-load measurements of a run, summarised.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoLoadSummary {
    /// Mean resonance, Hz.
    pub mean_hz: f64,
    /// Standard deviation about the mean, Hz; mostly drift. `None` for a single measurement.
    pub spread_hz: Option<f64>,
    /// Lowest resonance, Hz.
    pub min_hz: f64,
    /// Highest resonance, Hz.
    pub max_hz: f64,
    /// Slope of the least-squares line over time; `None` for fewer than three measurements.
    pub drift: Option<Drift>,
    /// Number of measurements.
    pub count: usize,
}

/// A slow change of the no-load resonance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drift {
    /// Slope, Hz per hour.
    pub hz_per_hour: f64,
    /// Standard deviation of the slope, Hz per hour, from the scatter about the line.
    pub sigma_hz_per_hour: f64,
}

/// Summarises the measurements of a run; `None` for an empty list.
pub fn summarize(measurements: &[NoLoadMeasurement]) -> Option<NoLoadSummary> {
    let first = measurements.first()?;
    let n = measurements.len() as f64;
    let frequencies = || measurements.iter().map(|measurement| measurement.frequency_hz);
    let mean_hz = frequencies().sum::<f64>() / n;
    let squares: f64 = frequencies().map(|frequency| (frequency - mean_hz).powi(2)).sum();
    Some(NoLoadSummary {
        mean_hz,
        spread_hz: (measurements.len() > 1).then(|| (squares / (n - 1.0)).sqrt()),
        min_hz: frequencies().fold(first.frequency_hz, f64::min),
        max_hz: frequencies().fold(first.frequency_hz, f64::max),
        drift: drift(measurements),
        count: measurements.len(),
    })
}

/// The line through at least three measurements at different times.
fn drift(measurements: &[NoLoadMeasurement]) -> Option<Drift> {
    const SECONDS_PER_HOUR: f64 = 3600.0;
    if measurements.len() < 3 {
        return None;
    }
    let n = measurements.len() as f64;
    let mean_s = measurements.iter().map(|measurement| measurement.time_s).sum::<f64>() / n;
    let mean_hz = measurements.iter().map(|measurement| measurement.frequency_hz).sum::<f64>() / n;
    let about_mean = || measurements.iter().map(|r| (r.time_s - mean_s, r.frequency_hz - mean_hz));
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

    fn measurements(frequency_hz: impl Fn(f64) -> f64) -> Vec<NoLoadMeasurement> {
        let measurement = |time_s| NoLoadMeasurement {
            time_s,
            frequency_hz: frequency_hz(time_s),
            sigma_hz: 0.02,
        };
        [0.0, 600.0, 1200.0, 1800.0].map(measurement).to_vec()
    }

    #[test]
    fn a_steady_drift_is_found_in_hertz_per_hour() {
        let found = summarize(&measurements(|time_s| 140.4 - 0.6 * time_s / 3600.0)).unwrap();
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
        let mut scattered = measurements(|_| 140.0);
        for (measurement, shift) in scattered.iter_mut().zip(shifts) {
            measurement.frequency_hz += shift;
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
        let all = measurements(|_| 140.0);
        assert_eq!(summarize(&all[..2]).unwrap().drift, None);
        assert_eq!(summarize(&[all[0]; 4]).unwrap().drift, None);
    }
}
