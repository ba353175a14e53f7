//! The surface search: duration against the error of the surface found.
//!
//! The daemon's search drives the simulated world, with its screws, noise and mountings, in the
//! time that stage and analyzer take. The error is the true depth of the tip at the surface found.

use rayon::prelude::*;
use rig_chart::{Axis, Chart, Series, Stroke};
use rig_engine::{Search, SearchStep};
use rig_model::{Mm, Position, Reading, RigTime, SweepPoint};
use rig_protocol::Approach;
use rig_sim::{
    scene,
    world::{AxisId, Profile, World},
};

use crate::{analyzer::reading, files::Csv};

/// The samples: the softest, the middle and the stiffest.
pub(super) const SAMPLES: [&str; 3] = ["1", "3", "5"];
/// Settling at each step, s.
const SETTLINGS_S: [f64; 3] = [0.02, 0.1, 0.5];
/// The approach, beside what is varied.
const APPROACH: Approach = Approach {
    start_above_mm: 0.8,
    give_up_below_mm: 0.8,
    coarse_step_mm: 0.1,
    fine_step_mm: 0.005,
    contact_threshold: 0.1,
    settle_s: 0.1,
    cycles: 10,
    slip_mm: 0.0,
    descent_mm_per_s: None,
    slow_descent_mm_per_s: None,
};
/// The expected surface of the shipped rig, mm, and its speeds, mm/s.
const EXPECTED_MM: f64 = 10.0;
const CONTACT_SPEED: f64 = 1.0;
const TRAVEL_SPEED: f64 = 20.0;
const ACCELERATION: f64 = 200.0;
/// Step of the shipped drive, mm.
const STEP_MM: f64 = 0.001;
/// Time constants of settling before the baseline, and after a contact.
const BASELINE_TIME_CONSTANTS: f64 = 8.0;
const AFTER_CONTACT_TIME_CONSTANTS: f64 = 5.0;

/// A search that found the surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct SurfaceFound {
    /// Duration of the search, s.
    time_s: f64,
    /// True depth of the tip at the surface found, mm; positive inside the sample.
    error_mm: f64,
}

/// Searches with the same sample and approach.
#[derive(Debug, Clone)]
pub(super) struct Searches {
    pub(super) sample: &'static str,
    pub(super) approach: Approach,
    /// The searches that found the surface.
    pub(super) found: Vec<SurfaceFound>,
    pub(super) count: u32,
}

impl Searches {
    pub(super) fn mean_time_s(&self) -> f64 {
        self.mean(|one| one.time_s)
    }

    pub(super) fn bias_um(&self) -> f64 {
        1000.0 * self.mean(|one| one.error_mm)
    }

    pub(super) fn rmse_um(&self) -> f64 {
        1000.0 * self.mean(|one| one.error_mm.powi(2)).sqrt()
    }

    fn mean(&self, of: impl Fn(&SurfaceFound) -> f64) -> f64 {
        self.found.iter().map(of).sum::<f64>() / self.found.len() as f64
    }
}

/// Searches with every fine step and settling time, on every sample.
pub(super) fn try_all(searches: u32, seed: u64) -> Vec<Searches> {
    let mut all = Vec::new();
    for sample in SAMPLES {
        for settle_s in SETTLINGS_S {
            for fine_step_mm in [0.05, 0.02, 0.01, 0.005, 0.002] {
                let approach = Approach { settle_s, fine_step_mm, ..APPROACH };
                let one = |number: u32| search(approach, sample, seed + u64::from(number));
                let found: Vec<_> = (0..searches).into_par_iter().filter_map(one).collect();
                all.push(Searches { sample, approach, found, count: searches });
            }
        }
    }
    all
}

