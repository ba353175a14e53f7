//! How long a measurement takes through the driver: `analyzer_overhead PATH COUNT`, with an IM3536 at the
//! serial port.
//!
//! Measures one point again and again, and prints the median time of it in microseconds, and then
//! the messages of the last two: settings that have not changed are not sent again.
//! `tests/peers/overhead.sh` compares it with what another library takes for the same messages.
#![expect(clippy::print_stdout, reason = "the numbers are the output of this program")]

use std::time::Instant;

use rig_analyzer::{Analyzer, HIOKI_IM3536};
use rig_link::{Clock, Endpoint, Flow, Frame, Port, StopSignal};
use rig_model::{DriveLevel, LineSettings, SweepPoint};

// As the rig's own thread runs it.
#[tokio::main(flavor = "current_thread")]
async fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, count] = &arguments[..] else {
        return Err("usage: analyzer_overhead PATH COUNT".into());
    };
    let line = LineSettings::eight_n_one(38_400);
    let endpoint = Endpoint::Serial { path: path.clone(), line };
    let clock = Clock::start();
    let mut analyzer = Analyzer::open(Port::open(endpoint, clock).await?, &HIOKI_IM3536);
    analyzer.identify().await?;
    analyzer.configure(DriveLevel { volt: 1.0 }).await?;
    let (count, stop) = (count.parse::<usize>()?, StopSignal::new());
    let mut took = Vec::with_capacity(count);
    let mut last_two = clock.now();
    for number in 0..count {
        // No two neighbours are alike, as in a sweep.
        #[expect(clippy::cast_precision_loss, reason = "it is small")]
        let frequency_hz = 10_000.0 + (number % 100) as f64;
        let point = SweepPoint { frequency_hz, settle_s: 0.0, cycles: 1 };
        if number + 2 == count {
            last_two = clock.now();
        }
        let asked = Instant::now();
        analyzer.measure(&[point], &stop).await?;
        took.push(asked.elapsed());
    }
    took.sort_unstable();
    println!("{:.1}", took[count / 2].as_secs_f64() * 1e6);
    let frames = analyzer.transcript().frames();
    let is_sent = |frame: &&Frame| frame.flow == Flow::Sent && last_two <= frame.at;
    for frame in frames.iter().filter(is_sent) {
        println!("{}", String::from_utf8_lossy(&frame.bytes).trim_end());
    }
    Ok(())
}
