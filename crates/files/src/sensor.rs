//! The keys of a sensor and of its contact, which a rig file and a scene file share.

use std::ops::RangeInclusive;

use rig_contact::{
    ContactLaw, CoreMaterial, Friction, PiezoMaterial, Sensor, SensorDesign, SensorError,
    inverse::TissueKind,
};

use crate::{
    Complaint,
    settings::{Presence, Setting, Table, with_unit_hint},
};

/// Longer than any part of a bench, mm.
pub(crate) const LONGEST_MM: f64 = 2000.0;

/// The contact of the sensor with every sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactKeys {
    /// Whether the sensor deflects when the stage moves. Otherwise the whole move is an indentation.
    pub deflects: bool,
    /// Growth of the contact with depth.
    pub law: ContactLaw,
    /// Contact along the surface while the sensor vibrates: sticking or frictionless.
    pub friction: Friction,
    /// Properties of every sample, apart from its stiffness.
    pub kind: TissueKind,
}

impl ContactKeys {
    /// A held indentation of soft, sticking samples.
    pub const DEFAULT: Self = Self {
        deflects: false,
        law: ContactLaw::Sneddon,
        friction: Friction::Sticking,
        kind: TissueKind::SOFT,
    };
}

/// Reads the keys of the contact.
pub fn contact(table: &mut Table<'_>, presence: Presence) -> ContactKeys {
    let default = ContactKeys::DEFAULT;
    let depths = [("indentation", false), ("stage", true)];
    let laws = ContactLaw::ALL.map(|law| (law.name(), law));
    let frictions = [("sticking", Friction::Sticking), ("frictionless", Friction::Frictionless)];
    let deflects = presence.read(table.choice("depth", depths), default.deflects).value;
    let law = presence.read(table.choice("law", laws), default.law).value;
    let friction = presence.read(table.choice("friction", frictions), default.friction).value;
    let mut number =
        |key, range, default| presence.read(table.number(key).range(range), default).value;
    let kind = TissueKind {
        poisson: number("poisson", 0.0..=0.5, default.kind.poisson),
        loss: number("tissue_loss", 0.0..=1.0, default.kind.loss),
    };
    ContactKeys { deflects, law, friction, kind }
}

/// The dimensions, masses, materials and losses of a sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DesignKeys {
    /// The values. A faulty one is replaced.
    pub design: SensorDesign,
    /// Whether none of the values is faulty.
    is_sound: bool,
}

impl DesignKeys {
    /// A design that was not read from a file.
    pub const fn new(design: SensorDesign) -> Self {
        Self { design, is_sound: true }
    }

    /// Reads the keys. The ball has its own key, unless its radius in mm is given.
    pub fn read(table: &mut Table<'_>, presence: Presence, probe_radius_mm: Option<f64>) -> Self {
        let reference = SensorDesign::reference();
        let (piezo, is_piezo) = table.section("piezo", piezo).or((reference.piezo, true)).value;
        let (core, is_core) = table.section("core", core).or((reference.core, true)).value;
        let mut is_sound = is_piezo && is_core;
        let mut number = |key, range, default| {
            let read = presence.read(table.number(key).range(range), default);
            is_sound &= read.sound().is_some();
            read.value
        };
        // Real sensors and probes are within these ranges. Other numbers have another unit.
        let design = SensorDesign {
            length_mm: number("length_mm", 1.0..=500.0, reference.length_mm),
            width_mm: number("width_mm", 0.05..=200.0, reference.width_mm),
            piezo_thickness_mm: number(
                "piezo_thickness_mm",
                0.005..=20.0,
                reference.piezo_thickness_mm,
            ),
            core_thickness_mm: number(
                "core_thickness_mm",
                0.005..=20.0,
                reference.core_thickness_mm,
            ),
            probe_radius_mm: probe_radius_mm.unwrap_or_else(|| {
                number("probe_radius_mm", 0.01..=50.0, reference.probe_radius_mm)
            }),
            arm_mm: number("arm_mm", 0.0..=1000.0, reference.arm_mm),
            probe_offset_mm: reference.probe_offset_mm,
            tip_mass_g: number("tip_mass_g", 0.0..=1000.0, reference.tip_mass_g),
            tip_gyration_mm: number("tip_gyration_mm", 0.0..=1000.0, reference.tip_gyration_mm),
            piezo,
            core,
            // Without any loss a sensor rings for ever.
            beam_loss: number("beam_loss", 1e-6..=1.0, reference.beam_loss),
            dielectric_loss: number("dielectric_loss", 0.0..=1.0, reference.dielectric_loss),
        };
        Self { design, is_sound }
    }

