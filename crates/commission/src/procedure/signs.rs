//! The sign of each axis, by the eye. Touches never find that of the rotary stage: a table that tilts the other
//! way gives the same heights.

use rig_files::rig_file::RigFile;
use rig_model::{Scale, Unit};

use super::{Early, confirm, contradictory, doubt, jog, reading, stop::STEPS};
use crate::{
    Asked, Bench, Change, Finding, JogAxis, Value,
    agreement::{Agreement, Progress},
};

/// Answers for each axis that must agree.
const ANSWERS: usize = 3;

pub(super) async fn carry_out<B: Bench>(
    rig: &RigFile,
    bench: &mut B,
) -> Result<Finding, Early<B::Trouble>> {
    confirm(bench, Asked::NoSample).await?;
    let (mut values, mut changes) = (Vec::new(), Vec::new());
    for (axis, by) in STEPS {
        let (sense, at) = sense(bench, axis, by).await?;
        let name = match axis {
            JogAxis::Linear => "linear.sign",
            JogAxis::Rotary => "rotary.sign",
        };
        values.push(Value { name, value: sense, standard_uncertainty: 0.0, unit: "1" });
        if sense < 0.0 {
            changes.extend(match axis {
                JogAxis::Linear => {
                    reversed(&rig.linear.scale, at, ["linear.mm_per_step", "linear.zero_mm"])
                }
                JogAxis::Rotary => {
                    reversed(&rig.rotary.scale, at, ["rotary.deg_per_step", "rotary.zero_deg"])
                }
            });
        }
    }
    Ok(Finding::of(values, changes))
}

/// The sense of an axis by several steps to and fro, 1 if it is that of the rig file, and where it stands.
async fn sense<B: Bench>(
    bench: &mut B,
    axis: JogAxis,
    step: f64,
) -> Result<(f64, f64), Early<B::Trouble>> {
    let mut agreement = Agreement::new(ANSWERS, 0.0);
    let mut by = step;
    let sense = loop {
        jog(bench, axis, by).await?;
        let seen = reading(bench, axis.seen()).await? * by.signum();
        by = -by;
        match agreement.add(seen) {
            Progress::Settled(sense) => break sense.value,
            Progress::More { contradicts } => doubt(bench, contradicts),
            Progress::Failed => return Err(contradictory(axis.seen())),
        }
    };
    if sense == 0.0 {
        let axis = axis.name();
        return Err(Early::Failed(format!(
            "the drive of the {axis} reports a motion, and none was seen"
        )));
    }
    // Back to where it was.
    let by = if by < 0.0 { by } else { 0.0 };
    Ok((sense, jog(bench, axis, by).await?.at))
}

/// The other sign, with the zero that leaves the axis where it is.
fn reversed<U: Unit>(scale: &Scale<U>, at: f64, keys: [&'static str; 2]) -> [Change; 2] {
    let (per_count, zero) = (scale.per_count, scale.zero.value());
    let new_zero = crate::finding::rounded(2.0 * at - zero, 6);
    [
        Change { key: keys[0], from: per_count, to: -per_count },
        Change { key: keys[1], from: zero, to: new_zero },
    ]
}
