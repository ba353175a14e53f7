//! Ends of a planned sweep that simulated benches hardly ever reach.

use rig_model::{DriveLevel, PointResult, RigTime, SweepMethod};

use super::*;
use crate::{
    Limit, Next, Planner, Refusal,
    plan::{Method, Survey},
};

fn circuit() -> Circuit {
    Circuit { resonance_hz: 140.0, q: 30.0, c0_farad: 27e-9, c1_farad: 1.5e-9, loss_tangent: 0.01 }
}

fn request(method: SweepMethod) -> SweepRequest {
    SweepRequest {
        window: Window { min_hz: 112.0, max_hz: 168.0 },
        method,
        target_sigma_hz: 1e-5,
        time_limit_s: 30.0,
        cycles: 10,
        settle_s: 0.0,
        level: DriveLevel { volt: 1.0 },
    }
}

/// A target that is reached after a few readings, Hz.
const EASY_HZ: f64 = 0.5;

/// A sweep of a circuit that answers at once, far from its target; its readings deviate by parts in a hundred thousand.
fn swept(request: &SweepRequest) -> Planner {
    let mut planner = Planner::new(request, None);
    let mut now = RigTime::ZERO;
    while decay(&mut planner).hypotheses.len() != 1 || planner.readings().len() < 25 {
        let Next::Measure(points) = planner.next() else { panic!("it has ended") };
        for (index, point) in points.into_iter().enumerate() {
            let integration_s = f64::from(point.cycles) / point.frequency_hz;
            let impedance = circuit().impedance_ohm(point.frequency_hz);
            let off = 1.0 + 1e-5 * ((index * 7) % 5) as f64;
            let measured = PointResult::Value(rig_model::Impedance {
                resistance_ohm: off * impedance.re,
                reactance_ohm: off * impedance.im,
            });
            let (frequency_hz, settle_s, started) = (point.frequency_hz, point.settle_s, now);
            let reading = Reading { frequency_hz, measured, started, settle_s, integration_s };
            planner.add(&[reading]);
            now = now + std::time::Duration::from_secs_f64(integration_s + 0.0015);
        }
    }
    planner
}

fn decay(planner: &mut Planner) -> &mut Decay {
    let Method::Adaptive { decay, .. } = &mut planner.method else { panic!("it is uniform") };
    decay
}

#[test]
fn at_the_time_limit_too_there_is_no_result_beside_a_rival() {
    let request = request(SweepMethod::Adaptive);
    let end = |rival_hz: Option<f64>| {
        let mut planner = swept(&request);
        planner.request.target_sigma_hz = EASY_HZ;
        let decay = decay(&mut planner);
        decay.is_searched = true;
        if let Some(rival_hz) = rival_hz {
            let mut rival = decay.hypotheses[0].clone();
            rival.at.resonance_hz = rival_hz;
            decay.hypotheses.push(rival);
        }
        planner.pass(request.time_limit_s);
        let Next::Finished(verdict) = planner.next() else { panic!("it goes on") };
        verdict
    };
    let FitOutcome::Refused(Refusal { reason, estimate }) = end(Some(131.0)) else {
        panic!("there is a result")
    };
    let Reason::Ambiguous { first_hz, other_hz } = reason else { panic!("{reason}") };
    assert!((first_hz - 140.0).abs() < 0.5 && other_hz == 131.0, "{reason}");
    assert!(estimate.is_some());
    assert!(end(None).accepted().is_some());
}

#[test]
fn a_survey_is_made_although_the_sweep_before_it_has_taken_its_time() {
    let request = request(SweepMethod::Survey { seconds: 20 });
    let mut planner = swept(&request);
    planner.request.target_sigma_hz = EASY_HZ;
    planner.pass(request.time_limit_s);
    let Next::Measure(points) = planner.next() else { panic!("it has ended") };
    assert!(points.len() > 100, "{}", points.len());
    let Method::Adaptive { survey, .. } = planner.method else { panic!("it is uniform") };
    assert_eq!(survey, Survey::Measured { seconds: 20, rounds: 1 });
}

#[test]
fn a_doubt_asks_for_one_more_stay_and_then_for_what_reaches_the_target() {
    let request = request(SweepMethod::Adaptive);
    let mut planner = swept(&request);
    let readings = planner.readings().to_vec();
    let decay = decay(&mut planner);
    decay.doubt = Some(Reason::Misfit { found: 3.0, allowed: 2.0 });
    let mut next = || {
        let points = decay.next(&request, &readings, 2.0).unwrap();
        (points[0].frequency_hz, points[0].cycles, points.len())
    };
    let forced = next();
    assert_eq!((forced.1, forced.2), FORCED);
    assert_ne!(next(), forced);
}

#[test]
fn the_last_of_many_steps_is_told_as_what_it_is() {
    let request = request(SweepMethod::Adaptive);
    let mut planner = swept(&request);
    decay(&mut planner).steps = STEPS_MAX;
    let Next::Finished(FitOutcome::Refused(refusal)) = planner.next() else { panic!("it goes on") };
    let Reason::TargetNotReached { limit, .. } = refusal.reason else { panic!("{refusal}") };
    assert_eq!(limit, Limit::Steps { max: STEPS_MAX });
}
