//! The simulated bench of a rehearsal.

use std::path::PathBuf;

use rig_files::Location;
use rig_files::rig_file::{Connection, Pace, RigFile, SimulatedPerson, Simulation};
use rig_protocol::Plan;
use rig_sim::world::{Assembly, Mechanics, Sample, Scene, TrueGeometry};
use rig_store::Source;

use crate::loaded_rig::{LoadedRig, LoadedScene};

/// The stiffness of a sample that the rig file does not know, MPa: the middle of the paper's.
const STIFFNESS_MPA: f64 = 0.235;

/// The depth at which a sample of the rehearsal tears, mm.
const TEARS_AT_MM: f64 = 1.0;

/// The rig with simulated devices of the same makes. Without a scene of its own, the bench is as the rig
/// file describes it.
pub(super) fn simulated(rig: &LoadedRig, plan: &Plan) -> LoadedRig {
    let scene = rig.scene.as_ref().map_or_else(
        || bench_of(&rig.file, plan),
        |loaded| LoadedScene { scene: loaded.scene.clone(), source: loaded.source.clone() },
    );
    let simulation = Simulation {
        scene: PathBuf::new(),
        scene_location: Location { line: 1, column: 1 },
        pace: Pace::Virtual,
        person: SimulatedPerson::Waits,
    };
    let file = RigFile { connection: Connection::Simulated(simulation), ..rig.file.clone() };
    LoadedRig {
        path: PathBuf::new(),
        file,
        instruments: rig.instruments,
        source: rig.source.clone(),
        scene: Some(scene),
    }
}

fn bench_of(file: &RigFile, plan: &Plan) -> LoadedScene {
    let matched = rig_sim::scene::matched();
    let known = |name: &String| {
        let found = file.samples.iter().find(|known| known.name == *name);
        found.map_or(STIFFNESS_MPA, |known| known.stiffness_mpa)
    };
    let sample = |name: &String| Sample {
        name: name.clone(),
        stiffness_mpa: known(name),
        max_indentation_mm: TEARS_AT_MM,
        thickness_mm: f64::INFINITY,
    };
    let (geometry, linear, rotary) =
        (&file.limits.geometry, &file.limits.linear, &file.limits.rotary);
    let scene = Scene {
        name: format!("the bench of {}", file.name),
        samples: plan.samples.iter().map(sample).collect(),
        place: TrueGeometry {
            surface_mm: geometry.surface.value(),
            surface_above_pivot_mm: geometry.surface_above_pivot_mm,
            probe_beside_pivot_mm: geometry.probe_beside_pivot_mm,
            edge_mm: f64::INFINITY,
            pin_mm: geometry.pin_radius_mm,
        },
        linear: Mechanics {
            start: linear.rest_target().position().value(),
            travel: (linear.travel().min.value(), linear.travel().max.value()),
            assembly: Assembly::AS_DESCRIBED,
        },
        rotary: Mechanics {
            start: rotary.rest_target().position().value(),
            travel: (rotary.travel().min.value(), rotary.travel().max.value()),
            assembly: Assembly::AS_DESCRIBED,
        },
        ..matched
    };
    let source = Source { name: scene.name.clone(), toml: String::new() };
    LoadedScene { scene, source }
}
