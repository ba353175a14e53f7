//! The surface by least squares: from several starts, held against the readings and against every rival.

use std::f64::consts::SQRT_2;

use num_complex::Complex64;
use rig_model::{PointResult, Reading};

use super::{
    EvenWay, Latency, Onset,
    model::{ContactModel, FreeSensor},
    watch::REFERENCES,
};
use crate::{
    Resonance,
    numeric::{
        dense::Cholesky,
        descent::{Descent, Normal, Step},
    },
};

/// Surface, strength, exponent, loss, latency, and two parts of the impedance of the clear probe.
const N: usize = 7;

/// Readings before the first that seems to touch that are fitted: they hold the impedance of the clear probe.
const CLEAR_MAX: usize = 24;

/// Readings that touch, at the least: with fewer, strength and surface are one.
const CONTACTS_MIN: usize = 2;

/// A reading touches if it deviates by this many standard deviations. This only counts readings.
const CONTACT_SIGMAS: f64 = 5.0;

/// How far above the first contact the surface is looked for, mm: the time constant of the sensor delays the
/// contact by a tenth of a millimetre at 1 mm/s at most.
const ABOVE_MM: [f64; 9] = [0.002, 0.006, 0.012, 0.02, 0.03, 0.045, 0.06, 0.09, 0.13];

/// Strengths of contact that are tried, Hz at 0.05 mm: from a tenth of the softest sample of the shipped bench to
/// three times the stiffest.
const STRENGTHS_HZ: [f64; 14] =
    [0.15, 0.4, 0.8, 1.5, 2.5, 4.0, 6.0, 9.0, 13.0, 18.0, 25.0, 35.0, 50.0, 90.0];

/// The best of them from which the fit starts. The vibration beats with the drive, so that there are several
/// minima.
const STARTS: usize = 6;

/// The model is wrong by this part of the change that a contact makes, as a standard deviation: coupling and
/// quality change with the depth too.
const MODEL_PART: f64 = 0.04;

/// What is known of a contact before: logarithm of the strength in Hz, exponent, and loss factor, with their
/// standard deviations. A ball in a half space has an exponent of a half; the deflection of the sensor lowers
/// it, a punch with a flat end or a layer changes it.
const STRENGTH: (f64, f64) = (1.2, 2.0);
const EXPONENT: (f64, f64) = (0.5, 0.12);
const LOSS: (f64, f64) = (0.1, 0.15);

/// Another minimum forbids the surface if its −2 ln L is within this of the best one, and it lies further off than
/// three standard deviations.
const RIVAL: f64 = 16.0;

/// Largest χ² per degree of freedom. Up to it the standard deviation grows with its root.
const MISFIT: f64 = 4.0;

/// The surface of the model is no truer than this, mm, and no better known than by this part of the standard
/// deviation of the latency: what seems to identify the latency may be an error of the model.
const MODEL_MM: f64 = 0.002;
const LATENCY_PART: f64 = 0.5;

/// Why readings do not determine a surface.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum OnsetRefusal {
    /// Too few readings.
    #[error(
        "{clear} readings are clear and {contact} touch, where at least {clear_min} and {contact_min} are needed"
    )]
    TooFew {
        /// Readings of the clear probe.
        clear: usize,
        /// Readings in contact.
        contact: usize,
        /// The least numbers of both.
        clear_min: usize,
        /// Of those in contact.
        contact_min: usize,
    },
    /// No contact law fits.
    #[error(
        "χ² per degree of freedom is {found:.1} for every contact law, where at most {limit} is allowed"
    )]
    Misfit {
        /// χ² per degree of freedom.
        found: f64,
        /// Largest value.
        limit: f64,
    },
    /// Two surfaces fit.
    #[error("surfaces at {one_mm:.4} mm and at {other_mm:.4} mm fit equally well")]
    Ambiguous {
        /// The better one, mm.
        one_mm: f64,
        /// The other, mm.
        other_mm: f64,
    },
    /// The surface is not known well enough.
    #[error(
        "the surface is known to ± {sigma_mm:.4} mm, where at most {limit_mm:.4} mm are allowed"
    )]
    Uncertain {
        /// Its standard deviation, mm.
        sigma_mm: f64,
        /// Largest standard deviation, mm.
        limit_mm: f64,
    },
    /// The surface lies where the readings say otherwise.
    #[error(
        "the surface fits at {surface_mm:.4} mm, and the readings are of {low_mm:.4} to {high_mm:.4} mm"
    )]
    Elsewhere {
        /// The surface, mm.
        surface_mm: f64,
        /// Lowest position read at, mm.
        low_mm: f64,
        /// Highest position read at, mm.
        high_mm: f64,
    },
}

