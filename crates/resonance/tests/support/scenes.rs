//! Sweeps as they go right and wrong, from models that share nothing with the fit: four elements,
//! the exact motion in time, a softening spring, pick-up, rounding.

use std::{
    f64::consts::{PI, TAU},
    time::Duration,
};

use num_complex::Complex64;
use rig_model::{Reading, RigTime};
use rig_resonance::{FitOptions, Timing};
use rig_sim::plant::Plant;

use crate::support::{Random, WAYS, impedance, measured, reading, wrong};

/// What is special about a sweep. Strengths are relative.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Kind {
    Nominal,
    /// Seven to twenty readings.
    Sparse,
    /// The resonance this many half-widths from the middle of the window.
    Place(f64),
    NoResonance,
    /// Strength and distance in linewidths.
    SecondMode(f64, f64),
    /// Linewidths over one sweep.
    Drift(f64),
    /// The same over a sweep up and down again.
    DriftBothWays(f64),
    /// Share of readings that are anything: scaled, mirrored, stuck, alone and in bursts.
    Outliers(f64),
    /// Time constants waited for at each point.
    Unsettled(f64),
    /// Change of stiffness at full amplitude times Q; bistable below −1.54.
    Softening(f64),
    /// Ohms in series.
    Stray(f64),
    /// Exponent by which the capacitance falls with the frequency, with the loss that belongs to it.
    ConstantPhase(f64),
    /// Relative change of the static capacitance during the sweep.
    CapacitanceDrift(f64),
    /// Phase error of the analyzer, rad.
    Phase(f64),
    /// Part of the current, and the frequency of the mains.
    Mains(f64, f64),
    Rounded(Rounding),
}

/// How readings are written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Rounding {
    /// As computed.
    Full,
    /// Significant digits of resistance and reactance.
    Digits(usize),
    /// Step of resistance and reactance, ohm.
    Ohm(f64),
    /// Significant digits of the magnitude and step of the phase in degrees.
    Polar(usize, f64),
}

/// A sensor and how it is swept.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scene {
    pub(crate) resonance_hz: f64,
    pub(crate) q: f64,
    pub(crate) capacitance_ratio: f64,
    pub(crate) loss_tangent: f64,
    pub(crate) noise: f64,
    pub(crate) points: usize,
    pub(crate) window: (f64, f64),
    pub(crate) falls: bool,
    /// Whether the times of the readings are known.
    pub(crate) is_timed: bool,
}

const PARALLEL_FARAD: f64 = 27e-9;
const CYCLES: u32 = 10;
/// A longer integration, which hears less of the mains on either side.
const LONG_CYCLES: f64 = 60.0;

impl Scene {
    /// Any sensor in any usual sweep.
    pub(crate) fn random(random: &mut Random) -> Self {
        let middle = random.between(120.0, 220.0);
        let half = middle * random.between(0.12, 0.25);
        let k_eff_squared = random.log_between(0.015, 0.12);
        Self {
            resonance_hz: middle + half * random.between(-0.8, 0.8),
            q: random.log_between(6.0, 150.0),
            capacitance_ratio: k_eff_squared / (1.0 - k_eff_squared),
            loss_tangent: random.between(0.0, 0.03),
            noise: random.log_between(0.0005, 0.02),
            points: random.count(51.0, 202.0),
            window: (middle - half, middle + half),
            falls: random.between(0.0, 1.0) < 0.5,
            is_timed: random.between(0.0, 1.0) < 0.5,
        }
    }

    pub(crate) fn linewidth_hz(&self) -> f64 {
        self.resonance_hz / self.q
    }

    pub(crate) fn options(&self) -> FitOptions {
        let timing = if self.is_timed { Timing::Waited } else { Timing::Unknown };
        FitOptions { timing, ..FitOptions::default() }
    }

