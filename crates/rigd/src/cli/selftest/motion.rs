//! The levels of the self-test that need a bench in service: what moves goes through the engine and the interlock, with the
//! probe clear.

use rig_commission::sensor::{DRIFT_HZ_PER_H, LEVEL_HZ, SensorSweeps, judge};
use rig_engine::Command;
use rig_model::{Position, RigLimits, Unit};

use super::super::{Failure, session::Session};
use crate::selftest::{Check, Quantity};

/// Ways there and back.
const WAYS: usize = 5;

/// Largest tilt of the empty table, degrees.
const TILT_DEG: f64 = 20.0;

/// Share of the sweeps of a night that may be refused.
const REFUSED_PERCENT: f64 = 1.0;

/// Moves both axes to and fro with the probe clear, and says how far from their targets they come to rest.
pub(super) async fn moves(
    session: &mut Session,
    limits: &RigLimits,
) -> Result<Vec<Check>, Failure> {
    let rest = limits.linear.rest_target().position();
    let top = limits.linear.soft().max;
    let (mut linear, mut rotary) = (Vec::new(), Vec::new());
    for _ in 0..WAYS {
        for to in [top, rest] {
            let status = session.carry_out(Command::MoveLinear(to)).await?;
            linear.extend(status.snapshot.linear.map(|at| off(at, to)));
        }
    }
    let soft = limits.rotary.soft();
    let (low, high) = (soft.min.value().max(-TILT_DEG), soft.max.value().min(TILT_DEG));
    for _ in 0..WAYS {
        for to in [low, high, 0.0].map(Position::new) {
            let status = session.carry_out(Command::MoveRotary(to)).await?;
            rotary.extend(status.snapshot.rotary.map(|at| off(at, to)));
        }
    }
    Ok(vec![
        rest_check("linear stage", &linear, limits.linear.tolerance(), "mm"),
        rest_check("rotary stage", &rotary, limits.rotary.tolerance(), "°"),
    ])
}

fn off<U: Unit>(at: Position<U>, to: Position<U>) -> f64 {
    at.value() - to.value()
}

/// The largest distance from a target, with the scatter of these distances.
fn rest_check(part: &'static str, off: &[f64], limit: f64, unit: &'static str) -> Check {
    let count = off.len().max(1) as f64;
    let mean = off.iter().sum::<f64>() / count;
    let squares: f64 = off.iter().map(|off| (off - mean).powi(2)).sum();
    let quantity = Quantity {
        value: off.iter().fold(0.0, |most: f64, off| most.max(off.abs())),
        uncertainty: Some((squares / (count - 1.0).max(1.0)).sqrt()),
        limit,
        unit,
    };
    let name = format!("rest beside the target, {} moves", off.len());
    let advice =
        "look at load, speed and acceleration of this axis, and at the tuning of its drive";
    Check::quantity(part, name, quantity, advice)
}

/// What a night of sweeps with a free sensor shows.
pub(super) fn soak(night: &SensorSweeps) -> Vec<Check> {
    let all = night.sweeps.len() + night.refused;
    let refused = Quantity {
        value: 100.0 * night.refused as f64 / all.max(1) as f64,
        uncertainty: None,
        limit: REFUSED_PERCENT,
        unit: "%",
    };
    let name = format!("refused of {all} sweeps");
    let advice = "`rigd serve` lists the sweeps of the session with their times: look at what was switched on then";
    let mut checks = vec![Check::quantity("free sensor", name, refused, advice)];
    match judge(night, None) {
        Err(error) => {
            let text = error.to_string();
            checks.push(Check::problem("free sensor", "night", text, "let it run for longer"));
        }
        Ok(found) => {
            let rows = [
                (
                    "sensor.drift",
                    "drift",
                    DRIFT_HZ_PER_H,
                    "warm up for longer, and keep the room at one temperature",
                ),
                (
                    "sensor.level",
                    "shift from the lowest level to the highest",
                    LEVEL_HZ,
                    "measure at a lower level",
                ),
            ];
            for (value, name, limit, advice) in rows {
                let Some(value) = found.values.iter().find(|one| one.name == value) else {
                    continue;
                };
                let quantity = Quantity {
                    value: value.value.abs(),
                    uncertainty: Some(value.standard_uncertainty),
                    limit,
                    unit: value.unit,
                };
                checks.push(Check::quantity("free sensor", name, quantity, advice));
            }
        }
    }
    if let Some(why) = &night.survey_refused {
        let advice = "look at the clamp of the sensor and at its cable, and repeat the survey";
        checks.push(Check::problem("free sensor", "survey", why.clone(), advice));
    }
    checks
}

#[cfg(test)]
mod tests {
    use rig_commission::sensor::FreeSweep;

    use super::*;
    use crate::doctor::Level;

    /// Sweeps of a night, one each five minutes, with this drift.
    fn night(drift_hz_per_h: f64, refused: usize) -> SensorSweeps {
        let sweep = |index: u32| {
            let at_s = 300.0 * f64::from(index);
            let noise_hz = 0.01 * f64::from(index % 7) - 0.03;
            FreeSweep {
                at_s,
                level_v: [0.5, 2.0, 5.0][(index % 3) as usize],
                resonance_hz: 140.4 + drift_hz_per_h * at_s / 3600.0 + noise_hz,
                quality_factor: 66.0,
                capacitance_ratio: 0.08,
                capacitance_f: 27.4e-9,
                loss_tangent: 0.018,
            }
        };
        SensorSweeps { sweeps: (0..99).map(sweep).collect(), refused, ..SensorSweeps::default() }
    }

    #[test]
    fn a_night_with_a_drift_or_with_refused_sweeps_is_a_problem() {
        let problems = |night: &SensorSweeps| -> Vec<String> {
            let found = soak(night).into_iter().filter(|check| check.level == Level::Problem);
            found.map(|check| check.name).collect()
        };
        assert!(problems(&night(0.1, 1)).is_empty());
        assert_eq!(problems(&night(1.4, 0)), ["drift"]);
        assert_eq!(problems(&night(0.0, 2)), ["refused of 101 sweeps"]);
        let why = Some("a second mode near 143.33 Hz".to_owned());
        assert_eq!(problems(&SensorSweeps { survey_refused: why, ..night(0.0, 0) }), ["survey"]);
        assert_eq!(problems(&SensorSweeps::default()), ["night"]);
    }

    #[test]
    fn the_largest_distance_from_a_target_counts() {
        let check = rest_check("linear stage", &[0.001, -0.003, 0.0], 0.002, "mm");
        assert_eq!(check.level, Level::Problem);
        assert_eq!(check.quantity.map(|quantity| quantity.value), Some(0.003));
        assert_eq!(rest_check("linear stage", &[0.001], 0.002, "mm").level, Level::Ok);
    }
}
