//! Scene files. What they may say is shown, with comments, in `config/scenes/paper.toml`.

use std::fmt;

use rig_contact::{ContactLaw, CoreMaterial, PiezoMaterial, Sensor, SensorDesign, SensorError};
use rig_files::{
    Complaint, Faults,
    settings::{Setting, Table},
};
use rig_model::Orientation;

use crate::world::{Drift, Mechanics, Nuisances, Sample, Scene, SensorScene, TrueGeometry};

/// Largest seed: TOML has no larger whole numbers.
const MAX_SEED: u64 = i64::MAX as u64;

/// Reads and checks the `text` of a scene `file`.
///
/// By how much the model of the sensor may be wrong where the scene does not say, Hz: half a percent
/// of the largest shift, and less than a bench repeats in two mountings.
const TOLERANCE_HZ: f64 = 0.5;

/// # Errors
/// Everything that is wrong with it.
pub fn read(file: &str, text: &str) -> Result<Scene, Faults> {
    let (scene, faults) = rig_files::settings::read(file, text, scene);
    faults.finish(scene)
}

/// The scene that is shipped: the paper's sensor and samples.
///
/// # Panics
/// Never: a test reads it.
pub fn paper() -> Scene {
    let text = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../config/scenes/paper.toml"));
    read("paper.toml", text).expect("the shipped scene is sound")
}

fn scene(table: &mut Table<'_>) -> Scene {
    let samples = table.section("samples", sample).list().required();
    for (index, sample) in samples.value.iter().enumerate() {
        let name = &sample.value.name;
        let is_known = samples.value[..index].iter().any(|known| known.value.name == *name);
        if is_known && sample.sound().is_some() {
            table.refuse(sample, &Refusal::SampleTwice { name: name.clone() });
        }
    }
    let contact = table.section("contact", contact).required().value;
    let design = table.section("sensor", sensor).required();
    if let Some(Err(error)) = design.sound().map(|design| Sensor::new(*design)) {
        table.refuse(&design, &Refusal::Sensor(error));
    }
    Scene {
        name: table.text("name").required().value,
        seed: table.whole("seed").range(0..=MAX_SEED).or(1).value,
        orientation: table.choice("orientation", ORIENTATIONS).or(Orientation::FrontBack).value,
        sensor: SensorScene { design: design.value, ..contact },
        samples: samples.value.into_iter().map(|sample| sample.value).collect(),
        place: table.section("place", place).required().value,
        linear: table
            .section("linear", |table| mechanics(table, "start_mm", "travel_mm"))
            .required()
            .value,
        rotary: table
            .section("rotary", |table| mechanics(table, "start_deg", "travel_deg"))
            .required()
            .value,
        nuisances: table.section("nuisances", nuisances).or(Nuisances::NONE).value,
    }
}

const ORIENTATIONS: [(&str, Orientation); 2] = [
    (Orientation::FrontBack.name(), Orientation::FrontBack),
    (Orientation::Left.name(), Orientation::Left),
];

fn sample(table: &mut Table<'_>) -> Sample {
    Sample {
        name: table.text("name").required().value,
        stiffness_mpa: table.number("stiffness_mpa").above(0.0).required().value,
        max_indentation_mm: table.number("max_indentation_mm").above(0.0).required().value,
    }
}

/// The contact, with a sensor that is replaced by that of its own section.
fn contact(table: &mut Table<'_>) -> SensorScene {
    let depths = [("indentation", false), ("stage", true)];
    let frictions = [("sticking", true), ("frictionless", false)];
    SensorScene {
        design: SensorDesign::reference(),
        gives_way: table.choice("depth", depths).required().value,
        law: table.choice("law", ContactLaw::ALL.map(|law| (law.name(), law))).required().value,
        sticks: table.choice("friction", frictions).required().value,
        tolerance_hz: table.number("tolerance_hz").above(0.0).or(TOLERANCE_HZ).value,
        poisson: table.number("poisson").range(0.0..=0.5).required().value,
        tissue_loss: table.number("tissue_loss").range(0.0..=1.0).required().value,
    }
}

