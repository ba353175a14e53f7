//! The ends of the travel: where each axis is stopped, and that the soft limits are inside of that.
//!
//! Upwards and in both turns the axis drives into its end, at the speed of a step. Downwards it does not: the table is
//! there. The lower switch is pressed by hand, and its place is measured by a rule.

use rig_files::rig_file::RigFile;
use rig_model::{Axis, Unit};

use super::{Early, agreed, attempt, confirm, doubt, go_to, jog, located, order, reading};
use crate::{
    Answer, Asked, Bench, Change, Choice, Finding, Jog, JogAxis, Order, Value,
    agreement::{Agreement, Mean, Progress},
    finding::rounded,
};

/// Stops at an end that must agree.
const STOPS: usize = 3;

/// How far before the expected end the last step begins, and how far beyond it ends, mm and degrees: a little less far
/// than the interlock admits, because an encoder jitters.
const BEFORE: f64 = 1.0;
const BEYOND: [f64; 2] = [0.9, 2.7];

/// How far an axis goes towards the middle of its soft limits before the step begins, mm and degrees: the next step of commissioning
/// needs room on both sides.
const FREE: f64 = 5.0;

/// Largest distance of the stops at one end from each other, mm and degrees.
const SCATTER: [f64; 2] = [0.05, 0.3];

/// How far the soft limits lie inside of the ends, mm and degrees: an axis at its highest speed stops within that.
const INSIDE: f64 = 2.0;

/// Division of a rule, and what a person may be wrong by with it, mm.
const RULE_STEP_MM: f64 = 0.1;
const RULE_LIMIT_MM: f64 = 0.3;

/// A step that the eye sees, mm.
const SEEN_MM: f64 = 0.2;

pub(super) async fn carry_out<B: Bench>(
    rig: &RigFile,
    bench: &mut B,
) -> Result<Finding, Early<B::Trouble>> {
    confirm(bench, Asked::NoSample).await?;
    let (linear, rotary) = (&rig.limits.linear, &rig.limits.rotary);
    without_soft_limits(bench, JogAxis::Linear, linear).await?;
    without_soft_limits(bench, JogAxis::Rotary, rotary).await?;
    let begin = free(bench, JogAxis::Linear, linear).await?;
    let turn = free(bench, JogAxis::Rotary, rotary).await?;
    let mut found = Vec::new();
    let upper = end(bench, JogAxis::Linear, (linear.travel().max.value(), 1.0)).await?;
    found.push(End { name: "linear.upper_end", key: UPPER_MM, sense: 1.0, at: upper });
    go_to(bench, JogAxis::Linear, begin).await?;
    let lower = lower(bench, begin).await?;
    found.push(End { name: "linear.lower_end", key: LOWER_MM, sense: -1.0, at: lower });
    for (name, key, sense, expected) in [
        ("rotary.upper_end", UPPER_DEG, 1.0, rotary.travel().max),
        ("rotary.lower_end", LOWER_DEG, -1.0, rotary.travel().min),
    ] {
        let at = end(bench, JogAxis::Rotary, (expected.value(), sense)).await?;
        found.push(End { name, key, sense, at });
        go_to(bench, JogAxis::Rotary, turn).await?;
    }
    let [up, down, tip, clamp] = &found[..] else {
        return Err(Early::Failed("an end of the travel was not tried".to_owned()));
    };
    let changes = [
        up.change(upper_of(linear)),
        down.change(lower_of(linear)),
        tip.change(upper_of(rotary)),
        clamp.change(lower_of(rotary)),
    ];
    let values = found.iter().map(End::value).collect();
    Ok(Finding::of(values, changes.into_iter().flatten().collect()))
}

const UPPER_MM: &str = "upper linear.soft_limits_mm";
const LOWER_MM: &str = "lower linear.soft_limits_mm";
const UPPER_DEG: &str = "upper rotary.soft_limits_deg";
const LOWER_DEG: &str = "lower rotary.soft_limits_deg";

