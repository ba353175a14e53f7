//! How long do planned sweeps take on an analyzer of which little is known, and are they right?
//!
//! `cargo bench -p rig-resonance --bench free_decay -- [RUNS [SEED [SECOND_MODE [TARGET_HZ [WRONG [PLACE
//! [SURVEY_S [PHASE_DEG [NOISE]]]]]]]]]` plans this number of sweeps from nothing for each sensor: the drive has
//! any phase after each change of frequency, dead times and gaps are up to 3 ms long, and their lengths
//! are known to a millisecond. A second mode of this part of the first capacitance lies `PLACE`
//! linewidths above (1), this share of the readings is wrong, and the analyzer has this phase error. If
//! `SURVEY_S` is not 0, a survey of that many seconds comes before each sweep. With `NOISE`, the standard
//! deviation of each part of a reading of ten cycles, the planner guesses it, as in the first sweep of a
//! bench; without, it is 0.005 and known. For each sensor it prints how
//! many sweeps were accepted, their median, 95 % and longest time on the rig, bias, error and coverage,
//! how many were off by more than five standard deviations, readings and stays of a sweep, the mean,
//! 99.9 % and longest time of a planning step or a verdict, and why the others were refused; of the surveys the error
//! of the phase and its stated standard deviation, that of a second mode, the largest time of
//! computing, and the mean time on the rig.

#![expect(clippy::print_stdout, reason = "printing is what it is for")]
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "numbers of runs, seeds and places are small and positive"
)]

use std::{collections::BTreeMap, f64::consts::TAU, time::Duration};

use num_complex::Complex64;
use rig_contact::Circuit;
use rig_model::{DriveLevel, Reading, RigTime, SweepMethod, SweepPoint, SweepRequest, Window};
use rig_resonance::{Bench as Known, FitOutcome, Next, NoisePrior, Planner, Prior, Refusal};
use rig_sim::plant::Plant;
use support::Random;

#[expect(dead_code, reason = "the tests use the rest")]
#[path = "../tests/support/mod.rs"]
mod support;

/// Quality factors and couplings of the sensors.
const SENSORS: [(f64, f64); 5] =
    [(10.0, 0.1), (30.0, 0.02), (30.0, 0.1), (100.0, 0.02), (100.0, 0.1)];
const CAPACITANCE_F: f64 = 22e-9;
const WINDOW: Window = Window { min_hz: 112.0, max_hz: 168.0 };
const NOISE: NoisePrior = NoisePrior { at_ten_cycles: 0.005, degrees_of_freedom: 1000.0 };
/// The longest gap before a reading, and the largest error of its length, s.
const GAP_MAX_S: f64 = 3e-3;
const GAP_ERROR_S: f64 = 1e-3;
/// Rest after a survey, at the lowest frequency, s.
const REST_S: f64 = 3.0;
const WRONG_SIGMAS: f64 = 5.0;

fn main() {
    // Cargo adds a flag of its own.
    let numbers: Vec<f64> = std::env::args().filter_map(|text| text.parse().ok()).collect();
    let number = |place: usize, otherwise: f64| numbers.get(place).copied().unwrap_or(otherwise);
    let (runs, seed) = (number(0, 100.0), number(1, 1.0));
    let (second, target_hz) = (number(2, 0.0), number(3, 0.01));
    let (wrong, place) = (number(4, 0.0), number(5, 1.0));
    let (survey_s, phase_deg) = (number(6, 0.0) as u32, number(7, 0.0));
    let noise = numbers.get(8).copied();
    println!(
        "Q   k²   accepted  median  95 %   max s  bias   rms mHz  |z|<1.96  worst  >5  readings stays  \
         ms a step  99.9 %  max  refused"
    );
    for (q, coupling) in SENSORS {
        let mut tally = Tally::default();
        let mut random = Random::new((1e6 * seed + 1e4 * q + 1e3 * coupling) as u64);
        let mode = (second, place);
        let scene = Scene { q, coupling, mode, wrong, target_hz, survey_s, phase_deg, noise };
        for _ in 0..runs as u64 {
            tally.run(&scene, &mut random);
        }
        tally.print(q, coupling);
    }
}

