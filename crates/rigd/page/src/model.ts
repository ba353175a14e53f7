// What the page knows, and how each event changes it. Pure: no clock, no network, no document.
import type {
  Axis, Circuit, Direction, Estimate, Event, Frame, JournalRecord, LiveNews, Plan, Purpose, Reading,
  Rig, RunDetail, TouchRow, TouchSettings,
} from "./wire.ts";
import { degrees, fixed } from "./format.ts";

export interface LiveSweep {
  id: number;
  purpose: Purpose;
  min_hz: number;
  max_hz: number;
  target_sigma_hz: number;
  time_limit_s: number;
  readings: Reading[];
  estimates: Estimate[];
  circuit: (Circuit & { resonance_hz: number }) | undefined;
  /** What became of it, once it is finished. */
  outcome: { resonance_hz: number; sigma_hz: number } | { reason: string } | undefined;
  /** The touch whose sweep in contact it was, as long as no step has begun since. */
  step?: string | undefined;
}

/** A sweep as the journal has it. */
type Finished = Pick<LiveSweep, "readings" | "outcome" | "circuit" | "step">;

export interface Touch {
  step: string;
  phase: "main" | "blind";
  sample: string;
  direction: Direction;
  angle_deg: number;
  repeat: number;
  status: "measured" | "refused" | "skipped" | "not_reached";
  reason?: string | undefined;
  sweep?: number | undefined;
  shift_hz?: number | undefined;
  sigma_hz?: number | undefined;
  /** `false` if steps lost in it would not have shown. */
  isSlipChecked?: boolean | undefined;
}

/** Something that happened, in plain words. */
export interface Happening { key: string; rig_s: number; text: string; tone: "plain" | "bad" | "ask" | "good" }

export interface Fault { rig_s: number; step: string | undefined; cause: string; hint: string; after: Happening[]; frames: { port: string; frames: Frame[] }[] }

export interface CurrentRun {
  id: string;
  plan: Plan | undefined;
  name: string | undefined;
  /** By address of the step. */
  touches: Map<string, Touch>;
  /** The step that began last. */
  step: string | undefined;
  freeHz: { rig_s: number; hz: number; sigma: number }[];
  status: string | undefined;
}

export interface Model {
  rig: Rig | undefined;
  sweep: LiveSweep | undefined;
  /** The sweep that was finished last. */
  finished: Finished | undefined;
  run: CurrentRun | undefined;
  asked: Partial<Record<Axis, { target: number; readBack: number }>>;
  /** What the touch under way is at. */
  activity: string | undefined;
  surface_mm: number | undefined;
  /** The sample that was put under the probe last, and how the sensor was turned last. */
  sample: string | undefined;
  orientation: string | undefined;
  fault: Fault | undefined;
  happenings: Happening[];
  /** Who answered the last prompt, and which. */
  answered: { step: string; by: string } | undefined;
}

/** A page left open for a week must not grow. */
const HAPPENINGS_MAX = 200;
const FREE_MAX = 500;

export const empty = (): Model => ({
  rig: undefined, sweep: undefined, finished: undefined, run: undefined, asked: {}, activity: undefined,
  surface_mm: undefined, sample: undefined, orientation: undefined, fault: undefined,
  happenings: [], answered: undefined,
});

export function withRig(model: Model, rig: Rig): Model {
  // Another session is another daemon: nothing that was known before holds.
  const from = model.rig && model.rig.session !== rig.session ? empty() : model;
  const id = rig.run?.id ?? rig.last_run?.id;
  const known = id === undefined || from.run?.id === id ? from.run : begun(id);
  const status = rig.run ? undefined : rig.last_run?.status;
  const run = known && status !== undefined && known.id === rig.last_run?.id ? { ...known, status } : known;
  const isAtRest = rig.state === "idle" || rig.state === "latched";
  return { ...from, rig, run, activity: isAtRest ? undefined : from.activity };
}

