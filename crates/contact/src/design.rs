//! The dimensions and materials of a sensor, before they are checked.

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
    /// Offset of that centre from the axis of the probe: along the bimorph, and across it, mm.
    pub probe_offset_mm: [f64; 2],
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
            probe_offset_mm: [0.0; 2],
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
