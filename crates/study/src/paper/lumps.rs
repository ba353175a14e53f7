//! Lump or normal tissue: the clinical claim, with rates and intervals.

use rayon::prelude::*;
use rig_analysis::score::grouped_95;
use rig_contact::{ContactLaw, Direction, Friction, Models, Sensor, Tier};
use rig_model::random::Stream;

use crate::{
    page::{Page, Table},
    paper_bench::{ANGLES_DEG, Control, SAMPLES_MPA},
    simulate::{Nuisances, TouchSimulation},
};

/// Stiffness of a lump over that of the normal tissue: two below the paper's softest lump, its four
/// lumps, and the least of the "5 to 15 times" of its text.
const RATIOS: [f64; 7] = [
    1.2,
    1.5,
    SAMPLES_MPA[1] / SAMPLES_MPA[0],
    5.0,
    SAMPLES_MPA[2] / SAMPLES_MPA[0],
    SAMPLES_MPA[3] / SAMPLES_MPA[0],
    SAMPLES_MPA[4] / SAMPLES_MPA[0],
];
/// Blind touches of each tissue after each calibration.
const TRIALS: u32 = 100;

pub(super) fn add(page: &mut Page, repeats: u32, seed: u64) {
    page.heading("Lump or normal tissue");
    page.text(format!(
        "The clinical claim: \"lump samples can be easily distinguished from normal tissue\". Sample \
         1 is the normal tissue. A touch is called a lump if its shift is above the geometric mean \
         of the shifts of both tissues, each calibrated by twelve touches in the paper's directions \
         and angles; with a known angle the shift is first divided by that of the normal tissue in \
         the same pose. Errors of a bench as above ({} Hz, {} mm, {}°, {} %), stage held as in the \
         experiment, random angles up to 45°, by tier E1s. Both models are ours: the rates say what \
         such errors allow, and not what tissue in a body does.",
        Nuisances::BENCH.shift_hz,
        Nuisances::BENCH.depth_mm,
        Nuisances::BENCH.angle_deg,
        100.0 * Nuisances::BENCH.young_rel,
    ));
    let mut table = Table::new(&[
        "lump over normal stiffness",
        "angle",
        "lumps found, %",
        "95 % interval",
        "normal tissue not called a lump, %",
        "95 % interval",
    ]);
    for (index, ratio) in RATIOS.into_iter().enumerate() {
        for is_known in [false, true] {
            let stream = (700 + 2 * index as u64 + u64::from(is_known)) << 32;
            let experiments: Vec<[u32; 2]> = (0..repeats)
                .into_par_iter()
                .map(|repeat| {
                    let mut random = Stream::new(seed, stream | u64::from(repeat));
                    experiment(ratio, is_known, &mut random)
                })
                .collect();
            let cells = [0, 1].map(|tissue| {
                // The touches of an experiment share their calibration.
                let right: Vec<u32> = experiments.iter().map(|one| one[tissue]).collect();
                let (low, high) = grouped_95(&right, TRIALS);
                let right = f64::from(right.iter().sum::<u32>());
                let rate = 100.0 * right / f64::from(repeats * TRIALS);
                [format!("{rate:.2}"), format!("{:.2} to {:.2}", 100.0 * low, 100.0 * high)]
            });
            let angle = if is_known { "known" } else { "unknown" };
            let head = [format!("{ratio:.2}"), angle.to_owned()];
            table.row(head.into_iter().chain(cells.into_iter().flatten()));
        }
    }
    page.table(table);
    page.text(
        "The paper's lumps are told from its normal tissue at any angle up to 45°, also unknown. \
         That follows from their stiffness: the softest lump is 2.31 times as stiff as the normal \
         tissue, and the angle changes a shift by a quarter. A lump of 1.2 to 1.5 times the normal \
         stiffness needs the angle. The paper prints neither rates nor an interval for this claim.",
    );
}

/// Right answers among the blind touches of the lump and of the normal tissue.
fn experiment(ratio: f64, is_known: bool, random: &mut Stream) -> [u32; 2] {
    let models = Models::new(&Sensor::reference(), ContactLaw::SneddonSeries);
    let simulation = TouchSimulation {
        models: &models,
        tier: Tier::E1s,
        law: ContactLaw::SneddonSeries,
        friction: Friction::Sticking,
        control: Control::Stage,
        nuisances: Nuisances::BENCH,
    };
    let normal_mpa = SAMPLES_MPA[0];
    let tissues = [ratio * normal_mpa, normal_mpa];
    let value = |young_mpa: f64, direction: Direction, angle: f64, random: &mut Stream| {
        // Noise may exceed a shift; a contact has a positive one.
        let shift = simulation.read_hz(young_mpa, direction, angle, random).max(1e-3);
        let known = simulation.exact_hz(normal_mpa, direction, angle);
        (if is_known { shift / known } else { shift }).ln()
    };
    let centre = |young_mpa: f64, random: &mut Stream| {
        let mut sum = 0.0;
        for direction in Direction::ALL {
            for angle in ANGLES_DEG {
                sum += value(young_mpa, direction, angle, random);
            }
        }
        sum / (Direction::ALL.len() * ANGLES_DEG.len()) as f64
    };
    let between = 0.5 * tissues.map(|young| centre(young, random)).iter().sum::<f64>();
    let mut is_lump = |young_mpa: f64| {
        let direction = random.pick(&Direction::ALL);
        let angle = 45.0 * random.uniform();
        value(young_mpa, direction, angle, random) > between
    };
    let found = (0..TRIALS).map(|_| u32::from(is_lump(tissues[0]))).sum();
    let spared = (0..TRIALS).map(|_| u32::from(!is_lump(tissues[1]))).sum();
    [found, spared]
}