fn upper_of<U: Unit>(axis: &Axis<U>) -> f64 {
    axis.soft().max.value()
}

fn lower_of<U: Unit>(axis: &Axis<U>) -> f64 {
    axis.soft().min.value()
}

/// An end of the travel, in the unit of its axis.
struct End {
    name: &'static str,
    key: &'static str,
    /// 1 for the upper end.
    sense: f64,
    at: Mean,
}

impl End {
    fn value(&self) -> Value {
        let unit = if self.name.starts_with("linear") { "mm" } else { "°" };
        let Mean { value, sigma } = self.at;
        Value { name: self.name, value, standard_uncertainty: sigma, unit }
    }

    /// A soft limit that is not far enough inside.
    fn change(&self, soft: f64) -> Option<Change> {
        let most = self.at.value - self.sense * INSIDE;
        // Two standard deviations are no reason for a change.
        let is_outside = self.sense * (soft - most) > 2.0 * self.at.sigma;
        let inside = (most - self.sense * 2.0 * self.at.sigma) * self.sense;
        let to = self.sense * (inside * 10.0).floor() / 10.0;
        is_outside.then(|| Change { key: self.key, from: soft, to: rounded(to, 4) })
    }
}

/// Refuses a drive with soft limits that would stop its axis before an end: it has those that rigd gave it when the rig was in service. The
/// linear stage does not go to its lower end.
async fn without_soft_limits<B: Bench, U: Unit>(
    bench: &mut B,
    axis: JogAxis,
    limits: &Axis<U>,
) -> Result<(), Early<B::Trouble>> {
    let Some([low, high]) = jog(bench, axis, 0.0).await?.soft else { return Ok(()) };
    let beyond = BEYOND[usize::from(axis == JogAxis::Rotary)];
    let (min, max) = (limits.travel().min.value() - beyond, limits.travel().max.value() + beyond);
    if max < high && (low < min || axis == JogAxis::Linear) {
        return Ok(());
    }
    let (name, unit) = (axis.name(), axis.unit());
    Err(Early::Failed(format!(
        "the drive of the {name} has soft limits at {low:.3} {unit} and {high:.3} {unit}, and would stop there before an end of its \
         travel; switch them off in the drive, or set them outside of {min} {unit} to {max} {unit}, and begin the step again: rigd gives \
         the drive those of the rig file when the rig goes into service"
    )))
}

/// Takes an axis a step towards the middle of its soft limits, and gives where it is then. An interrupted step has left it at an
/// end, perhaps with the alarm of that.
async fn free<B: Bench, U: Unit>(
    bench: &mut B,
    axis: JogAxis,
    limits: &Axis<U>,
) -> Result<f64, Early<B::Trouble>> {
    let soft = limits.soft();
    let middle = f64::midpoint(soft.min.value(), soft.max.value());
    let at = located(bench, axis).await?;
    let by = (middle - at).clamp(-FREE, FREE);
    if let Ok(made) = attempt(bench, Order::Step(Jog { axis, by })).await? {
        return Ok(made.at);
    }
    order(bench, Order::ClearAlarm(axis)).await?;
    Ok(jog(bench, axis, by).await?.at)
}

