//! A bimorph with a ball probe on a soft half space, by one beam element in three motions: deflection,
//! slope and twist of its end, around its state at rest under the force of the contact.

use std::f64::consts::TAU;

use serde::Deserialize;

use super::{SensorKeys, rest::AtRest};

/// A symmetric matrix over deflection, slope and twist.
type Matrix = [[f64; 3]; 3];

/// Growth of the contact with depth.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Law {
    Paper,
    Hertz,
    Sneddon,
    SneddonSeries,
    NeoHookean,
}

/// Direction in which the surface leans.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Lean {
    Front,
    Back,
    Left,
}

impl TryFrom<&str> for Lean {
    type Error = &'static str;

    fn try_from(word: &str) -> Result<Self, Self::Error> {
        match word {
            "front" => Ok(Self::Front),
            "back" => Ok(Self::Back),
            "left" => Ok(Self::Left),
            _ => Err("a touch has a direction that this checker does not know"),
        }
    }
}

/// A contact.
#[derive(Debug, Clone, Copy)]
pub(super) struct Contact {
    pub(super) direction: Lean,
    pub(super) angle_rad: f64,
    /// Along the probe.
    pub(super) depth_mm: f64,
    pub(super) is_held_by_stage: bool,
    pub(super) tangential_ratio: f64,
}

impl Contact {
    /// The normal of the surface: along the bimorph, to the left, along the probe.
    fn normal(&self) -> [f64; 3] {
        let (sin, cos) = self.angle_rad.sin_cos();
        match self.direction {
            Lean::Front => [sin, 0.0, cos],
            Lean::Back => [-sin, 0.0, cos],
            Lean::Left => [0.0, sin, cos],
        }
    }
}

/// The sensor in SI units.
#[derive(Debug, Clone, Copy)]
pub(super) struct Beam {
    stiffness: Matrix,
    mass: Matrix,
    pub(super) length_m: f64,
    bending_n_m2: f64,
    pub(super) lateral_n_m2: f64,
    torsion_n_m2: f64,
    radius_m: f64,
    pub(super) arm_m: f64,
    law: Law,
    poisson: f64,
}

/// Times that an interval is halved: to the last digits of a double.
const HALVINGS: u32 = 60;
/// The stiffness that any sample may have, as logarithms of MPa.
const LOG_RANGE: [f64; 2] = [-14.0, 7.0];

impl Beam {
    pub(super) fn new(keys: &SensorKeys, radius_mm: f64, arm_mm: f64) -> Self {
        let (length, width) = (keys.length_mm / 1e3, keys.width_mm / 1e3);
        let (layer, core) = (keys.piezo_thickness_mm / 1e3, keys.core_thickness_mm / 1e3);
        // ∫ z² dz over a layer from `from` to `to`, on both sides of the middle.
        let second = |from: f64, to: f64| 2.0 * (to.powi(3) - from.powi(3)) / 3.0;
        let (of_core, of_piezo) = (second(0.0, core / 2.0), second(core / 2.0, core / 2.0 + layer));
        let weighted = |piezo: f64, in_core: f64| piezo * of_piezo + in_core * of_core;
        let section = |piezo: f64, in_core: f64| piezo * 2.0 * layer + in_core * core;
        let (piezo, middle) = (keys.piezo, keys.core);
        let bending = 1e9 * width * weighted(piezo.modulus_gpa, middle.modulus_gpa);
        let torsion = 4e9 * width * weighted(piezo.shear_gpa, middle.shear_gpa);
        let lateral = 1e9 * width.powi(3) / 12.0 * section(piezo.modulus_gpa, middle.modulus_gpa);
        let line = width * section(piezo.density_kg_per_m3, middle.density_kg_per_m3);
        let tip = keys.tip_mass_g / 1e3;
        let inertia = tip * (keys.tip_gyration_mm / 1e3).powi(2);
        let roll = line * width.powi(2) / 12.0;
        let (l, k, m) = (length, bending / length.powi(3), line * length / 420.0);
        Self {
            stiffness: [
                [12.0 * k, -6.0 * l * k, 0.0],
                [-6.0 * l * k, 4.0 * l * l * k, 0.0],
                [0.0, 0.0, torsion / l],
            ],
            mass: [
                [156.0 * m + tip, -22.0 * l * m, 0.0],
                [-22.0 * l * m, 4.0 * l * l * m + inertia, 0.0],
                [0.0, 0.0, roll * l / 3.0 + inertia],
            ],
            length_m: l,
            bending_n_m2: bending,
            lateral_n_m2: lateral,
            torsion_n_m2: torsion,
            radius_m: radius_mm / 1e3,
            arm_m: arm_mm / 1e3,
            law: keys.law,
            poisson: keys.poisson,
        }
    }

    /// Resonance of the free sensor, Hz.
    pub(super) fn free_hz(&self) -> f64 {
        self.lowest_hz(&[[0.0; 3]; 3])
    }