/// What the sweeps of a line have in common.
struct Scene {
    q: f64,
    coupling: f64,
    /// Part of the capacitance and place of a second mode.
    mode: (f64, f64),
    wrong: f64,
    target_hz: f64,
    survey_s: u32,
    phase_deg: f64,
    /// Noise that the planner does not know.
    noise: Option<f64>,
}

/// A sensor, perhaps with a second mode, on an analyzer.
struct Bench {
    modes: Vec<Plant>,
    frequency_hz: f64,
    now_s: f64,
    /// By how much the clock of the readings is off, s.
    clock_error_s: f64,
    /// Standard deviation of each part of a reading of ten cycles.
    noise: f64,
    /// Share of wrong readings.
    wrong: f64,
    /// The impedance of the last reading, ohm.
    before: Complex64,
    phase: Complex64,
}

impl Bench {
    fn new(
        resonance_hz: f64,
        q: f64,
        coupling: f64,
        (second, place): (f64, f64),
        wrong: f64,
    ) -> Self {
        let circuit = |resonance_hz: f64, part: f64, dielectric_loss: f64| Circuit {
            series_resonance_hz: resonance_hz,
            q,
            capacitance_f: CAPACITANCE_F,
            capacitance_ratio: part * coupling / (1.0 - coupling),
            dielectric_loss,
        };
        let mut circuits = vec![circuit(resonance_hz, 1.0, 0.018)];
        if second > 0.0 {
            circuits.push(circuit(resonance_hz * (1.0 + place / q), second, 0.0));
        }
        let plant = |circuit| Plant::at_rest(circuit, WINDOW.min_hz).expect("these sensors ring");
        let modes = circuits.into_iter().map(plant).collect();
        let before = Complex64::new(0.0, -7e3);
        Self {
            modes,
            frequency_hz: 0.0,
            now_s: 0.0,
            clock_error_s: 0.0,
            noise: NOISE.at_ten_cycles,
            wrong,
            before,
            phase: Complex64::ONE,
        }
    }

    fn measure(&mut self, point: &SweepPoint, random: &mut Random) -> Reading {
        let hz = point.frequency_hz;
        if hz.to_bits() != self.frequency_hz.to_bits() {
            self.frequency_hz = hz;
            let turn = random.between(0.0, TAU);
            for mode in &mut self.modes {
                mode.set_frequency(hz);
                mode.turn_drive(turn);
            }
        }
        let gap_s = random.between(0.0, GAP_MAX_S);
        self.clock_error_s += random.between(-GAP_ERROR_S, GAP_ERROR_S);
        // One second later, so that no error of the clock leads to a time before the start.
        let started_s = 1.0 + self.now_s + gap_s + self.clock_error_s;
        let static_s = Complex64::new(0.0, TAU * hz * CAPACITANCE_F);
        let mut admittance = Complex64::new(0.0, 0.0);
        for (n, mode) in self.modes.iter_mut().enumerate() {
            mode.advance(gap_s + point.settle_s);
            // The static capacitance is that of the first alone.
            let less = if n == 0 { Complex64::new(0.0, 0.0) } else { static_s };
            admittance += 1.0 / mode.measure(point.cycles) - less;
        }
        let sigma = self.noise * (10.0 / f64::from(point.cycles)).sqrt();
        let integration_s = f64::from(point.cycles) / hz;
        self.now_s += gap_s + point.settle_s + integration_s;
        let mut ohm = (1.0 + sigma * random.normal()) / admittance * self.phase;
        if self.wrong > 0.0 && random.between(0.0, 1.0) < self.wrong {
            let way = random.below(support::WAYS);
            ohm = support::wrong(way, ohm, self.before, self.noise, random);
        }
        self.before = ohm;
        Reading {
            frequency_hz: hz,
            measured: support::measured(ohm),
            started: RigTime::ZERO + Duration::from_secs_f64(started_s),
            settle_s: point.settle_s,
            integration_s,
        }
    }
}

