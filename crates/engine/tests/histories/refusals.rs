//! What happens after a touch was refused, by the policy of the protocol and by a person.

use std::time::Duration;

use rig_engine::{Command, Event, RefusalAnswer, RigState, RunStatus, SweepPurpose, TouchOutcome};
use rig_model::{Clearance, SweepMethod, SweepRequest, Window};
use rig_protocol::{NoLoadPolicy, Plan, RefusalPolicy, StepId};

use crate::{
    skips::finish,
    world::{FREE_HZ, LOADED_HZ, World, plan},
};

impl World {
    /// Why touches were refused.
    pub(crate) fn refused(&self) -> Vec<String> {
        let refusal = |event: &Event| match event {
            Event::TouchFinished(result) => match &result.outcome {
                TouchOutcome::Refused { refusal, .. } => Some(refusal.to_string()),
                TouchOutcome::Measured { .. } => None,
            },
            _ => None,
        };
        self.events.iter().filter_map(refusal).collect()
    }
}

/// A plan with three touches, whose resonances in contact lie below the window.
pub(crate) fn narrow(on_refusal: RefusalPolicy) -> Plan {
    let mut narrow = plan();
    narrow.contact_sweep = SweepRequest {
        window: Window { min_hz: 165.0, max_hz: 190.0 },
        method: SweepMethod::Uniform { points: 41 },
        ..narrow.contact_sweep
    };
    narrow.touch.on_refusal = on_refusal;
    narrow
}

/// The touches finished, those measured, and the answers with their operators.
fn told(world: &World) -> (usize, usize, Vec<(RefusalAnswer, String)>) {
    let (mut finished, mut measured, mut answers) = (0, 0, Vec::new());
    for event in &world.events {
        match event {
            Event::TouchFinished(result) => {
                finished += 1;
                measured += usize::from(matches!(result.outcome, TouchOutcome::Measured { .. }));
            }
            Event::RefusalAnswered { answer, by, window, .. } => {
                assert_eq!(window.is_some(), *answer == RefusalAnswer::Widen);
                answers.push((*answer, by.clone()));
            }
            _ => {}
        }
    }
    (finished, measured, answers)
}

#[test]
fn the_policy_of_the_protocol_decides_when_nobody_is_asked() {
    use RefusalAnswer::{Abort, Repeat, Widen};
    use RunStatus::{Aborted, Completed, CompletedWithRefusals};
    for (policy, answer, times, finished, measured, ending) in [
        (RefusalPolicy::Record, None, 0, 3, 0, CompletedWithRefusals),
        (RefusalPolicy::Repeat, Some(Repeat), 3, 3, 0, CompletedWithRefusals),
        (RefusalPolicy::Widen, Some(Widen), 3, 3, 3, Completed),
        (RefusalPolicy::Abort, Some(Abort), 1, 1, 0, Aborted),
    ] {
        let mut world = World::new(None);
        world.play_plan(&narrow(policy));
        assert_eq!(world.endings(), [ending], "{policy:?}");
        let said = answer.map_or(Vec::new(), |one| vec![(one, "protocol".to_owned()); times]);
        assert_eq!(told(&world), (finished, measured, said), "{policy:?}");
        assert_eq!(world.engine.snapshot().clearance, Clearance::Clear);
    }
}

#[test]
fn a_person_who_is_asked_decides_with_the_probe_clear() {
    use RefusalAnswer::{Abort, Skip, Widen};
    for (decision, finished, measured, ending) in [
        (Skip, 3, 0, RunStatus::CompletedWithRefusals),
        (Widen, 3, 3, RunStatus::Completed),
        (Abort, 1, 0, RunStatus::Aborted),
    ] {
        let mut world = World::new(None);
        world.decision = decision;
        world.play_plan(&narrow(RefusalPolicy::Ask));
        assert_eq!(world.endings(), [ending], "{decision:?}");
        let answers = vec![(decision, "test".to_owned()); finished];
        assert_eq!(told(&world), (finished, measured, answers), "{decision:?}");
    }
}