/// Drives into an end several times, and gives where the axis was stopped.
async fn end<B: Bench>(
    bench: &mut B,
    axis: JogAxis,
    (expected, sense): (f64, f64),
) -> Result<Mean, Early<B::Trouble>> {
    let (name, unit) = (axis.name(), axis.unit());
    let part = usize::from(axis == JogAxis::Rotary);
    let (beyond, scatter) = (BEYOND[part], SCATTER[part]);
    let mut agreement = Agreement::new(STOPS, scatter);
    let mut elsewhere = 0;
    loop {
        let at = stopped_at(bench, axis, (expected, sense, beyond)).await?;
        if bench.ask(Asked::AtLimit).await? == Answer::Choice(Choice::Yes) {
            match agreement.add(at) {
                // The counts of a drive, and the speed at which it reads its switch, are below a tenth of the limit.
                Progress::Settled(Mean { value, sigma }) => {
                    return Ok(Mean { value, sigma: sigma.max(0.1 * scatter) });
                }
                Progress::More { contradicts } => doubt(bench, contradicts),
                Progress::Failed => {
                    return Err(Early::Failed(format!(
                        "the {name} is stopped at places more than {scatter} {unit} apart"
                    )));
                }
            }
        } else {
            elsewhere += 1;
            if elsewhere == STOPS {
                return Err(Early::Failed(format!(
                    "the {name} was stopped at {at:.3} {unit}, and not by its limit"
                )));
            }
            // It would drive into the same thing again.
            confirm(bench, Asked::ClearWay).await?;
        }
        jog(bench, axis, -sense * BEFORE).await?;
    }
}

/// Steps towards an end until the drive makes no further step, and gives where the axis is then.
async fn stopped_at<B: Bench>(
    bench: &mut B,
    axis: JogAxis,
    (expected, sense, beyond): (f64, f64, f64),
) -> Result<f64, Early<B::Trouble>> {
    loop {
        let at = jog(bench, axis, 0.0).await?.at;
        let (left, last) = (sense * (expected - at), sense * (expected - at) + beyond);
        if last < 0.1 * beyond {
            return Err(Early::Failed(format!(
                "nothing stopped the {} up to {at:.3} {unit}, which is {beyond} {unit} beyond its travel in the rig file",
                axis.name(),
                unit = axis.unit()
            )));
        }
        let by = if left <= 1.5 * BEFORE { last } else { (left - BEFORE).min(axis.longest_step()) };
        if attempt(bench, Order::Step(Jog { axis, by: sense * by })).await?.is_err() {
            return Ok(order(bench, Order::ClearAlarm(axis)).await?.at);
        }
    }
}

/// The lower switch of the linear stage, by hand, and its place, by a rule.
async fn lower<B: Bench>(bench: &mut B, at: f64) -> Result<Mean, Early<B::Trouble>> {
    let axis = JogAxis::Linear;
    if bench.ask(Asked::HoldSwitch).await? == Answer::Choice(Choice::Yes) {
        let (mut agreement, mut has_moved) = (Agreement::new(2, 0.0), false);
        let failed = |what: &str| {
            Err(Early::Failed(format!("{what} while the lower limit switch was pressed")))
        };
        loop {
            let made = attempt(bench, Order::Step(Jog { axis, by: -SEEN_MM })).await?;
            let seen = reading(bench, axis.seen()).await?;
            if made.is_err() {
                order(bench, Order::ClearAlarm(axis)).await?;
            }
            has_moved |= made.is_ok();
            match agreement.add(seen) {
                Progress::Settled(mean) if mean.value == 0.0 && has_moved => {
                    return failed("the drive reported a step downwards, and none was seen,");
                }
                Progress::Settled(mean) if mean.value == 0.0 => break,
                Progress::Settled(mean) if mean.value > 0.0 => {
                    return failed("the probe was seen to go up");
                }
                Progress::Settled(_) => return failed("the probe was seen to go down"),
                Progress::Failed => return failed("the probe was seen to move"),
                Progress::More { contradicts } => doubt(bench, contradicts),
            }
        }
        confirm(bench, Asked::LetGo).await?;
        go_to(bench, axis, at).await?;
    } else {
        bench.remark("The lower end has no switch: the soft limit alone keeps the probe above it.");
    }
    let way = agreed(bench, Asked::WayDown, Agreement::new(3, 2.0 * RULE_STEP_MM)).await?;
    let sigma = RULE_LIMIT_MM.hypot(RULE_STEP_MM / 2.0) / 3.0_f64.sqrt();
    Ok(Mean { value: at - way, sigma })
}
