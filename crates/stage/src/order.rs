//! A command in a drive's own units, and the requests it becomes.

use std::time::Duration;

use rig_model::{Axis, Position, Unit};

use crate::{
    RegisterMap, Request, Scale, StageError,
    map::{AccelerationUnit, Quantity, Slot, SpeedUnit, Step, Width},
    profile,
};

/// Standard acceleration of free fall, mm/s².
const FREE_FALL_MM_PER_S2: f64 = 9806.65;

/// The quantities of a command. A command that is not a move needs only some of them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Order {
    /// Where to, counts.
    pub(crate) target: i32,
    /// In the unit of the map.
    speed: i32,
    /// In the unit of the map.
    acceleration: i32,
    /// The soft limits, counts, the lower one first.
    limits: (i32, i32),
    counts_per_s: f64,
    counts_per_s2: f64,
}

/// What a command step is carried out by.
#[derive(Debug)]
pub(crate) enum Deed {
    /// A request to the drive.
    Ask(Request),
    /// Waiting while the drive holds the level.
    Wait(Duration),
}

impl Order {
    /// A command that moves nowhere.
    ///
    /// # Errors
    /// [`StageError::Uncountable`] when the drive cannot count to the limits of the axis.
    pub(crate) fn at_rest<U: Unit>(
        scale: &Scale<U>,
        axis: &Axis<U>,
    ) -> Result<Self, StageError<U>> {
        let soft = axis.soft();
        let counts = |wanted| {
            let axis = axis.name();
            scale.counts(wanted).ok_or(StageError::Uncountable { axis, wanted })
        };
        let (a, b) = (counts(soft.min)?, counts(soft.max)?);
        let limits = (a.min(b), a.max(b));
        let (counts_per_s, counts_per_s2) = (0.0, 0.0);
        Ok(Self { target: 0, speed: 0, acceleration: 0, limits, counts_per_s, counts_per_s2 })
    }

    /// A move, if it is one that the drive can make.
    ///
    /// # Errors
    /// [`StageError::Speed`], [`StageError::Uncountable`].
    pub(crate) fn to<U: Unit>(
        wanted: Position<U>,
        speed_per_s: f64,
        map: &RegisterMap,
        scale: &Scale<U>,
        axis: &Axis<U>,
    ) -> Result<Self, StageError<U>> {
        let max = axis.max_speed_per_s();
        if !(0.0 < speed_per_s && speed_per_s <= max) {
            return Err(StageError::Speed { axis: axis.name(), asked: speed_per_s, max });
        }
        let Some(target) = scale.counts(wanted) else {
            return Err(StageError::Uncountable { axis: axis.name(), wanted });
        };
        let counts_per_s = scale.counts_per_s(speed_per_s);
        let counts_per_s2 = scale.counts_per_s(scale.acceleration_per_s2);
        let rpm_per_count_per_s = 60.0 / scale.counts_per_revolution;
        let speed = match map.speed {
            SpeedUnit::CountsPerSecond => counts_per_s,
            SpeedUnit::RevolutionsPerMinute => counts_per_s * rpm_per_count_per_s,
        };
        let acceleration = match map.acceleration {
            AccelerationUnit::CountsPerSecond2 => counts_per_s2,
            AccelerationUnit::HundredthsOfG => {
                100.0 * scale.acceleration_per_s2 / FREE_FALL_MM_PER_S2
            }
            AccelerationUnit::MillisecondsPer1000Rpm => 1e6 / (counts_per_s2 * rpm_per_count_per_s),
        };
        Ok(Self {
            target,
            // Zero would be refused, or never arrive.
            speed: whole(speed).max(1),
            acceleration: whole(acceleration).max(1),
            counts_per_s,
            counts_per_s2,
            ..Self::at_rest(scale, axis)?
        })
    }

    /// How long the move takes from a count, from rest to rest.
    pub(crate) fn duration_from(&self, counts: i32) -> Duration {
        let distance = f64::from(self.target) - f64::from(counts);
        profile::duration(distance, self.counts_per_s, self.counts_per_s2)
    }

    /// How long the rest of the move takes at full speed.
    pub(crate) fn rest_from(&self, counts: i32) -> Duration {
        let distance = (f64::from(self.target) - f64::from(counts)).abs();
        Duration::try_from_secs_f64(distance / self.counts_per_s).unwrap_or(Duration::MAX)
    }

    /// What carries out a step of the command.
    pub(crate) fn deed(&self, step: Step) -> Deed {
        Deed::Ask(match step {
            Step::Hold { ms } => return Deed::Wait(Duration::from_millis(ms.into())),
            Step::Registers { address, slots } => {
                Request::WriteRegisters { address, values: self.words(slots) }
            }
            Step::Register { address, value } => Request::WriteRegister { address, value },
            Step::Coil { address, is_on } => Request::WriteCoil { address, is_on },
        })
    }

    /// The registers that a command writes.
    pub(crate) fn words(&self, slots: &[Slot]) -> Vec<u16> {
        let mut words = Vec::with_capacity(2 * slots.len());
        for &slot in slots {
            let (value, width) = match slot {
                Slot::Word(word) => (i32::from(word), Width::U16),
                Slot::Long(value) => (value, Width::I32),
                Slot::Of(quantity, width) => (self.value(quantity), width),
            };
            let [a, b, c, d] = value.to_be_bytes();
            if width == Width::I32 {
                words.push(u16::from_be_bytes([a, b]));
            }
            words.push(u16::from_be_bytes([c, d]));
        }
        words
    }

    const fn value(&self, quantity: Quantity) -> i32 {
        match quantity {
            Quantity::Target => self.target,
            Quantity::Speed => self.speed,
            Quantity::Acceleration | Quantity::Deceleration => self.acceleration,
            Quantity::LimitMin => self.limits.0,
            Quantity::LimitMax => self.limits.1,
        }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "a cast from float saturates")]
fn whole(value: f64) -> i32 {
    value.round() as i32
}
