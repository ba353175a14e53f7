//! Claims on equations (1) to (7).

use std::f64::consts::{PI, TAU};

use rig_contact::{
    ContactLaw, Direction, Models, Sensor, Tier,
    equations::{Press, TissueConstants, TissueImpedance, contact_radius_mm},
};

use super::{Assessment, Claim, claim};
use crate::{
    paper::figures::noiseless,
    paper_bench::{Control, SAMPLES_MPA},
};

pub(super) fn claims() -> Vec<Claim> {
    [impedance(), shift_and_contact()].concat()
}

/// Equations (1) and (2), and the step to (3).
fn impedance() -> Vec<Claim> {
    let radius_m = contact_radius_mm(PAPER_PRESS).expect("within equation (4)") * 1e-3;
    let constants = TissueConstants {
        young_pa: SAMPLES_MPA[2] * 1e6,
        poisson: 0.5,
        density_kg_per_m3: 1000.0,
        mass_factor: 1.0,
        resistance_factor: 1.0,
    };
    let punch = 2.0 * constants.young_pa / 0.75 * radius_m;
    let share = |young_mpa: f64, frequency_hz: f64| {
        let constants = TissueConstants { young_pa: young_mpa * 1e6, ..constants };
        let tissue = TissueImpedance::of(&constants, PI * radius_m * radius_m);
        (TAU * frequency_hz).powi(2) * tissue.mass_kg / tissue.stiffness_n_per_m
    };
    let impedance = TissueImpedance::of(&constants, PI * radius_m * radius_m);
    let sound = (61e9_f64 / 7750.0).sqrt();
    vec![
        claim(
            "eq. (1)",
            "the tissue is a resistance, a compliance and a mass",
            Assessment::HoldsInPart,
            format!(
                "1/cx is exactly the stiffness of a rigid punch, 2 E* a = {punch:.1} N/m for \
                 sample 3 (equation: {:.1}); a11 and a12 have no values; the text calls c1 the \
                 damping, but it is a compliance",
                impedance.stiffness_n_per_m
            ),
        ),
        claim(
            "eq. (2)",
            "the shift of the sensor's resonance",
            Assessment::DoesNotHold,
            format!(
                "it is the formula of a rod vibrating along its length, with the undefined sound \
                 speed C: a rod of PZT of 35 mm resonates at {:.1} kHz and not at 140 Hz; only \
                 C/(ω L Z1) is usable, as one fitted constant",
                sound / (2.0 * 0.035) * 1e-3
            ),
        ),
        claim(
            "eq. (2) to (3)",
            "the tissue's mass lx may be dropped",
            Assessment::Holds,
            format!(
                "with a11 = 1 it takes {:.2} % of the shift of sample 5 at 229 Hz and {:.1} % of \
                 sample 1's at 148 Hz",
                100.0 * share(SAMPLES_MPA[4], 229.0),
                100.0 * share(SAMPLES_MPA[0], 148.0)
            ),
        ),
    ]
}

/// Equations (3) to (7).
fn shift_and_contact() -> Vec<Claim> {
    vec![
        claim(
            "eq. (3), (7)",
            "the shift is proportional to the stiffness",
            Assessment::DoesNotHold,
            format!(
                "true for shifts far below the resonance; with the printed sensitivity the shift \
                 of sample 5 is {:.0} Hz of 140.4 Hz, {:.0} %, where the shift of a vibrating mass \
                 grows like √(1 + r) − 1; the text does not say whether ω is that of the free or \
                 of the loaded sensor",
                134.11 * SAMPLES_MPA[4],
                100.0 * 134.11 * SAMPLES_MPA[4] / 140.4
            ),
        ),
        claim(
            "eq. (4)",
            "a = √(Rδ − δ²/4), a ≤ R",
            Assessment::HoldsInPart,
            format!(
                "the radius of the ball's section at half the depth; at δ = R it is {:.4} R, where \
                 linear elasticity gives {:.4} R and Hertz 1 R; a ≤ R always holds, but the \
                 equation needs δ ≤ 2R, because the radius falls with the depth beyond",
                radius(ContactLaw::Paper),
                radius(ContactLaw::Sneddon)
            ),
        ),
        claim(
            "eq. (5) to (7)",
            "the larger the angle, the smaller area and shift",
            Assessment::HoldsInPart,
            front_rise(),
        ),
    ]
}

const PAPER_PRESS: Press = Press { ball_mm: 0.5, depth_mm: 0.5, angle_rad: 0.0 };

fn radius(law: ContactLaw) -> f64 {
    law.at(1.0).expect("a depth of one radius is within every law").radius_rel
}

/// The maximum of the shift to the front.
fn front_rise() -> String {
    let models = Models::new(&Sensor::reference(), ContactLaw::Sneddon);
    let simulation = noiseless(&models, Tier::Reference, Control::Indentation);
    let shift = |angle: f64| simulation.exact_hz(SAMPLES_MPA[4], Direction::Front, angle);
    let best = (0..=450).map(|tenth| f64::from(tenth) / 10.0);
    let best = best.max_by(|a, b| shift(*a).total_cmp(&shift(*b))).unwrap_or(0.0);
    format!(
        "true of the equations for δ cos α < 2R; with the probe's arm the shift of sample 5 to the \
         front rises first, from {:.2} Hz to {:.2} Hz at {best:.0}°",
        shift(0.0),
        shift(best)
    )
}
