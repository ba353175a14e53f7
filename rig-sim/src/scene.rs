//! Scenes: what stands on the simulated bench.

use rig_contact::{ContactLaw, Friction, SensorDesign};
use rig_model::Orientation;

use crate::world::{Drift, Mechanics, Nuisances, Place, Sample, Scene, SensorScene};

/// The paper's sensor and its five samples, on a bench with the nuisances of a good laboratory.
///
/// # Source
/// Sensors 20 (2020) 6607, Table 2 for the samples.
pub fn paper() -> Scene {
    let sample = |(name, stiffness_mpa): (&str, f64)| Sample {
        name: name.to_owned(),
        stiffness_mpa,
        max_indentation_mm: 1.0,
    };
    Scene {
        sensor: SensorScene {
            design: SensorDesign::reference(),
            gives_way: false,
            law: ContactLaw::Sneddon,
            friction: Friction::Sticking,
            poisson: 0.5,
            tissue_loss: 0.1,
        },
        samples: [("1", 0.045), ("2", 0.104), ("3", 0.235), ("4", 0.320), ("5", 0.649)]
            .map(sample)
            .to_vec(),
        place: Place { surface_mm: 10.0, surface_above_pivot_mm: 4.0, probe_beside_pivot_mm: 0.3 },
        linear: Mechanics { start: 40.0, travel: (0.0, 50.0) },
        rotary: Mechanics { start: 0.0, travel: (-60.0, 60.0) },
        orientation: Orientation::FrontBack,
        nuisances: Nuisances {
            mounting_mm: 0.1,
            slope_deg: 1.0,
            stiffness: 0.03,
            screw_mm: 0.014,
            screw_length_mm: 0.3,
            linear_backlash_mm: 0.002,
            rotary_backlash_deg: 0.02,
            encoder_steps: 0.3,
            drift: Drift { warm_up_hz: 0.3, warm_up_s: 3600.0, walk_hz_per_sqrt_hour: 0.1 },
            impedance_at_ten_cycles: 0.005,
            analyzer_command_s: 50e-6,
        },
    }
}
