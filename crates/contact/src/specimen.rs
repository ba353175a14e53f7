//! Samples that are no elastic half space: one that sticks to the ball, and one that lies thin on a hard
//! base.
//!
//! Both change the contact of the law: at the same depth an adhesive contact is wider and pulls, and a thin
//! sample is stiffer. The analysis knows neither; the simulator and the studies have them as truths.

use std::f64::consts::TAU;

use crate::{Contact, ContactPatch, Depth, LawError, Load, Refusal, Sensor, Tissue, rest::Rest};

/// Adhesion and thickness of a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Specimen {
    work_j_per_m2: f64,
    thickness_mm: f64,
}

/// A refused specimen.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum SpecimenError {
    /// The work of adhesion is negative or not a number.
    #[error("work of adhesion {work_j_per_m2} J/m² is not a number of zero or more")]
    Work {
        /// The value given, J/m².
        work_j_per_m2: f64,
    },
    /// The thickness is not positive.
    #[error("sample thickness {thickness_mm} mm is not positive")]
    Thickness {
        /// The value given, mm.
        thickness_mm: f64,
    },
}

impl Specimen {
    /// Without adhesion, and thick against the contact.
    pub const HALF_SPACE: Self = Self { work_j_per_m2: 0.0, thickness_mm: f64::INFINITY };

    /// A sample with the work of adhesion between it and the ball, J/m², and a thickness, mm, which may be
    /// infinite. It is bonded to its base.
    ///
    /// # Errors
    /// [`SpecimenError`] for a negative work or a thickness that is not positive.
    pub fn new(work_j_per_m2: f64, thickness_mm: f64) -> Result<Self, SpecimenError> {
        if !(work_j_per_m2.is_finite() && work_j_per_m2 >= 0.0) {
            return Err(SpecimenError::Work { work_j_per_m2 });
        }
        if thickness_mm > 0.0 {
            return Ok(Self { work_j_per_m2, thickness_mm });
        }
        Err(SpecimenError::Thickness { thickness_mm })
    }

    /// The smallest thickness, mm, for which a ball of this radius may indent by this depth, both in mm: up to
    /// it the series of a thin sample agrees within 3 % with the finite elements of `tests/peers/contact.py`.
    pub fn least_thickness_mm(radius_mm: f64, depth_mm: f64) -> f64 {
        (radius_mm * depth_mm).sqrt() / THIN_MAX
    }

    /// How many times as stiff as a thick sample it is at a depth in balls of this radius, both in mm.
    pub fn stiffening(&self, radius_mm: f64, depth_mm: f64) -> f64 {
        self.thin(radius_mm, depth_mm / radius_mm).1
    }

    /// The force and the stiffness of a thin, incompressible sample over those of a thick one.
    ///
    /// # Source
    /// Dimitriadis, Horkay, Maresca, Kachar and Chadwick, Biophys. J. 82 (2002) 2798, equation (12). The
    /// stiffness is the derivative of the force.
    fn thin(&self, radius_mm: f64, depth_rel: f64) -> (f64, f64) {
        let x = radius_mm * depth_rel.sqrt() / self.thickness_mm;
        let sum = |of: fn(usize) -> f64| {
            let terms = THIN.iter().enumerate();
            terms.rev().fold(0.0, |sum, (power, coefficient)| sum * x + of(power) * coefficient)
        };
        // The force grows as the 3/2th power of the depth, and a power of x as half of it.
        (sum(|_| 1.0), sum(|power| 1.0 + power as f64 / 3.0))
    }
}

/// Coefficients of the powers of √(R d)/h.
const THIN: [f64; 5] = [1.0, 1.133, 1.283, 0.769, 0.0975];
/// Largest √(R d)/h.
const THIN_MAX: f64 = 0.5;
/// Bisections of a depth: enough for the last digit.
const HALVINGS: u32 = 60;

