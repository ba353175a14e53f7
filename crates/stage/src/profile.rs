//! The duration of a move.

use std::time::Duration;

/// The time of a trapezoidal move of `distance`, from rest to rest; all in the same unit of
/// length.
pub(crate) fn duration(distance: f64, speed_per_s: f64, acceleration_per_s2: f64) -> Duration {
    let distance = distance.abs();
    let ramps = speed_per_s * speed_per_s / acceleration_per_s2;
    let seconds = if ramps <= distance {
        distance / speed_per_s + speed_per_s / acceleration_per_s2
    } else {
        2.0 * (distance / acceleration_per_s2).sqrt()
    };
    Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_moves_are_trapezoids_and_short_ones_triangles() {
        let seconds = |distance| duration(distance, 10.0, 100.0).as_secs_f64();
        assert_eq!(seconds(0.0), 0.0);
        // Two ramps of 0.1 s over 0.5 mm each, and 1.9 s at full speed.
        assert!((seconds(20.0) - 2.1).abs() < 1e-9);
        assert!((seconds(-1.0) - 0.2).abs() < 1e-9);
        assert!((seconds(0.25) - 0.1).abs() < 1e-9);
    }
}
