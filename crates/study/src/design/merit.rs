//! The four merits of a design.

use std::f64::consts::PI;

use rig_contact::{ContactLaw, Direction, Models, Sensor, SensorDesign, Tier};

use super::grid::Design;
use crate::paper_bench::{ANGLES_DEG, SAMPLES_MPA, contact, tissue};

/// The merits of a design.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Merit {
    /// Largest relative fall of a shift from upright to 45°, over samples and directions; less is
    /// better.
    pub(super) angle_influence: f64,
    /// Smallest gap between the shifts of neighbouring samples over all angles and directions,
    /// relative to the softer one; negative for overlapping ranges. More is better.
    pub(super) discrimination: f64,
    /// Difference of the shifts of the stiffest and the softest sample over that of their
    /// stiffnesses, upright; more is better.
    pub(super) sensitivity_hz_per_mpa: f64,
    /// Time of one frequency on the free sensor, with settling and ten cycles, s; less is better.
    pub(super) point_s: f64,
}

/// Time constants until the motion has settled to less than a hundredth.
const SETTLE_TIME_CONSTANTS: f64 = 5.0;
const CYCLES: f64 = 10.0;

impl Merit {
    /// The merits of a design; `None` outside the models.
    pub(super) fn of(design: &Design) -> Option<Self> {
        let made_of = SensorDesign {
            length_mm: design.length_mm,
            probe_radius_mm: design.radius_mm,
            arm_mm: design.arm_mm,
            ..SensorDesign::reference()
        };
        let sensor = Sensor::new(made_of).ok()?;
        let models = Models::new(&sensor, ContactLaw::Sneddon);
        let shift = |young_mpa: f64, direction, angle_deg| {
            let depth = design.control.depth(design.indentation_mm);
            let contact = contact(direction, angle_deg, depth, ContactLaw::Sneddon);
            Some(models.predict(Tier::E1s, &tissue(young_mpa), &contact).ok()?.shift_hz)
        };
        let mut angle_influence = 0.0_f64;
        let mut ranges = Vec::with_capacity(SAMPLES_MPA.len());
        let mut upright = Vec::with_capacity(SAMPLES_MPA.len());
        for young_mpa in SAMPLES_MPA {
            let straight = shift(young_mpa, Direction::Front, ANGLES_DEG[0])?;
            let (mut least, mut most) = (straight, straight);
            for direction in Direction::ALL {
                for angle_deg in &ANGLES_DEG[1..] {
                    let leaning = shift(young_mpa, direction, *angle_deg)?;
                    least = least.min(leaning);
                    most = most.max(leaning);
                }
                let steepest = shift(young_mpa, direction, ANGLES_DEG[3])?;
                angle_influence = angle_influence.max((1.0 - steepest / straight).abs());
            }
            ranges.push((least, most));
            upright.push(straight);
        }
        let gaps = ranges.windows(2).map(|pair| pair[1].0 / pair[0].1 - 1.0);
        let range_mpa = SAMPLES_MPA[4] - SAMPLES_MPA[0];
        let no_load_hz = models.no_load_hz(Tier::E1s);
        let quality = SensorDesign::reference().beam_loss.recip();
        Some(Self {
            angle_influence,
            discrimination: gaps.fold(f64::INFINITY, f64::min),
            sensitivity_hz_per_mpa: (upright[4] - upright[0]) / range_mpa,
            point_s: (SETTLE_TIME_CONSTANTS * quality / PI + CYCLES) / no_load_hz,
        })
    }

    /// Whether this design is at least as good in every merit, and better in one.
    pub(super) fn beats(&self, other: &Self) -> bool {
        let no_worse = self.angle_influence <= other.angle_influence
            && self.discrimination >= other.discrimination
            && self.sensitivity_hz_per_mpa >= other.sensitivity_hz_per_mpa
            && self.point_s <= other.point_s;
        no_worse && self != other
    }

    /// The smallest relative gain in any merit over a design that this one beats.
    pub(super) fn least_gain_over(&self, other: &Self) -> f64 {
        let gains = [
            (other.angle_influence - self.angle_influence) / other.angle_influence,
            (self.discrimination - other.discrimination) / other.discrimination.abs(),
            self.sensitivity_hz_per_mpa / other.sensitivity_hz_per_mpa - 1.0,
            1.0 - self.point_s / other.point_s,
        ];
        gains.into_iter().fold(f64::INFINITY, f64::min)
    }

    /// The merits as table cells.
    pub(super) fn cells(&self) -> [String; 4] {
        [
            format!("{:.4}", 100.0 * self.angle_influence),
            format!("{:.4}", 100.0 * self.discrimination),
            format!("{:.4}", self.sensitivity_hz_per_mpa),
            format!("{:.6}", self.point_s),
        ]
    }

    /// The merits from table cells.
    pub(super) fn of_cells(cells: &[&str]) -> Option<Self> {
        let numbers: Vec<f64> =
            cells.iter().map(|cell| cell.parse().ok()).collect::<Option<_>>()?;
        let [influence, discrimination, sensitivity_hz_per_mpa, point_s] = numbers[..] else {
            return None;
        };
        Some(Self {
            angle_influence: influence / 100.0,
            discrimination: discrimination / 100.0,
            sensitivity_hz_per_mpa,
            point_s,
        })
    }
}
