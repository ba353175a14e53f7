//! From touches to the quantities of the daily check.

use super::Quantity;
use crate::{Calibration, Value};

/// The surface of the block at one tilt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlockHeight {
    /// Position of the rotary stage, degrees; positive to the front.
    pub tilt_deg: f64,
    /// Position of the linear stage, mm.
    pub height_mm: f64,
}

/// What the two runs of a check have measured.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Readings {
    /// The resonances with the probe clear, Hz.
    pub free_hz: Vec<f64>,
    /// The touches on the block.
    pub block: Vec<BlockHeight>,
    /// The frequency shifts on the two reference samples, Hz.
    pub references_hz: [Vec<f64>; 2],
}

/// A part of a check that gave no value.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{what} was not measured")]
pub struct Unmeasured {
    what: &'static str,
}

/// The values of one check, in the order of [`Quantity::ALL`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CheckValues(pub(crate) [Measured; Quantity::ALL.len()]);

/// A mean with the standard deviation of the mean by the scatter of its values, 0 for a single value. What the touches of one
/// reference share is not in it: the charts judge by the scatter between checks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Measured {
    pub(crate) value: f64,
    pub(crate) sigma: f64,
}

/// Tilt of the tilted block, degrees, and by how much a touch may differ from it.
const TILT_DEG: f64 = 45.0;
const TILT_TOLERANCE_DEG: f64 = 1.0;

impl Readings {
    /// The quantities of the check.
    ///
    /// # Errors
    /// [`Unmeasured`] names the first part without a value. A shift that is not positive is none.
    pub fn values(&self) -> Result<CheckValues, Unmeasured> {
        let at = |tilt_deg: f64, what| {
            let is_there =
                |touch: &&BlockHeight| (touch.tilt_deg - tilt_deg).abs() < TILT_TOLERANCE_DEG;
            mean(self.block.iter().filter(is_there).map(|touch| touch.height_mm), what)
        };
        let free = mean(self.free_hz.iter().copied(), "the free resonance")?;
        let level = at(0.0, "the level block")?;
        let front = at(TILT_DEG, "the block at 45° to the front")?;
        let back = at(-TILT_DEG, "the block at 45° to the back")?;
        let reference = |index: usize, what| {
            let shifts = self.references_hz[index].iter().copied();
            mean(shifts.filter(|shift_hz| *shift_hz > 0.0).map(f64::ln), what)
        };
        let first = reference(0, "the first reference sample")?;
        let second = reference(1, "the second reference sample")?;
        let of = |value: f64, sigma: f64| Measured { value, sigma };
        let tilted_sigma = front.sigma.hypot(back.sigma);
        Ok(CheckValues([
            free,
            level,
            of(
                0.5 * (front.value + back.value) - level.value,
                (0.5 * tilted_sigma).hypot(level.sigma),
            ),
            of(front.value - back.value, tilted_sigma),
            first,
            second,
            of(second.value - first.value, first.sigma.hypot(second.sigma)),
        ]))
    }
}

impl CheckValues {
    /// The values of a record of a check; `None` for a record of another kind, or one without all values.
    pub fn of(record: &Calibration) -> Option<Self> {
        let find = |quantity: Quantity| {
            let found = record.values.iter().find(|value| value.name == quantity.name())?;
            Some(Measured { value: found.value, sigma: found.standard_uncertainty })
        };
        let found: Vec<_> = Quantity::ALL.into_iter().map_while(find).collect();
        found.try_into().ok().map(Self)
    }

    /// A quantity.
    pub fn get(&self, quantity: Quantity) -> f64 {
        self.0[quantity.index()].value
    }

    /// The quantities for a record.
    pub(crate) fn to_values(self) -> Vec<Value> {
        let value = |(quantity, measured): (Quantity, Measured)| Value {
            name: quantity.name(),
            value: measured.value,
            standard_uncertainty: measured.sigma,
            unit: quantity.unit(),
        };
        Quantity::ALL.into_iter().zip(self.0).map(value).collect()
    }
}

fn mean(
    values: impl Iterator<Item = f64> + Clone,
    what: &'static str,
) -> Result<Measured, Unmeasured> {
    let n = values.clone().count() as f64;
    if n == 0.0 {
        return Err(Unmeasured { what });
    }
    let value = values.clone().sum::<f64>() / n;
    let squares: f64 = values.map(|one| (one - value).powi(2)).sum();
    let sigma = if n > 1.0 { (squares / (n * (n - 1.0))).sqrt() } else { 0.0 };
    Ok(Measured { value, sigma })
}
