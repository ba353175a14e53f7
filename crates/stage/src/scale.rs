//! Between the units of an axis and the counts of its drive.

use rig_model::{Position, Unit};

use crate::map::Route;

/// An axis that comes back to where it was after a turn.
///
/// The drive must be set to the same turn, and its positions are then compared within one turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Turn {
    /// Counts of a whole turn, at least one.
    pub counts: u32,
    /// Which way it goes.
    pub route: Route,
}

impl Turn {
    /// How far it is from one count to another on the way that the axis takes.
    pub(crate) fn distance(self, from: i32, to: i32) -> f64 {
        let turn = i64::from(self.counts.max(1));
        let forward = (i64::from(to) - i64::from(from)).rem_euclid(turn);
        let distance = match self.route {
            Route::Direct => (i64::from(to) - i64::from(from)).abs(),
            Route::Shortest => forward.min(turn - forward),
            Route::Forward => forward,
            Route::Reverse => (turn - forward) % turn,
        };
        distance as f64
    }

    /// The count that is the same place as `count`, as near to `to` as can be.
    pub(crate) fn nearest(self, count: i32, to: i32) -> i64 {
        let turn = i64::from(self.counts.max(1));
        let ahead = (i64::from(count) - i64::from(to)).rem_euclid(turn);
        let ahead = if turn < 2 * ahead { ahead - turn } else { ahead };
        i64::from(to) + ahead
    }
}

/// How the counts of a drive correspond to positions of the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale<U> {
    /// How far one count moves the axis, in the unit `U`; negative when the drive counts the other
    /// way.
    pub per_count: f64,
    /// Where the axis stands when the drive counts zero.
    pub zero: Position<U>,
    /// Counts per revolution of the motor, for drives that take speed in revolutions per minute.
    pub counts_per_revolution: f64,
    /// Acceleration and deceleration, in units per second squared.
    pub acceleration_per_s2: f64,
}

impl<U: Unit> Scale<U> {
    /// The nearest count, or `None` where the drive's 32-bit counter does not reach.
    pub(crate) fn counts(&self, position: Position<U>) -> Option<i32> {
        let counts = ((position.value() - self.zero.value()) / self.per_count).round();
        let is_in_range = f64::from(i32::MIN) <= counts && counts <= f64::from(i32::MAX);
        #[expect(clippy::cast_possible_truncation, reason = "the range was checked")]
        is_in_range.then_some(counts as i32)
    }

    /// Where the axis stands at a count.
    pub(crate) fn position(&self, counts: i64) -> Position<U> {
        self.zero.offset(counts as f64 * self.per_count)
    }

    /// Counts per second at a speed in units per second.
    pub(crate) fn counts_per_s(&self, speed_per_s: f64) -> f64 {
        speed_per_s / self.per_count.abs()
    }
}

#[cfg(test)]
mod tests {
    use rig_model::Mm;

    use super::*;

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

    #[test]
    fn the_way_round_is_the_one_that_the_route_says() {
        let turn = |route| Turn { counts: 36_000, route };
        let rows = [
            (Route::Direct, 1000, 35_000, 34_000.0),
            (Route::Shortest, 1000, 35_000, 2000.0),
            (Route::Forward, 1000, 35_000, 34_000.0),
            (Route::Reverse, 1000, 35_000, 2000.0),
            (Route::Forward, 35_000, 1000, 2000.0),
            (Route::Reverse, 0, 0, 0.0),
            (Route::Shortest, i32::MIN, i32::MAX, 12_705.0),
        ];
        for (route, from, to, expected) in rows {
            assert_eq!(turn(route).distance(from, to), expected, "{route:?} {from} {to}");
        }
        let nearest = |count, to| turn(Route::Shortest).nearest(count, to);
        assert_eq!(
            [nearest(35_990, 10), nearest(-10, 35_995), nearest(72_005, 0)],
            [-10, 35_990, 5]
        );
    }
}