    /// The shift for a stiffness, as the logarithm of MPa, Hz.
    pub(super) fn shift_hz(&self, contact: &Contact, log_mpa: f64) -> f64 {
        let modulus_pa = 1e6 * log_mpa.exp() / (1.0 - self.poisson.powi(2));
        let depth_rel = self.depth_rel(contact, modulus_pa);
        let normal = 2.0 * modulus_pa * self.radius_m * self.law.radius_rel(depth_rel);
        let tangential = contact.tangential_ratio * normal;
        let n = contact.normal();
        let force_n = modulus_pa * self.radius_m.powi(2) * self.law.force_rel(depth_rel);
        let rest = AtRest::of(self, &n, force_n);
        let (h, reach) = (self.arm_m, self.arm_m + self.radius_m * n[2]);
        let one = |motion: usize| std::array::from_fn(|at| f64::from(u8::from(at == motion)));
        let shorter = [one(0), one(1)].map(|one| self.shorter(&rest.end, &one));
        // The motion of the point of contact for each motion of the end.
        let point = [
            [-shorter[0], reach - shorter[1], 0.0],
            [0.0, 0.0, reach],
            [1.0, h * rest.end[1] - self.radius_m * n[0], h * rest.end[2] - self.radius_m * n[1]],
        ];
        // The force along the beam pulls it straight; the one along the probe pushes on the arm.
        let [pull, _, push] = rest.force_n;
        let of_arm = [0.0, h * (pull * rest.end[1] - push), -h * push];
        let along: [f64; 3] =
            std::array::from_fn(|motion| (0..3).map(|axis| n[axis] * point[axis][motion]).sum());
        let entry = |a: usize, b: usize| {
            let all: f64 = point.iter().map(|row| row[a] * row[b]).sum();
            let of_tissue = tangential * all + (normal - tangential) * along[a] * along[b];
            let of_pull = pull * self.shorter(&one(a), &one(b));
            of_tissue + of_pull + if a == b { of_arm[a] } else { 0.0 }
        };
        let added = std::array::from_fn(|a| std::array::from_fn(|b| entry(a, b)));
        self.lowest_hz(&added) - self.free_hz()
    }

    /// The logarithm of the stiffness in MPa that gives this shift, if any does.
    pub(super) fn log_young(&self, contact: &Contact, shift_hz: f64) -> Option<f64> {
        let [low, high] = LOG_RANGE;
        let is_above = |log: f64| self.shift_hz(contact, log) > shift_hz;
        (!is_above(low) && is_above(high)).then(|| bisect(low, high, is_above))
    }

    /// The indentation along the normal, in ball radii.
    fn depth_rel(&self, contact: &Contact, modulus_pa: f64) -> f64 {
        let moved = contact.depth_mm / 1e3 * contact.angle_rad.cos() / self.radius_m;
        if !contact.is_held_by_stage {
            return moved;
        }
        // Force and indentation rise together: one of them is too large on either side.
        let n = contact.normal();
        bisect(0.0, moved, |depth| {
            let force_n = modulus_pa * self.radius_m.powi(2) * self.law.force_rel(depth);
            let given_m = force_n * AtRest::of(self, &n, force_n).give_m_per_n;
            depth + given_m / self.radius_m > moved
        })
    }

    /// Deflection, slope and twist of the end under a force and two moments there.
    pub(super) fn bent(&self, [force, moment, torque]: &[f64; 3]) -> [f64; 3] {
        let l = self.length_m;
        [
            (force * l.powi(3) / 3.0 + moment * l * l / 2.0) / self.bending_n_m2,
            (force * l * l / 2.0 + moment * l) / self.bending_n_m2,
            torque * l / self.torsion_n_m2,
        ]
    }

    /// The integral over the beam of the product of the slopes of two shapes with these ends: twice the
    /// way by which one shape draws the end back.
    pub(super) fn shorter(&self, a: &[f64; 3], b: &[f64; 3]) -> f64 {
        let l = self.length_m;
        let slope = |end: &[f64; 3], at: f64| {
            6.0 * end[0] / l * at * (1.0 - at) + end[1] * at * (3.0 * at - 2.0)
        };
        let product = |at: f64| slope(a, at) * slope(b, at);
        // Gauss and Legendre, exact for these polynomials.
        let off = 0.15_f64.sqrt();
        l * (5.0 * (product(0.5 - off) + product(0.5 + off)) + 8.0 * product(0.5)) / 18.0
    }

