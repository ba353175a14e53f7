//! What a drive does while the rig is commissioned: the interlock sees it, and the drive gets no settings.

use rig_commission::{Jog, JogAxis, Jogged, NotDone, Order};
use rig_interlock::{Outcome, PortCommand, Refusal};
use rig_link::StopSignal;
use rig_model::{Position, Unit, with_causes};
use rig_stage::{Look, Stage, StageError};

use super::{devices::Axes, gate::Gate};

/// Why a drive did not do what was ordered.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NotMade {
    /// The interlock refused it. Nothing was sent.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// The drive, with all causes.
    #[error("{0}")]
    Failed(String),
}

impl NotMade {
    fn of(error: &(dyn std::error::Error + 'static)) -> Self {
        Self::Failed(with_causes(error))
    }
}

impl From<NotMade> for NotDone {
    fn from(trouble: NotMade) -> Self {
        match trouble {
            NotMade::Refused(refusal) => Self::Refused(refusal.to_string()),
            NotMade::Failed(why) => Self::Failed(why),
        }
    }
}

/// Does what is ordered, or says why not.
pub(super) async fn make(
    axes: &mut Axes,
    order: Order,
    stop: &StopSignal,
) -> Result<Jogged, NotMade> {
    let Axes { linear, rotary, is_homing_up, gate, .. } = axes;
    match order.axis() {
        JogAxis::Linear => {
            let command = |from, is_homed| match order {
                Order::Step(Jog { by, .. }) => PortCommand::JogLinear {
                    from,
                    is_homed,
                    by_mm: by,
                    speed_mm_per_s: JogAxis::Linear.speed_per_s(),
                },
                Order::ClearAlarm(_) => PortCommand::ClearLinear,
                Order::Home(_) | Order::HomeDown => PortCommand::SeekLinear,
            };
            along(linear, gate, command, (order, *is_homing_up), stop).await
        }
        JogAxis::Rotary => {
            let command = |from, is_homed| match order {
                Order::Step(Jog { by, .. }) => PortCommand::JogRotary {
                    from,
                    is_homed,
                    by_deg: by,
                    speed_deg_per_s: JogAxis::Rotary.speed_per_s(),
                },
                Order::ClearAlarm(_) => PortCommand::ClearRotary,
                Order::Home(_) | Order::HomeDown => PortCommand::SeekRotary,
            };
            along(rotary, gate, command, (order, false), stop).await
        }
    }
}

async fn along<U: Unit>(
    stage: &mut Stage<U>,
    gate: &Gate,
    command: impl FnOnce(Position<U>, bool) -> PortCommand,
    (order, is_homing_up): (Order, bool),
    stop: &StopSignal,
) -> Result<Jogged, NotMade> {
    let Look { status, soft, .. } = stage.look().await.map_err(|error| NotMade::of(&error))?;
    let (from, is_homed) = (status.position, status.is_homed);
    let soft = soft.map(|soft| [soft.min.value(), soft.max.value()]);
    if let Order::Step(Jog { by: 0.0, .. }) = order {
        return Ok(Jogged { from: from.value(), at: from.value(), is_homed, soft });
    }
    let command = command(from, is_homed);
    gate.admit_step(&command)?;
    let done = match order {
        Order::Step(Jog { by, axis }) => stage.jog(by, axis.speed_per_s(), stop).await,
        Order::ClearAlarm(_) => stage.reset_alarm().await.map(|status| status.position),
        Order::Home(_) | Order::HomeDown => stage.home_unproven(is_homing_up, stop).await,
    };
    let outcome = match &done {
        Ok(_) => Outcome::Done,
        Err(StageError::Stopped { .. }) => Outcome::Interrupted,
        Err(_) => Outcome::Failed,
    };
    gate.step_ended(&command, &outcome);
    let at = done.map_err(|error| NotMade::of(&error))?;
    Ok(Jogged { from: from.value(), at: at.value(), is_homed, soft })
}
