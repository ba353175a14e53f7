//! A pause that a person asks for, at each moment of a run.

use rig_engine::{Command, Event, RefusalAnswer, RigState, RunStatus};
use rig_protocol::{Action, RefusalPolicy};

use crate::{
    refusals::narrow,
    skips::{OPERATIONS_MAX, finish, running_after},
    world::{World, plan},
};

/// Also during the last touch, after which nothing is left to do.
#[test]
fn a_pause_comes_before_the_end_and_not_between_a_reference_and_its_touch() {
    let steps = plan().steps;
    let is_of_a_reference = |index: usize| {
        let before = index.checked_sub(1).map(|before| &steps[before].action);
        matches!((before, &steps[index].action), (Some(Action::NoLoad(_)), Action::Touch(_)))
    };
    let mut paused = 0;
    for at in 1..OPERATIONS_MAX {
        let Some(mut world) = running_after(at) else { break };
        world.command(Command::Pause);
        while world.engine.snapshot().state != RigState::Paused {
            match world.engine.snapshot().state {
                RigState::WaitingForPerson => world.answer(),
                state => {
                    assert_eq!(state, RigState::Running, "{at}");
                    world.step();
                }
            }
        }
        let before = world.events.len();
        world.command(Command::Resume);
        finish(&mut world);
        let next = world.events[before..].iter().find_map(|event| match event {
            Event::StepStarted { index } => Some(*index),
            _ => None,
        });
        assert!(!next.is_some_and(is_of_a_reference), "{at}: {next:?}");
        assert_eq!(world.endings(), [RunStatus::Completed], "{at}");
        paused += 1;
    }
    assert!(paused > 60, "{paused}");
}

#[test]
fn a_pause_comes_before_a_refused_touch_is_made_again() {
    for decision in [RefusalAnswer::Repeat, RefusalAnswer::Widen] {
        let mut world = World::new(None);
        world.decision = decision;
        world.command(Command::Prepare);
        finish(&mut world);
        world.command(Command::Run(Box::new(narrow(RefusalPolicy::Ask))));
        while world.engine.snapshot().refused.is_none() {
            match world.engine.snapshot().state {
                RigState::WaitingForPerson => world.answer(),
                _ => world.step(),
            }
        }
        world.command(Command::Pause);
        let before = world.operations;
        world.answer();
        assert_eq!(world.engine.snapshot().state, RigState::Paused, "{decision:?}");
        let is_answered = |world: &World| {
            world.events.iter().any(|event| matches!(event, Event::RefusalAnswered { .. }))
        };
        assert!(!is_answered(&world) && world.operations == before, "{decision:?}");
        world.command(Command::Resume);
        assert_eq!(world.engine.snapshot().state, RigState::Running, "{decision:?}");
        assert!(is_answered(&world), "{decision:?}");
    }
}

/// A person who pauses may reseat the sample, which is then higher.
#[test]
fn a_sample_that_was_moved_during_a_pause_contradicts_no_touch_before_it() {
    let mut twice = plan();
    twice.steps[3].action = twice.steps[2].action;
    if let Action::Touch(touch) = &mut twice.steps[3].action {
        touch.repeat = 2;
    }
    let mut paused = 0;
    for at in 1..OPERATIONS_MAX {
        let mut world = World::new(None);
        world.command(Command::Prepare);
        finish(&mut world);
        world.command(Command::Run(Box::new(twice.clone())));
        let begun = world.operations;
        while world.operations < begun + at && world.endings().is_empty() {
            match world.engine.snapshot().state {
                RigState::WaitingForPerson => world.answer(),
                _ => world.step(),
            }
        }
        if !world.endings().is_empty() {
            break;
        }
        world.command(Command::Pause);
        while world.engine.snapshot().state != RigState::Paused {
            match world.engine.snapshot().state {
                RigState::WaitingForPerson => world.answer(),
                _ => world.step(),
            }
        }
        world.slip_mm -= 0.3;
        world.command(Command::Resume);
        finish(&mut world);
        let doubted = |event: &Event| matches!(event, Event::TouchDoubted(_));
        assert!(!world.events.iter().any(doubted), "{at}");
        assert_eq!(world.endings(), [RunStatus::Completed], "{at}");
        paused += 1;
    }
    assert!(paused > 60, "{paused}");
}