    /// The lowest resonance with an added stiffness, Hz.
    fn lowest_hz(&self, added: &Matrix) -> f64 {
        let has_root_below = |rad2: f64| {
            let entry =
                |a: usize, b: usize| self.stiffness[a][b] + added[a][b] - rad2 * self.mass[a][b];
            negative_pivots(&std::array::from_fn(|a| std::array::from_fn(|b| entry(a, b)))) > 0
        };
        // Above the resonance of the end as a point mass held by everything there is.
        let most = (self.stiffness[0][0] + added[0][0]) / self.mass[0][0];
        bisect(0.0, 2.0 * most, has_root_below).sqrt() / TAU
    }
}

impl Law {
    /// Contact radius over that of the ball.
    fn radius_rel(self, depth_rel: f64) -> f64 {
        let d = depth_rel;
        match self {
            Self::Paper => (d - d * d / 4.0).max(0.0).sqrt(),
            Self::Hertz => d.sqrt(),
            Self::NeoHookean => d.sqrt() * (1.0 - d / 4.0),
            Self::Sneddon | Self::SneddonSeries => {
                bisect(0.0, 1.0 - f64::EPSILON, |x| x * x.atanh() > d)
            }
        }
    }

    /// Force over contact modulus and ball radius squared: twice the integral of the radius.
    fn force_rel(self, depth_rel: f64) -> f64 {
        let d = depth_rel;
        match self {
            Self::Paper => {
                let twice = 2.0 * (1.0 - d / 2.0).clamp(-1.0, 1.0).acos();
                twice - twice.sin()
            }
            Self::Hertz => 4.0 / 3.0 * d.powf(1.5),
            Self::NeoHookean => 4.0 / 3.0 * d.powf(1.5) * (1.0 - 0.15 * d),
            Self::Sneddon | Self::SneddonSeries => {
                let x = self.radius_rel(d);
                (1.0 + x * x) * x.atanh() - x
            }
        }
    }
}

/// The point between `low` and `high` from which on the condition holds.
fn bisect(mut low: f64, mut high: f64, holds: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if holds(middle) {
            high = middle;
        } else {
            low = middle;
        }
    }
    0.5 * (low + high)
}

/// Number of negative pivots of a symmetric matrix: of its negative eigenvalues (Sylvester).
fn negative_pivots(matrix: &Matrix) -> usize {
    let mut m = *matrix;
    let mut count = 0;
    for k in 0..3 {
        count += usize::from(m[k][k] < 0.0);
        for row in k + 1..3 {
            let factor = m[row][k] / m[k][k];
            let by = m[k];
            m[row].iter_mut().zip(by).skip(k).for_each(|(value, by)| *value -= factor * by);
        }
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    fn beam() -> Beam {
        let rig = include_str!("../../../../config/rigs/simulated.toml");
        let keys: super::super::RigKeys = toml::from_str(rig).unwrap();
        Beam::new(&keys.sensor, keys.geometry.probe_radius_mm, 8.0)
    }

    fn contact(direction: Lean, degrees: f64) -> Contact {
        Contact {
            direction,
            angle_rad: degrees.to_radians(),
            depth_mm: 0.5,
            is_held_by_stage: false,
            tangential_ratio: 2.0 / 3.0,
        }
    }

    /// Printed values of a chain of rigid links in Python, which turns by any angle: sample 5 at 0.5 mm.
    #[test]
    fn the_shifts_are_those_of_other_programs() {
        let beam = beam();
        assert!((beam.free_hz() - 140.4).abs() < 0.1, "{}", beam.free_hz());
        let found = |lean, degrees| beam.shift_hz(&contact(lean, degrees), 0.649_f64.ln());
        for (lean, degrees, expected_hz) in [
            (Lean::Front, 0.0, 89.152),
            (Lean::Front, 45.0, 76.967),
            (Lean::Back, 15.0, 83.864),
            (Lean::Back, 45.0, 65.429),
            (Lean::Left, 15.0, 86.794),
        ] {
            let found = found(lean, degrees);
            // The single element is too stiff by up to 0.21 Hz.
            assert!((found - expected_hz - 0.1).abs() < 0.13, "{lean:?} {degrees}°: {found}");
        }
    }

    #[test]
    fn a_stiffness_is_found_again_and_the_stage_indents_less() {
        let beam = beam();
        for is_held_by_stage in [false, true] {
            let contact = Contact { is_held_by_stage, ..contact(Lean::Left, 30.0) };
            for young_mpa in [0.001_f64, 0.045, 0.649, 10.0] {
                let shift_hz = beam.shift_hz(&contact, young_mpa.ln());
                let found = beam.log_young(&contact, shift_hz).unwrap();
                assert!((found - young_mpa.ln()).abs() < 1e-6, "{found} {young_mpa}");
            }
        }
        let held = Contact { is_held_by_stage: true, ..contact(Lean::Front, 0.0) };
        let shift_hz = beam.shift_hz(&held, 0.649_f64.ln());
        assert!((shift_hz - 74.3).abs() < 0.5, "{shift_hz}");
        assert_eq!(beam.log_young(&held, -1.0), None);
    }
}
