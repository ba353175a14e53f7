//! The surface from the onset of a contact, by trying: for each place and each law of the contact, the current of
//! the sensor is followed in small steps of time.

use std::{f64::consts::TAU, ops::RangeInclusive};

use num_complex::Complex64;

use super::parts;
use crate::record::{Descended, Reading};

/// Exponents and loss factor of contacts, and the strengths at 0.05 mm, Hz: the first, the ratio to the next, and
/// their number. At other places than the stated one, this many strengths each way from the best one there.
const EXPONENTS: [f64; 3] = [0.38, 0.48, 0.58];
const LOSS: f64 = 0.1;
const DEPTH_MM: f64 = 0.05;
const STRENGTHS: (f64, f64, i32) = (0.1, 1.15, 52);
const NEAR_STRENGTHS: i32 = 6;
/// Places that are tried around the stated one, mm: each way, and in between.
const PLACES: (i32, f64) = (10, 0.005);
const NEAR_PLACES: (i32, f64) = (3, 0.0015);
/// Steps of time, s.
const STEP_S: f64 = 0.7e-3;
/// The readings before the stated surface that are compared.
const CLEAR_READINGS: usize = 10;
/// The weight of a reading falls with its change by this part, because the model is no truer.
const MODEL_PART: f64 = 0.04;
const NOISE: f64 = 0.012;

/// The free sensor.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Free {
    pub(crate) resonance_hz: f64,
    pub(crate) quality: f64,
    pub(crate) capacitance_f: f64,
    pub(crate) ratio: f64,
    pub(crate) loss: f64,
}

/// The way of the probe: a line down to its rest.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Way {
    at_s: f64,
    at_mm: f64,
    speed: f64,
    rest_mm: f64,
}

impl Way {
    /// The median line of the speed of the descent through its positions; `None` if there are fewer than three.
    pub(crate) fn of(descended: &Descended) -> Option<Self> {
        let (speed, rest_mm) = (descended.speed_mm_per_s, descended.read_back_mm);
        let first = descended.way.first()?;
        // The first may be of a stage that speeds up, and the last of one that slows down.
        let even =
            descended.way.iter().skip(1).filter(|one| rest_mm + 0.02 * speed < one.position_mm);
        let mut starts: Vec<f64> =
            even.map(|one| one.position_mm + speed * (one.at_s - first.at_s)).collect();
        starts.sort_by(f64::total_cmp);
        let at_mm = *starts.get(starts.len() / 2)?;
        (starts.len() > 1).then_some(Self { at_s: first.at_s, at_mm, speed, rest_mm })
    }

    fn position_mm(&self, at_s: f64) -> f64 {
        (self.at_mm - self.speed * (at_s - self.at_s)).max(self.rest_mm)
    }

    /// When the probe passes a position.
    fn passes_s(&self, at_mm: f64) -> f64 {
        self.at_s + (self.at_mm - at_mm) / self.speed
    }
}

/// The readings near the stated surface: begin and end, s, and admittance over that of the clear probe.
type Window = (f64, f64, Complex64);

/// The place of the surface that explains the readings best, mm.
pub(super) fn surface_mm(
    free: &Free,
    readings: &[&Reading],
    [clear_re, clear_im]: [f64; 2],
    way: &Way,
    stated_mm: f64,
) -> f64 {
    let clear = Complex64::new(clear_re, clear_im);
    let all: Vec<Window> = readings
        .iter()
        .filter_map(|reading| {
            let [re, im] = parts(reading)?;
            let admittance = clear / Complex64::new(re, im);
            Some((reading.begin_s(), reading.end_s(), admittance))
        })
        .collect();
    let before = all.iter().take_while(|one| one.1 < way.passes_s(stated_mm)).count();
    let windows = &all[before.saturating_sub(CLEAR_READINGS)..];
    let drive_hz = readings.first().map_or(free.resonance_hz, |reading| reading.frequency_hz);
    let driven = Driven::new(free, drive_hz);
    let least = |surface_mm: f64, strengths: RangeInclusive<i32>, most: f64| {
        let passed = passed(windows, way, surface_mm);
        least_cost(strengths, most, |strength_hz, exponent, most| {
            driven.cost(&passed, strength_hz, exponent, most)
        })
    };
    let (strength, _) = least(stated_mm, 0..=STRENGTHS.2, f64::INFINITY);
    let near = strength - NEAR_STRENGTHS..=strength + NEAR_STRENGTHS;
    let best_near = |around_mm: f64, (places, step_mm): (i32, f64)| {
        let (mut best_mm, mut best) = (around_mm, f64::INFINITY);
        for index in -places..=places {
            let place_mm = around_mm + f64::from(index) * step_mm;
            let (_, cost) = least(place_mm, near.clone(), best);
            if cost < best {
                (best_mm, best) = (place_mm, cost);
            }
        }
        best_mm
    };
    best_near(best_near(stated_mm, PLACES), NEAR_PLACES)
}

