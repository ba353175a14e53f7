//! The time of one measurement through the driver, with an IM3536 at a serial port.

use std::{error::Error, time::Instant};

use rig_analyzer::Analyzer;
use rig_files::instrument::HIOKI_IM3536;
use rig_link::{Clock, Endpoint, Flow, Frame, Port, StopSignal};
use rig_model::{DriveLevel, LineSettings, Parity, StopBits, SweepPoint};

/// Measures one point again and again, and prints the median time in microseconds, then the messages
/// of the last two points: the driver does not repeat unchanged settings. The runtime is that of the
/// rig's thread.
#[tokio::main(flavor = "current_thread")]
pub(crate) async fn time(path: &str, count: usize) -> Result<(), Box<dyn Error>> {
    let line = LineSettings { baud: 38_400, parity: Parity::None, stop_bits: StopBits::One };
    let endpoint = Endpoint::Serial { path: path.to_owned(), line };
    let clock = Clock::start();
    let mut analyzer = Analyzer::open(Port::open(endpoint, clock).await?, &HIOKI_IM3536);
    analyzer.identify().await?;
    analyzer.configure(DriveLevel { volt: 1.0 }).await?;
    let stop = StopSignal::new();
    let mut took = Vec::with_capacity(count);
    let mut last_two = clock.now();
    for number in 0..count {
        // Neighbours differ, as in a sweep.
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
