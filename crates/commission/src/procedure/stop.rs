//! The emergency stop, before anything else moves: pressed, it must keep both axes still.

use super::{Early, attempt, confirm, contradictory, doubt, insist, jog, reading};
use crate::{
    Asked, Bench, Finding, Jog, JogAxis, Order,
    agreement::{Agreement, Progress},
};

/// Steps that a person sees and that hurt nothing, mm and degrees.
pub(super) const STEPS: [(JogAxis, f64); 2] = [(JogAxis::Linear, 0.2), (JogAxis::Rotary, 1.0)];

/// Answers that must agree, each about a step of its own.
const ANSWERS: usize = 2;

pub(super) async fn carry_out<B: Bench>(bench: &mut B) -> Result<Finding, Early<B::Trouble>> {
    confirm(bench, Asked::NoSample).await?;
    insist(bench, Asked::PressStop).await?;
    for (axis, by) in STEPS {
        if is_seen_to_move(bench, axis, by).await? {
            let axis = axis.name();
            return Err(Early::Failed(format!("the {axis} moved while the stop was pressed")));
        }
    }
    insist(bench, Asked::ReleaseStop).await?;
    // A stop that keeps everything still also afterwards shows nothing.
    for (axis, by) in STEPS {
        let mut seen = 0.0;
        for by in [by, -by] {
            jog(bench, axis, by).await?;
            if seen == 0.0 {
                seen = reading(bench, axis.seen()).await?;
            }
        }
        if seen == 0.0 {
            let axis = axis.name();
            return Err(Early::Failed(format!("the {axis} was not seen to move after the stop")));
        }
    }
    Ok(Finding::of(Vec::new(), Vec::new()))
}

/// Whether the eye sees an axis move in steps to and fro. The drive may say that it was stopped, or that it has
/// moved: it does not decide.
async fn is_seen_to_move<B: Bench>(
    bench: &mut B,
    axis: JogAxis,
    step: f64,
) -> Result<bool, Early<B::Trouble>> {
    let mut agreement = Agreement::new(ANSWERS, 0.0);
    let mut by = step;
    loop {
        _ = attempt(bench, Order::Step(Jog { axis, by })).await?;
        let seen = reading(bench, axis.seen()).await?;
        by = -by;
        match agreement.add(seen.abs()) {
            Progress::Settled(mean) => return Ok(mean.value != 0.0),
            Progress::More { contradicts } => doubt(bench, contradicts),
            Progress::Failed => return Err(contradictory(axis.seen())),
        }
    }
}
