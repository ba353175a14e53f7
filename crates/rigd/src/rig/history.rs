//! How long the touches of this rig took in earlier runs, beside what their plans expected.

use std::collections::BTreeMap;

use rig_model::RigLimits;
use rig_protocol::{Action, Plan};
use rig_store::{Reader, Record, StoreError, StoredRecord};

use super::Setting;
use crate::protocol_file::LoadedProtocol;

/// Number of earlier runs that count: a bench changes slowly.
const RUNS_MAX: usize = 20;

/// With fewer steps of a kind, the plan is the better estimate.
const LEAST_STEPS: usize = 5;

/// The range holds the middle four fifths of what happened before: its ends.
const ENDS: [f64; 2] = [0.1, 0.9];

/// Two runs of one protocol on one bench differ by about this, relative, beyond what the differences of
/// their touches explain: another sample, another temperature.
const BETWEEN_RUNS: f64 = 0.1;

/// The kinds of steps that take time of the rig.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum StepKind {
    NoLoad,
    Touch,
}

impl StepKind {
    /// The kind of a step; a prompt has none.
    pub(super) const fn of(action: &Action) -> Option<Self> {
        match action {
            Action::Prompt(_) => None,
            Action::NoLoad(_) => Some(Self::NoLoad),
            Action::Touch(_) => Some(Self::Touch),
        }
    }
}

/// A step: its expected and its real duration, s.
type Taken = (f64, f64);

/// The ended steps of earlier runs.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct History {
    /// For each kind, the steps of each run in order.
    runs: BTreeMap<StepKind, Vec<Vec<Taken>>>,
    /// The times of the answers to prompts, s, in ascending order.
    answers_s: Vec<f64>,
}

impl History {
    /// Reads the last runs of this rig. A run whose protocol does not fit the rig any more is left
    /// out.
    pub(super) fn read(reader: &Reader, setting: &Setting) -> Result<Self, StoreError> {
        let mut history = Self::default();
        for run in reader.latest_runs(Some(RUNS_MAX), None)? {
            let records = reader.unchecked(run.id, &KINDS)?;
            if let Some(plan) = plan_of(&records, setting) {
                history.add(&plan, &records, &setting.limits);
            }
        }
        history.answers_s.sort_by(f64::total_cmp);
        Ok(history)
    }

    fn add(&mut self, plan: &Plan, records: &[StoredRecord], limits: &RigLimits) {
        let durations_s = plan.durations_s(limits);
        let planned: BTreeMap<String, (StepKind, f64)> = plan
            .steps
            .iter()
            .zip(durations_s)
            .filter_map(|(step, s)| Some((step.id.to_string(), (StepKind::of(&step.action)?, s))))
            .collect();
        let mut run = BTreeMap::<StepKind, Vec<Taken>>::new();
        for pair in records.windows(2) {
            // What lies between two epochs is no time of the rig.
            if pair[0].epoch != pair[1].epoch {
                continue;
            }
            let took_s = pair[1].rig_us.saturating_sub(pair[0].rig_us) as f64 / 1e6;
            let (begun, next) = match (pair[0].record(), pair[1].record()) {
                (Ok(Record::StepStarted(begun)), Ok(next)) => (begun, next),
                (Ok(Record::PromptAsked(_)), Ok(Record::PromptAnswered(_))) => {
                    self.answers_s.push(took_s);
                    continue;
                }
                _ => continue,
            };
            let Some(&(kind, planned_s)) = planned.get(&begun.step) else { continue };
            let is_ended = match (kind, &next) {
                (StepKind::Touch, Record::TouchResult(touch)) => touch.touch.step == begun.step,
                (StepKind::Touch, Record::TouchRefused(touch)) => touch.touch.step == begun.step,
                (StepKind::NoLoad, Record::StepStarted(_)) => true,
                _ => false,
            };
            if is_ended && planned_s > 0.0 {
                run.entry(kind).or_default().push((planned_s, took_s));
            }
        }
        for (kind, steps) in run {
            self.runs.entry(kind).or_default().push(steps);
        }
    }

    /// Number of touches from which it is learned.
    pub fn touches(&self) -> usize {
        self.runs.get(&StepKind::Touch).map_or(0, |runs| runs.iter().map(Vec::len).sum())
    }

