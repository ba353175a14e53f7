//! Between the units of an axis and the counts of its drive.

use crate::{Position, Unit};

/// The scale between counts of a drive and positions of the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale<U> {
    /// Move of the axis for one count, in the unit `U`; negative when the drive counts the other
    /// way.
    pub per_count: f64,
    /// Position of the axis at count zero.
    pub zero: Position<U>,
    /// Counts per revolution of the motor, as it is set in the drive.
    pub counts_per_revolution: f64,
    /// Acceleration and deceleration, in units per second squared.
    pub acceleration_per_s2: f64,
}

impl<U: Unit> Scale<U> {
    /// The nearest count, or `None` where the drive's 32-bit counter does not reach.
    pub fn counts(&self, position: Position<U>) -> Option<i32> {
        let counts = ((position.value() - self.zero.value()) / self.per_count).round();
        let is_in_range = f64::from(i32::MIN) <= counts && counts <= f64::from(i32::MAX);
        #[expect(clippy::cast_possible_truncation, reason = "the range was checked")]
        is_in_range.then_some(counts as i32)
    }

    /// Position of the axis at a count.
    pub fn position(&self, counts: i64) -> Position<U> {
        self.zero.offset(counts as f64 * self.per_count)
    }

    /// Counts per second at a speed in units per second.
    pub fn counts_per_s(&self, speed_per_s: f64) -> f64 {
        speed_per_s / self.per_count.abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Mm;

    #[test]
    fn counts_and_positions_are_inverse_also_for_a_drive_that_counts_downwards() {
        for per_count in [0.0006, -0.0006] {
            let scale = Scale::<Mm> {
                per_count,
                zero: Position::new(50.0),
                counts_per_revolution: 1000.0,
                acceleration_per_s2: 100.0,
            };
            for counts in [-83_333, -1, 0, 1, 20_000] {
                assert_eq!(scale.counts(scale.position(counts.into())), Some(counts));
            }
            assert_eq!(scale.counts(Position::new(1e9)), None);
            assert_eq!(scale.counts(Position::new(f64::NAN)), None);
        }
    }
}
