// What the daemon says over HTTP: docs/http.md. Units are in the names.

export type State =
  | "preparing" | "idle" | "running" | "waiting for a person" | "paused" | "retracting" | "latched";
export type Probe = "clear" | "in contact" | "unknown";
export type Direction = "front" | "back" | "left";

export interface AxisLimits { min: number; max: number; rest: number }
export interface Limits { linear_mm: AxisLimits; rotary_deg: AxisLimits; surface_mm: number; surface_above_pivot_mm: number }

export interface Rig {
  name: string;
  state: State;
  probe: Probe;
  linear_mm?: number;
  rotary_deg?: number;
  rig_time_s: number;
  unix_ms: number;
  state_since_s: number;
  session: string;
  is_simulated: boolean;
  is_virtual_time: boolean;
  limits: Limits;
  devices: Device[];
  run?: RunProgress;
  last_run?: { id: string; status: string };
  prompt?: string;
  asked?: Asked;
  refused?: RefusedTouch;
  fault?: { kind: "fault" | "interrupted" | "not_homed" | "position_jumped" | "position_lost" | "not_commissioned"; cause: string; hint: string; attempts?: number };
  /** Who operates the rig, where clients have tokens. */
  lease?: { name: string; since_unix_ms: number };
  journal_error?: string;
  /** The rig loop gives no sign of life; all else is old. */
  silence?: { since_unix_ms: number; message: string; hint: string };
}

/** The commissioning of the rig: its steps, and what is asked. */
export interface Commission { steps: CommissionStep[]; under_way: string | null; question: CommissionQuestion | null; said: string[] }
export interface CommissionStep {
  step: string;
  shows: string;
  accepted_when: string;
  remedy: string;
  /** Text in lines of equal letters. */
  picture: string;
  is_held: boolean;
  why: string | null;
  made: string | null;
  person: string | null;
}
export interface CommissionQuestion { number: number; text: string; choices: string[]; expected: string }

/** A calibration that was made. */
export interface Calibrated { verdict: string; reason: string | null; values: { name: string; value: number; standard_uncertainty: number; unit: string }[]; file: string }

/** The check of the free sensor, and its record. */
export interface SensorCheck {
  is_under_way: boolean;
  minutes: number;
  sweeps: number;
  refused: number;
  trouble: string | null;
  found: Calibrated | null;
  record: { made: string; person: string } | null;
  why: string | null;
  remedy: string;
}

/** A device, and what it has answered since rigd was started. */
export interface Device { role: string; identity: string; health: Health }
export interface Health { requests: number; retries: number; late: number; corrupt: number; refusals: number; last_round_trip_ms?: number }

/** What a device answered when it was asked again who it is. */
export interface Identified { role: string; known: string; found?: string; is_as_known: boolean; position?: string; trouble?: string }

export interface RunProgress {
  id: string;
  protocol: string;
  step: number;
  steps: number;
  touches_planned: number;
  touches_measured: number;
  touches_refused: number;
  doing: string;
  is_pausing: boolean;
  elapsed_s: number;
  remaining_s: [number, number];
  next_prompt?: { prompt: string; in_s: number; touches: number };
}

/** A refused touch about which a person is asked. */
export interface RefusedTouch { step: string; reason: string; answers: ("widen" | "repeat" | "skip" | "abort")[] }

export type AskedFor =
  | { what: "place_sample"; sample: string }
  | { what: "turn_sensor"; orientation: string };
export type Asked = AskedFor & { step: string; number: number; prompts: number };

export interface Reading {
  frequency_hz: number;
  resistance_ohm: number;
  reactance_ohm: number;
  started_s: number;
  settle_s: number;
  integration_s: number;
}

export interface Circuit {
  quality_factor: number;
  static_capacitance_f: number;
  capacitance_ratio: number;
  loss_tangent: number;
}

export type Purpose = "no_load" | "touch" | "manual";

export interface Estimate { readings: number; resonance_hz: number; sigma_hz: number }

/** An event `live_sweep`. */
export interface LiveNews {
  sweep: number;
  purpose: Purpose;
  min_hz: number;
  max_hz: number;
  target_sigma_hz: number;
  time_limit_s: number;
  from: [number, number];
  readings: Reading[];
  estimates: Estimate[];
  circuit?: Circuit & { resonance_hz: number };
}

export type Outcome =
  | { status: "accepted"; resonance_hz: number; sigma_hz: number; circuit?: Circuit }
  | { status: "refused"; reason: string };

export interface Sweep {
  number: number;
  purpose: Purpose;
  step?: string;
  pose?: Pose;
  readings: Reading[];
  outcome: Outcome;
}

export interface Pose { direction: Direction; angle_deg: number }

export interface TouchSettings {
  step: string;
  phase: "main" | "blind";
  sample: string;
  pose: Pose;
  repeat: number;
}

