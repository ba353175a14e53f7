//! The engine alone, with two troubles at any moments of a run in the ideal world of its own tests,
//! which checks every operation that leaves the engine.

use std::panic::{AssertUnwindSafe, catch_unwind};

use rig_engine::{Command, FailureKind, RigState, RunStatus};
use rig_model::{Clearance, panic_message};

use crate::{
    bench::Draw,
    drive::DriveTrouble,
    world::{OF_ONE_OPERATION, REST_MM, Trouble, World, plan},
};

/// The end of a history.
#[derive(Debug)]
pub(crate) struct History {
    pub(crate) operations: usize,
    /// What must not be.
    pub(crate) failure: Option<String>,
}

/// More steps than any history has.
const STEPS: usize = 4000;

/// Operations of an undisturbed run, and some more: a trouble may come on the way out.
const MOMENTS: u64 = 120;

/// Troubles that last, in addition to those of one operation.
const LASTING: [Trouble; 15] = [
    Trouble::Freezes,
    Trouble::Drive(DriveTrouble::Silent { seconds: 1 }),
    Trouble::Drive(DriveTrouble::Silent { seconds: 30 }),
    Trouble::Drive(DriveTrouble::Silent { seconds: 100_000 }),
    Trouble::Drive(DriveTrouble::Refuses { requests: 6 }),
    Trouble::Drive(DriveTrouble::Alarm { resets: 1, is_another: false }),
    Trouble::Drive(DriveTrouble::Alarm { resets: 2, is_another: false }),
    Trouble::Drive(DriveTrouble::Alarm { resets: 2, is_another: true }),
    Trouble::Drive(DriveTrouble::Alarm { resets: 3, is_another: true }),
    Trouble::Drive(DriveTrouble::EmergencyStop),
    Trouble::Drive(DriveTrouble::Unhomed { is_homing_safe: true }),
    Trouble::Drive(DriveTrouble::Unhomed { is_homing_safe: false }),
    Trouble::Drive(DriveTrouble::HomedUnheard),
    Trouble::Drive(DriveTrouble::Jumped { by_mm: 45.0, then: FailureKind::Line }),
    Trouble::Drive(DriveTrouble::Jumped { by_mm: 45.0, then: FailureKind::Blocked }),
];

/// Plays the history of a seed.
pub(crate) fn play(seed: u64) -> History {
    let draw = &mut Draw::new(seed, 0xe17e);
    let trouble = |draw: &mut Draw| {
        // Preparing takes four operations; the first reads where the stage is.
        let at = 1 + usize::try_from(draw.below(MOMENTS)).unwrap_or_default();
        let troubles = [&OF_ONE_OPERATION[..], &LASTING].concat();
        (at, *draw.one_of(&troubles))
    };
    let mut world = World::new(Some(trouble(draw)));
    world.then = Some(trouble(draw));
    world.random = seed;
    let story = format!("{:?}, {:?}", world.trouble, world.then);
    let played = catch_unwind(AssertUnwindSafe(|| judge(&mut world)));
    let failure = match played {
        Ok(Ok(())) => None,
        Ok(Err(what)) => Some(what),
        Err(panic) => Some(panic_message(&*panic).to_owned()),
    };
    let failure = failure.map(|failure| format!("{story}: {failure}"));
    History { operations: world.operations, failure }
}

fn judge(world: &mut World) -> Result<(), String> {
    world.play();
    let end = world.engine.snapshot();
    // A drive that is homed upwards stays where that has ended.
    let is_out = REST_MM - 0.011 < world.linear_mm;
    if end.clearance == Clearance::Clear && !is_out {
        return Err(format!("said clear at {} mm", world.linear_mm));
    }
    if end.state == RigState::Latched && end.fault.is_none() {
        return Err("latched without a cause".to_owned());
    }
    if end.state == RigState::Idle && end.clearance != Clearance::Clear {
        return Err(format!("idle, and {}", end.clearance.name()));
    }
    (world.trouble, world.then, world.drive, world.frozen) = (None, None, None, None);
    world.is_lost = false;
    go_on(world)
}

/// The troubles are over: a person acknowledges, and a run must be completed.
fn go_on(world: &mut World) -> Result<(), String> {
    let mut is_started = false;
    for _ in 0..STEPS {
        match world.engine.snapshot().state {
            RigState::Latched => {
                // An operation that never ends needs another start of the program.
                if world.engine.admit(Command::Acknowledge).is_err() {
                    return Ok(());
                }
                if is_started {
                    return Err("latched again without trouble".to_owned());
                }
                let is_jumped = world.engine.snapshot().jump.is_some();
                world.command(if is_jumped { Command::HomeLinear } else { Command::Acknowledge });
            }
            RigState::Idle if is_started => {
                let last = world.endings().last().copied();
                let is_whole = last == Some(RunStatus::Completed);
                return if is_whole { Ok(()) } else { Err(format!("ended {last:?}")) };
            }
            RigState::Idle => {
                world.command(Command::Run(Box::new(plan())));
                is_started = true;
            }
            RigState::WaitingForPerson => world.command(Command::Answer),
            RigState::Paused => world.command(Command::Resume),
            RigState::Preparing | RigState::Running | RigState::Retracting => world.step(),
        }
    }
    Err("not finished after the trouble".to_owned())
}
