//! The error of the reference of a touch between two, on benches whose resonance walks.

use rig_record::{Direction, Phase, Pose, TouchSettings};

use super::*;

const TOUCH_S: f64 = 5.0;
const SIGMA_HZ: f64 = 0.02;

/// Normal numbers: twelve uniform ones of a linear congruential generator (Knuth, MMIX).
struct Stream(u64);

impl Stream {
    fn uniform(&mut self) -> f64 {
        let (factor, term) = (6_364_136_223_846_793_005_u64, 1_442_695_040_888_963_407);
        self.0 = self.0.wrapping_mul(factor).wrapping_add(term);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

fn touch(drift_sigma_hz: f64) -> Touch {
    let pose = Pose { direction: Direction::Front, angle_deg: 0.0 };
    let touch = TouchSettings {
        step: "main/1/front/0/1".to_owned(),
        phase: Phase::Main,
        sample: "1".to_owned(),
        pose,
        repeat: 1,
    };
    Touch {
        touch,
        no_load_sweep: 1,
        no_load_hz: 140.0,
        no_load_sigma_hz: SIGMA_HZ,
        drift_sigma_hz,
        sweep: 2,
        resonance_hz: 150.0,
        sigma_hz: 0.05,
        shift_hz: 10.0,
        shift_sigma_hz: 0.05_f64.hypot(SIGMA_HZ).hypot(drift_sigma_hz),
        surface_mm: 10.0,
        surface_sigma_mm: 0.004,
        indentation_mm: 0.5,
        linear_mm: 9.5,
        rotary_deg: 0.0,
        is_slip_checked: None,
        halfway: None,
    }
}

/// Root mean squares of the errors of the reference of each touch, held and between two, and of the stated standard
/// deviation between two, Hz, when it is measured before every so many touches.
fn errors(walk_hz: f64, every: u32) -> [f64; 3] {
    let (mut noise, mut walk) = (Stream(1), Stream(2));
    let variance_hz2_per_s = walk_hz * walk_hz / 3600.0;
    let (mut squares, mut count) = ([0.0; 3], 0.0);
    for _ in 0..400 {
        let mut hz = 140.0;
        let mut measured = |at: u32, hz: f64| Measured {
            number: 1,
            hz: hz + SIGMA_HZ * noise.normal(),
            sigma_hz: SIGMA_HZ,
            at_s: TOUCH_S * f64::from(at),
        };
        let before = measured(0, hz);
        let mut path = vec![hz];
        for _ in 0..every {
            hz += (variance_hz2_per_s * TOUCH_S).sqrt() * walk.normal();
            path.push(hz);
        }
        let next = measured(every, hz);
        for (at, hz) in (1..every).zip(&path[1..]) {
            let at_s = TOUCH_S * f64::from(at);
            let mut touch = touch((variance_hz2_per_s * at_s).sqrt());
            assert!(move_reference(&mut touch, (before, at_s, next)).is_some());
            let shift_hz = touch.resonance_hz - touch.no_load_hz;
            assert!((touch.shift_hz - shift_hz).abs() < 1e-9, "{touch:?}");
            let stated_hz2 = touch.no_load_sigma_hz.powi(2) + touch.drift_sigma_hz.powi(2);
            let all = [(before.hz - hz).powi(2), (touch.no_load_hz - hz).powi(2), stated_hz2];
            squares.iter_mut().zip(all).for_each(|(sum, one)| *sum += one);
            count += 1.0;
        }
    }
    squares.map(|sum| (sum / count).sqrt())
}

#[test]
fn ten_touches_between_two_references_know_it_as_well_as_with_one_before_each() {
    let [held, between, stated] = errors(0.2, 10);
    println!("held {held:.4} Hz, between {between:.4} Hz, stated {stated:.4} Hz");
    assert!(between < 1.02 * SIGMA_HZ && 1.2 * between < held, "{held} {between}");
    for (walk_hz, every) in [(0.05, 10), (0.2, 10), (0.2, 30), (1.0, 10), (5.0, 3)] {
        let [held, between, stated] = errors(walk_hz, every);
        let told = format!("{walk_hz} Hz, every {every}: {held:.4} {between:.4} {stated:.4}");
        assert!(between < held && (0.9..1.1).contains(&(between / stated)), "{told}");
    }
}

#[test]
fn exact_references_give_the_straight_line_between_them() {
    let exact = |number, hz, at_s| Measured { number, hz, sigma_hz: 0.0, at_s };
    let (before, next) = (exact(1, 140.0, 0.0), exact(3, 141.0, 40.0));
    let mut touch = touch(0.1);
    assert!(move_reference(&mut touch, (before, 10.0, next)).is_some());
    assert!((touch.no_load_hz - 140.25).abs() < 1e-9, "{touch:?}");
    assert!((touch.drift_sigma_hz - 0.1 * 0.75_f64.sqrt()).abs() < 1e-9, "{touch:?}");
}

#[test]
fn a_run_that_knows_nothing_of_its_drift_keeps_its_references() {
    let of = |at_s| Measured { number: 1, hz: 140.0, sigma_hz: SIGMA_HZ, at_s };
    let mut unknown = touch(0.0);
    assert_eq!(move_reference(&mut unknown, (of(0.0), 10.0, of(40.0))), None);
    assert_eq!(unknown, touch(0.0));
    let mut behind = touch(0.1);
    assert_eq!(move_reference(&mut behind, (of(0.0), 50.0, of(40.0))), None);
}