export function withLive(model: Model, news: LiveNews): Model {
  const same = model.sweep?.id === news.sweep ? model.sweep : undefined;
  const [firstReading, firstEstimate] = news.from;
  const sweep: LiveSweep = {
    id: news.sweep,
    purpose: news.purpose,
    min_hz: news.min_hz,
    max_hz: news.max_hz,
    target_sigma_hz: news.target_sigma_hz,
    time_limit_s: news.time_limit_s,
    readings: [...(same?.readings.slice(0, firstReading) ?? []), ...news.readings],
    estimates: [...(same?.estimates.slice(0, firstEstimate) ?? []), ...news.estimates],
    circuit: news.circuit ?? same?.circuit,
    outcome: same?.outcome,
  };
  const last = model.finished ? ended(sweep, model.finished) : sweep;
  const words = { no_load: "measuring the free resonance", touch: "sweep in contact", manual: "single sweep" };
  return { ...model, sweep: last, activity: last.outcome ? model.activity : words[news.purpose] };
}

/** The journal and the live readings come side by side: either may tell first that a sweep is over. */
function ended(sweep: LiveSweep, finished: Finished): LiveSweep {
  const isThis = sweep.readings[0]?.started_s === finished.readings[0]?.started_s;
  if (!isThis || sweep.readings.length === 0) return sweep;
  return { ...sweep, ...finished, circuit: finished.circuit ?? sweep.circuit };
}

export function withPlan(model: Model, id: string, plan: Plan, detail: RunDetail): Model {
  if (model.run?.id !== id) return model;
  const touches = new Map(detail.results.touch_results.map((row) => [row.step, touchOfRow(row)]));
  // What an event has said already is newer than what was read from the journal.
  for (const [step, touch] of model.run.touches) {
    if (touch.status !== "not_reached") touches.set(step, touch);
  }
  return { ...model, run: { ...model.run, plan, touches, name: detail.name } };
}

export function withEvent(model: Model, event: Event): Model {
  const { record } = event;
  const rig_s = event.rig_us / 1e6;
  const told = describe(record);
  const happening = told && { ...told, key: `${event.run}-${event.seq}`, rig_s };
  const happenings = happening
    ? [happening, ...model.happenings].slice(0, HAPPENINGS_MAX)
    : model.happenings;
  const fault = happening && model.fault && record.kind !== "fault"
    ? { ...model.fault, after: [...model.fault.after, happening].slice(0, 20) }
    : model.fault;
  return apply({ ...model, happenings, fault }, event, rig_s);
}

function apply(model: Model, { run: id, record }: Event, rig_s: number): Model {
  switch (record.kind) {
    case "run_started":
    case "resumed":
      return { ...model, run: begun(id), activity: undefined, surface_mm: undefined };
    case "step_started": {
      const run = ofRun(model, id);
      const action = record.action;
      const sample = action.action === "touch" ? action.sample ?? model.sample : model.sample;
      return { ...ofNoStep(model), run: run && { ...run, step: record.step }, sample, activity: undefined, surface_mm: undefined };
    }
    case "prompt_answered":
      return { ...model, answered: { step: record.step, by: record.by } };
    case "prompt_asked":
      return record.prompt.what === "place_sample"
        ? { ...model, sample: record.prompt.sample, activity: undefined }
        : { ...model, orientation: record.prompt.orientation, activity: undefined };
    case "intent":
      return { ...model, activity: INTENTS[record.what] ?? model.activity };
    case "moved": {
      const asked = { ...model.asked, [record.axis]: { target: record.target, readBack: record.read_back } };
      return { ...model, asked, activity: record.is_clear ? undefined : model.activity };
    }
    case "surface_found":
      return { ...model, surface_mm: record.position_mm, activity: "pressing into the sample" };
    case "sweep": {
      const outcome = record.outcome.status === "accepted"
        ? { resonance_hz: record.outcome.resonance_hz, sigma_hz: record.outcome.sigma_hz }
        : { reason: record.outcome.reason };
      const circuit = record.outcome.status === "accepted" && record.outcome.circuit
        ? { ...record.outcome.circuit, resonance_hz: record.outcome.resonance_hz }
        : undefined;
      const run = ofRun(model, id);
      const step = record.purpose === "touch" ? run?.step : undefined;
      const finished = { readings: record.readings, outcome, circuit, step };
      const sweep = model.sweep && ended(model.sweep, finished);
      const freeHz = run && record.purpose === "no_load" && record.outcome.status === "accepted"
        ? [...run.freeHz, { rig_s, hz: record.outcome.resonance_hz, sigma: record.outcome.sigma_hz }].slice(-FREE_MAX)
        : run?.freeHz;
      const activity = record.purpose === "touch" ? "going up" : undefined;
      return { ...model, sweep, finished, run: run && { ...run, freeHz: freeHz ?? [] }, activity };
    }
    case "touch_result":
      return withTouch(model, id, {
        ...settingsOf(record.touch), status: "measured", sweep: record.sweep,
        shift_hz: record.shift_hz, sigma_hz: record.shift_sigma_hz, isSlipChecked: record.is_slip_checked,
      });
    case "touch_refused":
      return withTouch(model, id, { ...settingsOf(record.touch), status: "refused", reason: record.reason });
    case "amended":
      // The record is of a run of its own, and names the one under way. One that is measured again comes with its own records.
      return record.what === "skip" ? withoutTouch(model, record.run, record.step) : model;
    case "refusal_answered":
      return ofNoStep(model);
    case "fault":
      return { ...model, fault: { rig_s, step: record.step, cause: record.cause, hint: record.hint, after: [], frames: [] } };
    case "black_box": {
      const { port, frames } = record;
      const fault = model.fault && { ...model.fault, frames: [...model.fault.frames, { port, frames }] };
      return { ...model, fault };
    }
    case "run_finished": {
      const run = ofRun(model, id);
      return { ...model, run: run && { ...run, status: record.status }, activity: undefined };
    }
    default:
      return model;
  }
}