    /// The sweep, and between which frequencies the resonance was; `None` where there was none.
    pub(crate) fn sweep(
        mut self,
        kind: Kind,
        random: &mut Random,
    ) -> (Vec<Reading>, Option<(f64, f64)>) {
        let (low, high) = self.window;
        match kind {
            Kind::Sparse => self.points = random.count(7.0, 21.0),
            Kind::Place(halves) => {
                self.resonance_hz = 0.5 * (low + high) + 0.5 * (high - low) * halves;
            }
            Kind::Rounded(_) if random.between(0.0, 1.0) < 0.5 => self.noise = 0.0,
            _ => {}
        }
        let mut frequencies: Vec<f64> = (0..self.points)
            .map(|i| low + (high - low) * i as f64 / (self.points - 1) as f64)
            .collect();
        if self.falls {
            frequencies.reverse();
        }
        if let Kind::DriftBothWays(_) = kind {
            let back: Vec<f64> = frequencies.iter().rev().copied().collect();
            frequencies.extend(back);
        }
        let ideal = self.ideal(kind, &frequencies, random);
        let wait_s = self.wait_s(kind);
        let mut now_s = 1.0;
        let mut readings: Vec<Reading> = frequencies
            .iter()
            .zip(ideal)
            .map(|(&frequency_hz, impedance)| {
                let noisy = impedance * (1.0 + self.noise * random.normal());
                let mut reading = reading(frequency_hz, round(kind, noisy));
                reading.started = RigTime::ZERO + Duration::from_secs_f64(now_s);
                reading.settle_s = wait_s;
                if let Kind::Mains(..) = kind {
                    reading.integration_s = LONG_CYCLES / frequency_hz;
                }
                now_s += wait_s + reading.integration_s;
                if !self.is_timed {
                    (reading.started, reading.settle_s, reading.integration_s) =
                        (RigTime::ZERO, 0.0, 0.0);
                }
                reading
            })
            .collect();
        if let Kind::Outliers(share) = kind {
            spoil(&mut readings, share, self.noise, random);
        }
        let moved = match kind {
            Kind::Drift(widths) => 0.5 * widths.abs() * self.linewidth_hz(),
            _ => 0.0,
        };
        let truth = (self.resonance_hz - moved, self.resonance_hz + moved);
        (readings, (kind != Kind::NoResonance).then_some(truth))
    }

    fn wait_s(&self, kind: Kind) -> f64 {
        let time_constants = if let Kind::Unsettled(some) = kind { some } else { 12.0 };
        time_constants * self.q / (PI * self.resonance_hz)
    }

    /// The readings without noise.
    fn ideal(&self, kind: Kind, frequencies: &[f64], random: &mut Random) -> Vec<Complex64> {
        let steady =
            |f: f64, resonance_hz: f64| 1.0 / (self.fixed(f) + self.branch(f, resonance_hz, 1.0));
        let count = frequencies.len() as f64;
        match kind {
            Kind::NoResonance => frequencies.iter().map(|&f| 1.0 / self.fixed(f)).collect(),
            Kind::SecondMode(strength, widths) => {
                let second_hz = self.resonance_hz + widths * self.linewidth_hz();
                let second = Self { q: self.q * random.log_between(0.5, 2.0), ..*self };
                let both = |f| {
                    self.branch(f, self.resonance_hz, 1.0) + second.branch(f, second_hz, strength)
                };
                frequencies.iter().map(|&f| 1.0 / (self.fixed(f) + both(f))).collect()
            }
            Kind::Drift(widths) | Kind::DriftBothWays(widths) => frequencies
                .iter()
                .enumerate()
                .map(|(i, &f)| {
                    let part = i as f64 / (count - 1.0) - 0.5;
                    steady(f, self.resonance_hz + widths * self.linewidth_hz() * part)
                })
                .collect(),
            Kind::Unsettled(_) => self.in_time(self.wait_s(kind), frequencies),
            Kind::Softening(strength) => self.softening(strength, frequencies),
            Kind::Stray(ohm) => {
                frequencies.iter().map(|&f| ohm + steady(f, self.resonance_hz)).collect()
            }
            Kind::ConstantPhase(exponent) => frequencies
                .iter()
                .map(|&f| {
                    let turned = Complex64::new(0.0, f / self.resonance_hz).powf(-exponent);
                    1.0 / (self.fixed(f) * turned + self.branch(f, self.resonance_hz, 1.0))
                })
                .collect(),
            Kind::CapacitanceDrift(change) => frequencies
                .iter()
                .enumerate()
                .map(|(i, &f)| {
                    let part = 1.0 + change * (i as f64 / (count - 1.0) - 0.5);
                    1.0 / (part * self.fixed(f) + self.branch(f, self.resonance_hz, 1.0))
                })
                .collect(),
            Kind::Phase(rad) => frequencies
                .iter()
                .map(|&f| steady(f, self.resonance_hz) * Complex64::cis(rad))
                .collect(),
            Kind::Mains(part, mains_hz) => frequencies
                .iter()
                .map(|&f| {
                    let picked_up: Complex64 = (1..6)
                        .map(|multiple| {
                            // A lock-in over whole cycles at f hears what beats slowly against it.
                            let turns = LONG_CYCLES * (f64::from(multiple) * mains_hz / f - 1.0);
                            let response = if turns.abs() < 1e-9 {
                                1.0
                            } else {
                                (PI * turns).sin() / (PI * turns)
                            };
                            Complex64::from_polar(part * response, random.between(0.0, TAU))
                        })
                        .sum();
                    steady(f, self.resonance_hz) / (1.0 + picked_up)
                })
                .collect(),
            _ => frequencies.iter().map(|&f| steady(f, self.resonance_hz)).collect(),
        }
    }