#[test]
fn a_touch_is_repeated_as_often_as_a_person_says() {
    let mut world = World::new(None);
    world.decision = RefusalAnswer::Repeat;
    world.command(Command::Prepare);
    let mut asked = 0;
    for _ in 0..2000 {
        let snapshot = world.engine.snapshot();
        match snapshot.state {
            RigState::Idle if asked == 0 => {
                world.command(Command::Run(Box::new(narrow(RefusalPolicy::Ask))));
            }
            RigState::Idle => break,
            RigState::WaitingForPerson => {
                if let Some(touch) = snapshot.refused {
                    asked += 1;
                    assert_eq!(snapshot.clearance, Clearance::Clear);
                    // An answer about another touch is none, and so is an answer to a prompt.
                    let other = Command::Decide {
                        step: StepId("other".to_owned()),
                        answer: RefusalAnswer::Skip,
                    };
                    assert!(world.engine.admit(other).is_err(), "{touch:?}");
                    assert!(world.engine.admit(Command::Answer).is_err());
                    if asked == 5 {
                        world.decision = RefusalAnswer::Skip;
                    }
                }
                world.answer();
            }
            _ => world.step(),
        }
    }
    // Four repeats of the first touch, then three touches are skipped.
    assert_eq!((asked, told(&world).0), (7, 3));
}

/// A person who decides was at the bench, and may take hours: the planned touches after a person have a reference of their own.
#[test]
fn a_touch_that_a_person_has_made_again_has_the_reference_that_a_planned_one_would_have() {
    use NoLoadPolicy::{ByDrift, EveryPose, EverySample, EveryTouch, Once};
    for (no_load, person, references) in [
        (EveryTouch, "Ada", 3),
        // A name of a person, and no policy.
        (EveryTouch, "protocol", 3),
        (EveryPose, "Ada", 3),
        (EverySample, "Ada", 3),
        (ByDrift, "Ada", 3),
        (Once, "Ada", 0),
    ] {
        let mut world = World::new(None);
        (world.decision, world.person) = (RefusalAnswer::Widen, person);
        world.drift_hz_per_s = 0.2 / (5.0 * 3600.0);
        world.command(Command::Prepare);
        finish(&mut world);
        let narrow = narrow(RefusalPolicy::Ask);
        world.command(Command::Run(Box::new(Plan { no_load, ..narrow })));
        while world.engine.snapshot().state != RigState::Idle {
            let snapshot = world.engine.snapshot();
            assert_ne!(snapshot.state, RigState::Latched, "{no_load:?}: {:?}", snapshot.fault);
            match snapshot.state {
                RigState::WaitingForPerson => {
                    if snapshot.refused.is_some() {
                        world.now = world.now + Duration::from_secs(5 * 3600);
                    }
                    world.answer();
                }
                _ => world.step(),
            }
        }
        let (mut answered, mut again) = (false, 0);
        for event in &world.events {
            match event {
                Event::RefusalAnswered { .. } => answered = true,
                Event::SweepFinished(sweep) if sweep.purpose == SweepPurpose::NoLoad => {
                    again += usize::from(answered);
                }
                Event::TouchFinished(result) => {
                    answered = false;
                    let TouchOutcome::Measured { loaded, .. } = &result.outcome else {
                        panic!("{no_load:?}: {result:?}")
                    };
                    let shift_hz = loaded.resonance_hz - result.no_load.resonance_hz;
                    let is_right = (shift_hz - (LOADED_HZ - FREE_HZ)).abs() < 0.02;
                    assert_eq!(is_right, no_load != Once, "{no_load:?}: {shift_hz} Hz");
                }
                _ => {}
            }
        }
        assert_eq!(again, references, "{no_load:?}");
        assert_eq!(world.endings(), [RunStatus::Completed], "{no_load:?}");
    }
}

/// Nobody was at the bench: only the drift asks for a reference.
#[test]
fn a_touch_that_the_protocol_has_made_again_keeps_its_reference_until_the_drift_asks_for_one() {
    use NoLoadPolicy::{ByDrift, EveryTouch};
    for (no_load, target_hz, references) in
        [(EveryTouch, 0.05, 1), (ByDrift, 0.5, 1), (ByDrift, 1e-3, 4)]
    {
        let mut narrow = Plan { no_load, ..narrow(RefusalPolicy::Widen) };
        narrow.no_load_sweep.target_sigma_hz = target_hz;
        let mut world = World::new(None);
        world.play_plan(&narrow);
        let is_reference = |event: &&Event| matches!(event, Event::SweepFinished(sweep) if sweep.purpose == SweepPurpose::NoLoad);
        let found = world.events.iter().filter(is_reference).count();
        assert_eq!(found, references, "{no_load:?}, {target_hz} Hz");
    }
}
