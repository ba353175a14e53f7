//! Is any resonance silently wrong, and is the uncertainty what it says?
//!
//! `cargo bench -p rig-resonance --bench campaign -- [SCENES [SEED [KIND]]]` fits this number of
//! random scenes of each kind, nominal and violated, and prints how many were accepted, how far from
//! the truth in standard deviations, and why the others were refused. With a kind, only that one,
//! and every scene in which it was wrong.

#![expect(clippy::print_stdout, reason = "printing is what it is for")]

use std::{collections::BTreeMap, fmt, num::NonZero, thread};

use rig_resonance::{FitOutcome, fit};
use scenes::{Kind, Rounding, Scene};
use support::Random;

#[path = "../tests/support/scenes.rs"]
mod scenes;
#[expect(dead_code, reason = "the tests use the rest")]
#[path = "../tests/support/mod.rs"]
mod support;

/// An accepted value further than this from the truth, in its own standard deviations, is wrong.
const WRONG_SIGMAS: f64 = 5.0;

type Draw = fn(&mut Random) -> Kind;

const KINDS: [(&str, Draw); 23] = [
    ("nominal", |_| Kind::Nominal),
    ("sparse", |_| Kind::Sparse),
    ("edge-inside", |r| Kind::Place(r.sign() * r.between(0.8, 1.0))),
    ("edge-outside", |r| Kind::Place(r.sign() * r.between(1.0, 1.2))),
    ("far-outside", |r| Kind::Place(r.sign() * r.between(1.2, 2.0))),
    ("no-resonance", |_| Kind::NoResonance),
    ("mode-near", |r| Kind::SecondMode(r.log_between(0.01, 0.5), r.sign() * r.between(0.5, 2.0))),
    ("mode-half", |r| Kind::SecondMode(0.05, r.sign() * 0.5)),
    ("mode-far", |r| Kind::SecondMode(r.log_between(0.01, 0.5), r.sign() * r.between(2.0, 8.0))),
    ("drift", |r| Kind::Drift(r.sign() * r.log_between(0.01, 2.0))),
    ("drift-both-ways", |r| Kind::DriftBothWays(r.sign() * r.log_between(0.01, 2.0))),
    ("outliers-few", |r| Kind::Outliers(r.between(0.0, 0.05))),
    ("outliers-more", |r| Kind::Outliers(r.between(0.05, 0.1))),
    ("outliers-many", |r| Kind::Outliers(r.between(0.1, 0.3))),
    ("unsettled", |r| Kind::Unsettled(r.between(0.0, 4.0))),
    ("softening", |r| Kind::Softening(-r.log_between(0.03, 1.5))),
    ("bistable", |r| Kind::Softening(-r.log_between(1.55, 5.0))),
    ("stray", |r| Kind::Stray(r.log_between(10.0, 3000.0))),
    ("constant-phase", |r| Kind::ConstantPhase(r.log_between(0.001, 0.1))),
    ("capacitance-drift", |r| Kind::CapacitanceDrift(r.sign() * r.log_between(0.001, 0.1))),
    ("analyzer-phase", |r| Kind::Phase(r.sign() * r.log_between(0.001, 0.05))),
    ("mains", |r| Kind::Mains(r.log_between(0.001, 0.3), 55.0 + 5.0 * r.sign())),
    ("rounded", |r| {
        let (way, digits) = (r.count(1.0, 5.0), r.count(3.0, 7.0));
        let finer = 10_f64.powf(3.0 - digits as f64);
        Kind::Rounded(match way {
            1 => Rounding::Full,
            2 => Rounding::Digits(digits),
            3 => Rounding::Ohm(100.0 * finer),
            _ => Rounding::Polar(digits - 1, finer),
        })
    }),
];

