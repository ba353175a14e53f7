//! Sweeps that the planner of the daemon plans.

use rig_model::{DriveLevel, Reading, SweepMethod, SweepPoint, SweepRequest, Window};
use rig_resonance::{FitOutcome, Next, Planner, Prior};

/// The request for a planned sweep or a survey.
pub(crate) fn request(
    window: Window,
    method: SweepMethod,
    target_sigma_hz: f64,
    time_limit_s: f64,
) -> SweepRequest {
    let level = DriveLevel { volt: 1.0 };
    SweepRequest { window, method, target_sigma_hz, time_limit_s, cycles: 10, settle_s: 0.5, level }
}

/// Plans and measures a sweep. `measure` takes the readings of a stay and returns them with the time
/// since the start of the sweep, s.
pub(crate) fn sweep(
    request: &SweepRequest,
    prior: &Prior,
    mut measure: impl FnMut(&[SweepPoint]) -> (Vec<Reading>, f64),
) -> (FitOutcome, Planner) {
    let mut planner = Planner::new(request, Some(prior));
    loop {
        match planner.next() {
            Next::Finished(verdict) => return (verdict, planner),
            Next::Measure(points) => {
                let (readings, passed_s) = measure(&points);
                planner.pass(passed_s);
                planner.add(&readings);
            }
        }
    }
}
