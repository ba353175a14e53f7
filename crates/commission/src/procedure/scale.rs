//! How far each axis goes: a dial gauge for the probe, an angle gauge for the table. The way grows only while
//! what is seen agrees with what was asked: a scale that is ten times too large is found by the shortest step.

use std::ops::RangeInclusive;

use rig_files::rig_file::RigFile;
use rig_model::{Scale, Unit};

use super::{Early, agreed, confirm, contradictory, doubt, insist, jog, located, reading};
use crate::{
    Asked, Bench, Change, Finding, JogAxis, Value,
    agreement::{Agreement, Mean, Progress},
    finding::rounded,
};

/// Ways of the linear stage before the whole one, mm.
const COARSE_WAYS_MM: [f64; 2] = [0.2, 1.0];
/// The whole way, which is made in several windows, and the distance between their beginnings, mm.
const WAY_MM: f64 = 10.0;
const WINDOWS: usize = 4;
const WINDOW_MM: f64 = 0.7;
/// The part of the way before each window, in the same direction: it takes up the play of the screw, mm.
const PLAY_MM: f64 = 0.5;
/// The way that the step needs in its direction, mm: a scale that is still unknown to [`COARSE_REL`] makes it longer.
const REACH_MM: f64 = (PLAY_MM + WAY_MM + (WINDOWS - 1) as f64 * WINDOW_MM) * (1.0 + COARSE_REL);
/// The part of a way before each short step, in the same direction, mm.
const TAKE_UP_MM: f64 = 0.2;
/// Windows agree within this, mm: the errors of a rolled screw at both ends, and of two readings.
const SCATTER_MM: f64 = 0.12;
/// Standard deviation of the difference of a rolled screw at two places, mm.
const SCREW_MM: f64 = 0.02;
/// Turns before the tilts that count, degrees.
const TURNS_DEG: [f64; 2] = [1.0, 5.0];
/// Tilts at which the gauge is read, degrees.
const TILTS_DEG: [f64; 4] = [0.0, 30.0, 0.0, -30.0];

/// A dial gauge: its division, and what it may be wrong by over 10 mm, mm.
const DIAL_STEP_MM: f64 = 0.01;
const DIAL_LIMIT_MM: f64 = 0.015;
/// An angle gauge: its division, and what it may be wrong by, degrees.
const GAUGE_STEP_DEG: f64 = 0.1;
const GAUGE_LIMIT_DEG: f64 = 0.1;

/// A way agrees with what was asked within this share and two divisions: enough to go on with a longer one.
const COARSE_REL: f64 = 0.15;

/// A change of the scale beyond these factors, or with an uncertainty beyond this share of it, needs the same result twice: one slip
/// with a gauge would make each later step many times as long as it says.
const FACTORS: RangeInclusive<f64> = 0.5..=2.0;
const UNCERTAIN_REL: f64 = 1.0 / 3.0;

/// A gauge shows a scale if it goes the same way as the drive says, by a part of it within these limits. The sign is
/// shown by then.
const PLAUSIBLE: RangeInclusive<f64> = 0.02..=50.0;

/// Limits of acceptance.
const SCALE_REL: f64 = 0.003;
const TILT_DEG: f64 = 0.3;

/// Readings of one way that must agree.
const READINGS: usize = 3;

pub(super) async fn carry_out<B: Bench>(
    rig: &RigFile,
    bench: &mut B,
) -> Result<Finding, Early<B::Trouble>> {
    confirm(bench, Asked::NoSample).await?;
    let (mut values, mut changes) = linear(rig, bench).await?;
    match rotary(rig, bench).await {
        Ok((of_rotary, changes_of_rotary)) => {
            values.extend(of_rotary);
            changes.extend(changes_of_rotary);
        }
        // What was found of the linear stage is kept. The step is made again after its change, with the rotary stage.
        Err(Early::Failed(why)) if !changes.is_empty() => bench.remark(&why),
        Err(early) => return Err(early),
    }
    Ok(Finding::of(values, changes))
}

type Found = (Vec<Value>, Vec<Change>);

