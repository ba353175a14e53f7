//! The reference: many beam elements with losses and electrodes, giving the impedance at any
//! frequency.
//!
//! Sixteen cubic elements bend in the plane of the probe, sixteen across it, and sixteen linear
//! ones twist; together they carry the five motions (w, φ, v, ψ, θ) of the tip. No matrix of the
//! whole beam is built: two equal pieces are joined to one of twice the length, four times. Losses
//! are complex moduli. The sensor vibrates around its state at rest under the force of the contact.
//! The model neglects shear (0.003 Hz of shift) and the mass of the tissue (0.1 Hz).

use std::f64::consts::TAU;

use num_complex::Complex64;

use crate::{Circuit, ExactBeam, Load, Pose, Sensor, Tissue, rest::Rest, section::Section};

mod matrix;
mod substructure;

use matrix::{Eliminated, Matrix5, eliminate};
use substructure::{bending_at_tip, twist_at_tip};

/// A sensor as sixteen beam elements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Reference {
    section: Section,
    /// The beam without losses and lateral bending, where the search for a pole starts.
    exact: ExactBeam,
    free: Pole,
}

/// The lowest resonance: its complex ω² and the residue of the slope's compliance.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Pole {
    rad2: Complex64,
    residue: Complex64,
}

/// Number of doublings of a piece of the beam: 2⁴ elements.
const DOUBLINGS: u32 = 4;

impl Reference {
    /// The reference of a sensor.
    pub(crate) fn new(sensor: &Sensor) -> Self {
        let exact = ExactBeam::new(sensor);
        let none = Pole { rad2: Complex64::ZERO, residue: Complex64::ZERO };
        let mut reference = Self { section: *sensor.section(), exact, free: none };
        let rad2 = (TAU * exact.no_load_hz()).powi(2);
        let guess = Complex64::new(rad2, rad2 * reference.section.beam_loss);
        reference.free = reference.pole(&Held::FREE, guess);
        reference
    }

    /// Series resonance of the free sensor, Hz.
    pub(crate) fn no_load_hz(&self) -> f64 {
        self.free.rad2.re.sqrt() / TAU
    }

    /// The shift of the series resonance by this contact, Hz.
    pub(crate) fn shift_hz(&self, pose: &Pose, load: &Load, tissue: &Tissue) -> f64 {
        self.exact.element().resolved_hz(pose, load, |load| {
            let pole = self.pole_with(pose, load, tissue);
            let (rad2, free) = (pole.rad2.re, self.free.rad2.re);
            (rad2 - free) / (rad2.sqrt() + free.sqrt()) / TAU
        })
    }

    /// The equivalent circuit around the series resonance.
    pub(crate) fn circuit(&self, pose: &Pose, load: &Load, tissue: &Tissue) -> Circuit {
        let pole = self.pole_with(pose, load, tissue);
        let contact = self.contact(pose, load, tissue);
        let at = Complex64::from(pole.rad2.re);
        let series = pole.residue / (pole.rad2 - at);
        let rest = self.slope_compliance(&contact, at) - series;
        let transfer = self.section.moment_n_m_per_v.powi(2);
        let capacitance = self.held_capacitance() + transfer * rest;
        Circuit {
            series_resonance_hz: pole.rad2.re.sqrt() / TAU,
            q: pole.rad2.re / pole.rad2.im,
            capacitance_f: capacitance.re,
            capacitance_ratio: transfer * (pole.residue / pole.rad2.re).re / capacitance.re,
            dielectric_loss: -capacitance.im / capacitance.re,
        }
    }

    fn held_capacitance(&self) -> Complex64 {
        self.section.capacitance_f * Complex64::new(1.0, -self.section.dielectric_loss)
    }

    fn pole_with(&self, pose: &Pose, load: &Load, tissue: &Tissue) -> Pole {
        if load.normal_n_per_m == 0.0 {
            return self.free;
        }
        let contact = self.contact(pose, load, tissue);
        // The exact beam gives the pole without losses. The slope of the resonance over the contact
        // stiffness gives the contact's share of the strain energy, and with it the loss.
        let rad2 = |load: &Load| {
            (TAU * (self.exact.no_load_hz() + self.exact.shift_hz(pose, load))).powi(2)
        };
        let here = rad2(load);
        let share = (rad2(&load.stiffer(1.0 + SHARE_STEP)) / here - 1.0) / SHARE_STEP;
        let loss = self.section.beam_loss + share * (tissue.loss() - self.section.beam_loss);
        self.pole(&contact, Complex64::new(here, here * loss))
    }