/// What these numbers may be is the business of [`Sensor::new`], which names the field at fault.
fn sensor(table: &mut Table<'_>) -> SensorDesign {
    let reference = SensorDesign::reference();
    let piezo = table.section("piezo", piezo).or(reference.piezo).value;
    let core = table.section("core", core).or(reference.core).value;
    let mut number = |key| table.number(key).required().value;
    SensorDesign {
        length_mm: number("length_mm"),
        width_mm: number("width_mm"),
        piezo_thickness_mm: number("piezo_thickness_mm"),
        core_thickness_mm: number("core_thickness_mm"),
        probe_radius_mm: number("probe_radius_mm"),
        arm_mm: number("arm_mm"),
        tip_mass_g: number("tip_mass_g"),
        tip_gyration_mm: number("tip_gyration_mm"),
        piezo,
        core,
        beam_loss: number("beam_loss"),
        dielectric_loss: number("dielectric_loss"),
    }
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

fn place(table: &mut Table<'_>) -> TrueGeometry {
    let mut number = |key| table.number(key).required().value;
    TrueGeometry {
        surface_mm: number("surface_mm"),
        surface_above_pivot_mm: number("surface_above_pivot_mm"),
        probe_beside_pivot_mm: number("probe_beside_pivot_mm"),
    }
}

fn mechanics(table: &mut Table<'_>, start: &'static str, travel: &'static str) -> Mechanics {
    let start = table.number(start).required();
    let travel = table.number(travel).interval().required();
    if let (Some(place), Some((min, max))) = (start.sound(), travel.sound())
        && !(min..=max).contains(&place)
    {
        table.refuse(&start, &Refusal::BeyondTravel(start, travel));
    }
    Mechanics { start: start.value, travel: travel.value }
}

fn nuisances(table: &mut Table<'_>) -> Nuisances {
    let none = Nuisances::NONE;
    let screw_length_mm = table.number("screw_length_mm").above(0.0).or(none.screw_length_mm).value;
    let drift = table.section("drift", drift).or(none.drift).value;
    let mut share = |key| table.number(key).range(0.0..=1.0).or(0.0).value;
    let (stiffness_rel, impedance_rel) = (share("stiffness_rel"), share("impedance_rel"));
    let mut size = |key| table.number(key).at_least(0.0).or(0.0).value;
    Nuisances {
        mounting_mm: size("mounting_mm"),
        slope_deg: size("slope_deg"),
        stiffness_rel,
        screw_mm: size("screw_mm"),
        screw_length_mm,
        linear_backlash_mm: size("linear_backlash_mm"),
        rotary_backlash_deg: size("rotary_backlash_deg"),
        encoder_steps: size("encoder_steps"),
        drift,
        impedance_rel,
        analyzer_command_s: size("analyzer_command_s"),
    }
}

fn drift(table: &mut Table<'_>) -> Drift {
    let none = Nuisances::NONE.drift;
    Drift {
        warm_up_hz: table.number("warm_up_hz").or(none.warm_up_hz).value,
        warm_up_s: table.number("warm_up_s").above(0.0).or(none.warm_up_s).value,
        walk_hz_per_sqrt_hour: table.number("walk_hz_per_sqrt_hour").at_least(0.0).or(0.0).value,
    }
}

/// What is wrong with a scene whose values are right one by one.
#[derive(Debug)]
enum Refusal {
    BeyondTravel(Setting<f64>, Setting<(f64, f64)>),
    SampleTwice { name: String },
    Sensor(SensorError),
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BeyondTravel(start, travel) => {
                let (min, max) = travel.value;
                write!(f, "{start} is outside {} = [{min}, {max}]", travel.key)
            }
            Self::SampleTwice { name } => write!(f, "there are two samples named \"{name}\""),
            Self::Sensor(error) => write!(f, "{error}"),
        }
    }
}

impl Complaint for Refusal {}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(written: &str, instead: &str, message: &str) {
        let text = include_str!("../../config/scenes/paper.toml");
        assert!(text.contains(written), "{written}");
        let faults = read("s.toml", &text.replacen(written, instead, 1)).unwrap_err();
        let told: Vec<_> = faults.iter().map(ToString::to_string).collect();
        assert!(told[0].contains(message), "{told:?}");
        assert_eq!(told.len(), 1, "{told:?}");
    }

    #[test]
    fn the_shipped_scene_is_the_papers_bench() {
        let scene = paper();
        assert_eq!(scene.sensor.design, SensorDesign::reference());
        let stiffness: Vec<f64> = scene.samples.iter().map(|sample| sample.stiffness_mpa).collect();
        assert_eq!(stiffness, [0.045, 0.104, 0.235, 0.320, 0.649]);
        assert!(crate::world::World::new(scene, 1).is_ok());
    }

    #[test]
    fn what_may_be_left_out_is_none() {
        let text = include_str!("../../config/scenes/paper.toml");
        let (start, end) = (text.find("[sensor.piezo]").unwrap(), text.find("[contact]").unwrap());
        let nuisances = text.find("[nuisances]").unwrap();
        let short = format!("{}{}", &text[..start], &text[end..nuisances]);
        let scene = read("s.toml", &short).unwrap();
        assert_eq!(scene.nuisances, Nuisances::NONE);
        assert_eq!(scene.sensor, paper().sensor);
    }

    #[test]
    fn what_is_wrong_is_told_by_its_key() {
        check("start_mm = 40", "start_mm = 60", "start_mm = 60 is outside travel_mm = [0, 50]");
        check("name = \"2\"", "name = \"1\"", "there are two samples named \"1\"");
        check("length_mm = 35", "length_mm = 5.9", "sensor length_mm = 5.9 is below 6.000");
        check("stiffness_mpa = 0.104", "stiffness_mpa = 0", "stiffness_mpa = 0");
        check("law = \"sneddon\"", "law = \"snedon\"", "did you mean \"sneddon\"");
        check("slope_deg = 1", "slope_degrees = 1", "`slope_degrees` is not a key in [nuisances]");
    }
}