async fn linear<B: Bench>(rig: &RigFile, bench: &mut B) -> Result<Found, Early<B::Trouble>> {
    let at = located(bench, JogAxis::Linear).await?;
    let sense = direction(rig, at).map_err(Early::Failed)?;
    let found = |value: f64, sigma: f64, digits| {
        let keys = ["linear.mm_per_step", "linear.zero_mm"];
        let changes = stretched(&rig.linear.scale, at, (value, digits), keys);
        let name = "linear.scale";
        (Value { name, value, standard_uncertainty: sigma, unit: "1" }, changes)
    };
    for way in COARSE_WAYS_MM {
        let scale = coarse(bench, sense, way).await?;
        if !is_close(scale, DIAL_STEP_MM / way) {
            if is_doubtful(scale, DIAL_STEP_MM / way) {
                bench.remark(AGAIN);
                let again = coarse(bench, sense, way).await?;
                is_the_same::<B::Trouble>(JogAxis::Linear, [scale, again], DIAL_STEP_MM / way)?;
            }
            let (value, changes) = found(scale, DIAL_STEP_MM / way, 2);
            return Ok((vec![value], changes.into()));
        }
    }
    let excess = excess(bench, sense).await?;
    let gauge = DIAL_LIMIT_MM.hypot(DIAL_STEP_MM / 2.0) / 3.0_f64.sqrt();
    // A few windows may agree by chance.
    let screw = excess.sigma.max(SCREW_MM / (WINDOWS as f64).sqrt());
    let scale = 1.0 + excess.value / (sense * WAY_MM);
    if (scale - 1.0).abs() > 2.0 * COARSE_REL {
        return Err(Early::Failed(format!(
            "over {WAY_MM} mm the probe goes {scale:.3} times as far as its drive says, and over {} mm it did not",
            COARSE_WAYS_MM[1]
        )));
    }
    let (value, changes) = found(scale, gauge.hypot(screw) / WAY_MM, 5);
    let is_wrong = (value.value - 1.0).abs() > SCALE_REL;
    Ok((vec![value], if is_wrong { changes.into() } else { Vec::new() }))
}

/// How many times as far as its drive says the probe goes in steps over a way, by a gauge that is set to zero before each. Longer steps
/// are admitted if it is close.
async fn coarse<B: Bench>(bench: &mut B, sense: f64, way: f64) -> Result<f64, Early<B::Trouble>> {
    let mut agreement = Agreement::new(READINGS, 2.0 * DIAL_STEP_MM);
    loop {
        jog(bench, JogAxis::Linear, -sense * TAKE_UP_MM).await?;
        jog(bench, JogAxis::Linear, sense * TAKE_UP_MM).await?;
        insist(bench, Asked::DialZero).await?;
        let there = jog(bench, JogAxis::Linear, sense * way).await?.way();
        let progress = agreement.add(reading(bench, Asked::Dial).await?);
        let scale = match progress {
            Progress::Settled(mean) => Some(ratio(JogAxis::Linear, mean.value, there)),
            _ => None,
        };
        if let Some(Ok(scale)) = scale
            && is_close(scale, DIAL_STEP_MM / way)
        {
            bench.seen(JogAxis::Linear).await?;
        }
        jog(bench, JogAxis::Linear, -sense * way).await?;
        match progress {
            Progress::Settled(_) => {}
            Progress::More { contradicts } => doubt(bench, contradicts),
            Progress::Failed => return Err(contradictory(Asked::Dial)),
        }
        if let Some(scale) = scale {
            return scale;
        }
    }
}

/// How many times as far as its drive says the table turns by a step and back. Longer steps are admitted if it is close.
async fn turn<B: Bench>(
    bench: &mut B,
    begin: (f64, f64),
    way: f64,
) -> Result<f64, Early<B::Trouble>> {
    let there = read_tilt(bench, way).await?;
    let ratio = ratio(JogAxis::Rotary, there.1 - begin.1, there.0 - begin.0);
    if ratio.as_ref().is_ok_and(|ratio| is_close(*ratio, GAUGE_STEP_DEG / way)) {
        bench.seen(JogAxis::Rotary).await?;
    }
    jog(bench, JogAxis::Rotary, -way).await?;
    ratio
}

