//! How long one transaction with a Modbus device takes through the driver:
//! `bus_overhead rtu PATH COUNT PAUSE_US` or `bus_overhead tcp ADDRESS COUNT PAUSE_US`.
//!
//! Reads four registers of unit 1 again and again, with a pause before each, and prints the median
//! time of one read in microseconds. The pause is no part of it. `tests/peers/overhead.sh` compares
//! this with what other libraries take for the same.
#![expect(clippy::print_stdout, reason = "the number is the output of this program")]

use std::time::{Duration, Instant};

use rig_link::{Clock, Endpoint, Port};
use rig_model::LineSettings;
use rig_stage::{BusHandle, BusSettings};

// As the rig's own thread runs it.
#[tokio::main(flavor = "current_thread")]
async fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [framing, place, count, pause_us] = &arguments[..] else {
        return Err("usage: bus_overhead rtu|tcp PLACE COUNT PAUSE_US".into());
    };
    let (endpoint, settings) = match framing.as_str() {
        "rtu" => {
            let line = LineSettings::eight_n_one(115_200);
            (Endpoint::Serial { path: place.clone(), line }, BusSettings::rtu())
        }
        _ => (Endpoint::Tcp { address: place.clone() }, BusSettings::tcp()),
    };
    let (count, pause) = (count.parse::<usize>()?, Duration::from_micros(pause_us.parse()?));
    let bus = BusHandle::open(Port::open(endpoint, Clock::start()).await?, settings);
    let mut took = Vec::with_capacity(count);
    for _ in 0..count {
        // The same sleep for every library, which leaves the runtime asleep as well.
        std::thread::sleep(pause);
        let asked = Instant::now();
        bus.read(1, 0, 4).await?;
        took.push(asked.elapsed());
    }
    took.sort_unstable();
    println!("{:.1}", took[count / 2].as_secs_f64() * 1e6);
    Ok(())
}