impl Sensor {
    /// The contact at rest with a specimen: as [`Sensor::load`] if it is a half space without adhesion.
    ///
    /// An adhesive contact is that of Johnson, Kendall and Roberts on the law of the contact: its radius a is
    /// that of a depth which is √(2π w a/E*) larger, and its force is smaller by 2 E* a times that. A ball of
    /// half a millimetre on a soft solid has a Tabor parameter far above five, for which this holds and the
    /// theory of Derjaguin, Muller and Toporov does not. The stiffness is 2 E* a: in a vibration the edge of the
    /// contact has no time to move. The ball comes into contact at the surface, as without adhesion. Friction
    /// ([`crate::Friction::Coulomb`]) is judged without adhesion.
    ///
    /// # Errors
    /// As [`Sensor::load`]; the depth of the law is the larger one.
    ///
    /// # Source
    /// Johnson, Kendall and Roberts, Proc. R. Soc. A 324 (1971) 301; for other profiles Maugis and Barquins,
    /// J. Phys. D 11 (1978) 1989; for the vibration Wahl, Asif, Greenwood and Johnson, J. Colloid Interface
    /// Sci. 296 (2006) 178.
    pub fn load_on(
        &self,
        tissue: &Tissue,
        contact: &Contact,
        specimen: &Specimen,
    ) -> Result<Load, Refusal> {
        let (Depth::Indentation { along_probe_mm } | Depth::Stage { along_probe_mm }) =
            contact.depth;
        if *specimen == Specimen::HALF_SPACE || along_probe_mm <= 0.0 {
            return self.load(tissue, contact);
        }
        let (law, section) = (contact.law, self.section());
        let (radius_m, modulus_pa) = (section.radius_m, tissue.contact_modulus_pa());
        let is_stage = matches!(contact.depth, Depth::Stage { .. });
        let at = |depth_rel: f64| {
            let patch = law.at_valid(depth_rel);
            Adhered::of(&patch, specimen, radius_m, modulus_pa)
        };
        // The move of the ball along the normal that leads to a contact, m.
        let moved_m = |one: &Adhered| {
            let given = Rest::of(section, &contact.pose, one.force_n.max(0.0)).compliance_m_per_n;
            one.depth_m + if is_stage { given * one.force_n } else { 0.0 }
        };
        let wanted_m = along_probe_mm * 1e-3 * contact.pose.cos();
        let limit_rel = law.depth_limit_rel();
        let mut high = limit_rel;
        if moved_m(&at(high)) < wanted_m {
            let depth_rel = limit_rel + (wanted_m - moved_m(&at(high))) / radius_m;
            return Err(LawError::Depth { law, depth_rel, limit_rel }.into());
        }
        // A contact without depth is already as wide as adhesion makes it: below that it is unstable.
        let mut low = 0.0;
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if moved_m(&at(middle)) < wanted_m { low = middle } else { high = middle }
        }
        let found = at(high);
        let depth_rel = found.depth_m / radius_m;
        contact.check_grip(self, tissue, depth_rel)?;
        Ok(Load {
            depth_mm: found.depth_m * 1e3,
            radius_mm: law.at_valid(high).radius_rel * radius_m * 1e3,
            force_n: found.force_n,
            normal_n_per_m: found.normal_n_per_m,
            tangential_n_per_m: found.normal_n_per_m * contact.tangential_ratio(tissue),
        })
    }
}

/// A contact as wide as that of a law at some depth, in SI units.
struct Adhered {
    depth_m: f64,
    force_n: f64,
    normal_n_per_m: f64,
}

