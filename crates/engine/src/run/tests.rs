use rig_protocol::StepId;

use super::*;
use crate::contact_sense::tests::{loose_sweep, plan};

/// A run whose free resonance has been steady, with a touch since the last reference.
fn after_a_touch() -> (Run, Resonance) {
    let mut run = Run::new(plan(), 0, false);
    let steady = loose_sweep();
    for minute in 0..20 {
        let found = vec![(RigTime::ZERO + Duration::from_secs(60 * minute), steady)];
        let step = run.referred(&Reference { found, bench: None }, &mut Vec::new());
        assert!(matches!(step, MachineStep::Done(())));
    }
    run.unreferenced.push(StepId("main/1/front/0/1".to_owned()));
    (run, steady)
}

/// The jump was lost if only the second of two sweeps knew the resonance well enough to tell it.
#[test]
fn a_jump_is_told_whichever_of_the_sweeps_of_a_reference_shows_it() {
    const KNOCK_HZ: f64 = 0.6;
    for (vague_by_hz, vague_sigma_hz, by_hz, jumps) in
        [(KNOCK_HZ, 0.02, KNOCK_HZ, true), (0.0, 1.0, KNOCK_HZ, true), (0.01, 0.02, 0.0, false)]
    {
        let (mut run, steady) = after_a_touch();
        let moved = |by_hz, sigma_hz| Resonance {
            resonance_hz: steady.resonance_hz + by_hz,
            sigma_hz,
            ..steady
        };
        let at = |second: u64| RigTime::ZERO + Duration::from_secs(1200 + second);
        let found = vec![(at(0), moved(vague_by_hz, vague_sigma_hz)), (at(2), moved(by_hz, 0.02))];
        let mut notes = Vec::new();
        let step = run.referred(&Reference { found, bench: None }, &mut notes);
        assert!(matches!(step, MachineStep::Done(())), "{step:?}");
        match notes.as_slice() {
            [Event::ReferenceJumped { off_hz, touches, .. }] if jumps => {
                assert!((off_hz - KNOCK_HZ).abs() < 0.05 && touches.len() == 1, "{notes:?}");
            }
            [] if !jumps => {}
            notes => panic!("{notes:?}"),
        }
        assert!(run.unreferenced.is_empty());
    }
}
