//! The records of a run of the paper's protocol.

use rig_record::{
    Action, BlackBox, Chain, ChainCheck, Clearance, Device, Digest, Direction, Ending, Fault,
    Frame, Phase, PlanSize, Pose, Prompt, PromptAnswered, PromptAsked, ReadingFlag, ReadingRecord,
    Record, RefusedTouch, Run, RunFinished, RunId, RunKind, RunStarted, RunStatus, Sample, Source,
    StepStarted, StoredRecord, Sweep, SweepOutcome, SweepPurpose, Touch, TouchPosition,
    TouchSettings,
};
use rig_resonance::Circuit;
use uuid::Uuid;

use crate::{RunVerdict, results::RunResults};

const SAMPLES: [(&str, f64); 5] =
    [("1", 0.045), ("2", 0.104), ("3", 0.235), ("4", 0.320), ("5", 0.649)];
const NO_LOAD_HZ: f64 = 137.6;

/// The course of the sample run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Story {
    /// Every touch of the paper is measured.
    Complete,
    /// A fault after seven touches.
    Faulted,
    /// The touches of sample 2 at 45° from the left and the third blind one are refused.
    Refused,
    /// Aborted before the first measurement.
    Empty,
}

/// A run and its records.
pub(crate) struct SampleRun {
    pub(crate) run: Run,
    pub(crate) chain: Chain,
}

const ID: RunId = RunId::new(Uuid::from_u128(0x019a_a5b0_0000_7000_8000_0000_0000_0001));

impl SampleRun {
    pub(crate) fn new(story: Story) -> Self {
        let (records, ending) = Recorder {
            story,
            records: Vec::new(),
            planned: Vec::new(),
            now_us: BEGIN_US,
            sweeps: 0,
            noise: 7,
        }
        .record();
        let chain = chain(&records);
        let run = Run {
            id: ID,
            kind: RunKind::Run,
            name: "three-direction".to_owned(),
            number: 1,
            started_at: "2026-11-21T08:15:42.120Z".to_owned(),
            finished_at: Some("2026-11-21T08:15:46.300Z".to_owned()),
            wall_s: Some(4.18),
            status: RunStatus::Ended(ending),
            records: chain.records.len() as u64,
            epoch: 1,
            amendments: 0,
            is_sealed: ending.is_complete(),
        };
        Self { run, chain }
    }

    pub(crate) fn results(&self) -> RunResults {
        RunResults::new(&self.run, &self.chain.records).unwrap()
    }

    pub(crate) fn html(&self) -> String {
        let sentence = "sound: as many records as there are".to_owned();
        self.html_with(&RunVerdict { sentence, findings: Vec::new() })
    }

    pub(crate) fn html_with(&self, verdict: &RunVerdict) -> String {
        self.results().html(&self.chain.check, verdict, "2026-11-22 19:49 +01:00")
    }

    /// The same run with another beginning.
    pub(crate) fn change_start(&mut self, change: impl FnOnce(&mut RunStarted)) {
        let first = &mut self.chain.records[0];
        let Record::RunStarted(mut started) = first.record().unwrap() else { panic!("{first:?}") };
        change(&mut started);
        first.payload = serde_json::to_string(&Record::RunStarted(started)).unwrap();
    }

    /// The same run with other touches.
    pub(crate) fn change_touches(&mut self, mut change: impl FnMut(&mut Touch)) {
        for stored in &mut self.chain.records {
            let Record::TouchResult(mut touch) = stored.record().unwrap() else { continue };
            change(&mut touch);
            stored.payload = serde_json::to_string(&Record::TouchResult(touch)).unwrap();
        }
    }
}

/// Beginning of the run on the rig's clock, µs.
const BEGIN_US: u64 = 12_000_000;

