//! A step of one axis while the rig is commissioned: the interlock sees it, and the drive gets no settings.

use rig_commission::{Jog, JogAxis, Jogged};
use rig_interlock::{Outcome, PortCommand};
use rig_link::StopSignal;
use rig_model::{Position, Unit, with_causes};
use rig_stage::{Stage, StageError};

use super::{devices::Axes, gate::Gate};

/// Makes a step, or says why there is none.
pub(super) async fn make(axes: &mut Axes, jog: Jog, stop: &StopSignal) -> Result<Jogged, String> {
    let speed_per_s = jog.speed_per_s();
    match jog.axis {
        JogAxis::Linear => {
            let step =
                |from| PortCommand::JogLinear { from, by_mm: jog.by, speed_mm_per_s: speed_per_s };
            along(&mut axes.linear, &axes.gate, step, (jog.by, speed_per_s), stop).await
        }
        JogAxis::Rotary => {
            let step = |from| PortCommand::JogRotary {
                from,
                by_deg: jog.by,
                speed_deg_per_s: speed_per_s,
            };
            along(&mut axes.rotary, &axes.gate, step, (jog.by, speed_per_s), stop).await
        }
    }
}

async fn along<U: Unit>(
    stage: &mut Stage<U>,
    gate: &Gate,
    step: impl FnOnce(Position<U>) -> PortCommand,
    (by, speed_per_s): (f64, f64),
    stop: &StopSignal,
) -> Result<Jogged, String> {
    let from = stage.look().await.map_err(|error| with_causes(&error))?.status.position;
    if by == 0.0 {
        return Ok(Jogged { from: from.value(), at: from.value() });
    }
    let step = step(from);
    gate.admit_step(&step).map_err(|refusal| refusal.to_string())?;
    let moved = stage.jog(by, speed_per_s, stop).await;
    let outcome = match &moved {
        Ok(_) => Outcome::Done,
        Err(StageError::Stopped { .. }) => Outcome::Interrupted,
        Err(_) => Outcome::Failed,
    };
    gate.step_ended(&step, &outcome);
    let at = moved.map_err(|error| with_causes(&error))?;
    Ok(Jogged { from: from.value(), at: at.value() })
}
