//! Fits the sweeps of a file again and again.
//!
//! The file holds 64-bit floats, little-endian: the number of sweeps, the number of points, the
//! frequencies in Hz, then for each sweep the real and the imaginary part of each impedance in ohm.
//! Each point is integrated over ten cycles.

use std::{error::Error, fs, hint::black_box, num::NonZero, time::Instant};

use rig_model::{Impedance, PointResult, Reading, RigTime};
use rig_resonance::{FitOptions, FitOutcome, Fitter};

/// Prints one line for each sweep: the resonance and its standard deviation in Hz and the model, or
/// `refused` and the reason; then the 10th percentile, the median, the mean and the 99th percentile
/// of the time of one call, in microseconds.
pub(crate) fn time(file: &str, rounds: NonZero<u32>) -> Result<(), Box<dyn Error>> {
    let sweeps = sweeps(&fs::read(file)?)?;
    let options = FitOptions::default();
    let mut fitter = Fitter::default();
    let mut micros = Vec::new();
    // The first round warms up, and prints.
    for readings in &sweeps {
        match fitter.fit(readings, &options) {
            FitOutcome::Accepted(found) => {
                println!("{} {} {}", found.resonance_hz, found.sigma_hz, found.model_order.name());
            }
            FitOutcome::Refused(refusal) => println!("refused {}", refusal.reason.code()),
        }
    }
    for _ in 0..rounds.get() {
        for readings in &sweeps {
            let start = Instant::now();
            black_box(fitter.fit(black_box(readings), &options));
            micros.push(start.elapsed().as_secs_f64() * 1e6);
        }
    }
    micros.sort_unstable_by(f64::total_cmp);
    let percentile = |percent: usize| micros[(micros.len() - 1) * percent / 100];
    let mean = micros.iter().sum::<f64>() / micros.len() as f64;
    let (p10, median, p99) = (percentile(10), percentile(50), percentile(99));
    println!("micros {p10:.3} {median:.3} {mean:.3} {p99:.3}");
    Ok(())
}

fn sweeps(bytes: &[u8]) -> Result<Vec<Vec<Reading>>, Box<dyn Error>> {
    let (floats, []) = bytes.as_chunks() else { return Err("half a number at the end".into()) };
    let mut floats = floats.iter().copied().map(f64::from_le_bytes);
    let mut next = || floats.next().ok_or("the file is too short");
    let (sweeps, points) = (next()?, next()?);
    let count = |number: f64| -> Result<usize, Box<dyn Error>> { Ok(format!("{number}").parse()?) };
    let (sweeps, points) = (count(sweeps)?, count(points)?);
    let frequencies = (0..points).map(|_| next()).collect::<Result<Vec<_>, _>>()?;
    let mut sweep = || {
        let reading = |frequency_hz: &f64| {
            Ok(Reading {
                frequency_hz: *frequency_hz,
                measured: PointResult::Value(Impedance {
                    resistance_ohm: next()?,
                    reactance_ohm: next()?,
                }),
                started: RigTime::ZERO,
                settle_s: 60.0,
                integration_s: 10.0 / frequency_hz,
            })
        };
        frequencies.iter().map(reading).collect()
    };
    (0..sweeps).map(|_| sweep()).collect()
}
