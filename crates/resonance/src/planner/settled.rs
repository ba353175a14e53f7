//! Points that are left to settle, for analyzers whose drive between the points is not known.
//!
//! How long a point must be waited for follows from the circuit, which is not known at first. So
//! nothing waits for the worst: every reading counts for as much as it has settled, and what is
//! believed of the circuit after each one says how the sweep ends soonest. The first ones are cheap,
//! and show where to wait; the last ones are waited for as long as the asked uncertainty needs and no
//! longer.

mod plan;

use rig_model::{Reading, SweepPoint, SweepRequest};

use super::{Goal, Prior, elapsed_s, tracker::Tracker};
use crate::{NoisePrior, Timing, scatter::Pool};
use plan::{Ground, Plan};

/// The plan of one sweep.
#[derive(Debug, Clone)]
pub(super) struct Settled {
    tracker: Tracker,
    opening: std::vec::IntoIter<SweepPoint>,
    /// What is left of the last plan.
    rest: Option<Plan>,
}

/// Places in the window of the first readings, and how each is taken.
const OPENING: [f64; 4] = [0.0, 0.33, 0.67, 1.0];
const OPENING_SETTLE_S: f64 = 0.02;
const OPENING_CYCLES: u32 = 2;

impl Settled {
    pub(super) fn new(request: &SweepRequest, prior: Option<&Prior>, noise: &NoisePrior) -> Self {
        let window = prior.map_or(request.window, |prior| prior.within);
        let tracker = Tracker::new(request, prior, Timing::Waited, Pool::known(noise));
        let ratio = window.max_hz / window.min_hz;
        let look = |part: &f64| SweepPoint {
            frequency_hz: (window.min_hz * ratio.powf(*part)).min(window.max_hz),
            settle_s: OPENING_SETTLE_S,
            cycles: OPENING_CYCLES,
        };
        // Where the circuit is nearly known, nothing has to be looked for.
        let places: &[f64] = if tracker.best().is_some() { &[] } else { &OPENING };
        let opening: Vec<_> = places.iter().map(look).collect();
        Self { tracker, opening: opening.into_iter(), rest: None }
    }

    pub(super) fn add(&mut self, readings: &[Reading]) {
        for reading in readings {
            self.tracker.add(reading);
        }
    }

    pub(super) fn tracker(&self) -> &Tracker {
        &self.tracker
    }

    pub(super) fn tracker_mut(&mut self) -> &mut Tracker {
        &mut self.tracker
    }

    /// The next point, or `None` when the readings so far lead nowhere.
    pub(super) fn next(&mut self, readings: &[Reading], goal: &Goal) -> Option<SweepPoint> {
        if let Some(point) = self.opening.next() {
            return Some(point);
        }
        let ground = Ground::new(&self.tracker, goal, elapsed_s(readings))?;
        let plan = ground.plan(self.rest.take());
        let (point, rest) = ground.first(&plan, readings.len());
        self.rest = rest;
        Some(point)
    }
}
