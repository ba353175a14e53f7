//! Steps and prompts in the words that a person at the bench reads.

use rig_model::{Direction, Orientation};
use rig_protocol::{Action, Phase, Plan, Pose, Prompt};

/// The text of a prompt.
pub(crate) fn prompt(plan: &Plan, prompt: &Prompt) -> String {
    match *prompt {
        Prompt::PlaceSample { sample } => place(sample_name(plan, sample)),
        Prompt::TurnSensor { orientation } => turn(orientation.name()),
    }
}

/// The text of a prompt of the journal.
pub(crate) fn recorded_prompt(prompt: &rig_store::Prompt) -> String {
    match prompt {
        rig_store::Prompt::PlaceSample { sample } => place(sample),
        rig_store::Prompt::TurnSensor { orientation } => turn(orientation),
    }
}

fn place(sample: &str) -> String {
    format!("Put sample {sample} under the probe.")
}

fn turn(orientation: &str) -> String {
    let how = if orientation == Orientation::Left.name() {
        "a quarter to the left about its own axis"
    } else {
        "so that the stage leans it front and back"
    };
    format!("Turn the sensor {how}.")
}

/// The description of a step, such as `sample 3 of 5, left, 30°`.
pub(crate) fn step(plan: &Plan, index: usize) -> String {
    let Some(step) = plan.steps.get(index) else { return "done".to_owned() };
    match step.action {
        Action::Prompt(asked) => prompt(plan, &asked),
        Action::NoLoad(at) => format!("no-load reference, {}", pose(at)),
        Action::Touch(touch) => match touch.phase {
            Phase::Main => format!(
                "sample {} of {}, {}",
                touch.sample + 1,
                plan.samples.len(),
                pose(touch.pose)
            ),
            Phase::Blind => format!("blind touch {}, {}", touch.repeat, pose(touch.pose)),
        },
    }
}

fn pose(pose: Pose) -> String {
    format!("{}, {}", direction(pose.direction), angle(pose))
}

const fn direction(direction: Direction) -> &'static str {
    direction.name()
}

/// Blind angles are random and have many digits.
fn angle(pose: Pose) -> String {
    let degrees = pose.angle.degrees();
    if degrees.fract() == 0.0 { format!("{degrees}°") } else { format!("{degrees:.1}°") }
}

fn sample_name(plan: &Plan, index: usize) -> &str {
    plan.samples.get(index).map_or("?", String::as_str)
}
