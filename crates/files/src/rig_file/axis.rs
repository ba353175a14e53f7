//! The sections of the two axes, whose keys differ in the unit.

use std::ops::RangeInclusive;

use rig_model::{Axis, AxisError, AxisLimits, DriveMake, Position, Scale, Span, Unit};

use super::{AxisFile, fault::RigFileFault};
use crate::{
    instrument::Named,
    settings::{Setting, Table},
};

/// The keys of an axis, with its unit.
#[derive(Debug)]
pub(super) struct AxisKeys {
    name: &'static str,
    per_count: &'static str,
    zero: &'static str,
    acceleration: &'static str,
    travel: &'static str,
    soft_limits: &'static str,
    /// Rest position; 0, which is level, for an axis without this key.
    rest: Option<&'static str>,
    /// Direction in which the drive homes; only one of them leads away from the sample.
    homes: Option<&'static str>,
    tolerance: &'static str,
    max_speed: &'static str,
    ranges: Ranges,
}

/// The narrowest travel of a real axis, mm or degrees.
const NARROWEST: f64 = 1.0;

/// Ranges of real axes, in their unit and in seconds. A number outside its range is likely to be in
/// another unit.
#[derive(Debug)]
struct Ranges {
    /// Finest step of a drive.
    finest: f64,
    tolerance: RangeInclusive<f64>,
    speed: RangeInclusive<f64>,
    acceleration: RangeInclusive<f64>,
}

pub(super) const LINEAR: AxisKeys = AxisKeys {
    name: "linear stage",
    per_count: "mm_per_step",
    zero: "zero_mm",
    acceleration: "acceleration_mm_per_s2",
    travel: "travel_mm",
    soft_limits: "soft_limits_mm",
    rest: Some("clear_mm"),
    homes: Some("homes"),
    tolerance: "tolerance_mm",
    max_speed: "max_speed_mm_per_s",
    ranges: Ranges {
        finest: 1e-5,
        tolerance: 0.0001..=1.0,
        speed: 0.1..=2000.0,
        acceleration: 1.0..=100_000.0,
    },
};

pub(super) const ROTARY: AxisKeys = AxisKeys {
    name: "rotary stage",
    per_count: "deg_per_step",
    zero: "zero_deg",
    acceleration: "acceleration_deg_per_s2",
    travel: "travel_deg",
    soft_limits: "soft_limits_deg",
    rest: None,
    homes: None,
    tolerance: "tolerance_deg",
    max_speed: "max_speed_deg_per_s",
    ranges: Ranges {
        finest: 1e-6,
        tolerance: 0.0001..=5.0,
        speed: 0.1..=10_000.0,
        acceleration: 1.0..=1_000_000.0,
    },
};

/// An axis, with the settings that other sections are checked against.
#[derive(Debug)]
pub(super) struct AxisRead<U> {
    pub(super) axis: Axis<U>,
    pub(super) file: AxisFile<U>,
    /// `None` if it is faulty.
    pub(super) instrument: Option<Named<DriveMake>>,
    pub(super) unit_id: Setting<u32>,
    pub(super) soft_limits: Setting<(f64, f64)>,
    pub(super) rest: Setting<f64>,
    pub(super) max_speed: Setting<f64>,
}