/// The strength, by its number, and the least misfit of all contacts of these strengths, if that is less than `most`.
/// `cost` takes a strength, Hz, the number of an exponent, and the misfit that does not count any more.
fn least_cost(
    strengths: RangeInclusive<i32>,
    most: f64,
    cost: impl Fn(f64, usize, f64) -> f64,
) -> (i32, f64) {
    let (first_hz, ratio, _) = STRENGTHS;
    let mut least = (0, most);
    for index in strengths {
        for exponent in 0..EXPONENTS.len() {
            let found = cost(first_hz * ratio.powi(index), exponent, least.1);
            if found < least.1 {
                least = (index, found);
            }
        }
    }
    least
}

/// A reading of a probe that passes a surface.
#[derive(Debug)]
struct Passed {
    /// How long the probe was clear in it, and its length, s.
    clear_s: f64,
    length_s: f64,
    /// The time in contact since the reading before, and in this one.
    steps: Vec<Step>,
    measured: Complex64,
    /// Of its relative error.
    variance: f64,
}

/// A step of time.
#[derive(Debug)]
struct Step {
    long_s: f64,
    is_read: bool,
    /// The depth in its middle over that of the strengths, to the power of each exponent; `None` while the probe is
    /// clear.
    powers: Option<[f64; EXPONENTS.len()]>,
}

/// The readings of a probe that passes this surface: what contacts of all strengths have in common.
fn passed(windows: &[Window], way: &Way, surface_mm: f64) -> Vec<Passed> {
    let mut now_s = way.passes_s(surface_mm);
    let read = |&(begin_s, end_s, measured): &Window| {
        let clear_s = (now_s.min(end_s) - begin_s).max(0.0);
        let mut steps = Vec::new();
        while now_s < end_s {
            // Not beyond the next edge of a window.
            let edge_s = if now_s < begin_s { begin_s } else { end_s };
            let long_s = STEP_S.min(edge_s - now_s).max(1e-9);
            let depth_mm = surface_mm - way.position_mm(now_s + 0.5 * long_s);
            let power = |exponent| (depth_mm / DEPTH_MM).powf(exponent);
            let powers = if depth_mm <= 0.0 { None } else { Some(EXPONENTS.map(power)) };
            steps.push(Step { long_s, is_read: begin_s <= now_s, powers });
            now_s += long_s;
        }
        let model = MODEL_PART * (1.0 - 1.0 / measured).norm().min(1.0);
        let variance = NOISE * NOISE + model * model;
        Passed { clear_s, length_s: end_s - begin_s, steps, measured, variance }
    };
    windows.iter().map(read).collect()
}

/// The free sensor under its drive.
#[derive(Debug, Clone, Copy)]
struct Driven {
    /// Of the free resonance, 1/s.
    natural: f64,
    /// How the current of the clear probe goes on, 1/s.
    detuned: Complex64,
    /// V/2L of the series branch, whose capacitance is a part of the static one.
    force: f64,
    static_part: Complex64,
    free_current: Complex64,
}

impl Driven {
    fn new(free: &Free, drive_hz: f64) -> Self {
        let omega = TAU * drive_hz;
        let natural = TAU * free.resonance_hz;
        let static_part = free.capacitance_f * Complex64::new(free.loss, 1.0) * omega;
        let force = 0.5 * natural * natural * free.capacitance_f * free.ratio;
        let damping = natural / (2.0 * free.quality);
        let detuned = Complex64::new(-damping, natural - omega);
        Self { natural, detuned, force, static_part, free_current: -force / detuned }
    }

    /// The misfit of a contact of this strength, Hz, and of the exponent of this number, or infinity as soon as it is
    /// more than `most`.
    fn cost(&self, passed: &[Passed], strength_hz: f64, exponent: usize, most: f64) -> f64 {
        let &Self { natural, detuned, force, static_part, free_current } = self;
        let rate = |step: &Step| {
            let Some(powers) = &step.powers else { return detuned };
            let rise = TAU * strength_hz * powers[exponent];
            // The resonance grows with the root of the stiffness.
            let risen = natural * ((1.0 + 2.0 * rise / natural).sqrt() - 1.0);
            detuned + risen * Complex64::new(-LOSS, 1.0)
        };
        let clear = static_part + free_current;
        let mut current = free_current;
        let mut sum = 0.0;
        for Passed { clear_s, length_s, steps, measured, variance } in passed {
            let mut mean = free_current * *clear_s;
            for step in steps {
                let rate = rate(step);
                let settled = -force / rate;
                let next = settled + (current - settled) * (rate * step.long_s).exp();
                if step.is_read {
                    mean += 0.5 * (current + next) * step.long_s;
                }
                current = next;
            }
            let expected = (static_part + mean / *length_s) / clear;
            sum += (expected / measured - 1.0).norm_sqr() / variance;
            if most < sum {
                return f64::INFINITY;
            }
        }
        sum
    }
}
