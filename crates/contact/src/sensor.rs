//! The sensor: a piezoelectric bimorph clamped at one end, with a mass and a ball probe at the
//! other.
//!
//! The probe stands perpendicular to the bimorph, so that the ball moves along the probe when the
//! beam bends. The tiers model the vibration.

use crate::section::Section;

/// A piezoelectric layer of the bimorph, in the reduced constants of a thin beam.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PiezoMaterial {
    /// Elastic modulus at constant electric field, GPa.
    pub modulus_gpa: f64,
    /// Shear modulus, GPa.
    pub shear_gpa: f64,
    /// Density, kg/m³.
    pub density_kg_per_m3: f64,
    /// Magnitude of the piezoelectric stress constant e31, C/m².
    pub coupling_c_per_m2: f64,
    /// Permittivity at constant strain, nF/m.
    pub permittivity_nf_per_m: f64,
}

/// The layer between the two piezoelectric ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CoreMaterial {
    /// Elastic modulus along the beam, GPa.
    pub modulus_gpa: f64,
    /// Shear modulus, GPa.
    pub shear_gpa: f64,
    /// Density, kg/m³.
    pub density_kg_per_m3: f64,
}

/// The description of a sensor before it is checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorDesign {
    /// Free length of the bimorph from the clamp to the probe, mm.
    pub length_mm: f64,
    /// Width of the bimorph, mm.
    pub width_mm: f64,
    /// Thickness of each of the two piezoelectric layers, mm.
    pub piezo_thickness_mm: f64,
    /// Thickness of the layer between them, mm.
    pub core_thickness_mm: f64,
    /// Radius of the ball at the tip of the probe, mm.
    pub probe_radius_mm: f64,
    /// Length of the probe from the middle plane of the bimorph to the centre of the ball, mm.
    pub arm_mm: f64,
    /// Mass of the probe and its fixture, g.
    pub tip_mass_g: f64,
    /// Radius of gyration of that mass about the end of the bimorph, in pitch and in roll, mm.
    pub tip_gyration_mm: f64,
    /// The piezoelectric layers.
    pub piezo: PiezoMaterial,
    /// The layer between them.
    pub core: CoreMaterial,
    /// Loss factor of the bending beam, the reciprocal of its quality factor.
    pub beam_loss: f64,
    /// Dielectric loss tangent of the piezoelectric layers.
    pub dielectric_loss: f64,
}

impl SensorDesign {
    /// The sensor behind the printed numbers of this crate.
    ///
    /// Length, ball radius and materials are the paper's. Width and tip mass follow from its two
    /// printed facts, the no-load resonance of 140.4 Hz and the sensitivity of 134.11 Hz/MPa
    /// between 0.045 MPa and 0.649 MPa at 0.5 mm; layers, arm, inertia and losses are assumed.
    /// A sensor with a longer arm and a wider beam can have the same two facts.
    ///
    /// # Source
    /// Sensors 20 (2020) 6607, section 3.1.1 and Tables 1 and 2. PZT-5A: Erturk and Inman,
    /// Piezoelectric Energy Harvesting (2011), appendix E.
    pub const fn reference() -> Self {
        Self {
            length_mm: 35.0,
            width_mm: 5.888,
            piezo_thickness_mm: 0.2,
            core_thickness_mm: 0.2,
            probe_radius_mm: 0.5,
            arm_mm: 8.0,
            tip_mass_g: 0.418,
            tip_gyration_mm: 3.6,
            piezo: PiezoMaterial {
                modulus_gpa: 61.0,
                shear_gpa: 21.1,
                density_kg_per_m3: 7750.0,
                coupling_c_per_m2: 10.4,
                permittivity_nf_per_m: 13.3,
            },
            core: CoreMaterial { modulus_gpa: 100.0, shear_gpa: 5.0, density_kg_per_m3: 1600.0 },
            beam_loss: 0.015,
            dielectric_loss: 0.018,
        }
    }
}

/// A refused sensor design.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum SensorError {
    /// A dimension, a mass or a material constant is not positive.
    #[error("sensor {what} must be a positive number, found {found}")]
    NotPositive {
        /// The field of [`SensorDesign`].
        what: &'static str,
        /// The value given.
        found: f64,
    },
    /// A quantity that may be zero is negative or too large.
    #[error("sensor {what} = {found} is outside [0, {limit}]")]
    OutOfRange {
        /// The field of [`SensorDesign`].
        what: &'static str,
        /// The value given.
        found: f64,
        /// The largest allowed value.
        limit: f64,
    },
    /// The beam is too thick for its length: shear, which no tier models, would matter.
    #[error("sensor length_mm = {length_mm} is below {limit_mm:.3}, ten times the thickness")]
    NotSlender {
        /// The length given, mm.
        length_mm: f64,
        /// The shortest allowed length, mm.
        limit_mm: f64,
    },
}