/// The time that this thread has had of the processor, s: other load hardly changes it.
fn processor_s() -> f64 {
    rig_system::clocks::of_thread().as_secs_f64()
}

/// What became of the sweeps.
#[derive(Default)]
struct Tally {
    times_s: Vec<f64>,
    errors_hz: Vec<f64>,
    sigmas: Vec<f64>,
    refused: BTreeMap<&'static str, usize>,
    readings: usize,
    stays: usize,
    steps_ms: Vec<f64>,
    /// Longest time of computing after a survey.
    survey_ms: f64,
    /// Error of the phase, rad, what is known of the bench, and the time after the survey, s.
    known: Vec<(f64, Known, f64)>,
}

impl Tally {
    fn run(&mut self, scene: &Scene, random: &mut Random) {
        let &Scene { q, coupling, mode, wrong, target_hz, survey_s, phase_deg, noise } = scene;
        let resonance_hz = random.between(130.0, 150.0);
        let mut bench = Bench::new(resonance_hz, q, coupling, mode, wrong);
        bench.phase = Complex64::cis(phase_deg.to_radians());
        bench.noise = noise.unwrap_or(NOISE.at_ten_cycles);
        let request = SweepRequest {
            window: WINDOW,
            method: SweepMethod::Adaptive,
            target_sigma_hz: target_hz,
            time_limit_s: 60.0,
            cycles: 10,
            settle_s: 0.5,
            level: DriveLevel { volt: 1.0 },
        };
        let mut prior =
            Prior { noise: noise.is_none().then_some(NOISE), ..Prior::anywhere(WINDOW, None) };
        if survey_s > 0 {
            prior.bench = self.survey(&mut bench, &request, &prior, scene, random);
            if prior.bench.is_none() {
                return;
            }
        }
        for mode in &mut bench.modes {
            mode.set_frequency(WINDOW.min_hz);
            mode.advance(REST_S);
        }
        let begun_s = bench.now_s;
        let mut planner = Planner::new(&request, Some(&prior));
        let mut last_hz = 0.0;
        let mut passed_s = 0.0;
        let verdict = loop {
            let began = processor_s();
            let next = planner.next();
            passed_s += processor_s() - began;
            let points = match next {
                Next::Measure(points) => points,
                Next::Finished(verdict) => {
                    self.steps_ms.push(1000.0 * passed_s);
                    break verdict;
                }
            };
            self.stays += usize::from(points[0].frequency_hz.to_bits() != f64::to_bits(last_hz));
            last_hz = points[0].frequency_hz;
            let readings: Vec<Reading> =
                points.iter().map(|point| bench.measure(point, random)).collect();
            self.readings += readings.len();
            let began = processor_s();
            planner.add(&readings);
            passed_s += processor_s() - began;
            self.steps_ms.push(1000.0 * std::mem::take(&mut passed_s));
        };
        match verdict {
            FitOutcome::Accepted(found) => {
                let error_hz = found.resonance_hz - resonance_hz;
                self.times_s.push(bench.now_s - begun_s);
                self.errors_hz.push(error_hz);
                self.sigmas.push((error_hz / found.sigma_hz).abs());
            }
            FitOutcome::Refused(refusal) => self.refuse(&refusal),
        }
    }

