//! Microseconds per fit, from readings to verdict: `cargo bench -p rig-resonance`.
//!
//! Prints the median and 99th percentile of the time that passes in a call, and the mean processor time
//! of a call, over calls on different noise. Other programs on the machine do not change the mean.

#![expect(clippy::print_stdout, reason = "printing is what it is for")]

use std::{hint::black_box, time::Instant};

use rand_core::Rng;
use rand_pcg::Pcg64;
use rig_model::{Impedance, PointResult, Reading, RigTime};
use rig_resonance::{Circuit, FitOptions, FitOutcome, Fitter, Timing};

const CALLS: usize = 20_000;
const SWEEPS: usize = 2000;

fn main() {
    println!("points loss times   median_us mean_us p99_us accepted");
    for points in [21, 101, 401] {
        for (loss_tangent, timing) in
            [(0.0, Timing::Waited), (0.02, Timing::Waited), (0.0, Timing::Unknown)]
        {
            let sweeps = sweeps(points, loss_tangent);
            let always_loss = loss_tangent > 0.0;
            let options = FitOptions { always_loss, timing, ..FitOptions::default() };
            let mut fitter = Fitter::default();
            let mut accepted = 0;
            let began = processor_s();
            let mut micros: Vec<f64> = (0..CALLS)
                .map(|call| {
                    let readings = black_box(&sweeps[call % SWEEPS]);
                    let start = Instant::now();
                    let verdict = black_box(fitter.fit(readings, &options));
                    let micros = start.elapsed().as_secs_f64() * 1e6;
                    accepted += usize::from(matches!(verdict, FitOutcome::Accepted(_)));
                    micros
                })
                .collect();
            let mean = (processor_s() - began) * 1e6 / CALLS as f64;
            micros.sort_unstable_by(f64::total_cmp);
            let (median, p99) = (micros[CALLS / 2], micros[CALLS * 99 / 100]);
            let times = if timing == Timing::Unknown { "unknown" } else { "known" };
            println!(
                "{points:6} {loss_tangent:4} {times:7} {median:9.2} {mean:7.2} {p99:6.2} {accepted:8}"
            );
        }
    }
}

/// Processor time of this thread, s.
fn processor_s() -> f64 {
    rig_system::clocks::of_thread().as_secs_f64()
}

/// Even sweeps over ±20 % with 0.5 % of noise.
fn sweeps(points: usize, loss_tangent: f64) -> Vec<Vec<Reading>> {
    let (q, c0_farad, c1_farad) = (30.0, 27e-9, 1.5e-9);
    let circuit = Circuit { resonance_hz: 140.2, q, c0_farad, c1_farad, loss_tangent };
    let mut random = Pcg64::new(1, 2);
    let mut normal = move || {
        // The sum of twelve even numbers is normal enough here.
        (0..12).map(|_| random.next_u64() as f64 / 2_f64.powi(64)).sum::<f64>() - 6.0
    };
    let step = 56.0 / (points - 1) as f64;
    (0..SWEEPS)
        .map(|_| {
            (0..points)
                .map(|i| {
                    let frequency_hz = 112.0 + step * i as f64;
                    let impedance = circuit.impedance_ohm(frequency_hz);
                    let (re, im) = (1.0 + 0.005 * normal(), 0.005 * normal());
                    Reading {
                        frequency_hz,
                        measured: PointResult::Value(Impedance {
                            resistance_ohm: impedance.re * re - impedance.im * im,
                            reactance_ohm: impedance.re * im + impedance.im * re,
                        }),
                        started: RigTime::ZERO,
                        settle_s: 0.5,
                        integration_s: 10.0 / frequency_hz,
                    }
                })
                .collect()
        })
        .collect()
}
