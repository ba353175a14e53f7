//! Asks each device many times: how long an answer takes, and what went wrong.

use std::time::Duration;

use rig_analyzer::Analyzer;
use rig_files::rig_file::RigFile;
use rig_link::{Health, HealthMeter, StopSignal};
use rig_model::{SweepPoint, Unit, with_causes};
use rig_stage::Stage;
use tokio::time::Instant;

use super::{Check, NO_ANSWER, Quantity};

/// Readings of a drive; each asks for all blocks of its status.
const DRIVE_READINGS: usize = 500;

/// Readings of an analyzer, which are slower.
const ANALYZER_READINGS: usize = 50;

/// The driver waits for the answer of a drive for 100 ms.
const DRIVE_LIMIT_MS: f64 = 100.0;

/// A reading of two cycles at the highest frequency of the rig takes some tens of milliseconds.
const ANALYZER_LIMIT_MS: f64 = 1000.0;

pub(super) async fn with_drive<U: Unit>(device: &'static str, stage: &mut Stage<U>) -> Vec<Check> {
    let meter = stage.health();
    let before = meter.read();
    let mut times = Vec::with_capacity(DRIVE_READINGS);
    for _ in 0..DRIVE_READINGS {
        let asked = Instant::now();
        if let Err(error) = stage.status().await {
            return vec![Check::problem(device, "answers", with_causes(&error), NO_ANSWER)];
        }
        times.push(asked.elapsed());
    }
    let advice = "look at terminators, the third wire, and the latency timer of the adapter";
    checks(device, &times, &before, &meter, DRIVE_LIMIT_MS, advice)
}

pub(super) async fn with_analyzer(analyzer: &mut Analyzer, rig: &RigFile) -> Vec<Check> {
    let device = "analyzer";
    let meter = analyzer.health();
    let before = meter.read();
    let (_, frequency_hz) = rig.limits.analyzer.frequency_hz;
    let point = SweepPoint { frequency_hz, settle_s: 0.0, cycles: 2 };
    let mut times = Vec::with_capacity(ANALYZER_READINGS);
    for _ in 0..ANALYZER_READINGS {
        let asked = Instant::now();
        if let Err(error) = analyzer.measure(&[point], &StopSignal::new()).await {
            return vec![Check::problem(device, "answers", with_causes(&error), NO_ANSWER)];
        }
        times.push(asked.elapsed());
    }
    let advice = "look at the cable and the network, and whether another program speaks to it";
    checks(device, &times, &before, &meter, ANALYZER_LIMIT_MS, advice)
}

/// The checks of readings that took these times, at least one.
fn checks(
    device: &'static str,
    times: &[Duration],
    before: &Health,
    meter: &HealthMeter,
    limit_ms: f64,
    advice: &'static str,
) -> Vec<Check> {
    let mut all: Vec<f64> = times.iter().map(|time| time.as_secs_f64() * 1e3).collect();
    all.sort_by(f64::total_cmp);
    let count = all.len() as f64;
    let mean = all.iter().sum::<f64>() / count;
    let variance = all.iter().map(|ms| (ms - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    // The median of a normal distribution is known 1.25 times worse than its mean.
    let of_median = 1.253 * (variance / count).sqrt();
    let at = |share: f64| {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "it is an index"
        )]
        let index = (share * (count - 1.0)).round() as usize;
        all[index]
    };
    let ms = |check: &str, value, uncertainty| {
        let quantity = Quantity { value, uncertainty, limit: limit_ms, unit: "ms" };
        Check::quantity(device, check, quantity, advice)
    };
    let after = meter.read();
    let faults = |health: &Health| health.late + health.corrupt + health.retries + health.faults;
    let wrong = Quantity {
        value: faults(&after).saturating_sub(faults(before)) as f64,
        uncertainty: None,
        limit: 0.0,
        unit: "answers",
    };
    vec![
        ms("median of a reading", at(0.5), Some(of_median)),
        ms("99 % of the readings", at(0.99), None),
        ms("longest reading", at(1.0), None),
        Check::quantity(device, "late, corrupt or repeated", wrong, advice),
    ]
}
