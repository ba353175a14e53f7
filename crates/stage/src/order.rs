//! A command in a drive's own units, and the requests it becomes.

use std::time::Duration;

use rig_files::instrument::drive::{AccelerationUnit, Quantity, RegisterContent, Step, Width};
use rig_model::{Axis, Position, Scale, Unit};

use crate::{RegisterMap, Request, StageError, profile};

/// Standard acceleration of free fall, mm/s².
const FREE_FALL_MM_PER_S2: f64 = 9806.65;

/// The quantities of a command. One that is not a move needs only the limits.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Order {
    /// Target, counts.
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

/// The action of a command step.
#[derive(Debug)]
pub(crate) enum StepAction {
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
        let counts = |wanted| scale.counts(wanted).ok_or(StageError::Uncountable { wanted });
        let (a, b) = (counts(soft.min)?, counts(soft.max)?);
        Ok(Self {
            target: 0,
            speed: 0,
            acceleration: 0,
            limits: (a.min(b), a.max(b)),
            counts_per_s: 0.0,
            counts_per_s2: 0.0,
        })
    }

    /// A move, if it is one that the drive can make. It is never faster than asked.
    ///
    /// # Errors
    /// [`StageError::Speed`], [`StageError::TooSlow`], [`StageError::Uncountable`].
    pub(crate) fn to<U: Unit>(
        wanted: Position<U>,
        speed_per_s: f64,
        map: &RegisterMap,
        scale: &Scale<U>,
        axis: &Axis<U>,
    ) -> Result<Self, StageError<U>> {
        let max = axis.max_speed_per_s();
        if !(0.0 < speed_per_s && speed_per_s <= max) {
            return Err(StageError::Speed { asked: speed_per_s, max });
        }
        let Some(target) = scale.counts(wanted) else {
            return Err(StageError::Uncountable { wanted });
        };
        let rpm_per_count_per_s = 60.0 / scale.counts_per_revolution;
        let per_count_per_s = map.speed.per_count_per_s(scale);
        // A product that should be whole may be slightly below.
        let speed = (scale.counts_per_s(speed_per_s) * per_count_per_s + 1e-6).floor();
        if speed < 1.0 {
            let min = map.speed.slowest_per_s(scale);
            return Err(StageError::TooSlow { asked: speed_per_s, min });
        }
        let counts_per_s2 = scale.counts_per_s(scale.acceleration_per_s2);
        let acceleration = match map.acceleration {
            AccelerationUnit::CountsPerSecond2 => counts_per_s2.floor(),
            AccelerationUnit::HundredthsOfG => {
                (100.0 * scale.acceleration_per_s2 / FREE_FALL_MM_PER_S2).floor()
            }
            AccelerationUnit::MillisecondsPer1000Rpm => {
                (1e6 / (counts_per_s2 * rpm_per_count_per_s)).ceil()
            }
        };
        Ok(Self {
            target,
            speed: whole(speed),
            acceleration: whole(acceleration.max(1.0)),
            counts_per_s: speed / per_count_per_s,
            counts_per_s2,
            ..Self::at_rest(scale, axis)?
        })
    }

    /// Duration of the move from a count, from rest to rest.
    pub(crate) fn duration_from(&self, counts: i32) -> Duration {
        profile::duration(self.distance_from(counts), self.counts_per_s, self.counts_per_s2)
    }

    /// Duration of the rest of the move at full speed.
    pub(crate) fn rest_from(&self, counts: i32) -> Duration {
        let seconds = self.distance_from(counts) / self.counts_per_s;
        Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX)
    }

    fn distance_from(&self, counts: i32) -> f64 {
        (f64::from(self.target) - f64::from(counts)).abs()
    }

    /// The action of a step of the command.
    pub(crate) fn action(&self, step: &Step) -> StepAction {
        StepAction::Ask(match *step {
            Step::Hold { ms } => return StepAction::Wait(Duration::from_millis(ms.into())),
            Step::Registers { address, ref contents } => {
                Request::WriteRegisters { address, values: self.words(contents) }
            }
            Step::Register { address, value } => Request::WriteRegister { address, value },
            Step::Coil { address, is_on } => Request::WriteCoil { address, is_on },
        })
    }

    /// The registers that a command writes.
    pub(crate) fn words(&self, contents: &[RegisterContent]) -> Vec<u16> {
        let mut words = Vec::with_capacity(2 * contents.len());
        for &content in contents {
            let (value, width) = match content {
                RegisterContent::Word(word) => (i32::from(word), Width::U16),
                RegisterContent::Long(value) => (value, Width::I32),
                RegisterContent::Of(quantity, width) => (self.value(quantity), width),
            };
            match width {
                // A speed or a ramp beyond one register becomes the gentlest that it holds.
                Width::U16 => words.push(u16::try_from(value.max(0)).unwrap_or(u16::MAX)),
                Width::I32 => {
                    let [a, b, c, d] = value.to_be_bytes();
                    words.extend([u16::from_be_bytes([a, b]), u16::from_be_bytes([c, d])]);
                }
            }
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

/// The soft limits that the settings of a drive have, in counts; `None` for a drive without, or one whose other settings are not those
/// with which it gets its limits.
pub(crate) fn limits_in(expected: &[RegisterContent], found: &[u16]) -> Option<(i32, i32)> {
    let (mut min, mut max, mut rest) = (None, None, found);
    for content in expected {
        let (value, left) = match *content {
            RegisterContent::Of(_, Width::U16) | RegisterContent::Word(_) => {
                let (&word, left) = rest.split_first()?;
                (i32::from(word), left)
            }
            RegisterContent::Of(_, Width::I32) | RegisterContent::Long(_) => {
                let (&[high, low], left) = rest.split_first_chunk::<2>()?;
                ((i32::from(high.cast_signed()) << 16) | i32::from(low), left)
            }
        };
        rest = left;
        match *content {
            RegisterContent::Of(Quantity::LimitMin, _) => min = Some(value),
            RegisterContent::Of(Quantity::LimitMax, _) => max = Some(value),
            RegisterContent::Word(word) if i32::from(word) != value => return None,
            RegisterContent::Long(long) if long != value => return None,
            _ => {}
        }
    }
    // Two equal ones are those of a drive that was never given any.
    min.zip(max).filter(|(min, max)| min < max)
}

#[expect(clippy::cast_possible_truncation, reason = "a cast from float saturates")]
fn whole(value: f64) -> i32 {
    value.round() as i32
}