const INTENTS: Record<string, string> = {
  approach: "going down to find the surface",
  indent: "pressing into the sample",
  by_hand: "moving as a person asked",
};

const begun = (id: string): CurrentRun => ({
  id, plan: undefined, name: undefined, touches: new Map(), step: undefined, freeHz: [], status: undefined,
});

/** What begins now may be refused before its sweep: the one before is not its own. */
const ofNoStep = ({ sweep, finished, ...rest }: Model): Model =>
  ({ ...rest, sweep: sweep && { ...sweep, step: undefined }, finished: finished && { ...finished, step: undefined } });

/** The finished sweep of the touch that was made last, if it is this one. */
export const sweepOf = ({ sweep }: Model, step: string) => (sweep?.outcome && sweep.step === step ? sweep : undefined);

const ofRun = (model: Model, id: string) => (model.run?.id === id ? model.run : undefined);

function withTouch(model: Model, id: string, touch: Touch): Model {
  // A replayed stream may begin in the middle of a run.
  const run = ofRun(model, id);
  if (!run) return model;
  const touches = new Map(run.touches).set(touch.step, touch);
  return { ...model, run: { ...run, touches }, surface_mm: undefined };
}

/** A touch of the plan that a person leaves out. */
function withoutTouch(model: Model, id: string, step: string): Model {
  const planned = ofRun(model, id)?.plan?.steps.find((one) => one.step === step);
  if (planned?.action !== "touch") return model;
  const { phase, sample, direction, angle_deg, repeat } = planned;
  return withTouch(model, id, { step, phase, sample, direction, angle_deg, repeat, status: "skipped" });
}

const settingsOf = ({ step, phase, sample, pose, repeat }: TouchSettings) =>
  ({ step, phase, sample, direction: pose.direction, angle_deg: pose.angle_deg, repeat });

export const touchOfRow = (row: TouchRow): Touch => ({
  step: row.step, phase: row.phase, sample: row.sample, direction: row.direction,
  angle_deg: row.angle_deg, repeat: row.repeat, status: row.status,
  reason: row.reason ?? undefined, sweep: row.sweep ?? undefined,
  shift_hz: row.shift_hz ?? undefined, sigma_hz: row.shift_sigma_hz ?? undefined,
  isSlipChecked: row.is_slip_checked ?? undefined,
});

