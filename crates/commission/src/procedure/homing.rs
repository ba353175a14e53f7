//! Each axis is where it was after its drive was without power: at once, by an absolute encoder, or after the drive has found
//! its zero again.
//!
//! Test indicators show it, and no drive. They are set to zero before the power goes, so that a zero that moves shows
//! too: signs, scale and geometry were found with the old one.
//!
//! A linear stage that homes downwards has no room for the table with its indicator. The rotary axis is shown first then, and the
//! linear stage stands still. Then the table is taken away, and the linear stage is shown by the indicator that was set at the
//! begin.

use rig_files::rig_file::RigFile;
use rig_model::{Axis, Unit};

use super::{Early, agreed, attempt, confirm, doubt, go_to, jog, located, order, reading};
use crate::{
    Asked, Bench, Finding, Jog, JogAxis, Jogged, Order,
    agreement::Agreement,
    homing::{EDGE_MM, Kept, judge},
};

/// How often the power goes, and how often a drive that forgets its place finds its zero.
const POWER_CYCLES: usize = 3;
const HOMINGS: usize = 10;

/// Places, as ways from that of the indicators, from which the axis comes back, mm and degrees.
const WAYS: [[f64; 5]; 2] = [[0.5, 2.0, 4.0, 6.0, 8.0], [2.0, 5.0, 10.0, 15.0, 20.0]];

/// The last part of the way back, which is always in the same direction: play of the screw is not of the homing.
const LAST: [f64; 2] = [0.5, 2.0];

/// A drive that kept its place says where the axis was within this, mm and degrees.
const KEPT: f64 = 0.05;

/// Readings of a drive while it starts again, and of its position at a place, whose mean is less uncertain.
const STARTS: usize = 20;
const LOOKS: usize = 4;

/// Divisions of a test indicator within which two readings agree, and a reading that is further from zero is asked for
/// again, mm.
const SAME_MM: f64 = 0.002;
const FAR_MM: f64 = 0.01;

/// An axis and where its indicator was set to zero, by its drive.
struct Place {
    axis: JogAxis,
    at: f64,
    /// The direction in which it is brought away.
    away: f64,
    readings: Vec<f64>,
    is_homing: bool,
    /// How its drive is told to find its zero.
    home: Order,
}

pub(super) async fn carry_out<B: Bench>(
    rig: &RigFile,
    bench: &mut B,
) -> Result<Finding, Early<B::Trouble>> {
    confirm(bench, Asked::NoSample).await?;
    let mut linear = Place::of(bench, JogAxis::Linear, &rig.limits.linear).await?;
    let mut rotary = Place::of(bench, JogAxis::Rotary, &rig.limits.rotary).await?;
    confirm(bench, Asked::SetIndicators).await?;
    bench.homing_begins().await?;
    if rig.linear.is_homing_up {
        find_again(bench, &mut [&mut linear, &mut rotary], 0).await?;
    } else {
        find_again(bench, &mut [&mut rotary], 0).await?;
        // A drive with an absolute encoder does not home, and needs no such way.
        if !linear.started(bench).await?.is_homed {
            confirm(bench, Asked::TableAway).await?;
        }
        linear.home = Order::HomeDown;
        // The power of its drive was off meanwhile, and the axis stood still.
        linear.come_back(bench, 0.0).await?;
        find_again(bench, &mut [&mut linear], 1).await?;
    }
    Ok(judge([linear.kept(), rotary.kept()]))
}

/// Takes the power away and has the drives find their axes again, from the cycle `first` on.
async fn find_again<B: Bench>(
    bench: &mut B,
    places: &mut [&mut Place],
    first: usize,
) -> Result<(), Early<B::Trouble>> {
    for cycle in first..HOMINGS {
        let is_power = cycle < POWER_CYCLES;
        if !is_power && places.iter().all(|place| !place.is_homing) {
            break;
        }
        for place in places.iter() {
            let way = WAYS[part(place.axis)][cycle % 5];
            if is_power || place.is_homing {
                go_to(bench, place.axis, place.at + place.away * way).await?;
            }
        }
        if is_power {
            confirm(bench, Asked::PowerCycle).await?;
        }
        for place in places.iter_mut() {
            if is_power || place.is_homing {
                let way = WAYS[part(place.axis)][cycle % 5];
                place.come_back(bench, way).await?;
            }
        }
    }
    Ok(())
}

