//! Claims on equations (8) and (9), and on the choice of the ball.

use rig_contact::{
    ContactLaw,
    equations::{
        Arithmetic, angle_influence, influence_over_discrimination, largest_separating_radius,
        largest_separating_radius_tilted, radius_without_angle_influence,
    },
};

use super::{Assessment, Claim, claim};
use crate::paper_bench::SAMPLES_MPA;

pub(super) fn claims() -> Vec<Claim> {
    [bounds(), choices()].concat()
}

const EXACT: Arithmetic = Arithmetic::Exact;
const PRINTED: Arithmetic = Arithmetic::Printed;

/// D1 of equation (8) over the shift, in percent, at a depth in ball radii.
fn fall_percent(depth_rel: f64) -> f64 {
    let upright = ContactLaw::Paper.at(depth_rel).expect("within equation (4)").radius_rel;
    100.0 * angle_influence(depth_rel, EXACT).expect("within equation (4)") / upright
}

/// The same at R/δ below a half, outside the validity of equation (4).
fn fall_beyond_percent(radius_over_depth: f64) -> f64 {
    let squared = |cosine: f64| radius_over_depth * cosine - 0.25 * cosine * cosine;
    100.0 * (1.0 - (squared(std::f64::consts::FRAC_1_SQRT_2) / squared(1.0)).sqrt())
}

/// Claims on the solutions of equations (8) and (9).
fn bounds() -> Vec<Claim> {
    let at = |arithmetic| angle_influence(1.0, arithmetic).expect("within equation (4)");
    let tilted = |ratio, arithmetic| {
        largest_separating_radius_tilted(ratio, arithmetic).map_or("none".to_owned(), three_digits)
    };
    vec![
        claim(
            "eq. (8)",
            "D1 with cos 45° = 0.7 and its square 0.5",
            Assessment::DoesNotHold,
            format!(
                "0.7² is 0.49: the printed arithmetic gives {:.5} R at R = δ, the exact one {:.5} \
                 R, {:+.1} %; the printed roots end before the terms in δ²",
                at(PRINTED),
                at(EXACT),
                100.0 * (at(PRINTED) / at(EXACT) - 1.0)
            ),
        ),
        claim(
            "eq. (8)",
            "D1 ≥ 0 gives R ≥ 0.42 Δ",
            Assessment::DoesNotHold,
            format!(
                "D1 = 0 at R = {:.5} Δ exactly and at {:.5} Δ in printed arithmetic; both lie \
                 outside equation (4), which needs R ≥ 0.5 Δ, where D1 is still {:.1} %: the \
                 condition always holds within the equation. At R = 0.42 Δ itself D1 is {:+.2} %",
                radius_without_angle_influence(EXACT),
                radius_without_angle_influence(PRINTED),
                fall_percent(2.0),
                fall_beyond_percent(0.42)
            ),
        ),
        claim(
            "eq. (9)",
            "R < 2.5 Δ for stiffnesses 1.2 apart at 0°",
            Assessment::DoesNotHold,
            format!(
                "at 0° there is no upper bound for any ratio above 1.1892: D1/D2 stays below \
                 {:.4}; with D2 taken at 45° the bound is {} Δ exactly and {} Δ in printed \
                 arithmetic; a ratio of 1.17 gives 2.46 ({})",
                1.2 / 0.2 * (1.0 - 0.5_f64.sqrt().sqrt()),
                tilted(1.2, EXACT),
                tilted(1.2, PRINTED),
                largest_separating_radius(1.17, EXACT).map_or("none".to_owned(), three_digits)
            ),
        ),
    ]
}

/// Claims on the choices that follow.
fn choices() -> Vec<Claim> {
    let d1_d2 = |depth: f64| {
        influence_over_discrimination(depth, SAMPLES_MPA[2] / SAMPLES_MPA[0], EXACT)
            .expect("within equation (4)")
    };
    let ratios: Vec<String> =
        SAMPLES_MPA.windows(2).map(|pair| format!("{:.2}", pair[1] / pair[0])).collect();
    vec![
        claim(
            "section 2.2.2",
            "therefore R = Δ",
            Assessment::Undecided,
            format!(
                "a choice and not a consequence: the relative D1 is {:.1} % at R = 0.5 Δ, {:.1} % \
                 at R = Δ, {:.1} % at 2 Δ, {:.1} % in the limit; 0.5 Δ is better by the paper's \
                 own goal",
                fall_percent(2.0),
                fall_percent(1.0),
                fall_percent(0.5),
                fall_percent(1e-9)
            ),
        ),
        claim(
            "eq. (9)",
            "D1/D2 chooses between lengths",
            Assessment::DoesNotHold,
            format!(
                "the equation does not contain the length: {:.4}, {:.4}, {:.4} for (35, 0.5), (35, 1), \
                 (20, 0.5); at equal stiffnesses it is infinite",
                d1_d2(1.0),
                d1_d2(0.5),
                d1_d2(1.0)
            ),
        ),
        claim(
            "section 3.1.1",
            "the five samples can be told apart to 45°",
            Assessment::HoldsInPart,
            format!(
                "by equation (7) for every R and L: neighbours are {} apart, all above 1.1892; with \
                 tilt and arm samples 3 and 4 overlap beyond 30°",
                ratios.join(", ")
            ),
        ),
    ]
}

fn three_digits(value: f64) -> String {
    format!("{value:.3}")
}