/// The records as a journal would store them.
pub(crate) fn chain(records: &[(u64, Record)]) -> Chain {
    let (mut stored, mut digest) = (Vec::new(), Digest::START);
    for ((rig_us, record), seq) in records.iter().zip(1_u64..) {
        let (kind, payload) = (record.kind().to_owned(), serde_json::to_string(record).unwrap());
        digest = digest.next(seq, *rig_us, &kind, &payload);
        let at = Some(time(rig_us - records[0].0));
        let rig_us = *rig_us;
        let (event, run, epoch, run_us) = (seq, ID, 1, rig_us - records[0].0);
        stored.push(StoredRecord {
            event,
            run,
            seq,
            rig_us,
            epoch,
            run_us,
            at,
            kind,
            payload,
            digest,
        });
    }
    let check = ChainCheck::Intact { records: stored.len() as u64, digest };
    Chain { records: stored, check }
}

/// The wall clock this many µs, less than 44 minutes, after the beginning of the run.
fn time(since_us: u64) -> String {
    let ms = since_us / 1000 + 42_120;
    format!("2026-11-21T08:{:02}:{:02}.{:03}Z", 15 + ms / 60_000, ms / 1000 % 60, ms % 1000)
}

const RIG: &str = include_str!("../../../../config/rigs/simulated.toml");

struct Recorder {
    story: Story,
    /// The records, each with its time in µs.
    records: Vec<(u64, Record)>,
    planned: Vec<TouchSettings>,
    now_us: u64,
    sweeps: u64,
    noise: u64,
}

impl Recorder {
    /// Every record with its time in µs, and the ending.
    fn record(mut self) -> (Vec<(u64, Record)>, Ending) {
        let made = match self.story {
            Story::Complete | Story::Refused => usize::MAX,
            Story::Faulted => 7,
            Story::Empty => 0,
        };
        self.main_touches(made);
        self.blind_touches(made);
        let ending = match self.story {
            Story::Complete => Ending::Completed,
            Story::Refused => Ending::CompletedWithRefusals,
            Story::Faulted => {
                let step = self.planned[made].clone();
                self.begin(&step);
                self.write(Record::Fault(Fault {
                    step: Some(step.step),
                    cause: "linear stage: no answer within 100 ms".to_owned(),
                    probe: Clearance::InContact,
                    hint: "Check the cable of the <linear stage>.".to_owned(),
                    last_moves_mm: None,
                }));
                let frame = Frame { rig_us: 1, is_sent: true, hex: "0106".to_owned() };
                let port = "/dev/ttyUSB0".to_owned();
                self.write(Record::BlackBox(BlackBox { port, frames: vec![frame] }));
                Ending::Faulted
            }
            Story::Empty => Ending::Aborted,
        };
        self.write(Record::RunFinished(RunFinished { status: ending }));
        self.records.insert(0, (BEGIN_US, started(self.planned)));
        (self.records, ending)
    }

    fn write(&mut self, record: Record) {
        self.records.push((self.now_us, record));
    }

    fn begin(&mut self, touch: &TouchSettings) {
        let TouchSettings { step, phase, sample, pose, repeat } = touch.clone();
        let action = Action::Touch { phase, sample, pose, repeat };
        self.write(Record::StepStarted(StepStarted { step, index: 1, count: 177, action }));
    }

    fn main_touches(&mut self, made: usize) {
        for (sample, (name, _)) in SAMPLES.into_iter().enumerate() {
            for direction in [Direction::Front, Direction::Back, Direction::Left] {
                if self.planned.len() < made {
                    self.ask(name);
                }
                for angle_deg in [0.0, 15.0, 30.0, 45.0] {
                    self.touch(Phase::Main, sample, Pose { direction, angle_deg }, 1, made);
                }
            }
        }
    }

    fn blind_touches(&mut self, made: usize) {
        for trial in 1..=50 {
            let sample = self.below(5);
            let direction = [Direction::Front, Direction::Back, Direction::Left][self.below(3)];
            let angle_deg = 45.0 * self.unit();
            if self.planned.len() < made {
                self.ask(SAMPLES[sample].0);
            }
            self.touch(Phase::Blind, sample, Pose { direction, angle_deg }, trial, made);
        }
    }

