//! A stop reaches both drives whatever the rig is busy with.

use std::time::Duration;

use rig_tests::stops::{During, StopBench};

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
