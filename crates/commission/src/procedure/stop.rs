//! The emergency stop, before anything else moves: pressed, it must keep both axes still.

use super::{Early, agreed, confirm, jog, reading};
use crate::{Asked, Bench, Finding, Jog, JogAxis, agreement::Agreement};

/// Steps that a person sees and that hurt nothing, mm and degrees.
pub(super) const STEPS: [(JogAxis, f64); 2] = [(JogAxis::Linear, 0.2), (JogAxis::Rotary, 1.0)];

/// Answers that must agree.
const ANSWERS: usize = 2;

pub(super) async fn carry_out<B: Bench>(bench: &mut B) -> Result<Finding, Early<B::Trouble>> {
    confirm(bench, Asked::NoSample).await?;
    confirm(bench, Asked::PressStop).await?;
    for (axis, by) in STEPS {
        // The drive may say that it was stopped, or that it has moved: the eye decides.
        _ = bench.jog(Jog { axis, by }).await?;
        if agreed(bench, axis.seen(), Agreement::new(ANSWERS, 0.0)).await? != 0.0 {
            let axis = axis.name();
            return Err(Early::Failed(format!("the {axis} moved while the stop was pressed")));
        }
    }
    confirm(bench, Asked::ReleaseStop).await?;
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