    /// Time within which nine of ten prompts were answered, s; `None` without enough of them.
    pub(super) fn answer_s(&self) -> Option<f64> {
        let last = self.answers_s.len().checked_sub(1).filter(|last| LEAST_STEPS <= last + 1)?;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "an index")]
        let place = (last as f64 * ENDS[1]).round() as usize;
        Some(self.answers_s[place])
    }

    /// The least and the most of the real duration over the expected one, for this number of steps in
    /// a row; `None` without enough of them.
    ///
    /// The quantiles are those of as many steps in a row of the earlier runs, so that the range of a sum
    /// is narrower than that of one step, unless slow steps come together. Each run counts once, however
    /// many steps it has, because the steps of a run are alike.
    pub(super) fn ratios(&self, kind: StepKind, steps: usize) -> Option<[f64; 2]> {
        let runs = self.runs.get(&kind)?;
        if runs.iter().map(Vec::len).sum::<usize>() < LEAST_STEPS {
            return None;
        }
        let in_a_row = |run: &Vec<Taken>| -> Vec<(f64, f64)> {
            let count = steps.clamp(1, run.len());
            let share = 1.0 / (run.len() - count + 1) as f64;
            let ratio = |steps: &[Taken]| {
                let sums =
                    steps.iter().fold((0.0, 0.0), |sum, step| (sum.0 + step.0, sum.1 + step.1));
                (sums.1 / sums.0, share)
            };
            run.windows(count).map(ratio).collect()
        };
        let mut all: Vec<(f64, f64)> = runs.iter().flat_map(in_a_row).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let margin = BETWEEN_RUNS / (runs.len() as f64).sqrt();
        let end = |part: f64| {
            let mut left = part * runs.len() as f64;
            let mut places = all.iter();
            let place = places.find(|(_, share)| {
                left -= share;
                left <= 0.0
            });
            place.or(all.last()).map(|(ratio, _)| *ratio)
        };
        let [low, high] = [end(ENDS[0])?, end(ENDS[1])?];
        Some([low * (1.0 - margin), high * (1.0 + margin)])
    }
}

/// The kinds of records that say when steps begin and end. Those of a person, of an end and of a resumption lie between
/// the two of a step that was interrupted.
const KINDS: [&str; 10] = [
    "run_started",
    "step_started",
    "prompt_asked",
    "prompt_answered",
    "refusal_asked",
    "touch_result",
    "touch_refused",
    "operator",
    "run_finished",
    "resumed",
];

/// The plan of a run on the present rig, if it was a run of this rig.
fn plan_of(records: &[StoredRecord], setting: &Setting) -> Option<Plan> {
    let Ok(Record::RunStarted(started)) = records.first()?.record() else { return None };
    let is_simulated = setting.scene.is_some();
    if started.rig.name != setting.rig.name || started.is_simulated != is_simulated {
        return None;
    }
    let protocol = LoadedProtocol::of_run(&started, &setting.limits, None);
    Some(protocol.ok()?.plan)
}

#[cfg(test)]
mod tests {
    use rig_protocol::Step;
    use rig_store::{Digest, RefusalAsked, RefusedTouch, StepStarted, TouchSettings};

    use super::*;
    use crate::rig::way_out::tests::{load, protocol};

    fn history(runs: Vec<Vec<Taken>>) -> History {
        History { runs: BTreeMap::from([(StepKind::Touch, runs)]), answers_s: Vec::new() }
    }

    /// Those of the records that are read, of one epoch, at these times, s.
    fn stored(records: Vec<(u64, Record)>) -> Vec<StoredRecord> {
        let one = |(seq, (second, record)): (u64, (u64, Record))| StoredRecord {
            event: seq,
            run: "01a228ea-69c1-71fe-8c0c-5d0577a85304".parse().unwrap(),
            seq,
            rig_us: 1_000_000 * second,
            epoch: 1,
            run_us: 1_000_000 * second,
            at: None,
            kind: record.kind().to_owned(),
            payload: serde_json::to_string(&record).unwrap(),
            digest: Digest::START,
        };
        (1..).zip(records).map(one).filter(|one| KINDS.contains(&&*one.kind)).collect()
    }

