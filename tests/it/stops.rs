//! A stop reaches both drives whatever the rig is busy with.

use std::time::Duration;

use rig_engine::{Command, RigState};
use rig_model::{Clearance, Position};
use rig_store::MemoryDisk;
use rig_tests::{
    shipped,
    stops::{During, StopBench, arrivals},
};
use rigd::{loaded_rig::LoadedRig, rig};
use tokio::time::{Instant, sleep};

/// A tenth of this is what the rig needs; a loaded machine takes its time.
const WITHIN: Duration = Duration::from_secs(1);

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_stop_reaches_both_drives_in_every_activity() {
    let bench = StopBench::open(16).await;
    for during in During::ALL {
        let latencies = bench.stop(during, Duration::from_millis(150)).await;
        let is_fast = latencies.iter().all(|latency| *latency < WITHIN);
        assert!(is_fast, "{}: {latencies:?}", during.name());
    }
    bench.close().await;
}

/// The way out after a stop during a move at a height of 15 mm, with this many more stops: how long it
/// takes until the rig is latched with the probe clear, and the stops that arrived at each drive.
async fn way_out(stops: u32) -> (Duration, [usize; 2]) {
    let rig = LoadedRig::load(&shipped("config/rigs/simulated.toml")).unwrap();
    let disk = MemoryDisk::new().unwrap();
    let (handle, rig) = rig::open_in_memory(rig, &disk, None).await.unwrap();
    let act = async {
        let mut status = handle.status();
        let give = async |command| handle.command(command, None, "a person").await.unwrap();
        status.wait_for(|status| status.snapshot.state == RigState::Idle).await.unwrap();
        give(Command::MoveLinear(Position::new(15.0))).await;
        status.wait_for(|status| status.snapshot.state == RigState::Idle).await.unwrap();
        let simulation = handle.simulation().unwrap();
        simulation.with(|_, rig| rig.listen_in());
        let begun = Instant::now();
        give(Command::Stop).await;
        status.wait_for(|status| status.snapshot.state == RigState::Retracting).await.unwrap();
        for _ in 0..stops {
            tokio::select! {
                biased;
                _ = status.wait_for(|status| status.snapshot.state == RigState::Latched) => break,
                () = sleep(Duration::from_millis(40)) => {
                    let asked = Instant::now();
                    give(Command::Stop).await;
                    assert!(asked.elapsed() < Duration::from_millis(100));
                }
            }
        }
        let latched = |status: &rig::Status| status.snapshot.state == RigState::Latched;
        let clearance = status.wait_for(latched).await.unwrap().snapshot.clearance;
        assert_eq!(clearance, Clearance::Clear);
        let took = begun.elapsed();
        let heard = simulation.with(|_, rig| [1, 2].map(|unit| arrivals(rig, unit).count()));
        handle.close().await;
        (took, heard)
    };
    let ((), out) = tokio::join!(rig.serve(), act);
    out
}

#[tokio::test(start_paused = true)]
async fn stops_during_a_retract_neither_delay_it_nor_reach_the_drives_again() {
    let (took, heard) = way_out(0).await;
    assert!(took < Duration::from_secs(10) && heard.iter().all(|count| *count > 0), "{took:?}");
    assert_eq!(way_out(1).await, (took, heard));
    assert_eq!(way_out(1000).await, (took, heard));
}

#[tokio::test(start_paused = true)]
async fn a_stop_is_served_while_the_rig_closes() {
    let rig = LoadedRig::load(&shipped("config/rigs/simulated.toml")).unwrap();
    let (handle, rig) = rig::open_in_memory(rig, &MemoryDisk::new().unwrap(), None).await.unwrap();
    let act = async {
        let mut status = handle.status();
        status.wait_for(|status| status.snapshot.state == RigState::Preparing).await.unwrap();
        sleep(Duration::from_millis(100)).await;
        let begun = Instant::now();
        let stop = async {
            sleep(Duration::from_millis(100)).await;
            handle.command(Command::Stop, None, "a person").await.unwrap();
            status.wait_for(|status| status.snapshot.state != RigState::Preparing).await.unwrap();
            assert!(begun.elapsed() < Duration::from_secs(1), "{:?}", begun.elapsed());
        };
        tokio::join!(handle.close(), handle.close(), stop);
        assert_eq!(status.borrow().snapshot.state, RigState::Latched);
    };
    tokio::join!(rig.serve(), act);
}
