//! Pick-up from the mains.
//!
//! A lock-in responds to signals near its reference frequency. Near a multiple of 50 or 60 Hz the
//! pick-up of the cables scatters the readings by a random amount, because the phase of the mains is
//! random. This is additional noise near these frequencies, so that such readings are down-weighted.

use std::f64::consts::PI;

use crate::circuit::trace::{Sample, Trace};

/// Mains pick-up that is visible in the scatter of readings.
#[derive(Debug, Clone)]
pub(crate) struct PickUp {
    /// The multiple of the mains frequency, Hz.
    pub(crate) near_hz: f64,
    /// The variance that it adds to each part of the relative error of each sample.
    pub(crate) added: Vec<f64>,
    /// The variance of each part of a reading of ten cycles without pick-up.
    pub(crate) variance: f64,
    /// Twice the log-likelihood gained.
    pub(crate) gain: f64,
}

const MAINS_HZ: [f64; 2] = [50.0, 60.0];
/// Highest multiple tried. Higher multiples are weak, and a voltage symmetric in time has few even
/// ones.
const MULTIPLES: i32 = 6;
/// Assumed integration times, in cycles or in seconds, if they are unknown.
const CYCLES: f64 = 10.0;
const SECONDS: [f64; 2] = [0.3, 1.0];
/// Twice the log-likelihood that pick-up must gain. Chance reaches it once in ten thousand sweeps: a
/// dozen multiples and three widths are tried.
const GAIN_MIN: f64 = 27.0;
/// Smallest trial variance of pick-up in units of the noise, the factor between trials, and their
/// number.
const TIMES_MIN: f64 = 3.0;
const FACTOR: f64 = 2.0;
const TRIALS: usize = 20;

/// The pick-up that best explains the differences of the weighted |r|² of the samples.
pub(crate) fn strongest(trace: &Trace, sizes: &[f64]) -> Option<PickUp> {
    let used = || trace.samples.iter().filter(|sample| sample.weight > 0.0);
    let frequencies = used().map(|sample| sample.visit.frequency_hz);
    let (low, high) =
        frequencies.fold((f64::INFINITY, 0.0_f64), |(low, high), f| (low.min(f), high.max(f)));
    let mean =
        used().map(|sample| sample.impedance.norm_sqr()).sum::<f64>() / used().count() as f64;
    let is_known = used().all(|sample| sample.visit.integration_s > 0.0);
    let widths: [&dyn Fn(&Sample) -> f64; 3] = [
        &|sample| {
            if is_known { sample.visit.integration_s } else { CYCLES / sample.visit.frequency_hz }
        },
        &|_| SECONDS[0],
        &|_| SECONDS[1],
    ];
    let widths = if is_known { &widths[..1] } else { &widths[..] };
    MAINS_HZ
        .iter()
        .flat_map(|mains_hz| (1..=MULTIPLES).map(move |multiple| mains_hz * f64::from(multiple)))
        .filter(|near_hz| (low..high).contains(near_hz))
        .flat_map(|near_hz| widths.iter().map(move |width| (near_hz, width)))
        .filter_map(|(near_hz, integration_s)| {
            let profile: Vec<f64> = trace
                .samples
                .iter()
                .map(|sample| {
                    let turns = (sample.visit.frequency_hz - near_hz) * integration_s(sample);
                    sample.impedance.norm_sqr() / mean * sinc(turns).powi(2)
                })
                .collect();
            most_likely(trace, sizes, near_hz, &profile)
        })
        .filter(|found| found.gain > GAIN_MIN)
        .max_by(|a, b| a.gain.total_cmp(&b.gain))
}

/// The most likely strength of pick-up with this profile.
fn most_likely(trace: &Trace, sizes: &[f64], near_hz: f64, profile: &[f64]) -> Option<PickUp> {
    let parts: Vec<(f64, f64)> = trace
        .samples
        .iter()
        .zip(sizes.iter().zip(profile))
        .filter(|(sample, _)| sample.weight > 0.0)
        .map(|(sample, (size, profile))| (0.5 * size, sample.weight * profile))
        .collect();
    let count = parts.len() as f64;
    // |r|² is exponentially distributed about its mean.
    let fit = |times: f64| {
        let (sum, logarithms) =
            parts.iter().fold((0.0, 0.0), |(sum, logarithms), (half, share)| {
                let variance = 1.0 + times * share;
                (sum + half / variance, logarithms + variance.ln())
            });
        (sum / count, -2.0 * (logarithms + count * (sum / count).ln()))
    };
    let (_, without) = fit(0.0);
    (0..TRIALS)
        .scan(TIMES_MIN / FACTOR, |times, _| {
            *times *= FACTOR;
            Some((*times, fit(*times)))
        })
        .max_by(|a, b| a.1.1.total_cmp(&b.1.1))
        .map(|(times, (variance, likelihood))| PickUp {
            near_hz,
            added: profile.iter().map(|profile| times * variance * profile).collect(),
            variance,
            gain: likelihood - without,
        })
}

fn sinc(turns: f64) -> f64 {
    if turns.abs() < 1e-6 { 1.0 } else { (PI * turns).sin() / (PI * turns) }
}
