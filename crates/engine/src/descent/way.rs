//! The way of a descent, from positions that were read on it.

use rig_model::{Mm, Position, RigTime};
use rig_resonance::EvenWay;

/// Positions this close to the beginning or the end of the way may be those of a stage that speeds up or slows
/// down, mm for each mm/s.
const RAMP_S: f64 = 0.03;

/// Positions that a way needs.
const LEAST: usize = 3;

/// Largest deviation of the speed from the one that was asked for, relative.
const SPEED_TOLERANCE: f64 = 0.05;

/// The way is not one of even speed, or not known.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub(super) enum Uneven {
    /// Too few positions.
    #[error(
        "{found} positions were read on the even part of the descent, where {LEAST} are needed"
    )]
    TooFew {
        /// Number of positions.
        found: usize,
    },
    /// Another speed.
    #[error("the stage went down at {found:.3} mm/s instead of {asked:.3} mm/s")]
    Speed {
        /// Speed of the positions, mm/s.
        found: f64,
        /// Speed asked for, mm/s.
        asked: f64,
    },
}

/// The straight line through the positions between both ends.
pub(super) fn even(
    way: &[(RigTime, Position<Mm>)],
    (from, rest): (Position<Mm>, Position<Mm>),
    speed_mm_per_s: f64,
) -> Result<EvenWay, Uneven> {
    let ramp_mm = RAMP_S * speed_mm_per_s;
    let is_even = |mm: f64| rest.value() + ramp_mm < mm && mm < from.value() - ramp_mm;
    let even: Vec<(f64, f64)> = way
        .iter()
        .map(|(at, position)| (at.as_seconds(), position.value()))
        .filter(|(_, mm)| is_even(*mm))
        .collect();
    let found = even.len();
    if found < LEAST {
        return Err(Uneven::TooFew { found });
    }
    let count = found as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| even.iter().map(of).sum::<f64>() / count;
    let (time_s, at_mm) = (mean(|one| one.0), mean(|one| one.1));
    let spread: f64 = even.iter().map(|(s, _)| (s - time_s).powi(2)).sum();
    let along: f64 = even.iter().map(|(s, mm)| (s - time_s) * (mm - at_mm)).sum();
    let speed = -along / spread;
    // NaN is refused too.
    let is_as_asked = (speed - speed_mm_per_s).abs() <= SPEED_TOLERANCE * speed_mm_per_s;
    if !is_as_asked {
        return Err(Uneven::Speed { found: speed, asked: speed_mm_per_s });
    }
    let off = |(s, mm): &(f64, f64)| (mm - at_mm + speed_mm_per_s * (s - time_s)).powi(2);
    let scatter = even.iter().map(off).sum::<f64>() / (count - 1.0);
    let sigma_mm = (scatter / count).sqrt();
    Ok(EvenWay { time_s, at_mm, sigma_mm, speed_mm_per_s, rest_mm: rest.value() })
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    /// Positions each 20 ms of a stage that goes from 11 to 10.4 mm at this speed, with ramps of 5 ms.
    fn way(speed: f64, jitter_mm: f64) -> Vec<(RigTime, Position<Mm>)> {
        let place = |step: u32| {
            let seconds = 0.02 * f64::from(step);
            let gone = (speed * (seconds - 0.0025)).max(0.0);
            let jitter = if step.is_multiple_of(2) { jitter_mm } else { -jitter_mm };
            let at = RigTime::from_micros(1_000_000) + Duration::from_secs_f64(seconds);
            (at, Position::new((11.0 - gone + jitter).max(10.4)))
        };
        (0..60).map(place).collect()
    }

    #[test]
    fn the_line_goes_through_the_even_part() {
        let ends = (Position::new(11.0), Position::new(10.4));
        let line = even(&way(1.0, 0.001), ends, 1.0).unwrap();
        assert!((line.position_mm(1.2) - 10.8025).abs() < 5e-4, "{line:?}");
        assert_eq!(line.position_mm(5.0), 10.4);
        assert!((1e-5..1e-3).contains(&line.sigma_mm), "{line:?}");
    }

    #[test]
    fn another_speed_and_too_few_positions_are_refused() {
        let ends = (Position::new(11.0), Position::new(10.4));
        assert!(matches!(even(&way(0.9, 0.0), ends, 1.0), Err(Uneven::Speed { .. })));
        let short = &way(1.0, 0.0)[..4];
        assert_eq!(even(short, ends, 1.0), Err(Uneven::TooFew { found: 2 }));
    }
}