    /// The pole nearest to a guess, by secant steps on the determinant.
    ///
    /// The slope's compliance would not do: it has no pole for a mode that does not turn the end of
    /// the beam.
    fn pole(&self, contact: &Held, guess_rad2: Complex64) -> Pole {
        let determinant = |rad2: Complex64| self.eliminated(contact, rad2).determinant;
        let mut at = guess_rad2;
        let (mut before, mut value_before) = (at * 1.001, determinant(at * 1.001));
        for _ in 0..STEPS_MAX {
            let value = determinant(at);
            let next = at - value * (at - before) / (value - value_before);
            (before, value_before) = (at, value);
            at = next;
            if (at - before).norm() <= TOLERANCE * at.norm() {
                break;
            }
        }
        // Close to the pole the compliance is residue/(pole − ω²) plus an even part.
        let step = at * RESIDUE_STEP;
        let residue = 0.5
            * step
            * (self.slope_compliance(contact, at - step)
                - self.slope_compliance(contact, at + step));
        Pole { rad2: at, residue }
    }

    /// The turn of the beam's end for a moment of 1 N·m there, at a complex ω².
    fn slope_compliance(&self, contact: &Held, rad2: Complex64) -> Complex64 {
        self.eliminated(contact, rad2).slope
    }

    /// Determinant and slope of the dynamic stiffness of the tip with its contact, at a complex ω².
    fn eliminated(&self, contact: &Held, rad2: Complex64) -> Eliminated {
        let s = &self.section;
        let lossy = Complex64::new(1.0, s.beam_loss);
        let mut tip = contact.stiffness;
        let (mass, pull_n) = (rad2 * s.mass_kg_per_m, contact.pull_n);
        for (first, rigidity) in [(0, s.bending_n_m2), (2, s.lateral_n_m2)] {
            tip.add_block(first, bending_at_tip(lossy * rigidity, mass, pull_n, s.length_m));
        }
        tip.add(4, 4, twist_at_tip(lossy * s.torsion_n_m2, rad2 * s.roll_kg_m, s.length_m));
        for (motion, inertia) in [
            (0, s.tip_mass_kg),
            (1, s.tip_inertia_kg_m2),
            (2, s.tip_mass_kg),
            (4, s.tip_inertia_kg_m2),
        ] {
            tip.add(motion, motion, -rad2 * inertia);
        }
        eliminate(&tip)
    }

    /// The tip in this contact.
    fn contact(&self, pose: &Pose, load: &Load, tissue: &Tissue) -> Held {
        let lossy = Complex64::new(1.0, tissue.loss());
        let n = pose.normal();
        let rest = Rest::of(&self.section, pose, load.force_n);
        let point = rest.point(&self.section, pose);
        let normal = std::array::from_fn(|motion| (0..3).map(|i| n[i] * point[i][motion]).sum());
        let mut stiffness = Matrix5::ZERO;
        for along in point {
            stiffness.add_square(lossy * load.tangential_n_per_m, along);
        }
        stiffness.add_square(lossy * (load.normal_n_per_m - load.tangential_n_per_m), normal);
        let (slope, twist) = rest.arm_n_m(&self.section);
        stiffness.add(1, 1, slope.into());
        stiffness.add(4, 4, twist.into());
        Held { stiffness, pull_n: rest.pull_n() }
    }
}

/// What a contact adds to the beam.
struct Held {
    /// The stiffness over the tip's five motions.
    stiffness: Matrix5,
    /// The force along the beam, N.
    pull_n: f64,
}

impl Held {
    const FREE: Self = Self { stiffness: Matrix5::ZERO, pull_n: 0.0 };
}

/// Largest last step, relative to ω².
const TOLERANCE: f64 = 1e-9;
/// From a guess within a few percent the secant needs about six steps.
const STEPS_MAX: u32 = 40;
/// Step relative to the contact's stiffness.
const SHARE_STEP: f64 = 1e-4;
/// Step relative to ω². The part without the pole is smooth over a hundred times this.
const RESIDUE_STEP: f64 = 1e-4;

#[cfg(test)]
mod tests;