/// A checked sensor with the constants of its beam.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensor {
    design: SensorDesign,
    section: Section,
}

/// Shortest length in thicknesses. Shear changes the resonance by a share of about 3 (t/L)².
const SLENDERNESS_MIN: f64 = 10.0;
/// Largest loss factor: above it there is no resonance.
pub(crate) const LOSS_MAX: f64 = 1.0;
/// Heavier than any probe on a bimorph.
const TIP_MASS_MAX_G: f64 = 1000.0;
/// Longest probe arm in beam lengths.
const ARM_MAX_REL: f64 = 2.0;

impl Sensor {
    /// Checks a design.
    ///
    /// # Errors
    /// [`SensorError`] with the first field at fault.
    pub fn new(design: SensorDesign) -> Result<Self, SensorError> {
        let positive = [
            ("length_mm", design.length_mm),
            ("width_mm", design.width_mm),
            ("piezo_thickness_mm", design.piezo_thickness_mm),
            ("core_thickness_mm", design.core_thickness_mm),
            ("probe_radius_mm", design.probe_radius_mm),
            ("piezo.modulus_gpa", design.piezo.modulus_gpa),
            ("piezo.shear_gpa", design.piezo.shear_gpa),
            ("piezo.density_kg_per_m3", design.piezo.density_kg_per_m3),
            ("piezo.coupling_c_per_m2", design.piezo.coupling_c_per_m2),
            ("piezo.permittivity_nf_per_m", design.piezo.permittivity_nf_per_m),
            ("core.modulus_gpa", design.core.modulus_gpa),
            ("core.shear_gpa", design.core.shear_gpa),
            ("core.density_kg_per_m3", design.core.density_kg_per_m3),
        ];
        for (what, found) in positive {
            if !(found.is_finite() && found > 0.0) {
                return Err(SensorError::NotPositive { what, found });
            }
        }
        let bounded = [
            ("arm_mm", design.arm_mm, ARM_MAX_REL * design.length_mm),
            ("tip_mass_g", design.tip_mass_g, TIP_MASS_MAX_G),
            ("tip_gyration_mm", design.tip_gyration_mm, ARM_MAX_REL * design.length_mm),
            ("beam_loss", design.beam_loss, LOSS_MAX),
            ("dielectric_loss", design.dielectric_loss, LOSS_MAX),
        ];
        for (what, found, limit) in bounded {
            if !(0.0 <= found && found <= limit) {
                return Err(SensorError::OutOfRange { what, found, limit });
            }
        }
        let thickness_mm = 2.0 * design.piezo_thickness_mm + design.core_thickness_mm;
        let limit_mm = SLENDERNESS_MIN * thickness_mm;
        if design.length_mm < limit_mm {
            return Err(SensorError::NotSlender { length_mm: design.length_mm, limit_mm });
        }
        Ok(Self { design, section: Section::of(&design) })
    }

    /// The sensor of [`SensorDesign::reference`].
    pub fn reference() -> Self {
        let design = SensorDesign::reference();
        Self { design, section: Section::of(&design) }
    }

    /// Dimensions and materials.
    pub const fn design(&self) -> &SensorDesign {
        &self.design
    }

    /// The beam's constants in SI units.
    pub(crate) const fn section(&self) -> &Section {
        &self.section
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn refused(change: impl Fn(&mut SensorDesign), message: &str) {
        let mut design = SensorDesign::reference();
        change(&mut design);
        assert_eq!(Sensor::new(design).unwrap_err().to_string(), message);
    }

    #[test]
    fn a_sensor_that_cannot_be_built_is_refused_by_field() {
        assert_eq!(Sensor::new(SensorDesign::reference()), Ok(Sensor::reference()));
        refused(|d| d.width_mm = 0.0, "sensor width_mm must be a positive number, found 0");
        refused(
            |d| d.length_mm = f64::NAN,
            "sensor length_mm must be a positive number, found NaN",
        );
        refused(|d| d.beam_loss = 1.5, "sensor beam_loss = 1.5 is outside [0, 1]");
        refused(|d| d.arm_mm = -1.0, "sensor arm_mm = -1 is outside [0, 70]");
        refused(|d| d.tip_mass_g = f64::INFINITY, "sensor tip_mass_g = inf is outside [0, 1000]");
        refused(
            |d| d.length_mm = 5.9,
            "sensor length_mm = 5.9 is below 6.000, ten times the thickness",
        );
    }
}