    /// What a survey says of the bench; `None` if it is refused.
    fn survey(
        &mut self,
        bench: &mut Bench,
        request: &SweepRequest,
        prior: &Prior,
        scene: &Scene,
        random: &mut Random,
    ) -> Option<Known> {
        let method = SweepMethod::Survey { seconds: scene.survey_s };
        let mut planner = Planner::new(&SweepRequest { method, ..*request }, Some(prior));
        let verdict = loop {
            let began = processor_s();
            let next = planner.next();
            self.survey_ms = self.survey_ms.max(1e3 * (processor_s() - began));
            match next {
                Next::Measure(points) => {
                    let readings: Vec<Reading> =
                        points.iter().map(|point| bench.measure(point, random)).collect();
                    planner.add(&readings);
                }
                Next::Finished(verdict) => break verdict,
            }
        };
        if let FitOutcome::Refused(refusal) = verdict {
            self.refuse(&refusal);
            return None;
        }
        let known = planner.bench()?;
        self.known.push((known.phase_rad - scene.phase_deg.to_radians(), known, bench.now_s));
        Some(known)
    }

    fn refuse(&mut self, refusal: &Refusal) {
        *self.refused.entry(refusal.reason.code()).or_default() += 1;
    }

    fn print(&mut self, q: f64, coupling: f64) {
        let accepted = self.times_s.len();
        let all = (accepted + self.refused.values().sum::<usize>()).max(1) as f64;
        let mean = |values: &mut dyn Iterator<Item = f64>, count: usize| {
            values.sum::<f64>() / count.max(1) as f64
        };
        self.times_s.sort_by(f64::total_cmp);
        let time_s = |part: f64| {
            let place = (part * accepted as f64) as usize;
            self.times_s.get(place.min(accepted.max(1) - 1)).copied().unwrap_or(f64::NAN)
        };
        let bias = 1e3 * mean(&mut self.errors_hz.iter().copied(), accepted);
        let rms = 1e3 * mean(&mut self.errors_hz.iter().map(|e| e * e), accepted).sqrt();
        let share = |limit: f64| self.sigmas.iter().filter(|z| **z < limit).count();
        let worst = self.sigmas.iter().copied().fold(0.0, f64::max);
        let steps = self.steps_ms.len();
        let step_ms = mean(&mut self.steps_ms.iter().copied(), steps);
        self.steps_ms.sort_by(f64::total_cmp);
        let step_part_ms = |part: f64| {
            let place = (part * steps as f64) as usize;
            self.steps_ms.get(place.min(steps.max(1) - 1)).copied().unwrap_or(f64::NAN)
        };
        let (most_ms, longest_ms) = (step_part_ms(0.999), step_part_ms(1.0));
        println!(
            "{q:3} {coupling:4} {accepted:5}/{all} {:7.3} {:6.3} {:6.3} {bias:6.1} {rms:6.1} {:10.3} \
             {worst:8.1} {:3} {:8.1} {:5.1} {step_ms:8.2} {most_ms:7.2} {longest_ms:7.2}  {:?}",
            time_s(0.5),
            time_s(0.95),
            time_s(1.0),
            share(1.96) as f64 / accepted.max(1) as f64,
            accepted - share(WRONG_SIGMAS),
            self.readings as f64 / all,
            self.stays as f64 / all,
            self.refused
        );
        if !self.known.is_empty() {
            let all = self.known.len();
            let square = mean(&mut self.known.iter().map(|(off, ..)| off * off), all);
            let worst =
                self.known.iter().map(|(off, known, _)| (off / known.phase_sigma_rad).abs());
            println!(
                "         survey: phase off by {:.1e} rad ± {:.1e}, at most {:.1} sigma; second mode ± \
                 {:.1e}; {:.1} ms, {:.1} s",
                square.sqrt(),
                mean(&mut self.known.iter().map(|(_, known, _)| known.phase_sigma_rad), all),
                worst.fold(0.0, f64::max),
                mean(&mut self.known.iter().map(|(_, known, _)| known.mode_sigma), all),
                self.survey_ms,
                mean(&mut self.known.iter().map(|(.., seconds)| *seconds), all),
            );
        }
    }
}