    /// A touch at these times, s: its begin, the question about it if there is one, and its end.
    fn refused_touch(step: &Step, begin: u64, asked: Option<u64>, end: u64) -> Vec<(u64, Record)> {
        let touch = TouchSettings {
            step: step.id.to_string(),
            phase: rig_store::Phase::Main,
            sample: "1".to_owned(),
            pose: rig_store::Pose { direction: rig_store::Direction::Front, angle_deg: 0.0 },
            repeat: 1,
        };
        let action = rig_store::Action::Touch {
            phase: touch.phase,
            sample: touch.sample.clone(),
            pose: touch.pose,
            repeat: 1,
        };
        let started = StepStarted { step: step.id.to_string(), index: 1, count: 1, action };
        let refused = RefusedTouch {
            touch,
            reason: "the fit did not converge".to_owned(),
            no_load_sweep: 1,
            no_load_hz: 140.0,
            no_load_sigma_hz: 0.02,
            rotary_deg: 0.0,
            indented: None,
        };
        let question = RefusalAsked { step: step.id.to_string(), reason: refused.reason.clone() };
        [(begin, Record::StepStarted(started))]
            .into_iter()
            .chain(asked.map(|at| (at, Record::RefusalAsked(question))))
            .chain([(end, Record::TouchRefused(refused))])
            .collect()
    }

    /// A person decides about a refused touch when there is time, which says nothing of the next run.
    #[test]
    fn the_wait_for_a_decision_is_no_work() {
        let protocol = protocol();
        let limits = load().facts().limits;
        let is_touch = |step: &&Step| matches!(step.action, Action::Touch(_));
        let touches: Vec<&Step> = protocol.plan.steps.iter().filter(is_touch).take(6).collect();
        let of = |asked: Option<u64>, wait: u64| {
            let one = |(number, step): (u64, &&Step)| {
                let (begin, asked) = (100_000 * number, asked.filter(|_| number == 5));
                let end = begin + 14 + if asked.is_some() { wait } else { 0 };
                refused_touch(step, begin, asked.map(|after| begin + after), end)
            };
            let mut history = History::default();
            let records = (0..).zip(&touches).flat_map(one).collect();
            history.add(&protocol.plan, &stored(records), &limits);
            history
        };
        let (undecided, decided) = (of(None, 0), of(Some(14), 18_000));
        assert_eq!((undecided.touches(), decided.touches()), (6, 5));
        let most = |history: &History| history.ratios(StepKind::Touch, 1).unwrap()[1];
        assert!(most(&decided) <= most(&undecided), "{} {}", most(&decided), most(&undecided));
        assert_eq!(decided.answer_s(), None);
    }

    #[test]
    fn fewer_than_five_touches_are_no_history() {
        let four = history(vec![vec![(10.0, 12.0); 4]]);
        assert_eq!(four.ratios(StepKind::Touch, 3), None);
        assert_eq!(four.ratios(StepKind::NoLoad, 3), None);
        assert_eq!((four.touches(), four.answer_s()), (4, None));
    }

    #[test]
    fn the_range_holds_what_happened_and_is_narrower_for_many_touches() {
        // Every fifth touch takes twice as long as planned, the others as long as planned.
        let run: Vec<Taken> =
            (0..40).map(|index| (10.0, if index % 5 == 0 { 20.0 } else { 10.0 })).collect();
        let history = history(vec![run; 4]);
        let [low, high] = history.ratios(StepKind::Touch, 1).unwrap();
        assert!((0.9..=1.0).contains(&low) && (2.0..=2.2).contains(&high), "{low} {high}");
        let [low, high] = history.ratios(StepKind::Touch, 40).unwrap();
        assert!((1.1..1.2).contains(&low) && (1.2..1.3).contains(&high), "{low} {high}");
        // One earlier run says less than many.
        let one = self::history(vec![vec![(10.0, 12.0); 40]]);
        let many = self::history(vec![vec![(10.0, 12.0); 40]; 16]);
        let width = |history: &History| {
            let [low, high] = history.ratios(StepKind::Touch, 40).unwrap();
            high - low
        };
        assert!(width(&one) > 3.9 * width(&many), "{} {}", width(&one), width(&many));
    }
}
