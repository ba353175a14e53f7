//! The methods of measuring a resonance: the choice of the points.

use num_complex::Complex64;
use rig_contact::Circuit;
use rig_model::{Reading, RigTime, SweepMethod, SweepPoint, SweepRequest, random::Stream};
use rig_resonance::{Bench, FitOptions, FitOutcome, NoisePrior, Past, Prior, Timing, fit};

use super::case::Case;
use crate::{
    analyzer::{Analyzer, Gaps, WINDOW, reading, time_constant_s},
    planned,
};

/// A method of measuring a resonance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Method {
    /// Even settled points of ten cycles.
    Steady { points: u32 },
    /// Even points of ten cycles, each after five time constants of settling.
    Even { points: u32 },
    /// Even points without settling.
    Fast { points: u32, cycles: u32 },
    /// The planner that fits the free decay, up to a target standard deviation, after a survey.
    Decay { target_hz: f64 },
    /// The same without a survey.
    Unsurveyed { target_hz: f64 },
}

/// The sweep of a careful laboratory.
pub(super) const LABORATORY: Method = Method::Even { points: 201 };
/// Time limit of a planner, s.
pub(super) const LIMIT_S: f64 = 5.0;
/// Duration of the survey of the bench, s.
pub(super) const SURVEY_S: u32 = 300;

/// A measured sweep.
#[derive(Debug)]
pub(super) struct Measured {
    pub(super) points: Vec<SweepPoint>,
    pub(super) readings: Vec<Reading>,
    pub(super) time_s: f64,
    /// The result of the production fit.
    pub(super) verdict: FitOutcome,
    /// The knowledge of the bench after a planned sweep.
    pub(super) bench: Option<Bench>,
}

impl Method {
    /// The name without parameters.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Steady { .. } => "ideal",
            Self::Even { .. } => "uniform",
            Self::Fast { .. } => "fast uniform",
            Self::Decay { .. } => "free-decay planner",
            Self::Unsurveyed { .. } => "free-decay planner without a survey",
        }
    }

    /// Parameters of the method, for the tooltip.
    pub(super) fn detail(self) -> String {
        match self {
            Self::Steady { points } => format!("{points} points; 10 cycles"),
            Self::Even { points } => format!("{points} points; 10 cycles; 5 time constants"),
            Self::Fast { points, cycles } => format!("{points} points; {cycles} cycles"),
            Self::Decay { target_hz } | Self::Unsurveyed { target_hz } => {
                format!("{:.0} mHz", 1000.0 * target_hz)
            }
        }
    }

    /// Measures a sensor at rest. Only the window and the noise of the analyzer are known and, for the
    /// planner, what a survey of the bench says.
    pub(super) fn measure(self, circuit: &Circuit, case: &Case, random: Stream) -> Measured {
        let at_rest = |random| Analyzer::at_rest(*circuit, case.noise, random);
        match self {
            Self::Steady { points } => steady(circuit, case.noise, points, random),
            Self::Even { points } => {
                let settle_s = 5.0 * time_constant_s(circuit);
                sweep(at_rest(random), WINDOW.evenly(points, settle_s, 10), Timing::Waited)
            }
            Self::Fast { points, cycles } => {
                let timing = Timing::Exact(Past::Rest);
                sweep(at_rest(random), WINDOW.evenly(points, 0.0, cycles), timing)
            }
            // No more is known of the drive and of the times than of those of a real analyzer.
            Self::Decay { target_hz } => {
                let mut random = random;
                let analyzer = |random| at_rest(random).with_any_phase(Gaps::USUAL);
                let survey = survey(&mut analyzer(random.fork()), target_hz, case.noise);
                if survey.bench.is_none() {
                    // Without a result, like a sweep that takes all of its time.
                    return Measured { time_s: LIMIT_S, ..survey };
                }
                let prior = Prior { bench: survey.bench, ..cold(case.noise) };
                plan(&mut analyzer(random), &request(target_hz), &prior)
            }
            Self::Unsurveyed { target_hz } => {
                let mut analyzer = at_rest(random).with_any_phase(Gaps::USUAL);
                plan(&mut analyzer, &request(target_hz), &cold(case.noise))
            }
        }
    }
}

/// The prior before the survey: only the noise of the analyzer.
pub(super) fn cold(noise: f64) -> Prior {
    let noise = NoisePrior { at_ten_cycles: noise, degrees_of_freedom: 1000.0 };
    Prior { noise: Some(noise), ..Prior::anywhere(WINDOW, None) }
}

/// The request for a sweep with a target standard deviation.
pub(super) fn request(target_sigma_hz: f64) -> SweepRequest {
    planned::request(WINDOW, SweepMethod::Adaptive, target_sigma_hz, LIMIT_S)
}

/// Readings of the settled circuit.
fn steady(circuit: &Circuit, noise: f64, points: u32, mut random: Stream) -> Measured {
    // Longer than the decay of any sensor.
    const SETTLE_S: f64 = 60.0;
    let points = WINDOW.evenly(points, SETTLE_S, 10);
    let read = |point: &SweepPoint| {
        let error = Complex64::new(random.normal(), random.normal());
        let impedance = circuit.impedance_ohm(point.frequency_hz) * (1.0 + noise * error);
        reading(point, impedance, RigTime::ZERO)
    };
    let readings: Vec<Reading> = points.iter().map(read).collect();
    let time_s = points.iter().map(SweepPoint::duration_s).sum();
    let verdict = fit(&readings, &FitOptions { window: Some(WINDOW), ..FitOptions::default() });
    Measured { points, readings, time_s, verdict, bench: None }
}

fn sweep(mut analyzer: Analyzer, points: Vec<SweepPoint>, timing: Timing) -> Measured {
    let readings: Vec<Reading> = points.iter().map(|point| analyzer.visit(point)).collect();
    let options = FitOptions { window: Some(WINDOW), timing, ..FitOptions::default() };
    let verdict = fit(&readings, &options);
    Measured { points, readings, time_s: analyzer.elapsed_s(), verdict, bench: None }
}

/// Runs a planner to its end. Its time starts with its first point.
pub(super) fn plan(analyzer: &mut Analyzer, request: &SweepRequest, prior: &Prior) -> Measured {
    let begun_s = analyzer.elapsed_s();
    let mut visited = Vec::new();
    let (verdict, planner) = planned::sweep(request, prior, |points| {
        visited.extend_from_slice(points);
        let readings = points.iter().map(|point| analyzer.visit(point)).collect();
        (readings, analyzer.elapsed_s() - begun_s)
    });
    let time_s = analyzer.elapsed_s() - begun_s;
    let (readings, bench) = (planner.readings().to_vec(), planner.bench());
    Measured { points: visited, readings, time_s, verdict, bench }
}

/// The survey of the bench that comes once, before all sweeps.
pub(super) fn survey(analyzer: &mut Analyzer, target_hz: f64, noise: f64) -> Measured {
    let method = SweepMethod::Survey { seconds: SURVEY_S };
    let request = SweepRequest { method, ..request(target_hz) };
    let first = plan(analyzer, &request, &cold(noise));
    // The daemon repeats a refused survey once too.
    if first.bench.is_some() { first } else { plan(analyzer, &request, &cold(noise)) }
}
