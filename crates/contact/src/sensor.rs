//! The sensor: a piezoelectric bimorph clamped at one end, with a mass and a ball probe at the
//! other.
//!
//! The probe is perpendicular to the bimorph, so that the ball moves along the probe when the beam
//! bends. The tiers model the vibration.

use crate::{SensorDesign, section::Section};

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
    /// The piezoelectric layers turn more of their energy into electricity than any material does.
    #[error("sensor piezo: coupling² = {k2:.3} by its constants is above {limit}")]
    Coupled {
        /// e²/(E ε + e²).
        k2: f64,
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
/// Largest square of the coupling of the layers along the beam: above that of the strongest single crystals.
const COUPLING2_MAX: f64 = 0.85;
/// Widest bimorph in its lengths: beyond, it is a plate.
const WIDTH_MAX_REL: f64 = 2.0;
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
        let [along_mm, across_mm] = design.probe_offset_mm;
        let bounded = [
            ("width_mm", design.width_mm, WIDTH_MAX_REL * design.length_mm),
            ("arm_mm", design.arm_mm, ARM_MAX_REL * design.length_mm),
            ("probe_offset_mm", along_mm.hypot(across_mm), design.length_mm),
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
        let piezo = &design.piezo;
        let coupled = piezo.coupling_c_per_m2.powi(2);
        // GPa · nF/m is C²/m⁴.
        let k2 = coupled / (piezo.modulus_gpa * piezo.permittivity_nf_per_m + coupled);
        if k2 > COUPLING2_MAX {
            return Err(SensorError::Coupled { k2, limit: COUPLING2_MAX });
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
        refused(|d| d.width_mm = 71.0, "sensor width_mm = 71 is outside [0, 70]");
        refused(
            |d| d.piezo.coupling_c_per_m2 = 104.0,
            "sensor piezo: coupling² = 0.930 by its constants is above 0.85",
        );
    }
}
