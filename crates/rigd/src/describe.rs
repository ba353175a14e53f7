//! Steps and prompts in the words that a person at the bench reads.

use rig_model::{Direction, Orientation};
use rig_protocol::{Action, Phase, Plan, Pose, Prompt};

/// The text of a prompt.
pub(crate) fn prompt(plan: &Plan, prompt: &Prompt) -> String {
    match *prompt {
        Prompt::PlaceSample { sample } => {
            format!("Put sample {} under the probe.", sample_name(plan, sample))
        }
        Prompt::TurnSensor { orientation: Orientation::FrontBack } => {
            "Turn the sensor so that the stage leans it front and back.".to_owned()
        }
        Prompt::TurnSensor { orientation: Orientation::Left } => {
            "Turn the sensor a quarter to the left about its own axis.".to_owned()
        }
    }
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