    fn fixed(&self, f: f64) -> Complex64 {
        TAU * f * PARALLEL_FARAD * Complex64::new(self.loss_tangent, 1.0)
    }

    /// Resistance, inductance and capacitance in series.
    fn branch(&self, f: f64, resonance_hz: f64, strength: f64) -> Complex64 {
        let farad = strength * self.capacitance_ratio * PARALLEL_FARAD;
        let henry = 1.0 / ((TAU * resonance_hz).powi(2) * farad);
        let ohm = TAU * resonance_hz * henry / self.q;
        1.0 / Complex64::new(ohm, TAU * f * henry - 1.0 / (TAU * f * farad))
    }

    fn in_time(&self, wait_s: f64, frequencies: &[f64]) -> Vec<Complex64> {
        let circuit = rig_contact::Circuit {
            series_resonance_hz: self.resonance_hz,
            q: self.q,
            capacitance_f: PARALLEL_FARAD,
            capacitance_ratio: self.capacitance_ratio,
            dielectric_loss: self.loss_tangent,
        };
        let mut plant = Plant::at_rest(circuit, frequencies[0]).expect("its Q is above 6");
        frequencies
            .iter()
            .map(|&f| {
                plant.set_frequency(f);
                plant.advance(wait_s);
                plant.measure(CYCLES)
            })
            .collect()
    }

    /// Harmonic balance: the stiffness changes with the square of the amplitude, and the motion
    /// follows its branch until that ends.
    fn softening(&self, strength: f64, frequencies: &[f64]) -> Vec<Complex64> {
        const STEPS: i32 = 500;
        let mut squared = 0.0;
        frequencies
            .iter()
            .map(|&f| {
                let u = f / self.resonance_hz;
                let divisor =
                    |a: f64| Complex64::new(1.0 - u * u + strength / self.q * a, u / self.q);
                let excess = |a: f64| a * (self.q * divisor(a)).norm_sqr() - 1.0;
                let roots = (0..STEPS).filter_map(|i| {
                    let (mut low, mut high) = (
                        2.0 * f64::from(i) / f64::from(STEPS),
                        2.0 * f64::from(i + 1) / f64::from(STEPS),
                    );
                    // Only where the excess rises is the motion stable.
                    if !(excess(low) <= 0.0 && excess(high) > 0.0) {
                        return None;
                    }
                    for _ in 0..40 {
                        let middle = 0.5 * (low + high);
                        if excess(middle) > 0.0 { high = middle } else { low = middle }
                    }
                    Some(low)
                });
                let before = squared;
                squared = roots
                    .min_by(|a, b| (a - before).abs().total_cmp(&(b - before).abs()))
                    .expect("far above resonance it is at rest");
                let motional = self.capacitance_ratio * PARALLEL_FARAD / divisor(squared);
                1.0 / (self.fixed(f) + Complex64::new(0.0, TAU * f) * motional)
            })
            .collect()
    }
}

/// Makes this share of the readings outliers, at least one.
fn spoil(readings: &mut [Reading], share: f64, noise: f64, random: &mut Random) {
    let count = readings.len();
    let mut left = (1..count).take_while(|&n| (n as f64) < share * count as f64).count().max(1);
    let mut is_spoilt = vec![false; count];
    while left > 0 {
        let first = random.below(count);
        // Most come alone, some in pairs and in bursts.
        let length = [1, 1, 1, 1, 2, 4][random.below(6)].min(left);
        let way = random.below(WAYS);
        for i in first..(first + length).min(count) {
            if is_spoilt[i] {
                continue;
            }
            let before = impedance(&readings[first.saturating_sub(1)]);
            let z = impedance(&readings[i]);
            readings[i].measured = measured(wrong(way, z, before, noise, random));
            is_spoilt[i] = true;
            left -= 1;
        }
    }
}

fn round(kind: Kind, impedance: Complex64) -> Complex64 {
    let to = |x: f64, step: f64| (x / step).round() * step;
    let digits =
        |x: f64, count: usize| format!("{x:.*e}", count - 1).parse::<f64>().expect("a number");
    match kind {
        Kind::Rounded(Rounding::Digits(count)) => {
            Complex64::new(digits(impedance.re, count), digits(impedance.im, count))
        }
        Kind::Rounded(Rounding::Ohm(step)) => {
            Complex64::new(to(impedance.re, step), to(impedance.im, step))
        }
        Kind::Rounded(Rounding::Polar(count, degrees)) => Complex64::from_polar(
            digits(impedance.norm(), count),
            to(impedance.arg().to_degrees(), degrees).to_radians(),
        ),
        _ => impedance,
    }
}