#[derive(Debug, Clone, Copy)]
struct Unknowns {
    contact: ContactModel,
    /// The impedance of the clear probe over the mean of the clear readings.
    clear: Complex64,
}

impl Unknowns {
    fn moved(&self, index: usize, by: f64) -> Self {
        let mut moved = *self;
        let contact = &mut moved.contact;
        match index {
            0 => contact.surface_mm += by,
            1 => contact.strength += by,
            2 => contact.exponent += by,
            3 => contact.loss += by,
            4 => contact.latency_s += by,
            5 => moved.clear.re += by,
            _ => moved.clear.im += by,
        }
        moved
    }
}

impl Step<N> for Unknowns {
    fn minus(&self, step: &[f64; N]) -> Self {
        const LONGEST: [f64; N] = [0.03, 1.0, 0.2, 0.3, 0.005, 0.1, 0.1];
        let part = step.iter().zip(LONGEST).map(|(step, most)| most / step.abs());
        let part = part.fold(1.0, f64::min);
        let mut next = *self;
        for (index, step) in step.iter().enumerate() {
            next = next.moved(index, -part * step);
        }
        next.contact.exponent = next.contact.exponent.clamp(0.1, 2.0);
        next
    }
}

/// The readings of one descent.
struct Problem<'a> {
    sensor: FreeSensor,
    way: &'a EvenWay,
    latency: Latency,
    /// Begin and end of each integration, s, impedance over the mean of the clear ones, and 1/σ² of each part.
    windows: Vec<(f64, f64)>,
    measured: Vec<(Complex64, f64)>,
}

impl Problem<'_> {
    fn expected(&self, contact: &ContactModel) -> Vec<Complex64> {
        self.sensor.relative(contact, &self.windows, self.way).collect()
    }

    /// The residuals of the readings, whose expected impedance over that of the clear probe is that of the contact.
    fn residuals(&self, at: &Unknowns, expected: &[Complex64]) -> Vec<Complex64> {
        let pairs = self.measured.iter().zip(expected);
        pairs.map(|((measured, _), expected)| residual(*measured, at.clear, *expected)).collect()
    }

    /// What is known before, as mean and standard deviation by unknown.
    fn priors(&self) -> [Option<(f64, f64)>; N] {
        let latency = (self.latency.mean_s, self.latency.sigma_s.max(1e-6));
        [None, Some(STRENGTH), Some(EXPONENT), Some(LOSS), Some(latency), None, None]
    }

    fn normal(&self, at: &Unknowns) -> Normal<N> {
        const STEPS: [f64; N] = [2e-5, 1e-4, 1e-4, 1e-4, 1e-5, 1e-5, 1e-5];
        let expected = self.expected(&at.contact);
        let here = self.residuals(at, &expected);
        let there: [Vec<Complex64>; N] = std::array::from_fn(|index| {
            let moved = at.moved(index, STEPS[index]);
            if moved.contact == at.contact {
                // Only the impedance of the clear probe is another one.
                self.residuals(&moved, &expected)
            } else {
                self.residuals(&moved, &self.expected(&moved.contact))
            }
        });
        let mut normal = Normal::default();
        for (place, (residual, (_, weight))) in here.iter().zip(&self.measured).enumerate() {
            let row = std::array::from_fn(|index| (there[index][place] - residual) / STEPS[index]);
            normal.add(*residual, &row, *weight);
        }
        let contact = &at.contact;
        let values =
            [0.0, contact.strength, contact.exponent, contact.loss, contact.latency_s, 0.0, 0.0];
        for (index, prior) in self.priors().into_iter().enumerate() {
            let Some((mean, sigma)) = prior else { continue };
            let (off, weight) = (values[index] - mean, sigma.powi(-2));
            normal.matrix[index][index] += weight;
            normal.gradient[index] += weight * off;
            normal.cost += weight * off * off;
        }
        normal
    }

    /// The sum of squares, or infinity as soon as it is more than `most`.
    fn cost(&self, at: &Unknowns, most: f64) -> f64 {
        let expected = self.sensor.relative(&at.contact, &self.windows, self.way);
        let mut sum = 0.0;
        for ((measured, weight), expected) in self.measured.iter().zip(expected) {
            sum += weight * residual(*measured, at.clear, expected).norm_sqr();
            if most < sum {
                return f64::INFINITY;
            }
        }
        sum
    }

    /// The minima from several starts, the best one first.
    fn minima(&self, touched_mm: f64) -> Vec<(Unknowns, Normal<N>)> {
        let weight = self.measured.iter().map(|(_, weight)| weight).sum();
        let descent = Descent { count: self.measured.len(), weight, free: N };
        let start = |above_mm: f64, strength_hz: f64| {
            let (exponent, loss) = (EXPONENT.0, LOSS.0);
            let (surface_mm, strength) = (touched_mm + above_mm, strength_hz.ln());
            let latency_s = self.latency.mean_s;
            let contact = ContactModel { surface_mm, strength, exponent, loss, latency_s };
            Unknowns { contact, clear: Complex64::ONE }
        };
        let all = ABOVE_MM
            .iter()
            .flat_map(|above_mm| STRENGTHS_HZ.map(|strength_hz| start(*above_mm, strength_hz)));
        // The best so far, in order.
        let mut starts: Vec<(Unknowns, f64)> = Vec::with_capacity(STARTS + 1);
        for start in all {
            let worst = starts.get(STARTS - 1).map_or(f64::INFINITY, |(_, cost)| *cost);
            let cost = self.cost(&start, worst);
            let place = starts.partition_point(|(_, other)| other.total_cmp(&cost).is_le());
            starts.insert(place, (start, cost));
            starts.truncate(STARTS);
        }
        let mut minima: Vec<(Unknowns, Normal<N>)> = starts
            .into_iter()
            .map(|(start, _)| {
                let (place, normal, _) = descent.run(start, |at| self.normal(at));
                (place, normal)
            })
            .collect();
        minima.sort_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
        minima
    }
}

