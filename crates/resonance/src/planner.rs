//! Which frequency to measure next.
//!
//! The planner does not measure and has no clock: it is asked for points, is given the readings,
//! and is asked again, until it has a verdict. What it costs is told by the readings themselves.

mod design;
mod settled;

use rig_model::{Reading, SweepMethod, SweepPoint, SweepRequest, Window};

use crate::{Circuit, FitOptions, Fitter, NoisePrior, Resonance, Verdict};
use settled::Settled;

/// What to do next.
#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "one is alive at a time")]
pub enum Next {
    /// Measure these points in this order, and add the readings.
    Measure(Vec<SweepPoint>),
    /// Nothing more to measure.
    Finished(Verdict),
}

/// What is believed before the first reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// The circuit as it was last found.
    pub circuit: Circuit,
    /// Where its resonance may have moved since.
    pub within: Window,
    /// The noise of the analyzer as it was last found.
    pub noise: Option<NoisePrior>,
}

impl Prior {
    /// The last resonance, which may have moved anywhere in `within`.
    pub fn moved(last: &Resonance, within: Window) -> Self {
        let noise = NoisePrior {
            at_ten_cycles: last.noise_at_ten_cycles,
            degrees_of_freedom: (2 * last.points) as f64,
        };
        Self { circuit: last.circuit(), within, noise: Some(noise) }
    }
}

/// Chooses the points of one sweep.
#[derive(Debug, Clone)]
pub struct Planner {
    request: SweepRequest,
    options: FitOptions,
    readings: Vec<Reading>,
    fitter: Fitter,
    method: Method,
}

#[derive(Debug, Clone)]
enum Method {
    Uniform { points: u32, is_asked: bool },
    Settled(Settled),
}

impl Planner {
    /// A planner for this request, with what is believed so far.
    pub fn new(request: &SweepRequest, prior: Option<&Prior>) -> Self {
        let method = match request.method {
            SweepMethod::Uniform { points } => Method::Uniform { points, is_asked: false },
            SweepMethod::Adaptive => Method::Settled(Settled::new(request, prior)),
        };
        let options = FitOptions {
            window: Some(request.window),
            noise: prior.and_then(|prior| prior.noise),
            always_loss: true,
        };
        let fitter = Fitter::default();
        Self { request: *request, options, readings: Vec::new(), fitter, method }
    }

    /// What to do next. Asked again without new readings, it ends with what it has.
    #[expect(
        clippy::should_implement_trait,
        reason = "what comes next depends on the readings added in between"
    )]
    pub fn next(&mut self) -> Next {
        let points = match &mut self.method {
            Method::Uniform { is_asked: true, .. } => Vec::new(),
            Method::Uniform { points, is_asked } => {
                *is_asked = true;
                let SweepRequest { window, settle_s, cycles, .. } = self.request;
                evenly(window, *points, settle_s, cycles)
            }
            Method::Settled(settled) => settled.next(&self.request, &self.readings, &self.options),
        };
        if points.is_empty() {
            let readings = match &self.method {
                Method::Uniform { .. } => &self.readings[..],
                Method::Settled(settled) => settled.usable(&self.readings),
            };
            return Next::Finished(self.fitter.fit(readings, &self.options));
        }
        Next::Measure(points)
    }

    /// Takes the readings of the points asked for last.
    pub fn add(&mut self, readings: &[Reading]) {
        self.readings.extend_from_slice(readings);
        if let Method::Settled(settled) = &mut self.method {
            settled.add(readings.len());
        }
    }

    /// All readings so far.
    pub fn readings(&self) -> &[Reading] {
        &self.readings
    }

    /// How many of the first readings only served to find the resonance. The verdict rests on the
    /// others.
    pub fn looks(&self) -> usize {
        match &self.method {
            Method::Settled(settled) => self.readings.len() - settled.usable(&self.readings).len(),
            Method::Uniform { .. } => 0,
        }
    }
}

/// Points at equal distances over a window, from end to end.
fn evenly(window: Window, points: u32, settle_s: f64, cycles: u32) -> Vec<SweepPoint> {
    let step = (window.max_hz - window.min_hz) / f64::from(points.max(2) - 1);
    (0..points)
        .map(|i| SweepPoint {
            frequency_hz: (window.min_hz + step * f64::from(i)).min(window.max_hz),
            settle_s,
            cycles,
        })
        .collect()
}
