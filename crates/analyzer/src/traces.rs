//! Measures a trace at a time.

use std::time::Duration;

use rig_model::{PointResult, Reading, SweepPoint};

use crate::{
    Analyzer, AnalyzerError,
    message::Message,
    point::mean,
    trace::{self, Trace},
};

/// A sweep may take this much longer than its delays and cycles: it ranges and computes.
const SWEEP_SLACK: Duration = Duration::from_secs(5);

/// And it may take this many times as long.
const SWEEP_TIMES: f64 = 3.0;

/// Relative tolerance of a frequency of the trace, in addition to its resolution: the instrument
/// prints twelve digits.
const FREQUENCY_TOLERANCE_REL: f64 = 1e-9;

impl Analyzer {
    /// Measures as many of these points as make up one trace.
    pub(crate) async fn try_trace(
        &mut self,
        points: &[SweepPoint],
    ) -> Result<Vec<Reading>, AnalyzerError> {
        self.set_up().await?;
        let (resolution, clock) = (self.dialect.resolution, self.port.link().clock());
        let tolerance_hz = |hz: f64| resolution.tolerance_hz(hz) + FREQUENCY_TOLERANCE_REL * hz;
        let (trace, run) = Trace::first_of(points, 2.0 * resolution.tolerance_hz(1.0));
        self.confirm(trace.settings(Message::new())).await?;
        let within = SWEEP_SLACK.max(self.port.reply_within())
            + Duration::from_secs_f64(SWEEP_TIMES * trace.duration_s());
        let (_, triggered_at, _) = self.ask_all(&[&Trace::trigger], within).await?;
        let passed_s = clock.now().since(triggered_at).as_secs_f64();
        // An answer may be late, and never early.
        let overhead_s = ((passed_s - trace.duration_s()) / trace.points as f64).max(0.0);
        self.trace_overhead_s = self.trace_overhead_s.min(overhead_s);
        let ([frequencies, resistances, reactances, status], _, message) = self
            .ask_all(
                &[&trace::frequencies, &trace::resistances, &trace::reactances, &|m| {
                    m.query("*ESR")
                }],
                self.port.reply_within(),
            )
            .await?;
        let status = self.read_status(&message, status.first())?;
        self.check(&message, status).await?;
        let Ok(measured) = trace::readings(&resistances, &reactances, trace.points) else {
            let found = format!("{} and {} numbers", resistances.len(), reactances.len());
            let expected = "two numbers for each point";
            return Err(self.port.unexpected(&message, expected, found.as_bytes()));
        };
        for (n, wanted) in trace.frequencies_hz().enumerate() {
            let found = frequencies.get(n).and_then(|datum| datum.number().ok());
            let found = found.unwrap_or(f64::NAN);
            if found.is_nan() || tolerance_hz(wanted) < (found - wanted).abs() {
                let (port, what) = (self.port.name(), "frequency in Hz");
                return Err(AnalyzerError::NotTaken { port, what, wanted, found });
            }
        }
        let integration_at = |n: usize| f64::from(trace.averages) / points[n].frequency_hz;
        if let ([point], [_, last], true) = (&points[..run], &measured[..], trace.is_last_alone) {
            // A flag of either point is one of the reading.
            let measured = match mean(&measured) {
                PointResult::Value(_) => *last,
                flagged => flagged,
            };
            let settle_s = 2.0 * trace.delay_s + integration_at(0) + self.trace_overhead_s;
            return Ok(vec![Reading {
                frequency_hz: point.frequency_hz,
                measured,
                started: triggered_at,
                settle_s,
                integration_s: integration_at(0),
            }]);
        }
        // Another single point was measured twice.
        let measured = if run == 1 { vec![mean(&measured)] } else { measured };
        let times = if run == 1 { 2.0 } else { 1.0 };
        let mut begins_s = 0.0;
        let reading = |(n, measured): (usize, PointResult)| {
            let integration_s = integration_at(n);
            let started = triggered_at + Duration::from_secs_f64(begins_s);
            begins_s += trace.delay_s + integration_s + self.trace_overhead_s;
            Reading {
                frequency_hz: points[n].frequency_hz,
                measured,
                started,
                settle_s: trace.delay_s,
                integration_s: times * integration_s,
            }
        };
        Ok(measured.into_iter().enumerate().map(reading).collect())
    }
}
