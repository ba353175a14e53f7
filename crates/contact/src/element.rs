//! Tier E1: the bimorph as one cubic beam element with a tip mass, in closed form.
//!
//! Two motions in the plane of bending, deflection w and slope φ, make a quadratic in ω². The twist θ,
//! which a surface that leans to the left excites a little, is eliminated beforehand. Losses and the
//! electrodes make the quadratic complex; its lower root gives the equivalent circuit.
//!
//! The reference adds the bending by the beam's own inertia (0.05 Hz of 140 Hz for the reference
//! sensor), lateral bending (0.03 Hz of shift), and shear.

use std::f64::consts::TAU;

use num_complex::Complex64;

use crate::{
    Circuit, Load, Pose, Sensor, Tissue, rest::Rest, section::Section, tip_stiffness::TipStiffness,
};

/// The beam element of tier E1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Element {
    section: Section,
    stiffness: Symmetric2,
    mass: Symmetric2,
    twist_stiffness_n_m: f64,
    twist_inertia_kg_m2: f64,
    /// ω² and ω of the free sensor, without losses.
    free_rad2: f64,
    free_rad: f64,
    /// Stiffness less ω² mass of the free sensor: singular.
    dynamic_stiffness: Symmetric2,
    /// Coefficients of the quadratic: the mass determinant, and the mixed term of the free sensor.
    mass_determinant: f64,
    mixed: f64,
}

/// A symmetric matrix over (w, φ).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Symmetric2 {
    pub(crate) ww: f64,
    pub(crate) wp: f64,
    pub(crate) pp: f64,
}

impl Symmetric2 {
    pub(crate) const ZERO: Self = Self { ww: 0.0, wp: 0.0, pp: 0.0 };

    pub(crate) fn plus(self, factor: f64, other: Self) -> Self {
        Self {
            ww: self.ww + factor * other.ww,
            wp: self.wp + factor * other.wp,
            pp: self.pp + factor * other.pp,
        }
    }

    pub(crate) fn determinant(self) -> f64 {
        self.ww * self.pp - self.wp * self.wp
    }

    /// The coefficient of x in det(A + x B).
    pub(crate) fn mixed(self, other: Self) -> f64 {
        self.ww * other.pp + self.pp * other.ww - 2.0 * self.wp * other.wp
    }
}

impl Element {
    /// The element of a sensor.
    pub(crate) fn new(sensor: &Sensor) -> Self {
        let section = *sensor.section();
        let l = section.length_m;
        let k = section.bending_n_m2 / l.powi(3);
        let m = section.mass_kg_per_m * l / 420.0;
        let stiffness = Symmetric2 { ww: 12.0 * k, wp: -6.0 * l * k, pp: 4.0 * l * l * k };
        let mass = Symmetric2 {
            ww: 156.0 * m + section.tip_mass_kg,
            wp: -22.0 * l * m,
            pp: 4.0 * l * l * m + section.tip_inertia_kg_m2,
        };
        let sum = stiffness.mixed(mass);
        let mass_determinant = mass.determinant();
        let discriminant = sum * sum - 4.0 * mass_determinant * stiffness.determinant();
        let free_rad2 = 2.0 * stiffness.determinant() / (sum + discriminant.sqrt());
        let dynamic_stiffness = stiffness.plus(-free_rad2, mass);
        Self {
            section,
            stiffness,
            mass,
            twist_stiffness_n_m: section.torsion_n_m2 / l,
            twist_inertia_kg_m2: section.roll_kg_m * l / 3.0 + section.tip_inertia_kg_m2,
            free_rad2,
            free_rad: free_rad2.sqrt(),
            dynamic_stiffness,
            mass_determinant,
            mixed: dynamic_stiffness.mixed(mass),
        }
    }

    /// Series resonance of the free sensor, without losses, Hz.
    pub(crate) fn no_load_hz(&self) -> f64 {
        self.free_rad / TAU
    }