/// Whether a scale with this standard deviation is that of the drive, well enough to go on with a longer way.
fn is_close(scale: f64, sigma: f64) -> bool {
    (scale - 1.0).abs() <= COARSE_REL + 2.0 * sigma
}

/// Whether a scale needs the same result twice.
fn is_doubtful(scale: f64, sigma: f64) -> bool {
    !FACTORS.contains(&scale) || UNCERTAIN_REL * scale < sigma
}

/// What is said before that.
const AGAIN: &str = "That is far from what the drive says. The step is repeated: set the gauge again, and look whether it stands firm.";

/// Refuses a scale that another reading of the same way does not show.
fn is_the_same<T>(axis: JogAxis, [first, again]: [f64; 2], sigma: f64) -> Result<(), Early<T>> {
    if (again - first).abs() <= 2.0 * sigma {
        return Ok(());
    }
    Err(Early::Failed(format!(
        "the {} went {first:.2} times as far as its drive says by the gauge, and {again:.2} times when the step was repeated",
        axis.name()
    )))
}

/// How much further than the drive says the probe goes over the whole way, mm, in windows that begin at several
/// places: an error of the screw at one end is not that at another.
async fn excess<B: Bench>(bench: &mut B, sense: f64) -> Result<Mean, Early<B::Trouble>> {
    let mut agreement = Agreement::new(WINDOWS, SCATTER_MM);
    jog(bench, JogAxis::Linear, sense * PLAY_MM).await?;
    for window in 1.. {
        insist(bench, Asked::DialZero).await?;
        let there = jog(bench, JogAxis::Linear, sense * WAY_MM).await?.way();
        let read = reading(bench, Asked::Dial).await?;
        jog(bench, JogAxis::Linear, sense * (WINDOW_MM - WAY_MM - PLAY_MM)).await?;
        if window % WINDOWS == 0 {
            // Further windows are the same ones again: there is no room for others.
            jog(bench, JogAxis::Linear, -sense * WINDOWS as f64 * WINDOW_MM).await?;
        }
        jog(bench, JogAxis::Linear, sense * PLAY_MM).await?;
        match agreement.add(read - there) {
            Progress::Settled(mean) => return Ok(mean),
            Progress::More { contradicts } => doubt(bench, contradicts),
            Progress::Failed => break,
        }
    }
    Err(contradictory(Asked::Dial))
}

/// The direction in which the step has room: upwards, or else downwards as far as neither the lower soft limit nor the surface
/// is reached.
fn direction(rig: &RigFile, at: f64) -> Result<f64, String> {
    let soft = rig.limits.linear.soft();
    let surface = rig.limits.geometry.surface.value();
    let (top, floor) = (soft.max.value(), soft.min.value().max(surface));
    if at + REACH_MM <= top {
        Ok(1.0)
    } else if floor <= at - REACH_MM {
        Ok(-1.0)
    } else {
        Err(format!(
            "the linear stage stands at {at:.3} mm, and the step needs {REACH_MM:.1} mm up to the upper soft limit of {top} mm, or \
             down to {floor} mm, the higher one of surface and lower soft limit"
        ))
    }
}

