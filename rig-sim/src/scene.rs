//! Scene files. The comments in `config/scenes/paper.toml` are the manual of their keys; those of adhesion and
//! thickness are in `matched.toml`, those of a bench that is not as its rig file describes it in `new-bench.toml`.

use std::ops::RangeInclusive;

use rig_contact::{Friction, SensorDesign, Specimen};
use rig_files::{
    Complaint, Faults,
    samples::{KnownSample, samples},
    sensor::{self, ContactKeys, DesignKeys},
    settings::{Presence, Setting, Table},
};
use rig_model::Orientation;

use crate::world::{
    Assembly, Drift, Mechanics, Nuisances, PersonScene, Relaxation, Sample, Scene, SensorScene,
    TrueGeometry,
};

/// Largest whole number of TOML.
const MAX_SEED: u64 = i64::MAX as u64;

/// Allowed error of the model of the sensor, Hz, for a scene without this key: half a percent of the
/// largest shift, and less than the difference between two mountings on a bench.
const TOLERANCE_HZ: f64 = 0.5;

/// Reads and checks the `text` of a scene `file`.
///
/// # Errors
/// All faults of the file.
pub fn read(file: &str, text: &str) -> Result<Scene, Faults> {
    let (scene, faults) = rig_files::settings::read(file, text, scene);
    faults.finish(scene)
}

/// The JSON Schema of scene files.
pub fn schema() -> serde_json::Value {
    rig_files::settings::schema("scene file of rigd", scene)
}

/// The scene of the shipped rig: the paper's samples under a sensor and a contact that differ from what
/// the rig file describes.
///
/// # Panics
/// Never: a test reads it.
pub fn paper() -> Scene {
    let text = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../config/scenes/paper.toml"));
    read("paper.toml", text).expect("the shipped scene is sound")
}

/// The scene whose sensor and contact are those of the rig file.
///
/// # Panics
/// Never: a test reads it.
pub fn matched() -> Scene {
    let text = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../config/scenes/matched.toml"));
    read("matched.toml", text).expect("the shipped scene is sound")
}

fn scene(table: &mut Table<'_>) -> Scene {
    let listed = samples(table, Presence::Required, sample);
    let contact = table.section("contact", contact).required().value;
    let section = table.section("sensor", design).required();
    let sensor = section.value.sensor(table, &section);
    let samples = listed.into_iter().map(|(sample, thickness)| {
        if let Some(thickness) = thickness.filter(|thickness| thickness.sound().is_some()) {
            let radius_mm = sensor.design().probe_radius_mm;
            let least_mm = Specimen::least_thickness_mm(radius_mm, sample.max_indentation_mm);
            if contact.poisson != 0.5 {
                table.refuse(&thickness, &ThinAndCompressible { poisson: contact.poisson });
            } else if thickness.value < least_mm {
                table.refuse(&thickness, &TooThin { thickness_mm: thickness.value, least_mm });
            }
        }
        sample
    });
    let samples = samples.collect();
    Scene {
        name: table.text("name").required().value,
        seed: table.whole("seed").range(0..=MAX_SEED).or(1).value,
        orientation: table.choice("orientation", ORIENTATIONS).or(Orientation::FrontBack).value,
        sensor: SensorScene { design: *sensor.design(), ..contact },
        samples,
        place: table.section("place", place).required().value,
        linear: table.section("linear", |table| mechanics(table, &LINEAR)).required().value,
        rotary: table.section("rotary", |table| mechanics(table, &ROTARY)).required().value,
        nuisances: table.section("nuisances", nuisances).or(Nuisances::NONE).value,
        person: table.section("person", person).or(PersonScene::RELIABLE).value,
    }
}

const ORIENTATIONS: [(&str, Orientation); 2] = [
    (Orientation::FrontBack.name(), Orientation::FrontBack),
    (Orientation::Left.name(), Orientation::Left),
];

/// Deeper than any sample is thick, mm.
const DEEPEST_MM: f64 = 100.0;

/// Largest work of adhesion, J/m²: that of a glue. Silicone on glass has 0.05.
const ADHESION_MAX: f64 = 10.0;

/// Furthest that a ball may be from the axis of its probe, mm: further than any probe is bent.
const BALL_OFFSET_MAX_MM: f64 = 5.0;

