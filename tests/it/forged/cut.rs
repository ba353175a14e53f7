//! A run that ended with a fault, forged as one that was cut off by the end of its program.

use rig_engine::{Command, RigState, RunStatus};
use rig_tests::{TestRig, forge::Forgery, text};
use rig_verify::Check;

use super::{any, names};

#[tokio::test]
async fn a_fault_that_is_taken_out_with_its_ending_is_found() {
    let rig = TestRig::open().await;
    rig.fault("fault bus alarm code=48 unit=1 nth=90");
    let (run, status) = rig.run(rig.protocol(&text("config/protocols/smoke.toml"))).await;
    assert_eq!(status, RunStatus::Faulted);
    rig.command(Command::Acknowledge).await.unwrap();
    rig.wait_for("service", |status| status.snapshot.state == RigState::Idle).await;
    let forgery = || Forgery::of(rig.data(), &run.to_string());
    assert!(forgery().verdict().is_sound, "{:#?}", forgery().verdict().findings);

    let mut forged = forgery();
    let fault = forged.nth("fault", 0, any);
    forged.records.truncate(fault);
    forged.write(true);
    forged.execute("UPDATE runs SET status = 'running', finished_at = NULL WHERE key = ?1");
    assert_eq!(names(&forged.verdict()), [Check::Ends]);

    rig.handle.resume(run, true, "test").await.unwrap();
    assert_eq!(rig.ended(run).await, RunStatus::Completed);
    assert!(forgery().verdict().is_sound, "{:#?}", forgery().verdict().findings);
    let mut forged = forgery();
    let resumed = forged.nth("resumed", 0, any);
    forged.records.drain(fault..resumed);
    forged.write(true);
    assert!(names(&forged.verdict()).contains(&Check::Ends), "{:?}", forged.verdict().findings);
    rig.close().await;
}
