//! Touches that have one reference, beside the same touches with one for each.

use super::sample::{SampleRun, Story};
use crate::results::RunResults;

const SWEEP_HZ: f64 = 0.1;
const DRIFT_HZ: f64 = 0.2;

/// The complete run with these errors of its references, which are one sweep or one for each touch.
fn results(is_shared: bool, keys: &str) -> RunResults {
    let mut sample = SampleRun::new(Story::Complete);
    sample.change_start(|started| started.protocol.toml += keys);
    let first = std::cell::Cell::new(None);
    sample.change_touches(|touch| {
        let sweep = first.get().unwrap_or(touch.no_load_sweep);
        first.set(is_shared.then_some(sweep));
        touch.no_load_sweep = sweep;
        touch.no_load_sigma_hz = SWEEP_HZ;
        touch.drift_sigma_hz = DRIFT_HZ;
        touch.shift_sigma_hz = touch.sigma_hz.hypot(SWEEP_HZ).hypot(DRIFT_HZ);
    });
    sample.results()
}

#[test]
fn means_of_touches_with_one_reference_keep_its_error_and_slopes_lose_it() {
    let [shared, alone] = [true, false].map(|is_shared| results(is_shared, ""));
    let common_hz2 = SWEEP_HZ.powi(2) + DRIFT_HZ.powi(2);
    for (shared, alone) in shared.angle_means.iter().zip(&alone.angle_means) {
        let (shared, alone) = (shared.mean, alone.mean);
        assert_eq!(shared.shift_hz, alone.shift_hz);
        // Of three directions, each has the common part once.
        let expected_hz2 = alone.sigma_hz.powi(2) + common_hz2 * (1.0 - 1.0 / 3.0);
        assert!((shared.sigma_hz.powi(2) - expected_hz2).abs() < 1e-9, "{shared:?}");
        assert!(shared.standard_error_hz() >= shared.sigma_hz);
    }
    let slope = |results: &RunResults| results.sensitivity.as_ref().unwrap().sensitivity;
    assert_eq!(slope(&shared).chord.hz_per_mpa, slope(&alone).chord.hz_per_mpa);
    assert!(slope(&shared).chord.sigma_hz_per_mpa < slope(&alone).chord.sigma_hz_per_mpa);
}

#[test]
fn the_stiffness_of_touches_and_of_sites_with_one_reference_is_less_certain() {
    for keys in ["", "angle = \"unknown\"\n"] {
        let [shared, alone] = [true, false].map(|is_shared| results(is_shared, keys).summary());
        for (shared, alone) in shared.stiffness.iter().zip(&alone.stiffness) {
            // What touches share does not become less in a mean.
            let [shared_mpa, alone_mpa] = [shared, alone]
                .map(|one| one.budget.unwrap().reference_mpa / one.stiffness_mpa.unwrap());
            assert!(shared_mpa > 1.2 * alone_mpa, "{keys:?} {shared:?} {alone:?}");
        }
        let [shared, alone] = [shared, alone].map(|one| one.calibration.unwrap());
        assert_eq!(shared.samples, alone.samples);
        assert!(shared.sigma_rel > 1.05 * alone.sigma_rel, "{keys:?} {shared:?} {alone:?}");
    }
}