    /// The shift of the series resonance by a contact stiffness, without losses, Hz.
    ///
    /// It is the root of a quadratic around the free sensor, and so keeps its relative accuracy down
    /// to the smallest stiffness.
    pub(crate) fn shift_hz(&self, pose: &Pose, load: &Load) -> f64 {
        if load.normal_n_per_m == 0.0 {
            return 0.0;
        }
        let rise = self.rise_with(&TipStiffness::of(&self.section, pose, load));
        rise / (((self.free_rad2 + rise).sqrt() + self.free_rad) * TAU)
    }

    /// The shift by a model that only gives the difference of two resonances.
    ///
    /// A shift too small for that difference is the element's shift times the ratio of the two
    /// models at a larger stiffness.
    pub(crate) fn resolved_hz(
        &self,
        pose: &Pose,
        load: &Load,
        difference_hz: impl Fn(&Load) -> f64,
    ) -> f64 {
        let shift = self.shift_hz(pose, load);
        let least = RESOLVED_REL * self.no_load_hz();
        if shift == 0.0 || shift >= least {
            return if shift == 0.0 { 0.0 } else { difference_hz(load) };
        }
        let seen = load.stiffer(2.0 * least / shift);
        shift * difference_hz(&seen) / self.shift_hz(pose, &seen)
    }

    /// The rise of ω² by this contact stiffness.
    fn rise_with(&self, k: &TipStiffness) -> f64 {
        if !k.is_twisting() {
            return self.rise_rad2(Symmetric2 { ww: k.ww, wp: k.wp, pp: k.pp });
        }
        // The twist's inertia needs ω². It is a few percent of the twist's stiffness, which itself
        // moves the shift by a fifth of a hertz, so that the first order in the contact suffices.
        let along = self.dynamic_stiffness.ww * k.pp + self.dynamic_stiffness.pp * k.ww
            - 2.0 * self.dynamic_stiffness.wp * k.wp;
        let first_order = along / (self.mixed + self.mass.ww * k.pp);
        // At the free twist's own resonance a sliding contact would have no stiffness, and beyond it
        // a negative one: the guess stays below.
        let free_twist_rad2 = self.twist_stiffness_n_m / self.twist_inertia_kg_m2;
        let guess = (self.free_rad2 + first_order).min(0.5 * free_twist_rad2);
        self.rise_rad2(self.in_plane(k, guess))
    }

    /// An upper bound of the first ω²: the resonance of the twist alone with this contact stiffness
    /// when the contact couples twist and bending; otherwise infinite.
    pub(crate) fn twist_rad2(&self, k: &TipStiffness) -> f64 {
        if !k.is_twisting() {
            return f64::INFINITY;
        }
        (self.twist_stiffness_n_m + k.tt) / self.twist_inertia_kg_m2
    }

    /// ω² with this contact stiffness.
    pub(crate) fn rad2_with(&self, k: &TipStiffness) -> f64 {
        self.free_rad2 + self.rise_with(k)
    }

    /// ω² of the free sensor.
    pub(crate) const fn free_rad2(&self) -> f64 {
        self.free_rad2
    }

    /// The mass over (w, φ).
    pub(crate) const fn mass(&self) -> Symmetric2 {
        self.mass
    }

    /// The contact's stiffness over (w, φ), with the twist eliminated at ω².
    pub(crate) fn in_plane(&self, k: &TipStiffness, omega_rad2: f64) -> Symmetric2 {
        let twist = self.twist_stiffness_n_m - omega_rad2 * self.twist_inertia_kg_m2;
        let give = 1.0 / (twist + k.tt);
        Symmetric2 {
            ww: k.ww - give * k.wt * k.wt,
            wp: k.wp - give * k.wt * k.pt,
            pp: k.pp - give * k.pt * k.pt,
        }
    }

    /// The rise of ω² by the contact: the small root of the quadratic around the free sensor.
    fn rise_rad2(&self, contact: Symmetric2) -> f64 {
        let constant = self.dynamic_stiffness.mixed(contact) + contact.determinant();
        let sum = self.mixed + contact.mixed(self.mass);
        let discriminant = sum * sum - 4.0 * self.mass_determinant * constant;
        2.0 * constant / (sum + discriminant.sqrt())
    }

