//! Progress of a run, the open prompt, and the forecast.

use std::time::{SystemTime, UNIX_EPOCH};

use rig_engine::Progress;
use rig_model::RigTime;
use rig_protocol::Action;

use crate::{
    rig::{RunView, Status},
    rig_view::{Forecast, LastRun, NextPrompt, OpenPrompt, PromptAction},
};

pub(super) fn ahead(run: &RunView, progress: &Progress, now: RigTime) -> Forecast {
    let steps = &run.plan.steps;
    let here = progress.step.min(steps.len());
    let elapsed_s = now.since(run.started).as_secs_f64();
    let is_prompt = |action: &Action| matches!(action, Action::Prompt(_));
    let remaining = run.remaining(here, now);
    // The open prompt is not the next one.
    let next = steps.iter().enumerate().skip(here + 1).find(|(_, step)| is_prompt(&step.action));
    let next_prompt = next.and_then(|(index, step)| {
        let Action::Prompt(prompt) = step.action else { return None };
        let touches = steps[here..index].iter();
        Some(NextPrompt {
            prompt: run.ask(&prompt),
            in_s: run.until_s(here, index, now),
            touches: touches.filter(|step| matches!(step.action, Action::Touch(_))).count(),
        })
    });
    Forecast {
        is_pausing: progress.is_pausing,
        elapsed_s,
        remaining_s: [remaining.least_s, remaining.most_s],
        learned_from_touches: run.history.touches(),
        next_prompt,
    }
}

pub(super) fn last_run(run: &RunView) -> Option<LastRun> {
    let status = run.ending?.name().to_owned();
    Some(LastRun { id: run.id.to_string(), status })
}

pub(super) fn asked(status: &Status) -> Option<OpenPrompt> {
    let (prompt, run) = status.snapshot.prompt.zip(status.run.as_ref())?;
    let index = status.snapshot.progress.as_ref()?.step;
    let is_prompt = |step: &&rig_protocol::Step| matches!(step.action, Action::Prompt(_));
    let steps = &run.plan.steps;
    Some(OpenPrompt {
        step: steps.get(index)?.id.to_string(),
        what: PromptAction::of(&run.plan, prompt),
        number: steps[..=index].iter().filter(is_prompt).count(),
        prompts: steps.iter().filter(is_prompt).count(),
    })
}

/// The wall clock, ms since 1970.
pub(super) fn unix_ms(at: SystemTime) -> u64 {
    let since = at.duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_millis()).unwrap_or(u64::MAX)
}