/// Largest height of debris on the tip, mm.
const DEBRIS_MAX_MM: f64 = 1.0;

/// Furthest place on a bench, mm: a bench is smaller than a metre.
const BENCH_MM: RangeInclusive<f64> = -1000.0..=1000.0;

/// Tilts that a table may have, degrees: beyond a quarter turn the probe is below the sample.
const TILT_DEG: RangeInclusive<f64> = -90.0..=90.0;

/// Largest play, scatter of a height and error of a screw, mm or degrees.
const PLAY_MAX: f64 = 10.0;

/// Lengths over which the error of a screw changes, mm: from less than a step to more than a bench.
const SCREW_LENGTH_MM: RangeInclusive<f64> = 1e-3..=1e4;

/// Largest standard deviation of a slope, degrees. A slope of four of them is nearly a wall.
const SLOPE_MAX_DEG: f64 = 20.0;

/// Largest jitter of an encoder, steps.
const ENCODER_MAX_STEPS: f64 = 1e4;

/// Longest time of an analyzer for one command, s.
const COMMAND_MAX_S: f64 = 10.0;

/// Largest shift of the resonance by warmth and by the walk of an hour, Hz: a sensor has about 140 Hz.
const DRIFT_MAX_HZ: f64 = 20.0;

/// Largest shift of the resonance for a square volt, Hz/V². An analyzer has up to 20 V.
const LEVEL_MAX_HZ_PER_V2: f64 = 0.1;

/// Reads the sensor. A rig file describes a ball on the axis of its probe, a scene may have it beside.
fn design(table: &mut Table<'_>) -> DesignKeys {
    let mut keys = DesignKeys::read(table, Presence::Required, None);
    let range = -BALL_OFFSET_MAX_MM..=BALL_OFFSET_MAX_MM;
    let mut offset_mm = |key| table.number(key).range(range.clone()).or(0.0).value;
    keys.design.probe_offset_mm = [offset_mm("ball_along_mm"), offset_mm("ball_across_mm")];
    keys
}

fn sample(table: &mut Table<'_>, known: KnownSample) -> (Sample, Option<Setting<f64>>) {
    let KnownSample { name, stiffness_mpa } = known;
    let tears = table.number("max_indentation_mm").range(0.001..=DEEPEST_MM).required();
    let max_indentation_mm = tears.value;
    let thickness = table.number("thickness_mm").above(0.0).optional();
    let thickness_mm = thickness.as_ref().map_or(f64::INFINITY, |thickness| thickness.value);
    (Sample { name, stiffness_mpa, max_indentation_mm, thickness_mm }, thickness)
}

/// Reads the contact. The design is replaced by that of the section `[sensor]`.
fn contact(table: &mut Table<'_>) -> SensorScene {
    let ContactKeys { deflects, law, friction, kind } = sensor::contact(table, Presence::Required);
    let sticking = table.number("tangential_ratio").range(0.0..=1.5).optional();
    let tangential_ratio = match friction {
        Friction::Frictionless => 0.0,
        _ => sticking.map_or(kind.tangential_ratio(), |ratio| ratio.value),
    };
    let coefficient = table.number("friction_coefficient").above(0.0).optional();
    let part = table.number("relaxation_part").range(0.0..=0.9).or(0.0).value;
    let time_s = table.number("relaxation_s").above(0.0).or(Relaxation::NONE.time_s).value;
    SensorScene {
        design: SensorDesign::reference(),
        deflects,
        law,
        tangential_ratio,
        friction_coefficient: coefficient.map_or(f64::INFINITY, |coefficient| coefficient.value),
        relaxation: Relaxation { part, time_s },
        adhesion_j_per_m2: table
            .number("adhesion_j_per_m2")
            .range(0.0..=ADHESION_MAX)
            .or(0.0)
            .value,
        tolerance_hz: table.number("tolerance_hz").above(0.0).or(TOLERANCE_HZ).value,
        poisson: kind.poisson,
        tissue_loss: kind.loss,
    }
}

