//! Measures one resonance: asks the planner for points until it has an answer.

use rig_model::{DriveLevel, PointResult, Reading, RigLimits, RigTime, SweepRequest};
use rig_resonance::{FitOutcome, Next, Planner, Prior, flagged};

use crate::{Event, Fault, FinishedSweep, Operation, SweepPurpose};

/// Possible drift of the free resonance since its last measurement, relative. A warm laboratory
/// moves a bimorph by a few tenths of a percent.
pub(crate) const DRIFT: f64 = 0.01;

/// The next step of a sweep.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum SweepStep {
    /// Measure, then call [`Sweep::measured`].
    Measure(Operation),
    /// The sweep is finished, and its outcome is noted.
    Finished(Box<FinishedSweep>),
    /// The sweep cannot continue.
    Fault(Fault),
}

#[derive(Debug)]
pub(crate) struct Sweep {
    purpose: SweepPurpose,
    planner: Planner,
    begun: RigTime,
    level: DriveLevel,
    asked: usize,
    readings: Vec<Reading>,
}

impl Sweep {
    pub(crate) fn begin(
        now: RigTime,
        purpose: SweepPurpose,
        request: &SweepRequest,
        prior: Option<&Prior>,
        (limits, notes): (&RigLimits, &mut Vec<Event>),
    ) -> (Self, SweepStep) {
        notes.push(Event::SweepBegun { purpose, request: *request });
        let shortest_s = limits.analyzer.shortest_integration_s;
        let planner = Planner::new(request, prior).with_shortest_integration(shortest_s);
        let mut sweep = Self {
            purpose,
            planner,
            begun: now,
            level: request.level,
            asked: 0,
            readings: Vec::new(),
        };
        let step = sweep.next(0, notes);
        (sweep, step)
    }

    /// Readings have come.
    pub(crate) fn measured(
        &mut self,
        now: RigTime,
        readings: &[Reading],
        notes: &mut Vec<Event>,
    ) -> SweepStep {
        let readings: Vec<Reading> =
            readings.iter().map(|reading| since(self.begun, *reading)).collect();
        self.readings.extend_from_slice(&readings);
        let values: Vec<Reading> = values(&readings).copied().collect();
        if let Some(refusal) = flagged(&readings) {
            return self.finish(FitOutcome::Refused(refusal), notes);
        }
        if values.len() != self.asked {
            let fault = Fault::MissingReadings { given: values.len(), asked: self.asked };
            return SweepStep::Fault(fault);
        }
        let work = self.planner.work();
        self.planner.pass(now.since(self.begun).as_secs_f64());
        self.planner.add(&values);
        let estimate = self.planner.estimate();
        notes.push(Event::Measured { readings: values, estimate });
        self.next(work, notes)
    }

    /// Asks the planner, which had done this much work before.
    fn next(&mut self, work: u64, notes: &mut Vec<Event>) -> SweepStep {
        let next = self.planner.next();
        let (readings, work) = (self.readings.len(), self.planner.work() - work);
        notes.push(Event::Planned { readings, work });
        match next {
            Next::Measure(points) => {
                self.asked = points.len();
                SweepStep::Measure(Operation::Measure { points, level: self.level })
            }
            Next::Finished(outcome) => self.finish(outcome, notes),
        }
    }

    fn finish(&mut self, outcome: FitOutcome, notes: &mut Vec<Event>) -> SweepStep {
        let readings = std::mem::take(&mut self.readings);
        // Every reading is fitted.
        let probe_readings = 0;
        let effective_time_s = self.planner.effective_time_s(&outcome);
        let finished = Box::new(FinishedSweep {
            purpose: self.purpose,
            level: self.level,
            readings,
            probe_readings,
            outcome,
            effective_time_s,
            fit: self.planner.fit_options(),
            target_hz: self.planner.target_hz(),
        });
        notes.push(Event::SweepFinished(finished.clone()));
        SweepStep::Finished(finished)
    }
}

/// A reading whose settling begins with its sweep at the earliest. An analyzer that was left at the
/// frequency of the first point has settled for long, which is no time of the sweep.
fn since(begun: RigTime, reading: Reading) -> Reading {
    let before_s = begun.since(reading.started).as_secs_f64();
    let settle_s = (reading.settle_s - before_s).max(0.0);
    Reading { started: reading.started.max(begun), settle_s, ..reading }
}

/// The readings without a flag.
fn values(readings: &[Reading]) -> impl Iterator<Item = &Reading> {
    readings.iter().filter(|reading| matches!(reading.measured, PointResult::Value(_)))
}
