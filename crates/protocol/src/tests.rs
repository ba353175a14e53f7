//! Plans of the shipped files, and the messages for faulty ones.

mod aim;
mod plan;
mod refusals;
mod summary;

use std::collections::BTreeSet;

use rig_model::{
    AnalyzerMake, AnalyzerRange, Axis, AxisLimits, Geometry, MotionLimits, Orientation, Position,
    ReadingStream, RigLimits, Span,
};

use crate::{
    Action, AngleKnowledge, ExpectedTouch, ModelOrigin, NoSensitivity, Phase, Plan, Prompt,
    Protocol, Sensitivity, Touch, TouchModel, layout::Draws,
};

const THREE_DIRECTION: &str = include_str!("../../../config/protocols/three-direction.toml");
const SMOKE: &str = include_str!("../../../config/protocols/smoke.toml");

fn limits() -> RigLimits {
    let linear = AxisLimits {
        travel: Span::new(0.0, 100.0),
        soft: Span::new(15.0, 95.0),
        rest: Position::new(45.0),
        tolerance: 0.002,
        max_speed_per_s: 50.0,
    };
    let rotary = AxisLimits {
        travel: Span::new(-90.0, 90.0),
        soft: Span::new(-50.0, 50.0),
        rest: Position::new(0.0),
        tolerance: 0.02,
        max_speed_per_s: 60.0,
    };
    RigLimits {
        linear: Axis::new("linear stage", linear).unwrap(),
        rotary: Axis::new("rotary stage", rotary).unwrap(),
        geometry: Geometry {
            surface: Position::new(20.0),
            surface_above_pivot_mm: 2.0,
            probe_beside_pivot_mm: 0.0,
            probe_radius_mm: 0.5,
            sample_half_width_mm: 25.0,
            surface_tolerance_mm: 0.2,
            pin_radius_mm: None,
        },
        motion: MotionLimits {
            max_indentation_mm: 0.8,
            travel_speed_mm_per_s: 20.0,
            contact_speed_mm_per_s: 1.0,
            rotary_speed_deg_per_s: 20.0,
            slowest_mm_per_s: 0.001,
        },
        analyzer: AnalyzerRange {
            frequency_hz: (4.0, 8e6),
            max_level_v: 5.0,
            min_level_v: 0.005,
            shortest_integration_s: 0.0,
            stream: ReadingStream::of(AnalyzerMake::HiokiIm3536),
        },
    }
}

/// About what the sensor of the paper has at a depth of 0.5 mm: a soft sample shifts it by few hertz.
struct PaperLike;

impl TouchModel for PaperLike {
    fn sensitivity(&self, touch: &ExpectedTouch<'_>) -> Result<Sensitivity, NoSensitivity> {
        let per_hz = match touch.sample {
            "1" => 0.1,
            "unknown" => 0.005 / touch.assumed_mpa.ok_or(NoSensitivity::UnknownSample)?,
            "beyond" => return Err(NoSensitivity::OutsideModel),
            _ => 0.02,
        };
        let of_angle = 0.002 + 0.02 * touch.pose.angle.radians().sin();
        Ok(Sensitivity { per_hz, per_mm: 0.64, of_depth: 0.0128, of_angle })
    }
}

#[track_caller]
fn plan_of(text: &str) -> Plan {
    Plan::new(&Protocol::read("protocol.toml", text), &limits(), None, &PaperLike).unwrap()
}

/// The keys that the three-direction protocol leaves to its aim, and a way to state them instead.
const STATED: [(&str, &str); 6] = [
    ("[aim]\n", "\n"),
    ("\nstiffness_percent = 2.9\n", "\n\n"),
    ("# no_load = ", "no_load = "),
    ("# fine_step_mm = 0.016", "fine_step_mm = 0.015"),
    ("# target_sigma_hz = 0.02", "target_sigma_hz = 0.02"),
    ("# target_sigma_hz = 0.05", "target_sigma_hz = 0.05"),
];

/// The three-direction protocol without its aim and with some of its lines changed. Each must be there.
#[track_caller]
fn changed(changes: &[(&str, &str)]) -> String {
    let mut text = THREE_DIRECTION.to_owned();
    for (old, new) in &STATED {
        assert!(text.contains(old), "{old:?} is not in the file");
        text = text.replacen(old, new, 1);
    }
    replaced(text, changes)
}

/// A text with some of its lines changed. Each must be there.
#[track_caller]
fn replaced(mut text: String, changes: &[(&str, &str)]) -> String {
    for (old, new) in changes {
        assert!(text.contains(old), "{old:?} is not in the file");
        text = text.replacen(old, new, 1);
    }
    text
}

/// The messages for a protocol, without the location, which each test would have to count out.
#[track_caller]
fn complaints(changes: &[(&str, &str)], limits: &RigLimits) -> String {
    let protocol = Protocol::read("protocol.toml", &changed(changes));
    let known: Vec<_> = ["1", "2", "3", "4", "5"].map(str::to_owned).into();
    let faults = Plan::new(&protocol, limits, Some(&known), &PaperLike).unwrap_err();
    faults.iter().map(|fault| fault.to_string() + "\n").collect()
}

fn touches(plan: &Plan, wanted: Phase) -> Vec<Touch> {
    let touch = |action| match action {
        Action::Touch(touch) if touch.phase == wanted => Some(touch),
        _ => None,
    };
    plan.steps.iter().filter_map(|step| touch(step.action)).collect()
}

fn prompts(plan: &Plan) -> Vec<Prompt> {
    let prompt = |action| match action {
        Action::Prompt(prompt) => Some(prompt),
        _ => None,
    };
    plan.steps.iter().filter_map(|step| prompt(step.action)).collect()
}

/// Walks through the plan as a bench would, and fails where something was not asked for.
#[track_caller]
fn check_that_every_touch_is_prepared(plan: &Plan) {
    let (mut sample, mut orientation, mut no_load) = (None, None, None);
    for step in &plan.steps {
        match step.action {
            Action::Prompt(Prompt::PlaceSample { sample: placed }) => {
                assert_ne!(sample.replace(placed), Some(placed), "{}: it lies there", step.id);
            }
            Action::Prompt(Prompt::TurnSensor { orientation: turned }) => {
                assert_ne!(orientation.replace(turned), Some(turned), "{}: it stands so", step.id);
            }
            Action::NoLoad(pose) => no_load = Some(pose),
            Action::Touch(touch) => {
                assert_eq!(sample, Some(touch.sample), "{}", step.id);
                assert_eq!(orientation, Some(touch.pose.direction.orientation()), "{}", step.id);
                assert!(no_load.is_some(), "{}", step.id);
            }
        }
    }
    let ids: BTreeSet<_> = plan.steps.iter().map(|step| &step.id).collect();
    assert_eq!(ids.len(), plan.steps.len(), "addresses are unique");
}