fn place(table: &mut Table<'_>) -> TrueGeometry {
    let edge = table.number("edge_mm").range(BENCH_MM).optional();
    let pin = table.number("pin_mm").above(0.0).at_most(*BENCH_MM.end()).optional();
    let mut number = |key| table.number(key).range(BENCH_MM).required().value;
    TrueGeometry {
        edge_mm: edge.map_or(f64::INFINITY, |edge| edge.value),
        pin_mm: pin.map(|pin| pin.value),
        surface_mm: number("surface_mm"),
        surface_above_pivot_mm: number("surface_above_pivot_mm"),
        probe_beside_pivot_mm: number("probe_beside_pivot_mm"),
    }
}

/// The keys of a stage.
struct StageKeys {
    start: &'static str,
    travel: &'static str,
    step: &'static str,
    zero: &'static str,
    /// Where the stage may be.
    range: RangeInclusive<f64>,
}

const LINEAR: StageKeys = StageKeys {
    start: "start_mm",
    travel: "travel_mm",
    step: "mm_per_step",
    zero: "zero_mm",
    range: BENCH_MM,
};
const ROTARY: StageKeys = StageKeys {
    start: "start_deg",
    travel: "travel_deg",
    step: "deg_per_step",
    zero: "zero_deg",
    range: TILT_DEG,
};

/// Largest step of a drive, mm or degrees.
const STEP_MAX: f64 = 10.0;

/// Furthest zero of a drive, mm or degrees: a counter may have wound on.
const ZERO_MAX: f64 = 1e5;

fn mechanics(table: &mut Table<'_>, keys: &StageKeys) -> Mechanics {
    let step = table.number(keys.step).range(-STEP_MAX..=STEP_MAX).optional();
    let units_per_step = step.and_then(|step| {
        if step.value == 0.0 {
            table.refuse(&step, &NoStep { key: keys.step });
        }
        step.sound().copied().filter(|step| *step != 0.0)
    });
    let zero = table.number(keys.zero).range(-ZERO_MAX..=ZERO_MAX).optional();
    let zero = zero.map(|zero| zero.value);
    let start = table.number(keys.start).required();
    let travel = table.number(keys.travel).range(keys.range.clone()).interval().required();
    if let (Some(place), Some((min, max))) = (start.sound(), travel.sound())
        && !(min..=max).contains(&place)
    {
        table.refuse(&start, &StartBeyondTravel { start, travel });
    }
    let assembly = Assembly { units_per_step, zero };
    Mechanics { start: start.value, travel: travel.value, assembly }
}

fn person(table: &mut Table<'_>) -> PersonScene {
    let reliable = PersonScene::RELIABLE;
    PersonScene {
        wrong_answers: table
            .number("wrong_answers")
            .range(0.0..=1.0)
            .or(reliable.wrong_answers)
            .value,
    }
}

fn nuisances(table: &mut Table<'_>) -> Nuisances {
    let none = Nuisances::NONE;
    let length = table.number("screw_length_mm").range(SCREW_LENGTH_MM);
    let screw_length_mm = length.or(none.screw_length_mm).value;
    let drift = table.section("drift", drift).or(none.drift).value;
    let mut share = |key| table.number(key).range(0.0..=1.0).or(0.0).value;
    let (stiffness_rel, impedance_rel) = (share("stiffness_rel"), share("impedance_rel"));
    let analyzer_phase_deg = table.number("analyzer_phase_deg").range(-10.0..=10.0).or(0.0).value;
    let capacitance_slope = table.number("capacitance_slope").range(-0.2..=0.2).or(0.0).value;
    let debris_mm = table.number("debris_mm").range(0.0..=DEBRIS_MAX_MM).or(0.0).value;
    let position_age_s = table.number("position_age_s").range(0.0..=0.1).or(0.0).value;
    let level = -LEVEL_MAX_HZ_PER_V2..=LEVEL_MAX_HZ_PER_V2;
    let level_hz_per_v2 = table.number("level_hz_per_v2").range(level).or(0.0).value;
    let mut size = |key, most| table.number(key).range(0.0..=most).or(0.0).value;
    Nuisances {
        mounting_mm: size("mounting_mm", PLAY_MAX),
        slope_deg: size("slope_deg", SLOPE_MAX_DEG),
        stiffness_rel,
        screw_mm: size("screw_mm", PLAY_MAX),
        screw_length_mm,
        linear_backlash_mm: size("linear_backlash_mm", PLAY_MAX),
        rotary_backlash_deg: size("rotary_backlash_deg", PLAY_MAX),
        homing_mm: size("homing_mm", PLAY_MAX),
        homing_deg: size("homing_deg", PLAY_MAX),
        encoder_steps: size("encoder_steps", ENCODER_MAX_STEPS),
        position_age_s,
        drift,
        level_hz_per_v2,
        impedance_rel,
        analyzer_phase_deg,
        capacitance_slope,
        analyzer_command_s: size("analyzer_command_s", COMMAND_MAX_S),
        debris_mm,
    }
}