    /// Whether the readings of this touch gave no resonance.
    fn is_refused(&self, touch: &TouchSettings) -> bool {
        let refused = ["main/2/left/45/1", "blind/3"];
        self.story == Story::Refused && refused.contains(&touch.step.as_str())
    }

    fn ask(&mut self, name: &str) {
        let step = format!("prompt/{}", self.sweeps);
        let prompt = Prompt::PlaceSample { sample: name.to_owned() };
        self.write(Record::PromptAsked(PromptAsked { step: step.clone(), prompt }));
        self.now_us += 1_000_000;
        let by = "simulated person".to_owned();
        self.write(Record::PromptAnswered(PromptAnswered { step, by }));
    }

    /// Plans a touch and makes it, if it is one of the first `made`.
    fn touch(&mut self, phase: Phase, sample: usize, pose: Pose, repeat: u32, made: usize) {
        let (name, stiffness_mpa) = SAMPLES[sample];
        let direction = pose.direction.name();
        let step = match phase {
            Phase::Main => format!("main/{name}/{direction}/{}/{repeat}", pose.angle_deg),
            Phase::Blind => format!("blind/{repeat}"),
        };
        let touch =
            TouchSettings { step: step.clone(), phase, sample: name.to_owned(), pose, repeat };
        self.planned.push(touch.clone());
        if self.planned.len() > made {
            return;
        }
        self.begin(&touch);
        let drift_hz = -2e-5 * self.now_us as f64 * 1e-6;
        let no_load_hz = NO_LOAD_HZ + drift_hz + 0.01 * self.about_zero();
        self.sweep(SweepPurpose::NoLoad, &step, pose, no_load_hz, 60.0);
        let lean = match pose.direction {
            Direction::Front => 0.14,
            Direction::Back => 0.26,
            Direction::Left => 0.20,
        };
        let fall = 1.0 - lean * (pose.angle_deg / 45.0).powi(2);
        let level = 134.0 * stiffness_mpa * (1.22 - 0.34 * stiffness_mpa);
        let shift_hz = level * fall * (1.0 + 0.015 * self.about_zero());
        self.sweep(SweepPurpose::Touch, &step, pose, no_load_hz + shift_hz, 22.0);
        if self.is_refused(&touch) {
            return self.refuse(touch, no_load_hz);
        }
        self.write(Record::TouchResult(Touch {
            touch,
            no_load_sweep: self.sweeps - 1,
            no_load_hz,
            no_load_sigma_hz: 0.012,
            drift_sigma_hz: 0.004,
            sweep: self.sweeps,
            resonance_hz: no_load_hz + shift_hz,
            sigma_hz: 0.05,
            shift_hz,
            shift_sigma_hz: 0.05_f64.hypot(0.012).hypot(0.004),
            surface_mm: 10.1,
            surface_sigma_mm: 0.003,
            indentation_mm: 0.5,
            linear_mm: 9.6,
            rotary_deg: pose.angle_deg,
            is_slip_checked: Some(true),
            halfway: None,
        }));
    }

    /// The last sweep gave no resonance, and so the touch gave no shift.
    fn refuse(&mut self, touch: TouchSettings, no_load_hz: f64) {
        let reason = "the analyzer flagged <overload> at 152.3 Hz in 3 of 3 tries".to_owned();
        if let Some((_, Record::Sweep(sweep))) = self.records.last_mut() {
            sweep.outcome = SweepOutcome::Refused { reason: reason.clone() };
        }
        let rotary_deg = touch.pose.angle_deg;
        self.write(Record::TouchRefused(RefusedTouch {
            touch,
            reason,
            no_load_sweep: self.sweeps - 1,
            no_load_hz,
            no_load_sigma_hz: 0.012,
            rotary_deg,
            indented: Some(TouchPosition {
                sweep: self.sweeps,
                surface_mm: 10.1,
                surface_sigma_mm: 0.003,
                indentation_mm: 0.5,
                linear_mm: 9.6,
            }),
        }));
    }

