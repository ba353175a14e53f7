//! The exact Euler–Bernoulli beam with a tip: its lowest resonance in contact, without losses.
//!
//! The beam's stiffness at its end is a quotient of sines and hyperbolic sines of βL with
//! β⁴ = ω² m/(EI). All terms are scaled by e^(−βL), so that no βL overflows. Twist is eliminated as in
//! tier E1. The reference adds lateral bending and losses.

use std::f64::consts::TAU;

use crate::{
    Element, Load, Pose, Sensor, element::Symmetric2, section::Section, tip_stiffness::TipStiffness,
};

/// A sensor as an exact beam.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ExactBeam {
    section: Section,
    element: Element,
    /// ω² of the free sensor.
    free_rad2: f64,
}

/// The trigonometric and hyperbolic functions of βL. The hyperbolic ones and 1 are scaled by
/// 2 e^(−βL).
#[derive(Debug, Clone, Copy)]
struct Scaled {
    sin: f64,
    cos: f64,
    sinh: f64,
    cosh: f64,
    one: f64,
}

impl Scaled {
    fn of(beta_l: f64) -> Self {
        let (sin, cos) = beta_l.sin_cos();
        let fall = (-beta_l).exp();
        let square = fall * fall;
        Self { sin, cos, sinh: 1.0 - square, cosh: 1.0 + square, one: 2.0 * fall }
    }
}

/// The lowest βL of a beam clamped at both ends, where the stiffness at the end has its first pole.
const CLAMPED_CLAMPED: f64 = 4.730_040_744_862_704;
/// Largest last step, relative to ω². A secant step leaves an error of about its square.
const TOLERANCE: f64 = 1e-8;
/// Bisection alone would need fifty steps.
const STEPS_MAX: u32 = 80;

/// The residual of the resonance condition at some ω².
struct Residual {
    /// The scaled determinant of the stiffness at the end.
    determinant: f64,
    /// A first guess of the slope of the determinant.
    slope: f64,
    /// The number of roots below this ω², by the signs of the pivots.
    roots_below: u8,
}

impl ExactBeam {
    /// The exact beam of a sensor.
    pub(crate) fn new(sensor: &Sensor) -> Self {
        let element = Element::new(sensor);
        let mut beam = Self { section: *sensor.section(), element, free_rad2: 0.0 };
        let none = |_| Symmetric2::ZERO;
        beam.free_rad2 = beam.lowest_rad2(none, element.free_rad2(), f64::INFINITY);
        beam
    }

    /// The single element of the same sensor.
    pub(crate) const fn element(&self) -> &Element {
        &self.element
    }

    /// Resonance of the free sensor, Hz.
    pub(crate) fn no_load_hz(&self) -> f64 {
        self.free_rad2.sqrt() / TAU
    }

    /// The shift of the resonance by a contact stiffness, Hz.
    pub(crate) fn shift_hz(&self, pose: &Pose, load: &Load) -> f64 {
        self.element.resolved_hz(pose, load, |load| self.difference_hz(pose, load))
    }

    fn difference_hz(&self, pose: &Pose, load: &Load) -> f64 {
        let contact = TipStiffness::of(&self.section, pose, load);
        let start = self.element.rad2_with(&contact);
        let twist_rad2 = self.element.twist_rad2(&contact);
        let contact = |at| self.element.in_plane(&contact, at);
        let rad2 = self.lowest_rad2(contact, start, twist_rad2);
        (rad2 - self.free_rad2) / (rad2.sqrt() + self.free_rad2.sqrt()) / TAU
    }

    /// The lowest ω² with this contact stiffness, which may depend on ω², from a guess near it.
    ///
    /// Secant steps on the determinant stay between bounds from the number of negative pivots: below
    /// the first root the stiffness at the end is positive definite. The first root lies below
    /// `twist_rad2`, the resonance of the eliminated twist alone.
    fn lowest_rad2(
        &self,
        contact: impl Fn(f64) -> Symmetric2,
        guess_rad2: f64,
        twist_rad2: f64,
    ) -> f64 {
        let s = &self.section;
        let clamped = (CLAMPED_CLAMPED / s.length_m).powi(4) * s.bending_n_m2 / s.mass_kg_per_m;
        let ceiling = clamped.min(twist_rad2);
        let (mut low, mut high) = (self.free_rad2 * (1.0 - 1e-12), ceiling);
        let mut at =
            if low < guess_rad2 && guess_rad2 < high { guess_rad2 } else { 0.5 * (low + high) };
        let mut before: Option<(f64, f64)> = None;
        for _ in 0..STEPS_MAX {
            let here = self.residual(at, contact(at));
            if here.roots_below == 0 {
                low = at;
            } else {
                high = at;
            }
            let slope = match before {
                Some((x, y)) if x != at => (here.determinant - y) / (at - x),
                _ => here.slope,
            };
            // Above the second root a secant would lead to that root.
            let is_near = here.roots_below < 2;
            before = is_near.then_some((at, here.determinant));
            let next = at - here.determinant / slope;
            let is_within = is_near && low < next && next < high;
            let next = if is_within { next } else { 0.5 * (low + high) };
            let is_done = (next - at).abs() <= TOLERANCE * at;
            at = next;
            if is_done {
                break;
            }
        }
        at
    }

    fn residual(&self, rad2: f64, contact: Symmetric2) -> Residual {
        let s = &self.section;
        let beta = (rad2 * s.mass_kg_per_m / s.bending_n_m2).sqrt().sqrt();
        let t = Scaled::of(beta * s.length_m);
        let ei = s.bending_n_m2;
        // The beam's stiffness times `pole`, which is positive up to the first clamped mode.
        let pole = t.one - t.cos * t.cosh;
        let beam = Symmetric2 {
            ww: ei * beta.powi(3) * (t.cos * t.sinh + t.sin * t.cosh),
            wp: -ei * beta * beta * t.sin * t.sinh,
            pp: ei * beta * (t.sin * t.cosh - t.cos * t.sinh),
        };
        let tip = Symmetric2 {
            ww: contact.ww - rad2 * s.tip_mass_kg,
            wp: contact.wp,
            pp: contact.pp - rad2 * s.tip_inertia_kg_m2,
        };
        // det(B/pole + X) pole; the pole cancels in det B = (EI)² β⁴ (1 + cos cosh) pole.
        let determinant = (ei * beta * beta).powi(2) * (t.one + t.cos * t.cosh)
            + beam.mixed(tip)
            + pole * tip.determinant();
        let sum = beam.plus(pole, tip);
        let roots_below = match (determinant > 0.0, sum.ww > 0.0) {
            (true, true) => 0,
            (false, _) => 1,
            (true, false) => 2,
        };
        // The element's mass approximates the slope of the stiffness.
        let slope = -sum.mixed(self.element.mass());
        Residual { determinant, slope, roots_below }
    }
}

#[cfg(test)]
mod tests;