/** A record of the journal, as it comes with an event. */
export type JournalRecord =
  | { kind: "run_started"; protocol: { name: string } }
  | { kind: "step_started"; step: string; index: number; count: number; action: { action: string; sample?: string; pose?: Pose } }
  | { kind: "prompt_asked"; step: string; prompt: AskedFor }
  | { kind: "prompt_answered"; step: string; by: string }
  | { kind: "refusal_asked"; step: string; reason: string }
  | { kind: "refusal_answered"; step: string; reason: string; answer: string; by: string }
  | { kind: "retract_tried"; attempt: number; cause?: string; probe: string }
  | { kind: "intent"; what: string; axis: Axis; to: number }
  | { kind: "moved"; axis: Axis; target: number; read_back: number; is_clear?: boolean }
  | { kind: "surface_found"; step: string; position_mm: number; sigma_mm: number }
  | ({ kind: "sweep" } & Sweep)
  | { kind: "touch_result"; touch: TouchSettings; sweep: number; shift_hz: number; shift_sigma_hz: number; resonance_hz: number; sigma_hz: number; no_load_hz: number; is_slip_checked?: boolean }
  | { kind: "touch_refused"; touch: TouchSettings; reason: string }
  | { kind: "operator"; action: string; who: string }
  | { kind: "fault"; step?: string; cause: string; probe: string; hint: string }
  | { kind: "black_box"; port: string; frames: Frame[] }
  | { kind: "state_changed"; state: string }
  | { kind: "resumed"; who: string; next?: string; touches_left: number }
  | { kind: "given_up"; who: string }
  | { kind: "amended"; run: string; step: string; what: "redo" | "skip"; who: string; why: string }
  | { kind: "run_finished"; status: string };

export type Axis = "linear_mm" | "rotary_deg";
export interface Frame { rig_us: number; is_sent: boolean; hex: string }
export interface Event { run: string; seq: number; rig_us: number; record: JournalRecord }

export interface Plan {
  protocol: string;
  samples: string[];
  touches: number;
  no_loads: number;
  prompts: number;
  duration_s: number;
  linear_mm: [number, number];
  rotary_deg: [number, number];
  indentation_mm: number;
  max_indentation_mm: number;
  is_slip_checked?: boolean;
  target_sigma_hz: number;
  steps: PlanStep[];
  protocol_toml: string;
}

export type PlanStep = { step: string; what_is_done: string; duration_s: number } & (
  | ({ action: "prompt" } & AskedFor)
  | ({ action: "no_load" } & Pose)
  | ({ action: "touch"; phase: "main" | "blind"; sample: string; repeat: number } & Pose)
);

export interface RunEntry {
  id: string;
  name: string;
  protocol: string;
  status: string;
  started_at: string;
  finished_at?: string;
  /** The folder in the archive that has its readings. */
  archived_to?: string;
  /** It can be continued. */
  is_resumable: boolean;
}

/** A protocol that waits for the rig. */
export interface QueueEntry {
  number: number;
  protocol: string;
  note: string;
  by: string;
  deadline_unix_ms?: number;
  is_missed: boolean;
  late_s?: number;
  duration_s: number;
  prompts: { prompt: string; after_s: number }[];
  fault?: string;
}

export interface Queue {
  hold?: { reason: string };
  entries: QueueEntry[];
  duration_s: number;
  prompts: number;
  missed: number;
  late: { run: string; protocol: string; deadline_unix_ms: number; ended_unix_ms: number }[];
}

export type TouchStatus = "measured" | "refused" | "skipped" | "not_reached";

export interface TouchRow {
  step: string;
  phase: "main" | "blind";
  sample: string;
  direction: Direction;
  angle_deg: number;
  repeat: number;
  status: TouchStatus;
  reason?: string | null;
  is_confirmed?: boolean | null;
  is_slip_checked?: boolean | null;
  is_reference_steady?: boolean | null;
  sweep?: number | null;
  resonance_hz?: number | null;
  sigma_hz?: number | null;
  no_load_hz?: number | null;
  shift_hz?: number | null;
  shift_sigma_hz?: number | null;
  stiffness_mpa?: number | null;
  class?: string | null;
  amended?: string | null;
  earlier?: string | null;
}

export interface RunDetail extends RunEntry {
  results: {
    touches_planned: number;
    touches_measured: number;
    touches_refused: number;
    touches_skipped: number;
    touches_not_reached: number;
    prompts: number;
    rig_seconds: number;
    wall_seconds?: number | null;
    no_load_hz?: number | null;
    stiffness: { sample: string; stiffness_mpa?: number | null; sigma_mpa?: number | null; sets_scale?: boolean; known_mpa?: number | null; used: number; planned: number }[];
    recognition: { method: string; trials: number; correct: number; rate: number; low: number; high: number }[];
    touch_results: TouchRow[];
    is_sound: boolean;
    model?: { verdict: string } | null;
    calibration?: { is_beyond_description: boolean } | null;
    daily_check?: { verdict: string } | null;
  };
}

/** The last frames of each port. */
export interface Frames { ports: { port: string; frames: Frame[] }[] }

/** A note of a person about a run; by the id of the run. */
export interface Note { note: string; is_starred: boolean }
export type Notes = Record<string, Note>;

/** What has changed since a run. */
export interface Since { changes: { what: string; was: string; is: string }[]; free_bytes?: number }

export interface Problem {
  title: string;
  status: number;
  detail: string;
  hint?: string;
  faults?: { line: number; column: number; message: string; suggestion?: string }[];
}
