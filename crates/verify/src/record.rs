//! The records of a journal, as far as the checker reads them.

use serde::Deserialize;

/// A record. A kind that is not here is a finding.
#[derive(Debug, Clone, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub(crate) enum Record {
    RunStarted(Box<RunStarted>),
    StepStarted(StepStarted),
    PromptAsked(PromptAsked),
    PromptAnswered(PromptAnswered),
    RefusalAsked {},
    RefusalAnswered(RefusalAnswered),
    Intent(Intent),
    Moved(Moved),
    Descended(Descended),
    SurfaceFound(SurfaceFound),
    SurfaceNotFound(SurfaceTrail),
    SurfaceChecked(SurfaceTrail),
    Sweep(Box<Sweep>),
    TouchResult(Box<TouchResult>),
    TouchRefused(TouchRefused),
    ReferenceJumped(ReferenceJumped),
    Operator(Operator),
    Fault(Fault),
    BlackBox(BlackBox),
    StateChanged(StateChanged),
    Stalled(Stalled),
    RetractTried(RetractTried),
    ClockJumped {},
    Resumed(Box<Resumed>),
    GivenUp(GivenUp),
    Amended(Amended),
    Archived(Archived),
    RunFinished(RunFinished),
}

/// The free resonance has jumped between two references.
#[derive(Debug, Clone, Deserialize)]
pub(crate) struct ReferenceJumped {
    pub(crate) no_load_sweep: u64,
    pub(crate) next_no_load_sweep: u64,
    pub(crate) off_hz: f64,
    pub(crate) sigma_hz: f64,
    pub(crate) touches: Vec<String>,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct RunStarted {
    pub(crate) software: Option<String>,
    pub(crate) devices: Option<Vec<Device>>,
    pub(crate) seed: Option<u64>,
    pub(crate) protocol: Source,
    pub(crate) rig: Source,
    pub(crate) is_simulated: bool,
    pub(crate) scene: Option<Source>,
    pub(crate) samples: Vec<Sample>,
    pub(crate) plan: PlanSize,
    pub(crate) touches: Vec<Touch>,
    pub(crate) aim: Option<Aim>,
    #[serde(default)]
    pub(crate) calibrations: Vec<Cited>,
}

/// A device that answered.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub(crate) struct Device {
    pub(crate) role: String,
    pub(crate) identity: String,
    pub(crate) instrument: Option<Source>,
}

/// A calibration that the run cites.
#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Cited {
    pub(crate) kind: String,
    pub(crate) made: String,
    pub(crate) file: String,
    pub(crate) sha256: String,
    /// Of a daily check, which the others do not have.
    pub(crate) verdict: Option<String>,
    pub(crate) screw: Option<Screw>,
    /// Of a correction of the analyzer, which the others do not have.
    pub(crate) cable: Option<String>,
}

/// The error of the linear screw at heights.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub(crate) struct Screw {
    pub(crate) heights_mm: Vec<f64>,
    pub(crate) errors_mm: Vec<f64>,
    pub(crate) covariance_um2: Vec<Vec<f64>>,
}

/// What the protocol wants of its touches, and the settings that were chosen for it.
#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Aim {
    pub(crate) stiffness_percent: Option<f64>,
    pub(crate) seconds_per_touch: Option<f64>,
    pub(crate) settings: AimSettings,
    pub(crate) seconds: f64,
    pub(crate) worst_percent: f64,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct AimSettings {
    pub(crate) contact_sigma_hz: f64,
    pub(crate) no_load_sigma_hz: f64,
    pub(crate) fine_step_mm: f64,
    pub(crate) no_load: String,
}

