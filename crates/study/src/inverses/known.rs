//! One touch at a known angle.

use rig_contact::{
    ContactLaw, Direction, Models, Sensor, Tier,
    inverse::{TissueKind, TouchSigmas},
};

use crate::{
    page::{Page, Table},
    paper_bench::{ANGLES_DEG, Control, INDENTATION_MM, SAMPLES_MPA, contact, tissue},
    simulate::Nuisances,
};

/// The errors of one touch on the bench, without the variation of the sample.
pub(super) const TOUCH_SIGMAS: TouchSigmas = TouchSigmas {
    shift_hz: Nuisances::BENCH.shift_hz,
    depth_mm: Nuisances::BENCH.depth_mm,
    angle_rad: Nuisances::BENCH.angle_deg * std::f64::consts::PI / 180.0,
};

pub(super) fn add(page: &mut Page) {
    page.heading("One touch at a known angle");
    page.text(
        "Relative standard deviation of the stiffness, and the parts due to the shift, the depth \
         and the angle. The last column is the error of the stiffness without compensation of the \
         angle.",
    );
    let models = Models::new(&Sensor::reference(), ContactLaw::Sneddon);
    let mut table = Table::new(&[
        "sample",
        "direction",
        "angle",
        "standard deviation, %",
        "due to the shift",
        "due to the depth",
        "due to the angle",
        "uncompensated, %",
    ]);
    for (sample, &young_mpa) in SAMPLES_MPA.iter().enumerate() {
        for direction in [Direction::Front, Direction::Back] {
            for angle_deg in ANGLES_DEG {
                let depth = Control::Indentation.depth(INDENTATION_MM);
                let leaning = contact(direction, angle_deg, depth, ContactLaw::Sneddon);
                let upright = contact(direction, 0.0, depth, ContactLaw::Sneddon);
                let shift = models
                    .predict(Tier::E1, &tissue(young_mpa), &leaning)
                    .expect("the paper's contacts are within the tier")
                    .shift_hz;
                let soft = TissueKind::SOFT;
                let found =
                    models.stiffness_of_touch(Tier::E1, shift, TOUCH_SIGMAS, soft, &leaning);
                let naive = models.young_of_shift_mpa(Tier::E1, shift, soft, &upright);
                let (Ok(found), Ok(naive)) = (found, naive) else { continue };
                let percent = |sigma: f64| format!("{:.2}", 100.0 * sigma / young_mpa);
                table.row([
                    (sample + 1).to_string(),
                    direction.name().to_owned(),
                    format!("{angle_deg}°"),
                    percent(found.sigma_mpa),
                    percent(found.sigma_of_shift_mpa),
                    percent(found.sigma_of_depth_mpa),
                    percent(found.sigma_of_angle_mpa),
                    format!("{:+.1}", 100.0 * (naive / young_mpa - 1.0)),
                ]);
            }
        }
    }
    page.table(table);
}
