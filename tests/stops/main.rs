//! How long a stop takes from the client to the port of the drives, in each activity of the rig and
//! with clients that poll it.
//!
//! `cargo run -p rig-tests --release --bin stops -- --stops 20 --clients 64` prints a line for each
//! activity. The exit code is 0 only if every stop arrived within `--within-ms`.

#![expect(clippy::print_stdout, reason = "what it prints is what it is for")]

use std::{process::ExitCode, time::Duration};

use clap::Parser;
use rig_tests::stops::{During, StopBench};

/// Measures how long a stop takes to the port of the drives.
#[derive(Debug, Clone, Parser)]
struct Arguments {
    /// Stops in each activity.
    #[arg(long, default_value_t = 20)]
    stops: u32,
    /// Clients that poll the daemon.
    #[arg(long, default_value_t = 64)]
    clients: usize,
    /// The longest time allowed, ms.
    #[arg(long, default_value_t = 100)]
    within_ms: u64,
}

#[tokio::main]
async fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let within = Duration::from_millis(arguments.within_ms);
    let bench = StopBench::open(arguments.clients).await;
    let mut is_fast = true;
    for during in During::ALL {
        let mut all = [Vec::new(), Vec::new()];
        for n in 0..arguments.stops {
            // At another moment of the activity each time.
            let delay = Duration::from_millis(u64::from(n * 37 % 400));
            let latencies = bench.stop(during, delay).await;
            for (all, latency) in all.iter_mut().zip(latencies) {
                all.push(latency);
            }
        }
        let figures = all.map(|mut all| {
            all.sort_unstable();
            let ms = |latency: &Duration| 1000.0 * latency.as_secs_f64();
            is_fast &= all.iter().all(|latency| *latency <= within);
            let (median, longest) = (all.get(all.len() / 2), all.last());
            format!("{:6.1} ms, {:6.1} ms", median.map_or(0.0, ms), longest.map_or(0.0, ms))
        });
        let [linear, rotary] = figures;
        println!("{:32} linear {linear}   rotary {rotary}", during.name());
    }
    println!("median and longest of {} stops, {} clients", arguments.stops, arguments.clients);
    bench.close().await;
    if is_fast { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