fn main() {
    // Cargo adds its own `--bench`.
    let arguments: Vec<String> =
        std::env::args().skip(1).filter(|argument| !argument.starts_with("--")).collect();
    let number = |place: usize| arguments.get(place).and_then(|text| text.parse::<usize>().ok());
    let scenes = number(0).unwrap_or(6000);
    let seed = number(1).unwrap_or(1);
    let only = arguments.get(2);
    println!("kind                scenes accepted |z|>2 in95% wrong worst refused");
    let (mut all, mut wrong) = (0, 0);
    for (index, (name, draw)) in KINDS.iter().enumerate() {
        if only.is_none_or(|only| only == name) {
            let tally = run(*draw, scenes, seed * 1000 + index, only.is_some());
            println!("{name:17} {tally}");
            all += tally.scenes;
            wrong += tally.wrong;
        }
    }
    println!("silently wrong: {wrong} of {all}");
}

/// Every scene of a kind, on all cores.
fn run(draw: Draw, scenes: usize, seed: usize, show: bool) -> Tally {
    let workers = thread::available_parallelism().map_or(1, NonZero::get);
    let work = |worker: usize| {
        let mut tally = Tally::default();
        for scene in (worker..scenes).step_by(workers) {
            let mut random = Random::new((seed * 1_000_000_007 + scene) as u64);
            let kind = draw(&mut random);
            let sensor = Scene::random(&mut random);
            let (readings, truth) = sensor.sweep(kind, &mut random);
            let verdict = fit(&readings, &sensor.options());
            let sigmas = tally.count(&verdict, truth);
            if show && sigmas > WRONG_SIGMAS {
                println!("{sigmas:.1} {kind:?} {sensor:?} {verdict:?}");
            }
        }
        tally
    };
    thread::scope(|scope| {
        let work = &work;
        let running: Vec<_> =
            (0..workers).map(|worker| scope.spawn(move || work(worker))).collect();
        let tallies = running.into_iter().map(|worker| worker.join().expect("it does not panic"));
        tallies.fold(Tally::default(), Tally::with)
    })
}

#[derive(Debug, Default)]
struct Tally {
    scenes: usize,
    accepted: usize,
    beyond_two: usize,
    in_interval: usize,
    wrong: usize,
    worst: f64,
    refused: BTreeMap<String, usize>,
}

impl Tally {
    /// Counts a verdict; gives how many standard deviations it is off, 0 where it was refused.
    fn count(&mut self, verdict: &FitOutcome, truth: Option<(f64, f64)>) -> f64 {
        self.scenes += 1;
        match verdict {
            FitOutcome::Accepted(found) => {
                let sigmas = truth.map_or(f64::INFINITY, |(low, high)| {
                    let nearest_hz = found.resonance_hz.clamp(low, high);
                    (found.resonance_hz - nearest_hz).abs() / found.sigma_hz
                });
                self.accepted += 1;
                self.beyond_two += usize::from(sigmas > 2.0);
                self.in_interval += usize::from(sigmas < 1.96);
                self.wrong += usize::from(sigmas > WRONG_SIGMAS);
                self.worst = self.worst.max(sigmas);
                sigmas
            }
            FitOutcome::Refused(refusal) => {
                let name = format!("{:?}", refusal.reason);
                let name = name.split([' ', '{']).next().unwrap_or_default();
                *self.refused.entry(name.to_owned()).or_default() += 1;
                0.0
            }
        }
    }

    fn with(mut self, other: Self) -> Self {
        self.scenes += other.scenes;
        self.accepted += other.accepted;
        self.beyond_two += other.beyond_two;
        self.in_interval += other.in_interval;
        self.wrong += other.wrong;
        self.worst = self.worst.max(other.worst);
        for (reason, count) in other.refused {
            *self.refused.entry(reason).or_default() += count;
        }
        self
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { scenes, accepted, wrong, worst, refused, .. } = self;
        let percent = |count: usize| 100.0 * count as f64 / (*accepted).max(1) as f64;
        let (beyond, inside) = (percent(self.beyond_two), percent(self.in_interval));
        write!(
            f,
            "{scenes:8} {accepted:8} {beyond:5.2} {inside:5.1} {wrong:5} {worst:5.1} {refused:?}"
        )
    }
}
