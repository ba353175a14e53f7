//! The readings of a survey: many around the resonance, and a few over the rest of the window.

use rig_model::{SweepPoint, Window};

use crate::Circuit;

/// Places around the resonance, in linewidths.
const NEAR: [f64; 19] = [
    0.0, 0.25, -0.25, 0.5, -0.5, 0.75, -0.75, 1.0, -1.0, 1.5, -1.5, 2.0, -2.0, 2.5, -2.5, 3.0,
    -3.0, 4.0, -4.0,
];
/// Distance of the other places, in linewidths, and largest number of them.
const STEP: f64 = 1.0;
const FAR_MAX: usize = 80;
/// Part of the time for the places around the resonance.
const NEAR_PART: f64 = 0.8;
/// Number of readings of a survey, about, and the range of their cycles.
const READINGS: f64 = 400.0;
const CYCLES: (u32, u32) = (10, 60);
/// Smallest and largest number of readings of a stay; the first gives the free decay.
const COUNT: (usize, usize) = (2, 100);
/// Assumed gap between two readings, s.
const GAP_S: f64 = 2e-3;

/// Stays for about this many seconds, at every place twice: on the way there and in the reverse order,
/// so that a steady drift looks like nothing else.
pub(super) fn points(circuit: &Circuit, window: Window, seconds: u32) -> Vec<SweepPoint> {
    let (at_hz, width_hz) = (circuit.resonance_hz, circuit.linewidth_hz());
    let is_inside = |hz: &f64| window.contains(*hz);
    let near: Vec<f64> =
        NEAR.iter().map(|place| at_hz + place * width_hz).filter(is_inside).collect();
    let first = NEAR.last().map_or(0.0, |last| last.abs()) + STEP;
    let length_hz = (window.max_hz - window.min_hz).max(width_hz);
    let step_hz = (STEP * width_hz).max(length_hz / FAR_MAX as f64);
    let far = (0..FAR_MAX).flat_map(|i| {
        let off_hz = first * width_hz + step_hz * i as f64;
        [at_hz + off_hz, at_hz - off_hz]
    });
    let far: Vec<f64> = far.filter(is_inside).take(FAR_MAX).collect();
    let part = if far.is_empty() { 1.0 } else { NEAR_PART };
    let half_s = 0.5 * f64::from(seconds);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small")]
    let cycles = (f64::from(seconds) / READINGS * at_hz) as u32;
    let cycles = cycles.clamp(CYCLES.0, CYCLES.1);
    let stays = |places: &[f64], seconds: f64| -> Vec<SweepPoint> {
        let reading_s = |hz: f64| GAP_S + f64::from(cycles) / hz;
        let all_s: f64 = places.iter().map(|hz| reading_s(*hz)).sum();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small")]
        let count = ((seconds / all_s) as usize).clamp(COUNT.0, COUNT.1);
        let stay = |hz: &f64| {
            let point = SweepPoint { frequency_hz: *hz, settle_s: 0.0, cycles };
            vec![point; count]
        };
        places.iter().flat_map(stay).collect()
    };
    let mut there = stays(&near, part * half_s);
    there.extend(stays(&far, (1.0 - part) * half_s));
    let back: Vec<SweepPoint> = there.iter().rev().copied().collect();
    there.extend(back);
    there
}