#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub(crate) struct Source {
    #[serde(default)]
    pub(crate) name: String,
    pub(crate) toml: String,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Sample {
    pub(crate) name: String,
    pub(crate) stiffness_mpa: Option<f64>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
pub(crate) struct PlanSize {
    pub(crate) steps: u32,
    pub(crate) touches: u32,
    pub(crate) prompts: Option<u32>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
pub(crate) struct Touch {
    pub(crate) step: String,
    pub(crate) phase: String,
    pub(crate) sample: String,
    pub(crate) pose: Pose,
    pub(crate) repeat: u32,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
pub(crate) struct Pose {
    pub(crate) direction: String,
    pub(crate) angle_deg: f64,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct StepStarted {
    pub(crate) step: String,
    pub(crate) index: u32,
    pub(crate) count: u32,
    pub(crate) action: Action,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "action", rename_all = "snake_case")]
pub(crate) enum Action {
    Prompt { prompt: Prompt },
    NoLoad { pose: Pose },
    Touch { phase: String, sample: String, pose: Pose, repeat: u32 },
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "what", rename_all = "snake_case")]
pub(crate) enum Prompt {
    PlaceSample { sample: String },
    TurnSensor { orientation: String },
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct PromptAsked {
    pub(crate) step: String,
    pub(crate) prompt: Prompt,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct PromptAnswered {
    pub(crate) step: String,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Axis {
    LinearMm,
    RotaryDeg,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Intent {
    pub(crate) what: String,
    pub(crate) axis: Axis,
    pub(crate) from: Option<f64>,
    pub(crate) to: f64,
    pub(crate) limit: Option<f64>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
pub(crate) struct Moved {
    pub(crate) axis: Axis,
    pub(crate) target: f64,
    pub(crate) read_back: f64,
    #[serde(default)]
    pub(crate) is_clear: bool,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct RetractTried {
    pub(crate) probe: String,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct RefusalAnswered {
    pub(crate) step: String,
    pub(crate) reason: String,
    pub(crate) answer: String,
    pub(crate) window_hz: Option<[f64; 2]>,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct SurfaceFound {
    pub(crate) step: String,
    pub(crate) pose: Pose,
    pub(crate) position_mm: f64,
    pub(crate) sigma_mm: f64,
    pub(crate) trail: Vec<Tried>,
}

/// A way down at even speed with a stream of readings.
#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Descended {
    pub(crate) step: String,
    pub(crate) pose: Pose,
    pub(crate) target_mm: f64,
    pub(crate) speed_mm_per_s: f64,
    pub(crate) read_back_mm: f64,
    pub(crate) end: String,
    pub(crate) way: Vec<WayPoint>,
    pub(crate) readings: Vec<Reading>,
}

/// A position of the moving stage.
#[derive(Debug, Clone, Copy, Deserialize)]
pub(crate) struct WayPoint {
    pub(crate) at_s: f64,
    pub(crate) position_mm: f64,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct SurfaceTrail {
    pub(crate) step: String,
    pub(crate) pose: Pose,
    pub(crate) trail: Vec<Tried>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
pub(crate) struct Tried {
    pub(crate) position_mm: f64,
    pub(crate) reading: Reading,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Flag {
    #[default]
    Normal,
    Overload,
    LowSignal,
}

#[derive(Debug, Clone, Copy, Deserialize)]
pub(crate) struct Reading {
    pub(crate) frequency_hz: f64,
    pub(crate) resistance_ohm: Option<f64>,
    pub(crate) reactance_ohm: Option<f64>,
    pub(crate) started_s: f64,
    pub(crate) settle_s: f64,
    pub(crate) integration_s: f64,
    #[serde(default)]
    pub(crate) flag: Flag,
}

impl Reading {
    /// Begin of the integration, s on the rig's clock.
    pub(crate) fn begin_s(&self) -> f64 {
        self.started_s + self.settle_s
    }

    /// End of the integration.
    pub(crate) fn end_s(&self) -> f64 {
        self.begin_s() + self.integration_s
    }
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Sweep {
    pub(crate) number: u64,
    pub(crate) purpose: String,
    pub(crate) step: Option<String>,
    pub(crate) pose: Option<Pose>,
    pub(crate) level_v: Option<f64>,
    pub(crate) readings: Vec<Reading>,
    pub(crate) probe_readings: usize,
    pub(crate) fit: Option<FitSettings>,
    pub(crate) outcome: Outcome,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(tag = "status", rename_all = "snake_case")]
pub(crate) enum Outcome {
    Accepted {
        resonance_hz: f64,
        sigma_hz: f64,
        effective_time_s: Option<f64>,
        circuit: Option<Circuit>,
        extra: Option<Extra>,
        #[serde(default)]
        left_out: usize,
    },
    Refused {
        reason: String,
    },
}

#[derive(Debug, Clone, Copy, Deserialize)]
pub(crate) struct Circuit {
    pub(crate) quality_factor: f64,
    pub(crate) static_capacitance_f: f64,
    pub(crate) capacitance_ratio: f64,
    pub(crate) loss_tangent: f64,
}

/// What was fitted together with the circuit.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub(crate) enum Extra {
    Drift { change: f64 },
    Relaxation { change: f64, time_s: f64 },
    Stray { resistance_ohm: f64, inductance_h: f64 },
    SecondMode { resonance_hz: f64, quality_factor: f64, capacitance_f: f64 },
    Dispersion { slope: f64 },
    AnalyzerPhase { phase_rad: f64 },
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct FitSettings {
    pub(crate) window_hz: [f64; 2],
    pub(crate) noise: Option<FitNoise>,
    pub(crate) timing: String,
    pub(crate) target_sigma_hz: Option<f64>,
    pub(crate) bench: Option<Bench>,
}

/// What a survey found on the bench.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub(crate) struct Bench {
    pub(crate) phase_rad: f64,
    pub(crate) phase_sigma_rad: f64,
    #[serde(default)]
    pub(crate) first_gap_s: f64,
    /// Records of before it was measured have none.
    #[serde(flatten)]
    pub(crate) dispersion: Option<Dispersion>,
    pub(crate) mode_sigma: f64,
    pub(crate) surveyed_hz: [f64; 2],
}

/// What a survey found of the dielectric.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub(crate) struct Dispersion {
    pub(crate) dispersion_f: f64,
    pub(crate) dispersion_sigma_f: f64,
}

impl FitSettings {
    /// Whether the free decay was fitted.
    pub(crate) fn is_ringing(&self) -> bool {
        self.timing == "any-phase"
    }
}

#[derive(Debug, Clone, Copy, Deserialize)]
pub(crate) struct FitNoise {
    pub(crate) at_ten_cycles: f64,
    pub(crate) degrees_of_freedom: f64,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct TouchResult {
    pub(crate) touch: Touch,
    pub(crate) no_load_sweep: u64,
    pub(crate) no_load_hz: f64,
    pub(crate) no_load_sigma_hz: f64,
    #[serde(default)]
    pub(crate) drift_sigma_hz: f64,
    pub(crate) sweep: u64,
    pub(crate) resonance_hz: f64,
    pub(crate) sigma_hz: f64,
    pub(crate) shift_hz: f64,
    pub(crate) shift_sigma_hz: f64,
    pub(crate) surface_mm: f64,
    pub(crate) surface_sigma_mm: f64,
    pub(crate) indentation_mm: f64,
    pub(crate) linear_mm: f64,
    pub(crate) rotary_deg: f64,
    pub(crate) is_slip_checked: Option<bool>,
    pub(crate) halfway: Option<Halfway>,
}

/// The measurement of a touch at a smaller depth.
#[derive(Debug, Clone, Copy, Deserialize)]
pub(crate) struct Halfway {
    pub(crate) sweep: u64,
    pub(crate) resonance_hz: f64,
    pub(crate) sigma_hz: f64,
    pub(crate) indentation_mm: f64,
    pub(crate) linear_mm: f64,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct TouchRefused {
    pub(crate) touch: Touch,
    pub(crate) reason: String,
    pub(crate) no_load_sweep: u64,
    pub(crate) no_load_hz: f64,
    pub(crate) no_load_sigma_hz: f64,
    pub(crate) rotary_deg: f64,
    pub(crate) indented: Option<Indented>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
pub(crate) struct Indented {
    pub(crate) sweep: u64,
    pub(crate) surface_mm: f64,
    pub(crate) surface_sigma_mm: f64,
    pub(crate) indentation_mm: f64,
    pub(crate) linear_mm: f64,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Operator {
    pub(crate) action: String,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Fault {
    pub(crate) probe: String,
    pub(crate) cause: String,
}

#[derive(Debug, Clone, Copy, Deserialize)]
pub(crate) struct Stalled {
    pub(crate) stalled_s: f64,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct BlackBox {
    pub(crate) frames: Vec<Frame>,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Frame {
    pub(crate) rig_us: u64,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct StateChanged {
    pub(crate) state: String,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct RunFinished {
    pub(crate) status: String,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Resumed {
    pub(crate) epoch: u64,
    pub(crate) next: Option<String>,
    pub(crate) touches_done: u32,
    pub(crate) touches_left: u32,
    #[serde(default)]
    pub(crate) changes: Vec<Change>,
    pub(crate) software: Option<String>,
    pub(crate) rig: Option<Source>,
    pub(crate) scene: Option<Source>,
    pub(crate) calibrations: Option<Vec<Cited>>,
    pub(crate) devices: Option<Vec<Device>>,
}

/// A difference between two parts of a run.
#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Change {
    pub(crate) what: String,
    pub(crate) was: String,
    pub(crate) is: String,
}

#[derive(Debug, Clone, Copy, Deserialize)]
pub(crate) struct GivenUp {
    pub(crate) epoch: u64,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Amended {
    pub(crate) run: String,
    pub(crate) head: String,
    pub(crate) who: String,
    pub(crate) step: String,
    pub(crate) what: String,
    pub(crate) why: String,
    pub(crate) software: Option<String>,
    pub(crate) rig: Option<Source>,
    pub(crate) calibrations: Option<Vec<Cited>>,
    #[serde(default)]
    pub(crate) devices: Vec<Device>,
    #[serde(default)]
    pub(crate) changes: Vec<Change>,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Archived {
    pub(crate) run: String,
    pub(crate) records: u64,
    pub(crate) head: String,
    pub(crate) place: String,
}