/// One search; `None` if it does not find the surface.
fn search(approach: Approach, sample: &str, seed: u64) -> Option<SurfaceFound> {
    let world = World::new(scene::matched(), seed).expect("the shipped scene is sound");
    let mut bench =
        SearchBench { world, now: RigTime::ZERO, frequency_hz: 0.0, time_constant_s: 0.0 };
    bench.world.place_sample(bench.now, sample).expect("the shipped scene has the sample");
    bench.move_to(EXPECTED_MM + 20.0, TRAVEL_SPEED);
    let free = bench.world.truth(bench.now).no_load_hz;
    // The quality factor of the free sensor is the reciprocal of its beam loss of 0.015.
    (bench.frequency_hz, bench.time_constant_s) =
        (free, 1.0 / (0.015 * std::f64::consts::PI * free));
    let baseline = bench.read(BASELINE_TIME_CONSTANTS * bench.time_constant_s, approach.cycles);
    let begun_s = bench.now.as_seconds();
    let (mut search, mut turn) =
        Search::begin(approach, Position::new(EXPECTED_MM), baseline.impedance()?);
    let mut speed = TRAVEL_SPEED;
    loop {
        turn = match turn {
            SearchStep::MoveTo(target) => {
                let here = bench.move_to(target.value(), speed);
                speed = CONTACT_SPEED;
                search.arrived(here)
            }
            SearchStep::Read { is_after_contact } => {
                let settle_s = if is_after_contact {
                    approach.settle_s.max(AFTER_CONTACT_TIME_CONSTANTS * bench.time_constant_s)
                } else {
                    approach.settle_s
                };
                search.read(bench.read(settle_s, approach.cycles))
            }
            SearchStep::Found(surface) => {
                let time_s = bench.now.as_seconds() - begun_s;
                // Approached from above, as for every reading of the search.
                let position_mm = surface.position.value();
                bench.move_to(position_mm + approach.coarse_step_mm, CONTACT_SPEED);
                bench.move_to(position_mm, CONTACT_SPEED);
                let error_mm = bench.world.truth(bench.now).indentation_mm;
                return Some(SurfaceFound { time_s, error_mm });
            }
            SearchStep::Flagged | SearchStep::Fault(_) => return None,
        };
    }
}

/// The simulated world with its clock.
struct SearchBench {
    world: World,
    now: RigTime,
    frequency_hz: f64,
    time_constant_s: f64,
}

impl SearchBench {
    /// Moves the tip, and returns the position of the encoder.
    fn move_to(&mut self, target_mm: f64, speed: f64) -> Position<Mm> {
        let profile = Profile { speed, acceleration: ACCELERATION, deceleration: ACCELERATION };
        let in_steps = |mm: f64| (mm / STEP_MM).round() * STEP_MM;
        let stage = self.world.drive(self.now, AxisId::Linear);
        stage.start(self.now, in_steps(target_mm), &profile);
        self.now = stage.rests_from();
        let motor_mm = self.world.stage(AxisId::Linear).motor(self.now);
        let jitter_mm = STEP_MM * self.world.encoder_jitter();
        Position::new(in_steps(motor_mm + jitter_mm))
    }

    /// Reads the impedance at the resonance of the free sensor.
    fn read(&mut self, settle_s: f64, cycles: u32) -> Reading {
        let point = SweepPoint { frequency_hz: self.frequency_hz, settle_s, cycles };
        let started = self.now;
        self.world.set_frequency(self.now, self.frequency_hz);
        let ready = started + std::time::Duration::from_secs_f64(settle_s);
        self.now = self.world.begin_reading(ready, cycles);
        let impedance = self.world.end_reading().expect("a reading was begun");
        reading(&point, impedance, started)
    }
}

pub(super) fn table(searches: &[Searches]) -> String {
    let mut table = Csv::new(&[
        "sample",
        "settle_s",
        "fine_step_mm",
        "searches",
        "found",
        "time_mean_s",
        "surface_bias_um",
        "surface_rmse_um",
    ]);
    for one in searches {
        table.row([
            one.sample.to_owned(),
            one.approach.settle_s.to_string(),
            one.approach.fine_step_mm.to_string(),
            one.count.to_string(),
            one.found.len().to_string(),
            format!("{:.3}", one.mean_time_s()),
            format!("{:.2}", one.bias_um()),
            format!("{:.2}", one.rmse_um()),
        ]);
    }
    table.text().to_owned()
}

pub(super) fn chart(searches: &[Searches]) -> Chart {
    let mut chart = Chart::new(
        "Duration of a search against the error of the surface found",
        "Root mean square error of the surface found against the duration of the search, for steps \
         of 50 to 2 µm, three settling times, and the softest and the stiffest sample.",
        Axis::linear("duration of the search (s)").including(0.0),
        Axis::log("error of the surface (µm rms)"),
    );
    for (colour, settle_s) in SETTLINGS_S.into_iter().enumerate() {
        for (sample, stroke) in [(SAMPLES[0], Stroke::Solid), (SAMPLES[2], Stroke::Dashed)] {
            let of = |one: &&Searches| {
                one.sample == sample && one.approach.settle_s == settle_s && !one.found.is_empty()
            };
            let points: Vec<(f64, f64)> =
                searches.iter().filter(of).map(|one| (one.mean_time_s(), one.rmse_um())).collect();
            if !points.is_empty() {
                let name = format!("sample {sample}, {:.0} ms", 1000.0 * settle_s);
                let series = Series::joined(&name, colour, points);
                chart.series.push(Series { stroke: Some(stroke), ..series });
            }
        }
    }
    chart
}
