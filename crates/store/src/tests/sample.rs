//! Data directories and a small run for the tests.
use std::{
    fs,
    path::{Path, PathBuf},
    sync::atomic::{AtomicU32, Ordering},
};

#[path = "../../../record/tests/support/sweep.rs"]
mod sweep;

use sweep::{POSE, STEP, reading};

use crate::{
    Action, Axis, CitedCalibration, Clearance, Device, Ending, Fault, Intent, Journal, Move,
    MoveReason, Phase, PlanSize, Prompt, PromptAnswered, PromptAsked, Record, RefusedTouch,
    RunFinished, RunStarted, Sample, Source, StepStarted, Surface, SurfaceReading, SweepPurpose,
    Touch, TouchPosition, TouchSettings,
};

/// A directory that is removed with the value.
pub(super) struct Directory(PathBuf);

impl Directory {
    pub(super) fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let name = format!("rig-store-{}-{number}", std::process::id());
        let path = std::env::temp_dir().join(name);
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    pub(super) fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Directory {
    fn drop(&mut self) {
        _ = fs::remove_dir_all(&self.0);
    }
}

/// Appends a record `seconds` after the rig was opened.
#[track_caller]
pub(super) fn append(journal: &mut Journal, seconds: u64, record: &Record) -> u64 {
    journal.append(seconds * 1_000_000, record).unwrap()
}

/// A run of one touch. The last record ends it.
pub(super) fn records() -> Vec<Record> {
    let step = || STEP.to_owned();
    let place = Prompt::PlaceSample { sample: "agar, \"soft\"".to_owned() };
    vec![
        run_started(),
        Record::StepStarted(StepStarted {
            step: "prompt/1".to_owned(),
            index: 1,
            count: 2,
            action: Action::Prompt { prompt: place.clone() },
        }),
        Record::PromptAsked(PromptAsked { step: "prompt/1".to_owned(), prompt: place }),
        Record::PromptAnswered(PromptAnswered {
            step: "prompt/1".to_owned(),
            by: "the page".to_owned(),
        }),
        Record::StepStarted(StepStarted {
            step: step(),
            index: 2,
            count: 2,
            action: Action::Touch {
                phase: Phase::Main,
                sample: "agar, \"soft\"".to_owned(),
                pose: POSE,
                repeat: 1,
            },
        }),
        sweep(1, SweepPurpose::NoLoad, 140.4),
        Record::Intent(Intent {
            what: MoveReason::Approach,
            axis: Axis::LinearMm,
            from: Some(40.0),
            to: 10.125,
            limit: Some(9.0),
        }),
        Record::Moved(Move {
            axis: Axis::LinearMm,
            target: 10.125,
            read_back: 10.1249,
            is_clear: false,
        }),
        Record::SurfaceFound(Surface {
            step: step(),
            pose: POSE,
            position_mm: 10.1,
            sigma_mm: 0.01 / 12.0_f64.sqrt(),
            onset: None,
            trail: vec![SurfaceReading { position_mm: 10.3, reading: reading(140.0, 0) }],
        }),
        sweep(2, SweepPurpose::Touch, 158.3),
        touch_result(),
        touch_refused(),
        Record::Fault(Fault {
            step: Some(step()),
            cause: "linear stage: no answer within 100 ms".to_owned(),
            probe: Clearance::InContact,
            hint: "check the cable of the linear stage".to_owned(),
            last_moves_mm: Some([9.5, 24.5]),
        }),
        Record::RunFinished(RunFinished { status: Ending::Faulted }),
    ]
}

fn touch_result() -> Record {
    Record::TouchResult(Touch {
        touch: touch_settings(),
        no_load_sweep: 1,
        no_load_hz: 140.4,
        no_load_sigma_hz: 0.01,
        drift_sigma_hz: 0.003,
        sweep: 2,
        resonance_hz: 158.3,
        sigma_hz: 0.02,
        shift_hz: 158.3 - 140.4,
        shift_sigma_hz: 5.09e-4_f64.sqrt(),
        surface_mm: 10.1,
        surface_sigma_mm: 0.01 / 12.0_f64.sqrt(),
        indentation_mm: 0.5,
        linear_mm: 9.6,
        rotary_deg: -30.0,
        is_slip_checked: Some(true),
        halfway: None,
    })
}

fn touch_refused() -> Record {
    Record::TouchRefused(RefusedTouch {
        touch: touch_settings(),
        reason: "the readings had not settled".to_owned(),
        no_load_sweep: 1,
        no_load_hz: 140.4,
        no_load_sigma_hz: 0.01,
        rotary_deg: 29.99,
        indented: Some(TouchPosition {
            sweep: 2,
            surface_mm: 10.1,
            surface_sigma_mm: 0.003,
            indentation_mm: 0.5,
            linear_mm: 9.6,
        }),
    })
}

fn touch_settings() -> TouchSettings {
    TouchSettings {
        step: STEP.to_owned(),
        phase: Phase::Main,
        sample: "agar, \"soft\"".to_owned(),
        pose: POSE,
        repeat: 1,
    }
}

pub(super) fn run_started() -> Record {
    let source = |name: &str| Source { name: name.to_owned(), toml: format!("name = \"{name}\"") };
    Record::RunStarted(RunStarted {
        software: "rigd 0.1.0".to_owned(),
        seed: u64::MAX,
        protocol: source("one touch"),
        rig: source("simulated"),
        is_simulated: true,
        scene: Some(source("paper")),
        devices: vec![Device {
            role: "analyzer".to_owned(),
            identity: "HIOKI,IM3536".to_owned(),
            instrument: Some(source("im3536")),
        }],
        calibrations: vec![CitedCalibration {
            kind: "scale".to_owned(),
            made: "2026-11-25T15:30:00Z".to_owned(),
            person: "ada".to_owned(),
            file: "scale-20261125T153000.000000Z.toml".to_owned(),
            sha256: "00".repeat(32),
            verdict: None,
            screw: None,
            cable: None,
        }],
        samples: vec![Sample { name: "agar, \"soft\"".to_owned(), stiffness_mpa: Some(0.104) }],
        plan: PlanSize { steps: 2, touches: 1, prompts: 1 },
        touches: vec![touch_settings()],
        classes: None,
        expected: None,
        aim: None,
        idempotency_key: None,
    })
}

pub(super) fn sweep(number: u64, purpose: SweepPurpose, resonance_hz: f64) -> Record {
    Record::Sweep(sweep::sweep(number, purpose, resonance_hz))
}

/// The names in a directory.
pub(super) fn names(directory: &Path) -> Vec<String> {
    let entries = fs::read_dir(directory).unwrap();
    let mut names: Vec<_> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}