    fn sweep(&mut self, purpose: SweepPurpose, step: &str, pose: Pose, resonance_hz: f64, q: f64) {
        self.sweeps += 1;
        let (c0_farad, ratio, loss_tangent) = (27.4e-9, 0.05, 0.018);
        let c1_farad = ratio * c0_farad;
        let circuit = Circuit { resonance_hz, q, c0_farad, c1_farad, loss_tangent };
        let mut readings = Vec::new();
        for index in 0..24_u32 {
            let off = (f64::from(index) - 11.5) / 11.5;
            let frequency_hz = resonance_hz * (1.0 + 0.12 * off * off * off.signum());
            let impedance_ohm = circuit.impedance_ohm(frequency_hz);
            let noise = 1.0 + 0.004 * self.about_zero();
            readings.push(ReadingRecord {
                frequency_hz,
                resistance_ohm: Some(impedance_ohm.re * noise),
                reactance_ohm: Some(impedance_ohm.im * noise),
                started_s: self.now_us as f64 * 1e-6,
                settle_s: 0.05,
                integration_s: 0.1,
                flag: ReadingFlag::Normal,
            });
            self.now_us += 150_000;
        }
        let circuit = rig_record::Circuit {
            quality_factor: q,
            static_capacitance_f: c0_farad,
            capacitance_ratio: ratio,
            loss_tangent,
            loss_tangent_sigma: None,
            quality_factor_sigma: None,
            static_capacitance_sigma_f: None,
            capacitance_ratio_sigma: None,
        };
        self.write(Record::Sweep(Sweep {
            number: self.sweeps,
            purpose,
            step: Some(step.to_owned()),
            pose: Some(pose),
            level_v: None,
            readings,
            probe_readings: 0,
            fit: None,
            outcome: SweepOutcome::Accepted {
                resonance_hz,
                sigma_hz: 0.012,
                effective_time_s: None,
                circuit: Some(circuit),
                extra: None,
                left_out: 0,
            },
        }));
        self.now_us += 2_000_000;
    }

    /// A random number between 0 and 1 (Knuth's MMIX generator).
    fn unit(&mut self) -> f64 {
        self.noise = self.noise.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.noise >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn below(&mut self, bound: u8) -> usize {
        (0..bound)
            .rev()
            .find(|&low| self.unit() * f64::from(low + 1) >= f64::from(low))
            .unwrap_or(0)
            .into()
    }

    /// A random number with mean 0 and variance 1.
    fn about_zero(&mut self) -> f64 {
        (0..12).map(|_| self.unit()).sum::<f64>() - 6.0
    }
}

pub(crate) fn started(touches: Vec<TouchSettings>) -> Record {
    let source = |name: &str, toml: &str| Source { name: name.to_owned(), toml: toml.to_owned() };
    let device = |role: &str, identity: &str| Device {
        role: role.to_owned(),
        identity: identity.to_owned(),
        instrument: None,
    };
    let sample = |(name, stiffness): (&str, f64)| Sample {
        name: name.to_owned(),
        stiffness_mpa: Some(stiffness),
    };
    Record::RunStarted(RunStarted {
        software: "rigd 0.1.0".to_owned(),
        seed: 2020,
        protocol: source(
            "three-direction",
            "name = \"three-direction\"\nangles_deg = [0, 15, 30, 45]\n",
        ),
        rig: source("simulated", RIG),
        is_simulated: true,
        scene: Some(source("paper", "name = \"paper\"\n")),
        devices: vec![
            device("analyzer", "HIOKI,IM3536,170614127,V2.00"),
            device("linear stage", "Oriental Motor AZ, unit 1"),
            device("rotary stage", "Oriental Motor AZ, unit 2"),
        ],
        calibrations: Vec::new(),
        samples: SAMPLES.map(sample).to_vec(),
        plan: PlanSize { steps: 177, touches: 110, prompts: 65 },
        expected: None,
        aim: None,
        idempotency_key: None,
        touches,
        classes: Some(5),
    })
}
