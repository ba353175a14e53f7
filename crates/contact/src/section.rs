//! The constants of the bimorph's cross section and of its tip, in SI units.

use crate::SensorDesign;

/// A beam with its tip mass, reduced to the constants that the tiers need.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Section {
    pub(crate) length_m: f64,
    /// Bending in the plane of the probe, electrodes shorted.
    pub(crate) bending_n_m2: f64,
    /// Bending across that plane.
    pub(crate) lateral_n_m2: f64,
    pub(crate) torsion_n_m2: f64,
    pub(crate) mass_kg_per_m: f64,
    /// Polar inertia about the beam's axis.
    pub(crate) roll_kg_m: f64,
    pub(crate) tip_mass_kg: f64,
    /// Inertia of the tip about the end of the beam, in pitch and in roll.
    pub(crate) tip_inertia_kg_m2: f64,
    pub(crate) radius_m: f64,
    pub(crate) arm_m: f64,
    pub(crate) offset_m: [f64; 2],
    pub(crate) beam_loss: f64,
    /// Capacitance of the two layers in parallel, with the beam held still.
    pub(crate) capacitance_f: f64,
    pub(crate) dielectric_loss: f64,
    /// Bending moment at the end of the electrodes for one volt.
    pub(crate) moment_n_m_per_v: f64,
}

impl Section {
    /// Classical laminate theory of a thin beam; thin-plate torsion; electrodes over the whole
    /// length, both layers in parallel.
    pub(crate) fn of(design: &SensorDesign) -> Self {
        let mm = 1e-3;
        let (piezo, core) = (&design.piezo, &design.core);
        let (width, length) = (design.width_mm * mm, design.length_mm * mm);
        let (layer, middle) = (design.piezo_thickness_mm * mm, design.core_thickness_mm * mm);
        let (inner, outer) = (0.5 * middle, 0.5 * middle + layer);
        // The second moments, per width, of both piezoelectric layers and of the core.
        let piezo_moment = 2.0 / 3.0 * (outer.powi(3) - inner.powi(3));
        let core_moment = 2.0 / 3.0 * inner.powi(3);
        let sum = |of_piezo: f64, of_core: f64| 2.0 * layer * of_piezo + middle * of_core;
        let giga = 1e9;
        let mass = width * sum(piezo.density_kg_per_m3, core.density_kg_per_m3);
        let tip_mass = design.tip_mass_g * 1e-3;
        Self {
            length_m: length,
            bending_n_m2: width
                * giga
                * (piezo.modulus_gpa * piezo_moment + core.modulus_gpa * core_moment),
            lateral_n_m2: width.powi(3) / 12.0 * giga * sum(piezo.modulus_gpa, core.modulus_gpa),
            torsion_n_m2: 4.0
                * width
                * giga
                * (piezo.shear_gpa * piezo_moment + core.shear_gpa * core_moment),
            mass_kg_per_m: mass,
            roll_kg_m: mass * width.powi(2) / 12.0,
            tip_mass_kg: tip_mass,
            tip_inertia_kg_m2: tip_mass * (design.tip_gyration_mm * mm).powi(2),
            radius_m: design.probe_radius_mm * mm,
            arm_m: design.arm_mm * mm,
            offset_m: design.probe_offset_mm.map(|offset| offset * mm),
            beam_loss: design.beam_loss,
            capacitance_f: 2.0 * piezo.permittivity_nf_per_m * 1e-9 * width * length / layer,
            dielectric_loss: design.dielectric_loss,
            // Each layer at the distance of its middle plane, the field being one volt per layer.
            moment_n_m_per_v: 2.0 * piezo.coupling_c_per_m2 * width * 0.5 * (inner + outer),
        }
    }

    /// Stiffness of the end of the bimorph against a force across it, 3EI/L³.
    pub(crate) fn tip_n_per_m(&self) -> f64 {
        3.0 * self.bending_n_m2 / self.length_m.powi(3)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(what: &str, found: f64, expected: f64) {
        assert!((found / expected - 1.0).abs() < 1e-12, "{what}: {found} is not {expected}");
    }

    /// By hand, for the width of 5.888 mm: 61 GPa · 2/3 · (0.3³ − 0.1³) mm³ and so on.
    #[test]
    fn the_constants_of_the_reference_beam() {
        let section = Section::of(&SensorDesign::reference());
        check("bending", section.bending_n_m2, 5.888e-3 * (61.0 * 0.052 + 100.0 * 0.002) / 3.0);
        check("lateral", section.lateral_n_m2, 5.888e-3_f64.powi(3) / 12.0 * 44.4e6);
        check("torsion", section.torsion_n_m2, 5.888e-3 * 4.0 * (21.1 * 0.052 + 5.0 * 0.002) / 3.0);
        check("mass", section.mass_kg_per_m, 5.888e-3 * (0.4e-3 * 7750.0 + 0.2e-3 * 1600.0));
        check("capacitance", section.capacitance_f, 2.0 * 13.3e-9 * 5.888e-3 * 35.0 / 0.2);
        check("moment", section.moment_n_m_per_v, 2.0 * 10.4 * 5.888e-3 * 0.2e-3);
        check("inertia", section.tip_inertia_kg_m2, 0.418e-3 * 3.6e-3 * 3.6e-3);
    }
}
