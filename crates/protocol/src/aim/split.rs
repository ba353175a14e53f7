//! The split itself: the settings that reach an aim at the least cost, among a grid of values.
//!
//! The time of a touch is a sum of one term for each setting, and so is the variance of its stiffness. The grid
//! has some thousand points, so that each of them is looked at: the number of steps is known, the result is the
//! best of the grid, and the same files give the same settings.

use super::{AimSettings, Wanted};

/// What settings cost and give.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Value {
    /// Time of a touch, s.
    pub(super) seconds: f64,
    /// Root mean square of the standard deviations of the touches, %.
    pub(super) percent: f64,
    /// The largest of them, %.
    pub(super) worst_percent: f64,
}

impl Value {
    /// What the aim limits: the largest standard deviation, or the time.
    pub(super) const fn limited_by(&self, wanted: Wanted) -> f64 {
        match wanted {
            Wanted::StiffnessPercent(_) => self.worst_percent,
            Wanted::SecondsPerTouch(_) => self.seconds,
        }
    }
}

/// Candidates of the grid with their values; none of them reaches the aim.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct OutOfReach {
    /// The settings that come nearest.
    pub(super) nearest: AimSettings,
    pub(super) value: Value,
}

/// The best of the candidates: the fastest of those that are accurate enough, or the most accurate of those
/// that are fast enough. Of equal ones the first.
///
/// # Panics
/// If there is no candidate.
pub(super) fn best(
    wanted: Wanted,
    candidates: impl Iterator<Item = (AimSettings, Value)>,
) -> Result<AimSettings, OutOfReach> {
    let limit = wanted.value();
    let limited = |value: &Value| value.limited_by(wanted);
    let free = |value: &Value| match wanted {
        Wanted::StiffnessPercent(_) => (value.seconds, value.percent),
        Wanted::SecondsPerTouch(_) => (value.percent, value.seconds),
    };
    let mut found: Option<(AimSettings, Value)> = None;
    let mut nearest: Option<(AimSettings, Value)> = None;
    for (settings, value) in candidates {
        if limited(&value) <= limit {
            let is_better = found.is_none_or(|(_, best)| free(&value) < free(&best));
            found = if is_better { Some((settings, value)) } else { found };
        }
        let is_nearer = nearest.is_none_or(|(_, best)| limited(&value) < limited(&best));
        nearest = if is_nearer { Some((settings, value)) } else { nearest };
    }
    let (nearest, value) = nearest.expect("each setting has at least one value");
    found.map(|(settings, _)| settings).ok_or(OutOfReach { nearest, value })
}

/// Preferred numbers: ten in each decade, about a quarter apart, as a person would write them.
///
/// # Source
/// ISO 3:1973, Preferred numbers, series R'10.
const PREFERRED: [f64; 10] = [1.0, 1.25, 1.6, 2.0, 2.5, 3.2, 4.0, 5.0, 6.3, 8.0];

/// The preferred numbers from `least` to `most`, both of which lie between 1e-6 and 10. If there is none, `most`
/// alone.
pub(super) fn preferred(least: f64, most: f64) -> Vec<f64> {
    // A division by a power of ten gives the number nearest to the decimal one.
    let decades = (0..=6).rev().map(|decade| 10.0_f64.powi(decade));
    let all = decades.flat_map(|decade| PREFERRED.map(|number| number / decade));
    let within: Vec<f64> = all.filter(|number| (least..=most).contains(number)).collect();
    if within.is_empty() { vec![most] } else { within }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::NoLoadPolicy;

    /// A touch of 1 s and 1 %, which the step of the search makes longer or less accurate.
    fn candidates() -> impl Iterator<Item = (AimSettings, Value)> {
        preferred(0.01, 1.0).into_iter().map(|fine_step_mm| {
            let settings = AimSettings {
                contact_sigma_hz: 0.1,
                no_load_sigma_hz: 0.1,
                fine_step_mm,
                no_load: NoLoadPolicy::EverySample,
            };
            let (seconds, percent) = (1.0 + 0.1 / fine_step_mm, 1.0 + fine_step_mm);
            (settings, Value { seconds, percent, worst_percent: 2.0 * percent })
        })
    }

    #[test]
    fn the_fastest_accurate_and_the_most_accurate_fast_settings_are_found() {
        let step = |wanted| best(wanted, candidates()).map(|found| found.fine_step_mm);
        assert_eq!(step(Wanted::StiffnessPercent(2.6)), Ok(0.25), "2 · (1 + 0.32) is too much");
        assert_eq!(step(Wanted::StiffnessPercent(100.0)), Ok(1.0));
        assert_eq!(step(Wanted::SecondsPerTouch(2.0)), Ok(0.1));
        assert_eq!(step(Wanted::SecondsPerTouch(100.0)), Ok(0.01));
    }

    #[test]
    fn an_aim_out_of_reach_is_told_what_comes_nearest() {
        let too_fine = best(Wanted::StiffnessPercent(1.0), candidates()).unwrap_err();
        assert_eq!((too_fine.nearest.fine_step_mm, too_fine.value.worst_percent), (0.01, 2.02));
        let too_fast = best(Wanted::SecondsPerTouch(1.0), candidates()).unwrap_err();
        assert_eq!((too_fast.nearest.fine_step_mm, too_fast.value.seconds), (1.0, 1.1));
    }

    #[test]
    fn preferred_numbers_are_the_decimal_ones() {
        let found: Vec<String> = preferred(0.004, 0.02).iter().map(f64::to_string).collect();
        assert_eq!(found, ["0.004", "0.005", "0.0063", "0.008", "0.01", "0.0125", "0.016", "0.02"]);
        assert_eq!(preferred(0.011, 0.012), [0.012]);
    }
}