    /// The equivalent circuit of the free sensor.
    pub(crate) fn free_circuit(&self) -> Circuit {
        self.circuit_of(self.complex(|_| Complex64::ZERO))
    }

    /// The equivalent circuit in contact, with the losses of beam and tissue.
    pub(crate) fn circuit(&self, pose: &Pose, load: &Load, tissue: &Tissue) -> Circuit {
        if load.normal_n_per_m == 0.0 {
            return self.free_circuit();
        }
        let rest = Rest::of(&self.section, pose, load.force_n);
        let of_tissue = TipStiffness::of_tissue(&self.section, pose, load, &rest);
        let of_force = TipStiffness::of_force(&self.section, &rest);
        let lossy = |of_tissue: f64, of_force: f64| {
            Complex64::new(of_tissue + of_force, of_tissue * tissue.loss())
        };
        let omega_rad2 = (TAU * (self.no_load_hz() + self.shift_hz(pose, load))).powi(2);
        let twist = Complex64::new(
            self.twist_stiffness_n_m - omega_rad2 * self.twist_inertia_kg_m2,
            self.twist_stiffness_n_m * self.section.beam_loss,
        );
        let [wt, pt] = [of_tissue.wt, of_tissue.pt].map(|coupled| lossy(coupled, 0.0));
        let give = (twist + lossy(of_tissue.tt, of_force.tt)).inv();
        self.circuit_of(self.complex(|part| match part {
            Entry::Ww => lossy(of_tissue.ww, of_force.ww) - give * wt * wt,
            Entry::Wp => lossy(of_tissue.wp, of_force.wp) - give * wt * pt,
            Entry::Pp => lossy(of_tissue.pp, of_force.pp) - give * pt * pt,
        }))
    }

    /// The beam's lossy stiffness plus that of a contact, as (ww, wφ, φφ).
    fn complex(&self, contact: impl Fn(Entry) -> Complex64) -> [Complex64; 3] {
        let lossy = Complex64::new(1.0, self.section.beam_loss);
        [
            lossy * self.stiffness.ww + contact(Entry::Ww),
            lossy * self.stiffness.wp + contact(Entry::Wp),
            lossy * self.stiffness.pp + contact(Entry::Pp),
        ]
    }

    /// The circuit of a lossy stiffness over (w, φ).
    ///
    /// The electrodes turn the end of the beam, so that the charge follows its slope. The compliance
    /// of the slope has a pole at each root of the quadratic. The lower pole is the series branch; the
    /// upper one is far away and adds to the capacitor.
    fn circuit_of(&self, [ww, wp, pp]: [Complex64; 3]) -> Circuit {
        let m = &self.mass;
        let sum = ww * m.pp + pp * m.ww - 2.0 * wp * m.wp;
        let constant = ww * pp - wp * wp;
        let root = (sum * sum - 4.0 * self.mass_determinant * constant).sqrt();
        let lower = 2.0 * constant / (sum + root);
        let upper = (sum + root) / (2.0 * self.mass_determinant);
        let residue = |pole: Complex64, other: Complex64| {
            (ww - pole * m.ww) / (self.mass_determinant * (other - pole))
        };
        let transfer = self.section.moment_n_m_per_v.powi(2);
        let series_f = (transfer * residue(lower, upper) / lower.re).re;
        let rest_f = transfer * residue(upper, lower) / (upper - lower.re);
        let capacitance_f = self.section.capacitance_f + rest_f.re;
        Circuit {
            series_resonance_hz: lower.re.sqrt() / TAU,
            q: lower.re / lower.im,
            capacitance_f,
            capacitance_ratio: series_f / capacitance_f,
            dielectric_loss: (self.section.capacitance_f * self.section.dielectric_loss
                - rest_f.im)
                / capacitance_f,
        }
    }
}

/// Smallest shift, relative to the resonance, for which a difference of resonances has six correct
/// digits.
const RESOLVED_REL: f64 = 1e-6;

/// The entries of a symmetric matrix over (w, φ).
#[derive(Clone, Copy)]
enum Entry {
    Ww,
    Wp,
    Pp,
}

#[cfg(test)]
mod tests;
