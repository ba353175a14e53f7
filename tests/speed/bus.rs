//! The time of one transaction with a Modbus device through the driver.

use std::{
    error::Error,
    time::{Duration, Instant},
};

use rig_link::{Clock, Endpoint, Port};
use rig_model::{LineSettings, Parity, StopBits};
use rig_stage::{BusHandle, BusSettings};

/// Reads four registers of unit 1 again and again, each time after a pause, and prints the median
/// time of one read in microseconds, without the pause. The runtime is that of the rig's thread.
#[tokio::main(flavor = "current_thread")]
pub(crate) async fn time(
    framing: &str,
    address: &str,
    count: usize,
    pause_us: u64,
) -> Result<(), Box<dyn Error>> {
    let (endpoint, settings) = match framing {
        "rtu" => {
            let line =
                LineSettings { baud: 115_200, parity: Parity::None, stop_bits: StopBits::One };
            (Endpoint::Serial { path: address.to_owned(), line }, BusSettings::rtu())
        }
        _ => (Endpoint::Tcp { address: address.to_owned() }, BusSettings::tcp()),
    };
    let bus = BusHandle::open(Port::open(endpoint, Clock::start()).await?, settings);
    let mut took = Vec::with_capacity(count);
    for _ in 0..count {
        // The pace at which the transactions are asked, an argument of the measurement and the same for
        // every library; nothing is waited for. It blocks the runtime too.
        std::thread::sleep(Duration::from_micros(pause_us));
        let asked = Instant::now();
        bus.read(1, 0, 4).await?;
        took.push(asked.elapsed());
    }
    took.sort_unstable();
    println!("{:.1}", took[count / 2].as_secs_f64() * 1e6);
    Ok(())
}
