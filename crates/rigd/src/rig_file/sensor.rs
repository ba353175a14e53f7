//! The sensor by which shifts are turned into stiffness, and how well it touches.
//!
//! Nothing of it moves anything: only the analysis of a run and the check of a protocol read it.

use rig_analysis::sensor::{SensorDescription, Uncertainty};
use rig_contact::{
    ContactLaw, CoreMaterial, Friction, PiezoMaterial, Sensor, SensorDesign, inverse::TissueKind,
};
use rig_files::settings::Table;
use rig_model::Geometry;

use super::refusal::Refusal;

/// The section as it was read, its sensor not yet checked.
struct SensorRead {
    design: SensorDesign,
    /// Whether every dimension could be read.
    is_sound: bool,
    deflects: bool,
    law: ContactLaw,
    friction: Friction,
    kind: TissueKind,
    uncertainty: Uncertainty,
}

/// Reads the section; its ball is that of the `geometry`, when this could be read.
pub(super) fn sensor(table: &mut Table<'_>, geometry: Option<&Geometry>) -> SensorDescription {
    let mut reference = SensorDesign::reference();
    if let Some(geometry) = geometry {
        reference.probe_radius_mm = geometry.probe_radius_mm;
    }
    let default = SensorRead {
        design: reference,
        is_sound: true,
        deflects: false,
        law: ContactLaw::Sneddon,
        friction: Friction::Sticking,
        kind: TissueKind::SOFT,
        uncertainty: Uncertainty::TYPICAL,
    };
    let section = table.section("sensor", |table| section(table, &reference)).or(default);
    let sensor = Sensor::new(section.value.design).unwrap_or_else(|error| {
        if section.sound().is_some_and(|section| section.is_sound) {
            table.refuse(&section, &Refusal::Sensor(error));
        }
        Sensor::reference()
    });
    let SensorRead { deflects, law, friction, kind, uncertainty, .. } = section.value;
    SensorDescription { sensor, deflects, law, friction, kind, uncertainty }
}

fn section(table: &mut Table<'_>, reference: &SensorDesign) -> SensorRead {
    let (design, is_sound) = design(table, reference);
    let depths = [("indentation", false), ("stage", true)];
    let frictions = [("sticking", Friction::Sticking), ("frictionless", Friction::Frictionless)];
    let laws = ContactLaw::ALL.map(|law| (law.name(), law));
    let soft = TissueKind::SOFT;
    SensorRead {
        design,
        is_sound,
        deflects: table.choice("depth", depths).or(false).value,
        law: table.choice("law", laws).or(ContactLaw::Sneddon).value,
        friction: table.choice("friction", frictions).or(Friction::Sticking).value,
        kind: TissueKind {
            poisson: table.number("poisson").range(0.0..=0.5).or(soft.poisson).value,
            loss: table.number("tissue_loss").range(0.0..=1.0).or(soft.loss).value,
        },
        uncertainty: table.section("uncertainty", uncertainty).or(Uncertainty::TYPICAL).value,
    }
}

/// The dimensions, and whether all of them could be read.
fn design(table: &mut Table<'_>, reference: &SensorDesign) -> (SensorDesign, bool) {
    let piezo = table.section("piezo", piezo).or(reference.piezo).value;
    let core = table.section("core", core).or(reference.core).value;
    let mut is_sound = true;
    let mut number = |key, range, default| {
        let read = table.number(key).range(range).or(default);
        is_sound &= read.sound().is_some();
        read.value
    };
    // From what nobody makes to what no probe has: beyond, the unit is another one.
    let design = SensorDesign {
        length_mm: number("length_mm", 1.0..=500.0, reference.length_mm),
        width_mm: number("width_mm", 0.05..=200.0, reference.width_mm),
        piezo_thickness_mm: number(
            "piezo_thickness_mm",
            0.005..=20.0,
            reference.piezo_thickness_mm,
        ),
        core_thickness_mm: number("core_thickness_mm", 0.005..=20.0, reference.core_thickness_mm),
        probe_radius_mm: reference.probe_radius_mm,
        arm_mm: number("arm_mm", 0.0..=1000.0, reference.arm_mm),
        tip_mass_g: number("tip_mass_g", 0.0..=1000.0, reference.tip_mass_g),
        tip_gyration_mm: number("tip_gyration_mm", 0.0..=1000.0, reference.tip_gyration_mm),
        piezo,
        core,
        beam_loss: number("beam_loss", 0.0..=1.0, reference.beam_loss),
        dielectric_loss: number("dielectric_loss", 0.0..=1.0, reference.dielectric_loss),
    };
    (design, is_sound)
}

fn piezo(table: &mut Table<'_>) -> PiezoMaterial {
    let mut number = |key| table.number(key).required().value;
    PiezoMaterial {
        modulus_gpa: number("modulus_gpa"),
        shear_gpa: number("shear_gpa"),
        density_kg_per_m3: number("density_kg_per_m3"),
        coupling_c_per_m2: number("coupling_c_per_m2"),
        permittivity_nf_per_m: number("permittivity_nf_per_m"),
    }
}

fn core(table: &mut Table<'_>) -> CoreMaterial {
    let mut number = |key| table.number(key).required().value;
    CoreMaterial {
        modulus_gpa: number("modulus_gpa"),
        shear_gpa: number("shear_gpa"),
        density_kg_per_m3: number("density_kg_per_m3"),
    }
}

fn uncertainty(table: &mut Table<'_>) -> Uncertainty {
    let mut size = |key, most, default| table.number(key).range(0.0..=most).or(default).value;
    Uncertainty {
        depth_mm: size("depth_mm", 5.0, Uncertainty::TYPICAL.depth_mm),
        angle_deg: size("angle_deg", 45.0, Uncertainty::TYPICAL.angle_deg),
        sample_rel: size("sample_rel", 1.0, Uncertainty::TYPICAL.sample_rel),
        scale_rel: size("scale_rel", 1.0, Uncertainty::TYPICAL.scale_rel),
    }
}
