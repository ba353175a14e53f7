//! Claims on equations (1) to (7).

use std::f64::consts::{PI, TAU};

use rig_contact::{
    ContactLaw, Direction, Models, Sensor, Tier,
    equations::{Press, TissueConstants, TissueImpedance, contact_radius_mm},
};

use super::{Claim, Verdict, claim};
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
            Verdict::HoldsInPart,
            format!(
                "1/cx is exactly the stiffness of a rigid punch, 2 E* a = {punch:.1} N/m for sample 3 \
                 (equation: {:.1}); a11 and a12 have no values; the text calls c1 the damping, and it \
                 is a compliance",
                impedance.stiffness_n_per_m
            ),
        ),
        claim(
            "eq. (2)",
            "the shift of the sensor's resonance",
            Verdict::DoesNotHold,
            format!(
                "it is the formula of a rod vibrating along its length, C its undefined sound speed: \
                 a rod of PZT of 35 mm resonates at {:.1} kHz, not at 140 Hz; only C/(ω L Z1) as one \
                 fitted constant can be used",
                sound / (2.0 * 0.035) * 1e-3
            ),
        ),
        claim(
            "eq. (2) to (3)",
            "the tissue's mass lx may be dropped",
            Verdict::Holds,
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
            Verdict::DoesNotHold,
            format!(
                "true for shifts far below the resonance; the printed sensitivity means {:.0} Hz on \
                 140.4 Hz for sample 5, {:.0} %, where the shift of a vibrating mass grows like \
                 √(1 + r) − 1; ω is not said to be the free or the loaded one",
                134.11 * SAMPLES_MPA[4],
                100.0 * 134.11 * SAMPLES_MPA[4] / 140.4
            ),
        ),
        claim(
            "eq. (4)",
            "a = √(Rδ − δ²/4), a ≤ R",
            Verdict::HoldsInPart,
            format!(
                "the radius of the ball's section at half depth; at δ = R it is {:.4} R, linear \
                 elasticity says {:.4} R, Hertz 1 R; a ≤ R always holds, what it needs is δ ≤ 2R, \
                 beyond which the radius falls with the depth",
                radius(ContactLaw::Paper),
                radius(ContactLaw::Sneddon)
            ),
        ),
        claim(
            "eq. (5) to (7)",
            "the larger the angle, the smaller area and shift",
            Verdict::HoldsInPart,
            front_rise(),
        ),
    ]
}

const PAPER_PRESS: Press = Press { ball_mm: 0.5, depth_mm: 0.5, angle_rad: 0.0 };

fn radius(law: ContactLaw) -> f64 {
    law.at(1.0).expect("a depth of one radius is within every law").radius_rel
}

/// Where the shift to the front has its maximum.
fn front_rise() -> String {
    let models = Models::new(&Sensor::reference(), ContactLaw::Sneddon);
    let way = noiseless(&models, Tier::Reference, Control::Indentation);
    let shift = |angle: f64| way.exact_hz(SAMPLES_MPA[4], Direction::Front, angle);
    let best = (0..=450).map(|tenth| f64::from(tenth) / 10.0);
    let best = best.max_by(|a, b| shift(*a).total_cmp(&shift(*b))).unwrap_or(0.0);
    format!(
        "true of the equations for δ cos α < 2R; with the probe's arm the shift of sample 5 to the \
         front first rises, from {:.2} Hz to {:.2} Hz at {best:.0}°",
        shift(0.0),
        shift(best)
    )
}