fn drift(table: &mut Table<'_>) -> Drift {
    let none = Nuisances::NONE.drift;
    let warm_up_hz = table.number("warm_up_hz").range(-DRIFT_MAX_HZ..=DRIFT_MAX_HZ);
    let warm_up_hz = warm_up_hz.or(none.warm_up_hz).value;
    let walk = table.number("walk_hz_per_sqrt_hour").range(0.0..=DRIFT_MAX_HZ);
    Drift {
        warm_up_hz,
        walk_hz_per_sqrt_hour: walk.or(0.0).value,
        warm_up_s: table.number("warm_up_s").above(0.0).or(none.warm_up_s).value,
    }
}

/// An axis that starts outside its travel.
#[derive(Debug, thiserror::Error)]
#[error("{start} is outside {} = [{}, {}]", travel.key, travel.value.0, travel.value.1)]
struct StartBeyondTravel {
    start: Setting<f64>,
    travel: Setting<(f64, f64)>,
}

impl Complaint for StartBeyondTravel {}

/// A drive whose steps move nothing.
#[derive(Debug, thiserror::Error)]
#[error("{key} = 0 moves nothing")]
struct NoStep {
    key: &'static str,
}

impl Complaint for NoStep {}

/// A sample so thin that its model does not hold down to the depth at which it tears.
#[derive(Debug, thiserror::Error)]
#[error("thickness_mm = {thickness_mm} is below {least_mm:.3}, the least for max_indentation_mm")]
struct TooThin {
    thickness_mm: f64,
    least_mm: f64,
}

impl Complaint for TooThin {
    fn suggestion(&self) -> Option<String> {
        Some("use a thicker sample or a smaller max_indentation_mm".to_owned())
    }
}

/// The model of a thin sample is that of an incompressible one.
#[derive(Debug, thiserror::Error)]
#[error("thickness_mm needs poisson = 0.5, found {poisson}")]
struct ThinAndCompressible {
    poisson: f64,
}