const fn part(axis: JogAxis) -> usize {
    match axis {
        JogAxis::Linear => 0,
        JogAxis::Rotary => 1,
    }
}

/// Where a drive says that its axis stands: the mean of some readings.
async fn position<B: Bench>(bench: &mut B, axis: JogAxis) -> Result<f64, Early<B::Trouble>> {
    let mut sum = 0.0;
    for _ in 0..LOOKS {
        sum += jog(bench, axis, 0.0).await?.at;
    }
    Ok(sum / LOOKS as f64)
}

impl Place {
    /// Where the axis stands, approached as it will be later. The linear stage is brought away upwards, where there is room.
    async fn of<B: Bench, U: Unit>(
        bench: &mut B,
        axis: JogAxis,
        limits: &Axis<U>,
    ) -> Result<Self, Early<B::Trouble>> {
        let last = LAST[part(axis)];
        located(bench, axis).await?;
        jog(bench, axis, -last).await?;
        jog(bench, axis, last).await?;
        let at = position(bench, axis).await?;
        let longest = WAYS[part(axis)][4];
        let away = if at + longest < limits.soft().max.value() { 1.0 } else { -1.0 };
        Ok(Self { axis, at, away, readings: vec![0.0], is_homing: false, home: Order::Home(axis) })
    }

    fn kept(&self) -> Kept<'_> {
        Kept { readings_mm: &self.readings, is_homing: self.is_homing }
    }

    /// Finds the axis again, this way from its place, brings it back, and reads its indicator.
    async fn come_back<B: Bench>(
        &mut self,
        bench: &mut B,
        way: f64,
    ) -> Result<(), Early<B::Trouble>> {
        let Self { axis, at: place, away, .. } = *self;
        let found = self.started(bench).await?;
        if self.is_homing || !found.is_homed {
            self.is_homing = true;
            order(bench, self.home).await?;
        } else if (found.at - place - away * way).abs() > KEPT {
            let (name, unit) = (axis.name(), axis.unit());
            return Err(Early::Failed(format!(
                "{name}: its drive was at {:.3} {unit} when the power went, and says that it is at {:.3} {unit} now",
                place + away * way,
                found.at
            )));
        }
        go_to(bench, axis, place - LAST[part(axis)]).await?;
        go_to(bench, axis, place).await?;
        // A drive stops at its counts, which need not be those of the place.
        let beside = position(bench, axis).await? - place;
        let beside_mm = match axis {
            JogAxis::Linear => beside,
            JogAxis::Rotary => beside.to_radians() * EDGE_MM,
        };
        self.readings.push(self.read(bench).await? - beside_mm);
        Ok(())
    }

    /// What the drive says as soon as it answers again.
    async fn started<B: Bench>(&self, bench: &mut B) -> Result<Jogged, Early<B::Trouble>> {
        let look = Order::Step(Jog { axis: self.axis, by: 0.0 });
        let mut trouble = String::new();
        for _ in 0..STARTS {
            match attempt(bench, look).await? {
                Ok(found) => return Ok(found),
                Err(why) => trouble = why,
            }
        }
        Err(Early::Failed(format!("{}: {trouble}", self.axis.name())))
    }

    /// A reading, and a second opinion of one that is far from the others.
    async fn read<B: Bench>(&self, bench: &mut B) -> Result<f64, Early<B::Trouble>> {
        let asked = match self.axis {
            JogAxis::Linear => Asked::Indicator,
            JogAxis::Rotary => Asked::EdgeIndicator,
        };
        let first = reading(bench, asked).await?;
        if first.abs() <= FAR_MM {
            return Ok(first);
        }
        doubt(bench, true);
        agreed(bench, asked, Agreement::new(2, SAME_MM)).await
    }
}