/** A record in plain words; nothing for what a person need not read. */
function describe(record: JournalRecord): Pick<Happening, "text" | "tone"> | undefined {
  const plain = (text: string) => ({ text, tone: "plain" as const });
  switch (record.kind) {
    case "run_started": return plain(`a run of ${record.protocol.name} began`);
    case "prompt_asked": return { text: `asked: ${record.prompt.what === "place_sample" ? `sample ${record.prompt.sample} under the probe` : `sensor to ${record.prompt.orientation}`}`, tone: "ask" };
    case "prompt_answered": return plain(`answered by ${record.by}`);
    case "refusal_asked": return { text: `asked about refused touch ${record.step}`, tone: "ask" };
    case "refusal_answered": return plain(`refused touch ${record.step}, ${record.by}: ${record.answer}`);
    case "retract_tried": return record.cause === undefined ? plain(`attempt ${record.attempt} to retract: the probe is ${record.probe}`) : { text: `attempt ${record.attempt} to retract: ${record.cause}`, tone: "bad" };
    case "touch_result": return plain(`${nameOf(record.touch)}: shift ${fixed(record.shift_hz, 2)} Hz${record.is_slip_checked === false ? ", slip not checked" : ""}`);
    case "touch_refused": return { text: `${nameOf(record.touch)}: refused, ${record.reason}`, tone: "bad" };
    case "sweep":
      return record.purpose !== "manual" ? undefined : record.outcome.status === "accepted"
        ? plain(`single sweep: ${fixed(record.outcome.resonance_hz, 3)} Hz`)
        : { text: `single sweep: refused, ${record.outcome.reason}`, tone: "bad" };
    case "operator": return plain(`${record.action}, asked by ${record.who}`);
    case "fault": return { text: record.cause, tone: "bad" };
    case "state_changed": return plain(`rig: ${record.state}`);
    case "resumed": return plain(`continued by ${record.who}${record.next ? `, at ${record.next}` : ""}`);
    case "given_up": return plain(`given up by ${record.who}`);
    case "amended": return plain(`${record.step}: ${record.what} by ${record.who}, ${record.why}`);
    case "run_finished": return { text: `the run ended: ${record.status.replaceAll("_", " ")}`, tone: record.status.startsWith("completed") ? "good" : "bad" };
    default: return undefined;
  }
}

export const nameOf = ({ sample, pose, phase, repeat }: TouchSettings) =>
  phase === "blind" ? `blind touch ${repeat}` : `sample ${sample}, ${pose.direction} ${degrees(pose.angle_deg)}`;

/** How deep the tip is below the surface that was found, mm; unknown before that. */
export function depthMm(model: Model): number | undefined {
  const { rig, surface_mm } = model;
  if (rig?.linear_mm === undefined || surface_mm === undefined) return undefined;
  const depth = surface_mm - rig.linear_mm;
  return depth > 0 ? depth : undefined;
}

/** What the state row says. */
export function stateOf(model: Model): { word: string; reason: string; tone: "busy" | "ask" | "good" | "bad" | "plain" } {
  const { rig, run, activity } = model;
  if (!rig) return { word: "Connecting", reason: "Waiting for the first word from rigd.", tone: "plain" };
  const progress = rig.run;
  const touch = progress && Math.min(progress.touches_measured + progress.touches_refused + 1, progress.touches_planned);
  const doing = progress ? `Touch ${touch} of ${progress.touches_planned}: ${activity ? `${activity}, ` : ""}${progress.doing}` : "";
  if (rig.silence) return { word: "No answer", reason: "The rig loop does not answer. What is shown is old.", tone: "bad" };
  switch (rig.state) {
    case "preparing": return { word: "Preparing", reason: "Reading both axes, moving the probe to its clear position, and turning the sample to level.", tone: "busy" };
    case "idle": return { word: "Ready", reason: readyReason(run), tone: "good" };
    case "running":
      if (!progress) return { word: "Running", reason: activity ? `${activity[0]?.toUpperCase()}${activity.slice(1)}.` : "A move or a single sweep.", tone: "busy" };
      return progress.is_pausing
        ? { word: "Pausing", reason: `After this step, with the probe clear. ${doing}`, tone: "busy" }
        : { word: "Running", reason: doing, tone: "busy" };
    case "waiting for a person": return { word: "Waiting for you", reason: rig.prompt ?? (rig.refused ? `Touch ${rig.refused.step} was refused: what now?` : "Something is asked of a person."), tone: "ask" };
    case "paused": return { word: "Paused", reason: `Nothing moves until you go on. Next: ${progress?.doing ?? "unknown"}`, tone: "ask" };
    case "retracting": return { word: "Retracting", reason: "Stopping, and taking the probe to where it is clear.", tone: "busy" };
    case "latched": return { word: "Latched, nothing moves", reason: rig.fault?.cause ?? "Unknown fault.", tone: "bad" };
  }
}

function readyReason(run: CurrentRun | undefined): string {
  if (!run?.status) return "Nothing is running.";
  return `${run.name ?? "The last run"} ended: ${run.status.replaceAll("_", " ")}.`;
}