/// How far a measured impedance is from that of the contact, relative to it.
fn residual(measured: Complex64, clear: Complex64, expected: Complex64) -> Complex64 {
    measured / (clear * expected) - 1.0
}

/// A reading that is not flagged, with its impedance, ohm.
type Usable<'a> = (Complex64, &'a Reading);

/// Standard deviation of each part of the relative error of a reading.
fn sigma(free: &Resonance, reading: &Reading) -> f64 {
    let cycles = reading.integration_s * reading.frequency_hz;
    free.noise_at_ten_cycles * (10.0 / cycles).sqrt()
}

/// Begin and end of an integration, s.
fn window(reading: &Reading) -> (f64, f64) {
    let from_s = reading.started.as_seconds() + reading.settle_s;
    (from_s, from_s + reading.integration_s)
}

impl<'a> Problem<'a> {
    /// The readings around the first contact, and the position there, mm.
    fn new(
        free: &Resonance,
        usable: &[Usable<'_>],
        way: &'a EvenWay,
        latency: Latency,
    ) -> Result<(Self, f64), OnsetRefusal> {
        let references = usable.iter().take(REFERENCES).map(|(value, _)| *value);
        let clear = references.sum::<Complex64>() / usable.len().clamp(1, REFERENCES) as f64;
        let touches = |(value, reading): &Usable<'_>| {
            CONTACT_SIGMAS * SQRT_2 * sigma(free, reading) < (value / clear - 1.0).norm()
        };
        // The first of the readings that touch to the end, so that an outlier before is none.
        let contact = usable.iter().rev().take_while(|one| touches(one)).count();
        let first = usable.len() - contact;
        if first < REFERENCES || contact < CONTACTS_MIN {
            let (clear_min, contact_min) = (REFERENCES, CONTACTS_MIN);
            return Err(OnsetRefusal::TooFew { clear: first, contact, clear_min, contact_min });
        }
        let fitted = &usable[first.saturating_sub(CLEAR_MAX)..];
        let weighed = |(value, reading): &Usable<'_>| {
            let relative = value / clear;
            let model = MODEL_PART * (1.0 - relative).norm().min(1.0);
            (relative, (sigma(free, reading).powi(2) + model * model).recip())
        };
        let (_, touching) = usable[first];
        let problem = Self {
            sensor: FreeSensor::new(free, touching.frequency_hz),
            way,
            latency,
            windows: fitted.iter().map(|(_, reading)| window(reading)).collect(),
            measured: fitted.iter().map(weighed).collect(),
        };
        let touched_mm = problem.position_mm(window(touching));
        Ok((problem, touched_mm))
    }

    fn position_mm(&self, (from_s, until_s): (f64, f64)) -> f64 {
        self.way.position_mm(0.5 * (from_s + until_s))
    }

    /// The best minimum, unless another surface fits as well or the readings are elsewhere.
    fn judge(&self, minima: &[(Unknowns, Normal<N>)]) -> Result<Onset, OnsetRefusal> {
        let ends = (self.windows.first(), self.windows.last());
        let (Some((best, normal)), (Some(&begin), Some(&end))) = (minima.first(), ends) else {
            return Err(OnsetRefusal::Misfit { found: f64::INFINITY, limit: MISFIT });
        };
        let degrees = (2 * self.measured.len()).saturating_sub(3) as f64;
        let chi_squared_per_dof = normal.cost / degrees;
        // NaN is refused too.
        let fits = chi_squared_per_dof <= MISFIT;
        let factors = Cholesky::new(&normal.matrix, N, 0.0).filter(|_| fits);
        let Some(covariance) = factors.map(|factors| factors.inverse()) else {
            return Err(OnsetRefusal::Misfit { found: chi_squared_per_dof, limit: MISFIT });
        };
        let wider = chi_squared_per_dof.max(1.0);
        let latency_mm = LATENCY_PART * self.way.speed_mm_per_s * self.latency.sigma_s;
        let model = MODEL_MM.powi(2) + latency_mm.powi(2);
        let variance = covariance[0][0] * wider + self.way.sigma_mm.powi(2) + model;
        let (surface_mm, sigma_mm) = (best.contact.surface_mm, variance.sqrt());
        let (low_mm, high_mm) = (self.position_mm(end), self.position_mm(begin));
        if !(low_mm..=high_mm).contains(&surface_mm) {
            return Err(OnsetRefusal::Elsewhere { surface_mm, low_mm, high_mm });
        }
        let is_rival = |(other, there): &&(Unknowns, Normal<N>)| {
            let off_mm = (other.contact.surface_mm - surface_mm).abs();
            there.cost - normal.cost < RIVAL && 3.0 * sigma_mm < off_mm
        };
        if let Some((other, _)) = minima.iter().find(is_rival) {
            let other_mm = other.contact.surface_mm;
            return Err(OnsetRefusal::Ambiguous { one_mm: surface_mm, other_mm });
        }
        let latency = Latency {
            mean_s: best.contact.latency_s,
            sigma_s: (covariance[4][4] * wider).sqrt().min(self.latency.sigma_s),
        };
        Ok(Onset {
            surface_mm,
            sigma_mm,
            exponent: best.contact.exponent,
            latency,
            mm_per_latency_s: covariance[0][4] / covariance[4][4],
            chi_squared_per_dof,
        })
    }
}

pub(super) fn fit(
    free: &Resonance,
    readings: &[Reading],
    way: &EvenWay,
    latency: Latency,
    sigma_max_mm: f64,
) -> Result<Onset, OnsetRefusal> {
    let value = |reading: &Reading| match reading.measured {
        PointResult::Value(one) => Some(Complex64::new(one.resistance_ohm, one.reactance_ohm)),
        _ => None,
    };
    let usable: Vec<Usable<'_>> =
        readings.iter().filter_map(|reading| Some((value(reading)?, reading))).collect();
    let (problem, touched_mm) = Problem::new(free, &usable, way, latency)?;
    let onset = problem.judge(&problem.minima(touched_mm))?;
    if onset.sigma_mm > sigma_max_mm {
        let (sigma_mm, limit_mm) = (onset.sigma_mm, sigma_max_mm);
        return Err(OnsetRefusal::Uncertain { sigma_mm, limit_mm });
    }
    Ok(onset)
}
