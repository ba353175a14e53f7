//! Axes that come back to where they were after a turn.

use crate::map::Route;

/// An axis that comes back to where it was after a turn.
///
/// The drive must be set to the same turn, and its positions are then compared within one turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RotationWrap {
    /// Counts of a whole turn, at least one.
    pub counts: u32,
    /// Which way it goes.
    pub route: Route,
}

impl RotationWrap {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_way_round_is_the_one_that_the_route_says() {
        let turn = |route| RotationWrap { counts: 36_000, route };
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
