//! Claims on the experiment.

use rig_contact::{ContactLaw, Models, Sensor, SensorDesign, Tier};

use super::{Assessment, Claim, claim};

pub(super) fn claims() -> Vec<Claim> {
    let per_length = {
        let no_load = |length_mm: f64| {
            let design = SensorDesign { length_mm, ..SensorDesign::reference() };
            let sensor = Sensor::new(design).expect("these lengths can be built");
            Models::new(&sensor, ContactLaw::Sneddon).no_load_hz(Tier::Exact)
        };
        (no_load(35.35) / no_load(34.65)).ln() / (35.35_f64 / 34.65).ln()
    };
    vec![
        claim(
            "section 3.2",
            "the samples' stiffness is consistent with the simulation",
            Assessment::Undecided,
            "Shore OO is not a modulus; in Table 3 below the order is right and the ratios are not",
        ),
        claim(
            "section 3.2",
            "137.6 Hz is about the simulation's 140.4 Hz",
            Assessment::Holds,
            format!(
                "{:.1} %; with d ln f/d ln L = {per_length:.2} this is {:.2} mm of free length at the \
                 clamp",
                100.0 * (137.6 / 140.4 - 1.0),
                35.0 * (140.4_f64 / 137.6).ln() / -per_length
            ),
        ),
        claim(
            "section 3.2",
            "the experiment is consistent with the simulation, and both with the theory",
            Assessment::Undecided,
            "no shifts are printed; in Figures 7 and 12 below, equation (7) falls by 11.9 % and a \
             sensor with tilt by 20 to 23 %, and a figure of five slightly falling curves shows \
             either",
        ),
    ]
}
