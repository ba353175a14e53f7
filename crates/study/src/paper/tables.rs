//! Tables 1 to 3: materials, samples and hardness.

use rig_contact::{ContactLaw, Direction, Models, SensorDesign, Tier};

use super::figures::noiseless;
use crate::{
    page::{Page, Table},
    paper_bench::{Control, SAMPLES_MPA},
    simulate::TouchSimulation,
};

pub(super) fn add(page: &mut Page) {
    page.heading("Tables 1 to 3");
    materials(page);
    samples(page);
    hardness(page);
}

fn materials(page: &mut Page) {
    page.text(
        "Table 1 names materials and gives no constants. Ours are from the literature. Width, \
         thicknesses, probe and losses are not printed.",
    );
    let SensorDesign { piezo, core, .. } = SensorDesign::reference();
    let mut table = Table::new(&["part", "printed", "ours"]);
    table.row([
        "probe".to_owned(),
        "stainless steel".to_owned(),
        format!(
            "rigid against every sample; its mass, {} g with the fixture, follows from 140.4 Hz",
            SensorDesign::reference().tip_mass_g
        ),
    ]);
    table.row([
        "PZT".to_owned(),
        "PZT-5A".to_owned(),
        format!(
            "{} GPa along the beam, {} GPa in shear, {} kg/m³, e31 {} C/m², {} nF/m (Erturk and \
             Inman, Piezoelectric Energy Harvesting, 2011, appendix E)",
            piezo.modulus_gpa,
            piezo.shear_gpa,
            piezo.density_kg_per_m3,
            -piezo.coupling_c_per_m2,
            piezo.permittivity_nf_per_m
        ),
    ]);
    table.row([
        "interlayer".to_owned(),
        "carbon fibre".to_owned(),
        format!(
            "{} GPa along the beam, {} GPa in shear, {} kg/m³ (a common plate; assumed)",
            core.modulus_gpa, core.shear_gpa, core.density_kg_per_m3
        ),
    ]);
    let models = Models::new(&rig_contact::Sensor::reference(), ContactLaw::Sneddon);
    let simulation = noiseless(&models, Tier::Reference, Control::Indentation);
    let change = |law: ContactLaw| {
        let other = TouchSimulation { law, ..simulation };
        let hz = |simulation: &TouchSimulation<'_>| {
            simulation.exact_hz(SAMPLES_MPA[4], Direction::Front, 0.0)
        };
        hz(&other) - hz(&simulation)
    };
    table.row([
        "samples".to_owned(),
        "Mooney-Rivlin".to_owned(),
        format!(
            "linear and incompressible (Sneddon); the two constants are not printed. A neo-Hookean \
             sample, which is Mooney-Rivlin with one constant zero, would change the shift of \
             sample 5 at 0.5 mm by {:+.1} Hz; the other extreme, close to Hertz, by up to {:+.1} \
             Hz. Both numbers are before a new fit of the sensor's width to 134.11 Hz/MPa",
            change(ContactLaw::NeoHookean),
            change(ContactLaw::Hertz)
        ),
    ]);
    page.table(table);
}

fn samples(page: &mut Page) {
    page.text(
        "Table 2 is an input and is used as printed. The text says that lumps are 5 to 15 times as \
         stiff as normal tissue; of its own lumps only samples 3 to 5 are.",
    );
    let mut table = Table::new(&[
        "sample",
        "printed, MPa",
        "ours, MPa",
        "difference",
        "over sample 1",
        "over the one before",
    ]);
    for (sample, young) in SAMPLES_MPA.into_iter().enumerate() {
        let before = sample.checked_sub(1).map_or(String::new(), |i| times(young / SAMPLES_MPA[i]));
        let shown = format!("{young:.3}");
        let (number, over) = ((sample + 1).to_string(), times(young / SAMPLES_MPA[0]));
        table.row([number, shown.clone(), shown, "0".to_owned(), over, before]);
    }
    page.table(table);
}

fn times(ratio: f64) -> String {
    format!("{ratio:.2}")
}

/// The values of Table 3.
const SHORE_OO: [f64; 5] = [24.0, 32.0, 60.0, 68.0, 75.0];

fn hardness(page: &mut Page) {
    page.text(
        "Table 3 gives the hardness of the experiment's samples, which the text calls consistent \
         with the simulation. Shore OO is not a modulus. With the durometer's nominal ball and \
         spring (not confirmed) and Sneddon's contact, the samples were stiffer than in Table 2, \
         and their ratios differ. The order is right; whether experiment and simulation used the \
         same stiffnesses cannot be decided.",
    );
    let mut table = Table::new(&[
        "sample",
        "printed, Shore OO",
        "ours, MPa",
        "Table 2, MPa",
        "difference, %",
        "over the one before",
        "in Table 2",
    ]);
    let young = SHORE_OO.map(young_of_shore_oo_mpa);
    for sample in 0..SHORE_OO.len() {
        let before = |list: &[f64; 5]| {
            sample.checked_sub(1).map_or(String::new(), |i| times(list[sample] / list[i]))
        };
        table.row([
            (sample + 1).to_string(),
            SHORE_OO[sample].to_string(),
            format!("{:.3}", young[sample]),
            format!("{:.3}", SAMPLES_MPA[sample]),
            format!("{:+.0}", 100.0 * (young[sample] / SAMPLES_MPA[sample] - 1.0)),
            before(&young),
            before(&SAMPLES_MPA),
        ]);
    }
    page.table(table);
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
    let patch =
        ContactLaw::Sneddon.at(depth_mm / ball_mm).expect("the ball is at most sunk to its top");
    // F = E* R² f, and E* = E/(1 − ν²).
    0.75 * force_n / (ball_mm * ball_mm * patch.force_rel)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By Hertz's contact sample 1 would be 98 kPa; the softer the ball's contact, the stiffer.
    #[test]
    fn shore_values_become_moduli_in_the_papers_order() {
        let moduli = SHORE_OO.map(young_of_shore_oo_mpa);
        assert!(moduli.is_sorted(), "{moduli:?}");
        assert!((0.08..0.12).contains(&moduli[0]) && (0.8..1.1).contains(&moduli[4]), "{moduli:?}");
    }
}