/// Reads and checks an axis.
pub(super) fn axis<U: Unit>(table: &mut Table<'_>, keys: &AxisKeys) -> AxisRead<U>
where
    RigFileFault: From<AxisError<U>>,
{
    let makes = DriveMake::ALL.map(|make| (make.name(), make));
    let make = table.choice_or_file("register_map", makes).required();
    let unit_id = table.count("unit_id").range(1..=247).required();
    let per_count = table.number(keys.per_count).required();
    let zero = table.number(keys.zero).or(0.0);
    let ranges = &keys.ranges;
    let acceleration =
        table.number(keys.acceleration).range(ranges.acceleration.clone()).required();
    let counts_per_revolution = table.number("steps_per_revolution").above(0.0).or(1000.0);
    let travel = table.number(keys.travel).interval().required();
    let soft_limits = table.number(keys.soft_limits).interval().required();
    let rest = match keys.rest {
        Some(key) => table.number(key).required(),
        None => soft_limits.map(|_| 0.0),
    };
    let homes = keys.homes.and_then(|key| {
        table.choice(key, [("up", true), ("down", false)]).optional().map(|homes| homes.value)
    });
    let tolerance = table.number(keys.tolerance).range(ranges.tolerance.clone()).required();
    let max_speed = table.number(keys.max_speed).range(ranges.speed.clone()).required();

    let are_wide = [&travel, &soft_limits].map(|span| is_wide::<U>(table, span)) == [true; 2];
    let limits = || {
        let (travel, soft) = (travel.sound()?, soft_limits.sound().filter(|_| are_wide)?);
        Some(AxisLimits {
            travel: Span::new(travel.0, travel.1),
            soft: Span::new(soft.0, soft.1),
            rest: Position::new(*rest.sound()?),
            tolerance: *tolerance.sound()?,
            max_speed_per_s: *max_speed.sound()?,
        })
    };
    let checked = limits().and_then(|limits| match Axis::new(keys.name, limits) {
        Ok(axis) => Some(axis),
        Err(error) => {
            let location = match error {
                AxisError::RestOutOfReach { .. } => rest.location,
                _ => soft_limits.location,
            };
            table.refuse(location, &RigFileFault::from(error));
            None
        }
    });
    step::<U>(table, &per_count, &tolerance, ranges);
    AxisRead {
        axis: checked.unwrap_or_else(placeholder),
        file: AxisFile {
            instrument: make.value.clone(),
            unit_id: u8::try_from(unit_id.value).expect("the range of the key ends at 247"),
            scale: Scale {
                per_count: per_count.value,
                zero: Position::new(zero.value),
                counts_per_revolution: counts_per_revolution.value,
                acceleration_per_s2: acceleration.value,
            },
            is_homing_up: homes.unwrap_or(false),
        },
        instrument: make.sound().cloned(),
        unit_id,
        soft_limits,
        rest,
        max_speed,
    }
}

/// Whether an interval is as wide as those of real axes.
fn is_wide<U: Unit>(table: &Table<'_>, span: &Setting<(f64, f64)>) -> bool {
    let (key, narrowest, unit) = (span.key, NARROWEST, U::SYMBOL);
    let Some(&(min, max)) = span.sound().filter(|(min, max)| max - min < narrowest) else {
        return true;
    };
    table.refuse(span, &RigFileFault::Narrow { key, min, max, narrowest, unit });
    false
}

/// Checks the distance of one step of the drive.
fn step<U: Unit>(
    table: &Table<'_>,
    per_count: &Setting<f64>,
    tolerance: &Setting<f64>,
    ranges: &Ranges,
) {
    if let Some(&found) = per_count.sound() {
        let (key, finest) = (per_count.key, ranges.finest);
        if found == 0.0 {
            table.refuse(per_count, &RigFileFault::NoStep { key });
        } else if found.abs() < finest {
            table
                .refuse(per_count, &RigFileFault::FineStep { key, found, finest, unit: U::SYMBOL });
        } else if let Some(&tolerance) = tolerance.sound()
            && found.abs() > 2.0 * tolerance
        {
            table.refuse(per_count, &RigFileFault::CoarseStep { key, found, tolerance });
        }
    }
}

/// Replaces a faulty axis.
fn placeholder<U: Unit>() -> Axis<U> {
    let span = Span::new(0.0, 1.0);
    let rest = Position::new(0.0);
    let limits =
        AxisLimits { travel: span, soft: span, rest, tolerance: 1.0, max_speed_per_s: 1.0 };
    Axis::new("placeholder", limits).expect("the limits agree")
}