    /// The sensor of this design. An impossible sensor is a fault of its section, and is replaced by
    /// the reference sensor.
    pub fn sensor<T>(&self, table: &Table<'_>, section: &Setting<T>) -> Sensor {
        Sensor::new(self.design).unwrap_or_else(|error| {
            if self.is_sound && section.sound().is_some() {
                table.refuse(section, &SensorFault(error));
            }
            Sensor::reference()
        })
    }
}

/// The material of the piezoelectric layers, and whether none of its constants is faulty.
fn piezo(table: &mut Table<'_>) -> (PiezoMaterial, bool) {
    let mut is_sound = true;
    let mut number = |key, range| constant(table, key, range, &mut is_sound);
    let material = PiezoMaterial {
        modulus_gpa: number("modulus_gpa", MODULUS_GPA),
        shear_gpa: number("shear_gpa", SHEAR_GPA),
        density_kg_per_m3: number("density_kg_per_m3", DENSITY_KG_PER_M3),
        // From polymers to the strongest single crystals.
        coupling_c_per_m2: number("coupling_c_per_m2", 0.001..=100.0),
        permittivity_nf_per_m: number("permittivity_nf_per_m", 0.01..=200.0),
    };
    (material, is_sound)
}

/// The material of the core, and whether none of its constants is faulty.
fn core(table: &mut Table<'_>) -> (CoreMaterial, bool) {
    let mut is_sound = true;
    let mut number = |key, range| constant(table, key, range, &mut is_sound);
    let material = CoreMaterial {
        modulus_gpa: number("modulus_gpa", MODULUS_GPA),
        shear_gpa: number("shear_gpa", SHEAR_GPA),
        density_kg_per_m3: number("density_kg_per_m3", DENSITY_KG_PER_M3),
    };
    (material, is_sound)
}

/// From rubber to diamond, and from wood to osmium. Other numbers have another unit.
const MODULUS_GPA: RangeInclusive<f64> = 0.001..=1500.0;
const SHEAR_GPA: RangeInclusive<f64> = 0.0003..=700.0;
const DENSITY_KG_PER_M3: RangeInclusive<f64> = 100.0..=25_000.0;

fn constant(
    table: &mut Table<'_>,
    key: &'static str,
    range: RangeInclusive<f64>,
    is_sound: &mut bool,
) -> f64 {
    let read = table.number(key).range(range).required();
    *is_sound &= read.sound().is_some();
    read.value
}

/// A sensor that cannot be built.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
struct SensorFault(SensorError);

impl Complaint for SensorFault {
    fn suggestion(&self) -> Option<String> {
        match &self.0 {
            SensorError::OutOfRange { what, found, limit } => {
                let is_within = |meant| 0.0 <= meant && meant <= *limit;
                Some(with_unit_hint(format!("use at most {limit}"), what, *found, is_within))
            }
            SensorError::NotSlender { length_mm, limit_mm } => {
                let is_within = |meant| *limit_mm <= meant && meant <= LONGEST_MM;
                let advice = format!("use at least {limit_mm:.3}");
                Some(with_unit_hint(advice, "length_mm", *length_mm, is_within))
            }
            // The message names the field and its limit.
            SensorError::NotPositive { .. } => None,
            SensorError::Coupled { .. } => Some(
                "give modulus, coupling and permittivity of one material in GPa, C/m² and nF/m"
                    .to_owned(),
            ),
        }
    }
}
