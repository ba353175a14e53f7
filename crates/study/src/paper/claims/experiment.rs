//! Claims on the experiment.

use rig_contact::{ContactLaw, Models, Sensor, SensorDesign, Tier};

use super::{Claim, Verdict, claim};
use crate::paper_bench::SAMPLES_MPA;

pub(super) fn claims() -> Vec<Claim> {
    let shore = [24.0, 32.0, 60.0, 68.0, 75.0].map(young_of_shore_oo_mpa);
    let list = |values: &[f64]| {
        values.iter().map(|value| format!("{value:.2}")).collect::<Vec<_>>().join(", ")
    };
    let ratios = |values: &[f64]| -> Vec<f64> { values.windows(2).map(|p| p[1] / p[0]).collect() };
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
            "Table 3",
            "the samples' stiffness is consistent with the simulation",
            Verdict::Undecided,
            format!(
                "Shore OO is no modulus; with the durometer's nominal spring and ball (not confirmed) \
                 and Sneddon's contact the values mean {} MPa, neighbours {} apart instead of {}: the \
                 order is right",
                list(&shore),
                list(&ratios(&shore)),
                list(&ratios(&SAMPLES_MPA))
            ),
        ),
        claim(
            "section 3.2",
            "137.6 Hz is about the simulation's 140.4 Hz",
            Verdict::Holds,
            format!(
                "{:.1} %; with d ln f/d ln L = {per_length:.2} this is {:.2} mm of free length at the \
                 clamp",
                100.0 * (137.6 / 140.4 - 1.0),
                35.0 * (140.4_f64 / 137.6).ln() / -per_length
            ),
        ),
    ]
}

/// Young's modulus of an incompressible half space under a durometer of type OO.
///
/// Nominally a ball of 3/32 inch, up to 2.5 mm deep, under a spring of 0.203 N to 1.111 N.
///
/// # Source
/// The constants are those commonly quoted of ASTM D2240, and were not checked against it.
fn young_of_shore_oo_mpa(hardness: f64) -> f64 {
    let ball_mm = 25.4 * 3.0 / 64.0;
    let depth_mm = 2.5 * (1.0 - hardness / 100.0);
    let force_n = 0.203 + 0.009_08 * hardness;
    let spot =
        ContactLaw::Sneddon.at(depth_mm / ball_mm).expect("the ball is at most sunk to its top");
    // F = E* R² f, and E* = E/(1 − ν²).
    0.75 * force_n / (ball_mm * ball_mm * spot.force_rel)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By Hertz's contact sample 1 would be 98 kPa; the softer the ball's contact, the stiffer.
    #[test]
    fn shore_values_become_moduli_in_the_papers_order() {
        let moduli = [24.0, 32.0, 60.0, 68.0, 75.0].map(young_of_shore_oo_mpa);
        assert!(moduli.is_sorted(), "{moduli:?}");
        assert!((0.08..0.12).contains(&moduli[0]) && (0.8..1.1).contains(&moduli[4]), "{moduli:?}");
    }
}