async fn rotary<B: Bench>(rig: &RigFile, bench: &mut B) -> Result<Found, Early<B::Trouble>> {
    let keys = ["rotary.deg_per_step", "rotary.zero_deg"];
    let scale = &rig.rotary.scale;
    located(bench, JogAxis::Rotary).await?;
    let begin = read_tilt(bench, 0.0).await?;
    for way in TURNS_DEG {
        let ratio = turn(bench, begin, way).await?;
        let sigma = GAUGE_STEP_DEG / way;
        if !is_close(ratio, sigma) {
            if is_doubtful(ratio, sigma) {
                bench.remark(AGAIN);
                let begin = read_tilt(bench, 0.0).await?;
                let again = turn(bench, begin, way).await?;
                is_the_same::<B::Trouble>(JogAxis::Rotary, [ratio, again], sigma)?;
            }
            let value = Value {
                name: "rotary.scale",
                value: ratio,
                standard_uncertainty: sigma,
                unit: "1",
            };
            return Ok((vec![value], stretched(scale, begin.0, (ratio, 2), keys).into()));
        }
    }
    let mut points = vec![begin];
    for tilt in TILTS_DEG {
        let at = points[points.len() - 1].0;
        points.push(read_tilt(bench, tilt - at).await?);
    }
    let at = points[points.len() - 1].0;
    jog(bench, JogAxis::Rotary, -at).await?;
    let (slope, offset) = line(&points);
    let n = points.len() as f64;
    let sigma = GAUGE_LIMIT_DEG.hypot(GAUGE_STEP_DEG / 2.0) / 3.0_f64.sqrt();
    let values = vec![
        Value { name: "rotary.scale", value: slope, standard_uncertainty: sigma / 30.0, unit: "1" },
        Value {
            name: "rotary.zero",
            value: offset,
            standard_uncertainty: sigma.max(GAUGE_LIMIT_DEG / n.sqrt()),
            unit: "°",
        },
    ];
    let zero = scale.zero.value();
    let mut changes = Vec::new();
    let is_stretched = (slope - 1.0).abs() * TILTS_DEG[1] > TILT_DEG;
    if is_stretched {
        let to = rounded(scale.per_count * slope, 4);
        changes.push(Change { key: keys[0], from: scale.per_count, to });
    }
    // The gauge reads offset + slope · (zero + counts · step).
    if is_stretched || offset.abs() > TILT_DEG {
        let to = rounded(offset + if is_stretched { slope * zero } else { zero }, 3);
        changes.push(Change { key: keys[1], from: zero, to });
    }
    Ok((values, changes))
}

/// How many times as far as its drive says an axis goes by a gauge.
fn ratio<T>(axis: JogAxis, read: f64, made: f64) -> Result<f64, Early<T>> {
    let ratio = read / made;
    if PLAUSIBLE.contains(&ratio) {
        return Ok(ratio);
    }
    let (name, unit) = (axis.name(), axis.unit());
    Err(Early::Failed(format!(
        "the drive of the {name} says that it went {made:+.3} {unit}, and the gauge {read:+.3} {unit}: neither sign nor \
         length agree well enough for a scale"
    )))
}

/// The step of a drive whose axis goes `ratio` times as far as it says, with the zero that leaves the axis where it
/// is.
fn stretched<U: Unit>(
    scale: &Scale<U>,
    at: f64,
    (ratio, digits): (f64, i32),
    keys: [&'static str; 2],
) -> [Change; 2] {
    let (per_count, zero) = (scale.per_count, scale.zero.value());
    let new = rounded(per_count * ratio, digits);
    let new_zero = at - (at - zero) * new / per_count;
    [
        Change { key: keys[0], from: per_count, to: new },
        Change { key: keys[1], from: zero, to: rounded(new_zero, 6) },
    ]
}

/// Turns by so much, and gives where the drive says that the table is and what the gauge says.
async fn read_tilt<B: Bench>(bench: &mut B, by: f64) -> Result<(f64, f64), Early<B::Trouble>> {
    let at = jog(bench, JogAxis::Rotary, by).await?.at;
    let agreement = Agreement::new(READINGS, 2.0 * GAUGE_STEP_DEG);
    Ok((at, agreed(bench, Asked::Gauge, agreement).await?))
}

/// Slope, and value at zero, of the line through points.
fn line(points: &[(f64, f64)]) -> (f64, f64) {
    let n = points.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / n;
    let (x, y) = (mean(|point| point.0), mean(|point| point.1));
    let sums = points.iter().fold((0.0, 0.0), |(xx, xy), point| {
        let dx = point.0 - x;
        (xx + dx * dx, xy + dx * (point.1 - y))
    });
    let slope = sums.1 / sums.0;
    (slope, y - slope * x)
}