impl Adhered {
    fn of(patch: &ContactPatch, specimen: &Specimen, radius_m: f64, modulus_pa: f64) -> Self {
        let (force, stiffness) = specimen.thin(radius_m * 1e3, patch.depth_rel);
        let normal_n_per_m = 2.0 * modulus_pa * radius_m * patch.radius_rel * stiffness;
        // On a thin sample the modulus is the one that its stiffness stands for.
        let pull_m = specimen.work_j_per_m2 / (modulus_pa * stiffness);
        let pulled_m = (TAU * radius_m * patch.radius_rel * pull_m).sqrt();
        Self {
            depth_m: patch.depth_rel * radius_m - pulled_m,
            force_n: modulus_pa * radius_m * radius_m * patch.force_rel * force
                - normal_n_per_m * pulled_m,
            normal_n_per_m,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::{ContactLaw, Pose};

    const RADIUS_M: f64 = 0.5e-3;

    fn contact(depth: Depth, law: ContactLaw) -> Contact {
        Contact { law, ..Contact::new(Pose::UPRIGHT, depth) }
    }

    fn indented(indentation_mm: f64, specimen: &Specimen) -> Load {
        let depth = Depth::Indentation { along_probe_mm: indentation_mm };
        let contact = contact(depth, ContactLaw::Hertz);
        Sensor::reference().load_on(&Tissue::soft(0.1).unwrap(), &contact, specimen).unwrap()
    }

    /// The radius under a force P by Johnson, Kendall and Roberts:
    /// a³ = R/K (P + 3wπR + √(6wπRP + (3wπR)²)) with K = 4/3 E*.
    #[test]
    fn radius_and_force_are_those_of_johnson_kendall_and_roberts() {
        let work = 0.05;
        let specimen = Specimen::new(work, f64::INFINITY).unwrap();
        for indentation_mm in [0.02, 0.1, 0.3, 0.45] {
            let load = indented(indentation_mm, &specimen);
            let stiffness = 4.0 / 3.0 * 0.1e6 / 0.75;
            let pull = 3.0 * PI * work * RADIUS_M;
            let inner = (2.0 * pull * load.force_n + pull * pull).sqrt();
            let radius = (RADIUS_M / stiffness * (load.force_n + pull + inner)).cbrt();
            let found = load.radius_mm * 1e-3;
            assert!((found / radius - 1.0).abs() < 1e-9, "{indentation_mm}: {found} {radius}");
            assert!((load.depth_mm / indentation_mm - 1.0).abs() < 1e-9, "{indentation_mm}");
            assert!(load.force_n < indented(indentation_mm, &Specimen::HALF_SPACE).force_n);
        }
    }

    /// By the same theory the force that pulls the ball off is (3/2) π w R.
    #[test]
    fn a_touch_of_the_surface_pulls_by_eight_ninths_of_the_greatest_pull() {
        let work = 0.05;
        let load = indented(1e-9, &Specimen::new(work, f64::INFINITY).unwrap());
        let expected = -8.0 / 9.0 * 1.5 * PI * work * RADIUS_M;
        assert!((load.force_n / expected - 1.0).abs() < 1e-4, "{} {expected}", load.force_n);
    }

    /// The stiffness is the derivative of the force, and the series that of the source at √(R d)/h = 0.2.
    #[test]
    fn a_thin_sample_is_stiffer_by_the_series_of_dimitriadis() {
        let thin = Specimen::new(0.0, 1.0).unwrap();
        let load = |mm: f64| indented(mm, &thin);
        let thick = indented(0.08, &Specimen::HALF_SPACE);
        let ratio = load(0.08).force_n / thick.force_n;
        let expected = 1.0 + 0.2266 + 0.05132 + 0.006152 + 0.000_156;
        assert!((ratio / expected - 1.0).abs() < 1e-9, "{ratio} {expected}");
        let step = 1e-5;
        let slope = (load(0.3 + step).force_n - load(0.3 - step).force_n) / (2e-3 * step);
        assert!((load(0.3).normal_n_per_m / slope - 1.0).abs() < 1e-6);
    }

    /// The ball indents by what the stage moves less what the sensor gives way.
    #[test]
    fn under_a_held_stage_the_sensor_gives_way_to_the_force_that_is_left() {
        let (sensor, tissue) = (Sensor::reference(), Tissue::soft(0.3).unwrap());
        let specimen = Specimen::new(0.1, 4.0).unwrap();
        let stage = contact(Depth::Stage { along_probe_mm: 0.4 }, ContactLaw::Sneddon);
        let load = sensor.load_on(&tissue, &stage, &specimen).unwrap();
        let given_mm = 0.4 - load.depth_mm;
        let tip_n_per_m = sensor.section().tip_n_per_m();
        let expected_mm = 1e3 * load.force_n / tip_n_per_m;
        assert!((given_mm / expected_mm - 1.0).abs() < 0.01, "{given_mm} {expected_mm}");
        // A specimen with nothing of its own is the half space of the law.
        let nothing = Specimen::new(1e-30, 1e12).unwrap();
        let (found, plain) = (
            sensor.load_on(&tissue, &stage, &nothing).unwrap(),
            sensor.load(&tissue, &stage).unwrap(),
        );
        assert!((found.normal_n_per_m / plain.normal_n_per_m - 1.0).abs() < 1e-9);
        assert!((found.force_n / plain.force_n - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_depth_beyond_the_law_is_refused_as_without_a_specimen() {
        let (sensor, tissue) = (Sensor::reference(), Tissue::soft(0.1).unwrap());
        let specimen = Specimen::new(0.05, 4.0).unwrap();
        let deep = contact(Depth::Indentation { along_probe_mm: 0.5 }, ContactLaw::Hertz);
        let refusal = sensor.load_on(&tissue, &deep, &specimen).unwrap_err();
        assert!(matches!(refusal, Refusal::Law(LawError::Depth { .. })), "{refusal}");
        assert!(Specimen::new(-1.0, 1.0).is_err() && Specimen::new(f64::NAN, 1.0).is_err());
        assert!(Specimen::new(0.0, 0.0).is_err() && Specimen::new(0.0, f64::NAN).is_err());
    }
}
