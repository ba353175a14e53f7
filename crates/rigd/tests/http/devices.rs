//! The counts of the devices, and their identities read again.

use rig_sim::{
    PortId,
    faults::{DeviceFault, Fault, FaultKind, FaultTrigger, ReplyFault},
};

use super::*;

impl Daemon {
    fn inject(&self, port: PortId, unit: Option<u8>, kind: FaultKind, trigger: FaultTrigger) {
        let simulation = self.handle.simulation().unwrap();
        simulation.with(|_, rig| rig.add_fault(Fault { port, unit, kind, trigger }));
    }

    async fn identify(&self) -> Vec<Value> {
        let (status, found) = self.ask("POST", "identify", &Value::Null).await;
        assert_eq!(status, StatusCode::OK, "{found}");
        self.wait_until_idle().await;
        found.as_array().unwrap().clone()
    }

    async fn health(&self, device: usize) -> Value {
        self.rig().await["devices"][device]["health"].clone()
    }
}

#[tokio::test]
async fn the_devices_of_an_idle_rig_say_again_who_they_are() {
    let daemon = Daemon::start().await;
    let before = daemon.rig().await;
    let found = daemon.identify().await;
    assert_eq!(found.len(), 3);
    for (device, known) in found.iter().zip(before["devices"].as_array().unwrap()) {
        assert_eq!((&device["role"], &device["known"]), (&known["role"], &known["identity"]));
        assert_eq!(device["found"], device["known"]);
        assert_eq!((&device["is_as_known"], &device["trouble"]), (&json!(true), &Value::Null));
    }
    assert_eq!(found[1]["position"], "24.500 mm");
    let after = daemon.rig().await;
    assert_eq!(after["linear_mm"], before["linear_mm"]);

    // A drive may be in an alarm, an analyzer may be silent.
    let alarm = FaultKind::Device(DeviceFault::Alarm(0x30));
    daemon.inject(PortId::Bus, Some(1), alarm, FaultTrigger::Nth(1));
    let silent = FaultKind::Reply(ReplyFault::Drop);
    daemon.inject(PortId::Analyzer, None, silent, FaultTrigger::Rate(1.0));
    let found = daemon.identify().await;
    assert_eq!((&found[0]["is_as_known"], &found[0]["found"]), (&json!(false), &Value::Null));
    assert!(found[0]["trouble"].as_str().unwrap().contains("nothing arrived"), "{}", found[0]);
    let trouble = found[1]["trouble"].as_str().unwrap();
    assert!(trouble.starts_with("alarm: "), "{trouble}");
    assert_eq!(found[1]["is_as_known"], true);
    assert_eq!(found[2]["trouble"], Value::Null);

    // A rig that does something else is not asked.
    daemon.handle.command(Command::Stop, None, "the lab").await.unwrap();
    let is_latched = |status: &Status| status.snapshot.state == RigState::Latched;
    daemon.handle.status().wait_for(is_latched).await.unwrap();
    let (status, problem) = daemon.ask("POST", "identify", &Value::Null).await;
    assert_eq!(status, StatusCode::CONFLICT, "{problem}");
    let detail = problem["detail"].as_str().unwrap();
    assert!(detail.contains("cannot identify the devices while the rig is latched"), "{detail}");
    daemon.close().await;
}

#[tokio::test]
async fn requests_repeats_and_bad_answers_are_counted_for_each_device() {
    let daemon = Daemon::start().await;
    for device in 0..3 {
        let health = daemon.health(device).await;
        assert!(health["requests"].as_u64() > Some(0), "{health}");
        assert!(health["last_round_trip_ms"].is_f64(), "{health}");
        for bad in ["retries", "late", "corrupt", "refusals"] {
            assert_eq!(health[bad], 0, "{device}: {health}");
        }
    }
    let rotary = daemon.health(2).await;
    for (device, port, unit) in [(0, PortId::Analyzer, None), (1, PortId::Bus, Some(1))] {
        for (kind, count) in [(ReplyFault::Drop, "late"), (ReplyFault::Truncate, "corrupt")] {
            let before = daemon.health(device).await;
            daemon.inject(port, unit, FaultKind::Reply(kind), FaultTrigger::Nth(1));
            let found = daemon.identify().await;
            assert_eq!(found[device]["is_as_known"], true, "{kind:?}: {}", found[device]);
            let after = daemon.health(device).await;
            let more =
                |count: &str| after[count].as_u64().unwrap() - before[count].as_u64().unwrap();
            assert_eq!((more("retries"), more(count)), (1, 1), "{kind:?}: {after}");
            assert_eq!(more("late") + more("corrupt"), 1, "{kind:?}: {after}");
        }
    }
    let health = daemon.health(2).await;
    assert_eq!((&health["retries"], &rotary["retries"]), (&json!(0), &json!(0)));
    assert!(health["requests"].as_u64() > rotary["requests"].as_u64());
    daemon.close().await;
}
