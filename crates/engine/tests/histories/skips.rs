//! A touch that a person leaves out, at each moment of a run.

use rig_engine::{Command, Event, RigState, RunStatus};
use rig_model::Clearance;
use rig_protocol::{Action, StepId};

use crate::world::{World, plan};

/// More operations than the run has.
pub(crate) const OPERATIONS_MAX: usize = 1000;

/// A run that is under way after this many operations; `None` if it has ended by then.
pub(crate) fn running_after(operations: usize) -> Option<World> {
    let mut world = World::new(None);
    world.play_until(|world| {
        operations <= world.operations && world.engine.snapshot().state == RigState::Running
    });
    world.endings().is_empty().then_some(world)
}

/// Plays a run to its end.
pub(crate) fn finish(world: &mut World) {
    for _ in 0..OPERATIONS_MAX {
        match world.engine.snapshot().state {
            RigState::Idle | RigState::Latched => return,
            RigState::WaitingForPerson => world.answer(),
            _ => world.step(),
        }
    }
    panic!("the run did not end");
}

/// Also while the probe is in the sample, or on its way up.
#[test]
fn a_touch_ahead_is_left_out_at_any_moment_and_the_others_are_made() {
    let steps = plan().steps.into_iter();
    let touches: Vec<StepId> =
        steps.filter(|step| matches!(step.action, Action::Touch(_))).map(|step| step.id).collect();
    let last = touches.last().unwrap();
    let (mut left_out, mut refused, mut in_contact) = (0, 0, 0);
    for at in 1..OPERATIONS_MAX {
        let Some(mut world) = running_after(at) else { break };
        let admitted = world.engine.admit(Command::Skip(last.clone())).ok();
        let is_in_contact = world.engine.snapshot().clearance == Clearance::InContact;
        in_contact += usize::from(admitted.is_some() && is_in_contact);
        let expected = if let Some(admitted) = admitted {
            world.begin(admitted);
            left_out += 1;
            &touches[..touches.len() - 1]
        } else {
            refused += 1;
            &touches[..]
        };
        finish(&mut world);
        assert_eq!(world.endings(), [RunStatus::Completed], "{at}");
        assert_eq!(world.engine.snapshot().clearance, Clearance::Clear, "{at}");
        let made = world.events.iter().filter_map(|event| match event {
            Event::TouchFinished(result) if !result.is_refused() => Some(result.step.clone()),
            _ => None,
        });
        assert_eq!(made.collect::<Vec<_>>(), expected, "{at}");
    }
    // A touch that has begun is made.
    assert!(left_out > 30 && refused > 10 && in_contact > 10, "{left_out} {refused} {in_contact}");
}