impl Complaint for ThinAndCompressible {
    fn suggestion(&self) -> Option<String> {
        Some("use poisson = 0.5, or leave thickness_mm out for a thick sample".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(written: &str, instead: &str, message: &str) {
        let text = include_str!("../../config/scenes/matched.toml");
        assert!(text.contains(written), "{written}");
        let faults = read("s.toml", &text.replacen(written, instead, 1)).unwrap_err();
        let told: Vec<_> = faults.iter().map(ToString::to_string).collect();
        assert!(told[0].contains(message), "{told:?}");
        assert_eq!(told.len(), 1, "{told:?}");
    }

    #[test]
    fn the_matched_scene_is_the_papers_bench() {
        let scene = matched();
        assert_eq!(scene.sensor.design, SensorDesign::reference());
        let stiffness: Vec<f64> = scene.samples.iter().map(|sample| sample.stiffness_mpa).collect();
        assert_eq!(stiffness, [0.045, 0.104, 0.235, 0.320, 0.649]);
        assert!(crate::world::World::new(scene, 1).is_ok());
    }

    /// A run on it shows what the analysis does with a bench that it was not told about.
    #[test]
    fn the_shipped_scene_differs_from_the_description_in_all_that_the_analysis_assumes() {
        let (bench, model) = (paper(), matched());
        let (sensor, described) = (&bench.sensor, &model.sensor);
        assert_ne!(sensor.law, described.law);
        assert_ne!(sensor.deflects, described.deflects);
        assert_ne!(sensor.design.arm_mm, described.design.arm_mm);
        assert_ne!(sensor.design.probe_radius_mm, described.design.probe_radius_mm);
        assert_ne!(sensor.tangential_ratio, described.tangential_ratio);
        assert!(sensor.friction_coefficient.is_finite() && sensor.relaxation.part > 0.0);
        assert_eq!(bench.samples, model.samples);
        assert!(crate::world::World::new(bench, 1).is_ok());
    }

    #[test]
    fn optional_sections_may_be_left_out() {
        let text = include_str!("../../config/scenes/matched.toml");
        let (start, end) = (text.find("[sensor.piezo]").unwrap(), text.find("[contact]").unwrap());
        let nuisances = text.find("[nuisances]").unwrap();
        let short = format!("{}{}", &text[..start], &text[end..nuisances]);
        let scene = read("s.toml", &short).unwrap();
        assert_eq!(scene.nuisances, Nuisances::NONE);
        assert_eq!(scene.sensor, matched().sensor);
    }

    #[test]
    fn a_ball_may_be_beside_the_axis_of_its_probe() {
        let text = include_str!("../../config/scenes/matched.toml");
        let keys = "ball_along_mm = 0";
        assert!(text.contains(keys));
        let scene = read("s.toml", &text.replacen(keys, "ball_along_mm = 0.3", 1)).unwrap();
        assert_eq!(scene.sensor.design.probe_offset_mm, [0.3, 0.0]);
        let across = text.replacen("ball_across_mm = 0", "ball_across_mm = -0.2", 1);
        let scene = read("s.toml", &across).unwrap();
        assert_eq!(scene.sensor.design.probe_offset_mm, [0.0, -0.2]);
        assert!(crate::world::World::new(scene, 1).is_ok());
        check(keys, "ball_along_mm = 300", "ball_along_mm = 300");
        check(keys, "ball_along_mm = -6", "ball_along_mm = -6");
        // Without the keys the ball is on the axis.
        let without = text.replacen(keys, "", 1).replacen("ball_across_mm = 0", "", 1);
        assert_eq!(read("s.toml", &without).unwrap().sensor, matched().sensor);
    }

    #[test]
    fn samples_may_stick_and_lie_thin_on_a_base() {
        let text = include_str!("../../config/scenes/matched.toml");
        let tears = "max_indentation_mm = 1.0 # Depth at which it tears.";
        assert!(text.contains(tears));
        let thin = text.replacen(tears, &format!("{tears}\nthickness_mm = 3"), 1);
        let sticky = thin.replacen("adhesion_j_per_m2 = 0", "adhesion_j_per_m2 = 0.05", 1);
        let scene = read("s.toml", &sticky).unwrap();
        assert_eq!(scene.samples[0].thickness_mm, 3.0);
        assert_eq!(scene.samples[1].thickness_mm, f64::INFINITY);
        assert_eq!(scene.sensor.adhesion_j_per_m2, 0.05);
        assert!(crate::world::World::new(scene, 1).is_ok());
        let with = |thickness| format!("{tears}\nthickness_mm = {thickness}");
        check(tears, &with("1"), "thickness_mm = 1 is below 1.414, the least for max_indentation");
        check(tears, &with("0"), "thickness_mm = 0");
        let compressible = sticky.replacen("poisson = 0.5", "poisson = 0.45", 1);
        let faults = read("s.toml", &compressible).unwrap_err().to_string();
        assert!(faults.contains("thickness_mm needs poisson = 0.5, found 0.45"), "{faults}");
        check("adhesion_j_per_m2 = 0", "adhesion_j_per_m2 = -1", "adhesion_j_per_m2 = -1");
    }

    #[test]
    fn a_bench_may_differ_from_its_rig_file() {
        let text = include_str!("../../config/scenes/new-bench.toml");
        let scene = read("s.toml", text).unwrap();
        let described = Assembly::AS_DESCRIBED;
        let longer = Assembly { units_per_step: Some(0.00102), zero: Some(0.0) };
        assert_eq!(scene.linear.assembly, longer);
        let turned = Assembly { units_per_step: Some(-0.01), zero: Some(0.8) };
        assert_eq!(scene.rotary.assembly, turned);
        assert_eq!(scene.person, PersonScene { wrong_answers: 0.1 });
        assert!(crate::world::World::new(scene, 1).is_ok());
        // Without the keys it is as described, and its person is reliable.
        let bench = matched();
        assert_eq!([bench.linear.assembly, bench.rotary.assembly], [described; 2]);
        assert_eq!(bench.person, PersonScene::RELIABLE);
        let misread = text.replacen("wrong_answers = 0.1", "wrong_answers = 1.5", 1);
        let faults = read("s.toml", &misread).unwrap_err().to_string();
        assert!(faults.contains("wrong_answers = 1.5"), "{faults}");
    }

    #[test]
    fn a_value_that_no_bench_has_is_refused() {
        for (written, key, value) in [
            ("analyzer_command_s = 50e-6", "analyzer_command_s", "1e20"),
            ("warm_up_hz = 0.3", "warm_up_hz", "-1e6"),
            ("walk_hz_per_sqrt_hour = 0.1", "walk_hz_per_sqrt_hour", "1e9"),
            ("slope_deg = 1", "slope_deg", "1000"),
            ("mounting_mm = 0.06", "mounting_mm", "1e9"),
            ("screw_length_mm = 0.3", "screw_length_mm", "1e-300"),
            ("encoder_steps = 0.3", "encoder_steps", "1e12"),
            ("linear_backlash_mm = 0.002", "linear_backlash_mm", "1e9"),
            ("surface_mm = 10.03", "surface_mm", "1e308"),
            ("probe_beside_pivot_mm = 0.32", "probe_beside_pivot_mm", "-1e5"),
            ("travel_mm = [0, 50]", "travel_mm", "[0, 1e9]"),
            ("travel_deg = [-60, 60]", "travel_deg", "[-170, 170]"),
            ("seed = 2020", "nuisances.level_hz_per_v2", "1"),
        ] {
            let text = include_str!("../../config/scenes/matched.toml");
            let text = match key.strip_prefix("nuisances.") {
                Some(key) => format!("{}\n[nuisances]\n{key} = {value}\n", without_nuisances(text)),
                None => text.replacen(written, &format!("{key} = {value}"), 1),
            };
            assert!(text.contains(&format!(" = {value}")), "{written}");
            let faults = read("s.toml", &text).unwrap_err();
            let told: Vec<_> = faults.iter().map(ToString::to_string).collect();
            let key = key.strip_prefix("nuisances.").unwrap_or(key);
            assert!(told.iter().all(|told| told.contains(key)), "{told:?}");
            assert!(told.iter().any(|told| told.contains(" the limit of ")), "{told:?}");
        }
    }

    fn without_nuisances(text: &str) -> &str {
        &text[..text.find("[nuisances]").unwrap()]
    }

    #[test]
    fn a_fault_names_its_key() {
        check("start_mm = 40", "start_mm = 40\nmm_per_step = 0", "mm_per_step = 0 moves nothing");
        check("start_mm = 40", "start_mm = 60", "start_mm = 60 is outside travel_mm = [0, 50]");
        check("name = \"2\"", "name = \"1\"", "there are two samples named \"1\"");
        check("length_mm = 35", "length_mm = 5.9", "sensor length_mm = 5.9 is below 6.000");
        check("length_mm = 35", "length_mm = 0.035", "if 0.035 is in metres, write 35");
        check("length_mm = 35", "", "`length_mm` is missing in [sensor]");
        check("modulus_gpa = 61.0", "", "`modulus_gpa` is missing in [sensor.piezo]");
        check("modulus_gpa = 100", "", "`modulus_gpa` is missing in [sensor.core]");
        check("stiffness_mpa = 0.104", "stiffness_mpa = 0", "stiffness_mpa = 0");
        check("modulus_gpa = 61.0", "modulus_gpa = 61e9", "if 61000000000 is in Pa, write 61");
        check("= 7750 # Density", "= 7.75 # Density", "if 7.75 is in g/cm³, write 7750");
        check("shear_gpa = 5 ", "shear_gpa = -5 ", "shear_gpa = -5 is below the limit");
        check("coupling_c_per_m2 = 10.4", "coupling_c_per_m2 = 99", "coupling² = 0.924");
        check("width_mm = 5.888", "width_mm = 80", "sensor width_mm = 80 is outside [0, 70]");
        check("beam_loss = 0.015", "beam_loss = 0", "beam_loss = 0 is below the limit of 0.000001");
        check("max_indentation_mm = 1.0", "max_indentation_mm = 1e9", "above the limit of 100 mm");
        check("law = \"sneddon\"", "law = \"snedon\"", "did you mean \"sneddon\"");
        check("slope_deg = 1", "slope_degrees = 1", "`slope_degrees` is not a key in [nuisances]");
    }
}
