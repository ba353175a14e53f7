//! Opens the simulated rig, runs a protocol on it in virtual time, and prints the touches:
//! `cargo run -p rigd --example simulated_rig`.
#![expect(clippy::print_stdout, reason = "the touches are the output of this program")]

use std::{error::Error, path::Path};

use rig_store::{Reader, Record};
use rigd::{loaded_rig::LoadedRig, protocol_file::LoadedProtocol, rig};
use tempfile::TempDir;

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
    // Another rig file, with `connection = "ports"`, opens real instruments instead.
    let loaded = LoadedRig::load(&config.join("rigs/simulated.toml"))?;
    let protocol = LoadedProtocol::load(&config.join("protocols/smoke.toml"), &loaded.facts())?;
    let data = TempDir::new()?;
    let (handle, thread) = rig::open(loaded, data.path().to_owned())?;
    let mut status = handle.status();

    // After opening, the rig homes its axes and proves that the probe is clear.
    status.wait_for(|status| status.snapshot.state == rig_engine::RigState::Idle).await?;
    let id = handle.run(protocol, "example").await?;
    let ended = status.wait_for(|status| {
        status.run.as_ref().is_some_and(|run| run.id == id && run.ending.is_some())
    });
    println!("{:?}", ended.await?.run.as_ref().and_then(|run| run.ending));
    handle.close().await;
    thread.join();

    for stored in Reader::open(data.path())?.records(id)? {
        if let Record::TouchResult(touch) = stored.record()? {
            println!(
                "{} {:?} {:>2}°: {:6.2} Hz ± {:.2} Hz",
                touch.touch.sample,
                touch.touch.pose.direction,
                touch.touch.pose.angle_deg,
                touch.shift_hz,
                touch.shift_sigma_hz
            );
        }
    }
    Ok(())
}
