//! A disk that fails while the rig is opened: at the first record of a session, or at one soon after it.

use std::pin::pin;

use rig_engine::RigState;
use rig_sim::world::AxisId;
use rig_store::{DiskFailure, MemoryDisk, Reader};
use rig_tests::shipped;
use rigd::{
    loaded_rig::LoadedRig,
    rig::{self, RigHandle},
};

/// What became of a rig that was opened on a failing disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    NotOpened,
    Latched,
    /// The failure comes later.
    Idle,
}

/// The clear position of the shipped rig, and twice the tolerance of its axis, mm.
const CLEAR_MM: f64 = 24.5;
const WITHIN_MM: f64 = 0.004;

/// Opens the shipped rig on a disk whose writer fails from the n-th call on. Returns its end, and the number of
/// records on the disk. Without a journal the probe is not lowered below its clear position.
async fn opened(nth: u64, failure: DiskFailure) -> (End, usize) {
    let rig = LoadedRig::load(&shipped("config/rigs/simulated.toml")).unwrap();
    let disk = MemoryDisk::new().unwrap();
    disk.fail_from(nth, failure);
    let Ok((handle, rig)) = rig::open_in_memory(rig, &disk, None).await else {
        return (End::NotOpened, 0);
    };
    let before_mm = target_mm(&handle);
    assert!(before_mm > CLEAR_MM + 1.0, "the way out would go up: {before_mm} mm");
    let mut status = handle.status();
    let mut serving = pin!(rig.serve());
    let is_settled = |state| matches!(state, RigState::Idle | RigState::Latched);
    let state = tokio::select! {
        () = &mut serving => panic!("the rig ended by itself"),
        status = status.wait_for(|status| is_settled(status.snapshot.state)) => {
            let status = status.unwrap();
            assert!(status.journal_error.is_none() || status.snapshot.state == RigState::Latched);
            status.snapshot.state
        }
    };
    let target_mm = target_mm(&handle);
    assert!(target_mm > CLEAR_MM - WITHIN_MM, "{failure:?} from call {nth} on: {target_mm} mm");
    tokio::join!(handle.close(), serving);
    let records = Reader::open_in_memory(&disk).unwrap().events_after(0, u32::MAX).unwrap().len();
    // The only way down is that of a rig that is prepared, whose first record is on the disk.
    let is_down = target_mm < before_mm - WITHIN_MM;
    assert!(!is_down || records > 0, "{failure:?} from call {nth} on: down to {target_mm} mm");
    let end = if state == RigState::Idle { End::Idle } else { End::Latched };
    (end, records)
}

/// Where the linear stage of the bench was sent, mm.
fn target_mm(handle: &RigHandle) -> f64 {
    let simulation = handle.simulation().unwrap();
    simulation.with(|_, rig| rig.world().stage(AxisId::Linear).target())
}

#[test]
fn a_rig_whose_first_record_cannot_be_written_is_latched_above_all_samples() {
    for failure in [DiskFailure::Full, DiskFailure::Io, DiskFailure::ReadOnly] {
        let (mut ends, mut without_a_record) = (Vec::new(), 0);
        for nth in 1..=60 {
            let runtime = tokio::runtime::Builder::new_current_thread()
                .enable_time()
                .start_paused(true)
                .build()
                .unwrap();
            let (end, records) = runtime.block_on(opened(nth, failure));
            without_a_record += u32::from(end == End::Latched && records == 0);
            ends.push(end);
        }
        assert!(without_a_record > 0, "{failure:?}: {ends:?}");
        for end in [End::NotOpened, End::Latched, End::Idle] {
            assert!(ends.contains(&end), "{failure:?}: never {end:?}: {ends:?}");
        }
    }
}
