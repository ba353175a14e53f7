// What is going on: a run, a prompt, a fault.
import { useEffect, useRef, useState } from "preact/hooks";
import { CommissionCard } from "./commission.tsx";
import { clock, degrees, duration, fixed, measured, range } from "./format.ts";
import { Bench, PromptDrawing, ShiftCharts, Timeline, type LiveTouch } from "./drawings.tsx";
import { Icon, SampleMark } from "./icons.tsx";
import type { Model, Touch } from "./model.ts";
import { CirclePlot, NarrowingPlot, SweepPlots, resonanceOf } from "./plots.tsx";
import { AskButton, Confirm } from "./shell.tsx";
import { get, operator, post, useAsking, type View } from "./store.ts";
import { Said } from "./shell.tsx";
import type { Asked, Rig, RunDetail, RunEntry } from "./wire.ts";
import { touchOfRow } from "./model.ts";

/** When something on the rig's clock was, by the wall clock, ms. */
export const wallMs = (rig: Rig, rig_s: number) => rig.unix_ms - (rig.rig_time_s - rig_s) * 1000;

export function Value({ value, sigma, unit }: { value: number; sigma: number; unit: string }) {
  const text = measured(value, sigma);
  return <>{text.value} <span class="sigma">± {text.sigma}</span> <span class="unit">{unit}</span></>;
}

// ---- Running ----------------------------------------------------------------------------------------

export function Running({ view }: { view: View }) {
  const { model } = view;
  const touches = [...(model.run?.touches.values() ?? [])];
  const before = useLastGoodRun(model);
  const live = liveTouch(model);
  return (
    <main class="running" id="main">
      <Progress view={view} />
      <section class="card bench-card" aria-label="Bench">
        <h2>Bench{view.link === "lost" ? `, as of ${clock(Date.now() - view.sinceMs)}` : ", as read back"}</h2>
        <Bench model={model} />
        <ReadBacks model={model} />
      </section>
      <SweepCard model={model} live={live} before={before} />
      <section class="card shift-card" aria-label="Frequency shift">
        <div class="row"><h2>Frequency shift (Hz) against contact angle, ± 2σ</h2>
          <Legend samples={model.run?.plan?.samples ?? []} hasBefore={before.touches.length > 0} beforeName={before.name} /></div>
        {model.run?.plan
          ? <ShiftCharts samples={model.run.plan.samples} touches={touches} before={before.touches} live={live} nowStep={model.run.step} height={158} />
          : <p class="soft">The plan of this run is being read.</p>}
      </section>
      <LatestTouches model={model} />
    </main>
  );
}

export function Legend({ samples, hasBefore, beforeName }: { samples: string[]; hasBefore: boolean; beforeName: string | undefined }) {
  return (
    <ul class="legend" aria-label="Samples">
      {samples.map((sample, i) => <li key={sample}><SampleMark index={i} />{sample}</li>)}
      {hasBefore && <li><svg width="22" height="8" aria-hidden="true"><path class="before" d="M0 4h22" /></svg>last good run{beforeName ? ` (${beforeName})` : ""}</li>}
      <li class="refused-word">✕ refused</li>
    </ul>
  );
}

/** The last run of the same protocol that was completed, for comparison. */
function useLastGoodRun(model: Model): { name: string | undefined; touches: Touch[] } {
  const [found, set] = useState<{ id: string; name: string | undefined; touches: Touch[] }>({ id: "", name: undefined, touches: [] });
  const run = model.run;
  const protocol = run?.plan?.protocol;
  useEffect(() => {
    if (!run || !protocol || found.id === run.id) return;
    const { id } = run;
    set({ id, name: undefined, touches: [] });
    get<RunEntry[]>("runs").then(async (runs) => {
      const good = runs.filter((r) => r.protocol === protocol && r.id !== id && r.status.startsWith("completed"));
      good.sort((a, b) => a.started_at.localeCompare(b.started_at));
      const last = good.at(-1);
      if (!last) return;
      const detail = await get<RunDetail>(`runs/${last.id}`);
      set({ id, name: detail.name, touches: detail.results.touch_results.map(touchOfRow) });
    }).catch(() => undefined);
  }, [run?.id, protocol]);
  return run && found.id === run.id ? found : { name: undefined, touches: [] };
}

/** The present estimate of the touch under way. */
function liveTouch(model: Model): LiveTouch | undefined {
  const { sweep, run } = model;
  const free = run?.freeHz.at(-1);
  const now = sweep?.purpose === "touch" && !sweep.outcome ? resonanceOf(sweep) : undefined;
  if (!now || !free || !run?.step) return undefined;
  return { step: run.step, shift_hz: now.hz - free.hz, sigma_hz: Math.hypot(now.sigma, free.sigma) };
}

export function Progress({ view, isSmall }: { view: View; isSmall?: boolean }) {
  const { model, link } = view;
  const { rig, run } = model;
  const [isAborting, setAborting] = useState(false);
  const progress = rig?.run;
  if (!rig || !progress) return null;
  const made = progress.touches_measured + progress.touches_refused;
  const name = run?.name ?? progress.protocol;
  const isPaused = rig.state === "paused" || progress.is_pausing;
  const off = link === "lost";
  const ends = rig.is_virtual_time ? undefined
    : progress.remaining_s.map((s) => clock(rig.unix_ms + s * 1000, false)) as [string, string];
  const next = progress.next_prompt;
  const abort = () => post(`runs/${progress.id}/abort`);
  return (
    <section class={`card progress${isSmall ? " small" : ""}`} aria-label="Progress of the run">
      <div class="count">
        <p class="big"><strong>{Math.min(made + 1, progress.touches_planned)}</strong> of {progress.touches_planned}{isSmall ? " touches" : ""}</p>
        <p class="tally"><strong>{progress.touches_measured}</strong> measured · <span class={progress.touches_refused ? "refused-word" : ""}>{progress.touches_refused ? "✕ " : ""}<strong>{progress.touches_refused}</strong> refused</span></p>
        {!isSmall && <p class="soft">{name}</p>}
      </div>
      <div class="time">
        {run?.plan && <Timeline plan={run.plan} touches={run.touches} now={run.step} />}
        <p class="times">
          <span>elapsed <strong>{duration(progress.elapsed_s)}</strong></span>
          <span>to go <strong>{range(progress.remaining_s)}</strong>{rig.is_virtual_time ? " of the rig's time" : ""}</span>
          {ends && <span>ends <strong>{ends[0] === ends[1] ? `about ${ends[0]}` : `${ends[0]} to ${ends[1]}`}</strong></span>}
        </p>
      </div>
      {!isSmall && (
        <div class="next">
          {next ? (
            <>
              <p class="soft ask-word"><Icon name="hand" size={15} /> Next for you, in about {duration(next.in_s)}</p>
              <p class="next-what">{next.prompt}</p>
              <p class="soft">{rig.is_virtual_time ? "" : `about ${clock(rig.unix_ms + next.in_s * 1000, false)}, `}after {next.touches} more {next.touches === 1 ? "touch" : "touches"}</p>
            </>
          ) : <p class="soft">Nothing more is asked of you in this run.</p>}
        </div>
      )}
      <div class="buttons column">
        {isPaused
          ? <AskButton icon="play" key="resume" send={() => post(`runs/${progress.id}/resume`)} isDone={!isPaused} disabled={off}>Go on</AskButton>
          : <AskButton icon="pause" key="pause" send={() => post(`runs/${progress.id}/pause`)} isDone={isPaused} disabled={off}>Pause</AskButton>}
        <button type="button" disabled={off} onClick={() => setAborting(true)}><Icon name="abort" />Abort run…</button>
      </div>
      {isAborting && (
        <Confirm title="Abort this run?" yes="Abort the run" onClose={() => setAborting(false)} send={abort} isDone={rig.state === "retracting" || rig.state === "idle" || rig.state === "latched"}
          text={`What is under way is stopped, the probe goes up to where it is clear, and the run ends there. The ${made} touches made so far are kept.`} />
      )}
    </section>
  );
}

function ReadBacks({ model }: { model: Model }) {
  const { rig, asked } = model;
  if (!rig) return null;
  const row = (name: string, at: number | undefined, ask: number | undefined, unit: string, decimals: number, tolerance: number) => {
    const isThere = at !== undefined && ask !== undefined && Math.abs(at - ask) <= tolerance;
    return (
      <tr><th scope="row">{name}</th>
        <td>{ask === undefined ? "unknown" : `${fixed(ask, decimals)}${unit}`}</td>
        <td><strong>{at === undefined ? "unknown" : `${fixed(at, decimals)}${unit}`}</strong></td>
        <td>{isThere ? <span class="good-word" title="as asked"><Icon name="tick" size={16} /><span class="hidden">as asked</span></span> : ""}</td></tr>
    );
  };
  return (
    <table class="readbacks">
      <thead><tr><td></td><th scope="col">asked</th><th scope="col">read back</th><td></td></tr></thead>
      <tbody>
        {row("Height of tip", rig.linear_mm, asked.linear_mm?.target, " mm", 3, 0.0105)}
        {row("Sample tilt", rig.rotary_deg, asked.rotary_deg?.target, "°", 2, 0.105)}
      </tbody>
    </table>
  );
}

const PURPOSE = { touch: "Resonance in contact", no_load: "Free resonance", manual: "Resonance, single sweep" };

export function SweepCard({ model, live, before }: { model: Model; live?: LiveTouch | undefined; before?: { touches: Touch[] } }) {
  const { sweep, run } = model;
  const [mode, setMode] = useState<"z" | "gb">("z");
  if (!sweep) {
    return <section class="card sweep-card" aria-label="Sweep"><h2>Sweep</h2><p class="soft">No sweep yet. Its readings appear here as they arrive.</p></section>;
  }
  const found = resonanceOf(sweep);
  const shown = run?.touches.get(run.step ?? "");
  const shift = live ?? (shown?.shift_hz !== undefined && shown.sigma_hz !== undefined ? { shift_hz: shown.shift_hz, sigma_hz: shown.sigma_hz } : undefined);
  const last = before?.touches.find((t) => t.step === run?.step && t.shift_hz !== undefined);
  const [first, newest] = [sweep.readings[0], sweep.readings.at(-1)];
  const took = first && newest ? newest.started_s + newest.settle_s + newest.integration_s - first.started_s : 0;
  const refused = sweep.outcome && "reason" in sweep.outcome ? sweep.outcome.reason : undefined;
  return (
    <section class="card sweep-card" aria-label="Sweep">
      <div class="row values">
        <div><h2>{PURPOSE[sweep.purpose]}{sweep.outcome ? "" : ", so far"}</h2>
          <p class="value">{refused !== undefined ? <span class="refused-word">✕ refused</span> : found ? <Value value={found.hz} sigma={found.sigma} unit="Hz" /> : <span class="soft">not yet known</span>}</p></div>
        {shift && sweep.purpose === "touch" && <div><h2>Shift</h2><p class="value second"><Value value={shift.shift_hz} sigma={shift.sigma_hz} unit="Hz" /></p></div>}
        {last?.shift_hz !== undefined && sweep.purpose === "touch" && <div><h2>Last good run here</h2><p class="value third">{fixed(last.shift_hz, 2)} <span class="unit">Hz</span></p></div>}
        <p class="soft right">{sweep.readings.length} {sweep.readings.length === 1 ? "reading" : "readings"}<br />{fixed(took, 1)} s of {fixed(sweep.time_limit_s, 0)} s</p>
        <div class="choice" role="group" aria-label="What is drawn">
          <button type="button" aria-pressed={mode === "z"} onClick={() => setMode("z")}>|Z|, phase</button>
          <button type="button" aria-pressed={mode === "gb"} onClick={() => setMode("gb")}>G, B</button>
        </div>
      </div>
      {refused !== undefined && <p class="refusal">Refused: {refused}. No value is stored.</p>}
      <div class="plots">
        <div class={mode === "z" ? "" : "other"}><SweepPlots sweep={sweep} height={236} /></div>
        <div class={mode === "gb" ? "" : "other"}><CirclePlot sweep={sweep} height={236} /></div>
        <NarrowingPlot sweep={sweep} height={236} />
      </div>
    </section>
  );
}

function LatestTouches({ model }: { model: Model }) {
  const made = [...(model.run?.touches.values() ?? [])].filter((t) => t.status !== "not_reached");
  const numbers = new Map<string, number>();
  let n = 0;
  for (const step of model.run?.plan?.steps ?? []) if (step.action === "touch") numbers.set(step.step, ++n);
  made.sort((a, b) => (numbers.get(b.step) ?? 0) - (numbers.get(a.step) ?? 0));
  const latest = made.slice(0, 6);
  const refused = made.filter((t) => t.status === "refused").slice(0, 2);
  const shown = [...latest.slice(0, 6 - refused.filter((t) => !latest.includes(t)).length), ...refused.filter((t) => !latest.includes(t))];
  return (
    <section class="card touches-card" aria-label="Latest touches">
      <h2>Latest touches</h2>
      {shown.length === 0 ? <p class="soft">None yet.</p> : (
        <table class="touches">
          <thead><tr><th scope="col">touch</th><th scope="col">sample</th><th scope="col">pose</th><th scope="col">shift, Hz</th></tr></thead>
          <tbody>{shown.map((t) => (
            <tr key={t.step}><td>{numbers.get(t.step) ?? ""}</td><td>{t.sample}</td><td>{t.direction} {degrees(t.angle_deg)}</td>
              <td>{t.status === "refused" ? <span class="refused-word" title={t.reason}>✕ refused</span> : t.status === "skipped" ? <span class="soft">left out</span> : t.shift_hz !== undefined ? <><Value value={t.shift_hz} sigma={t.sigma_hz ?? 0} unit="" />{t.isSlipChecked === false && <small class="refused-word"> slip not checked</small>}</> : ""}</td></tr>
          ))}</tbody>
        </table>
      )}
    </section>
  );
}

// ---- A prompt ---------------------------------------------------------------------------------------

/** An Enter that was meant for something else must not answer a prompt, ms. */
const STOOD_MS = 1000;
/** Nor the second press of a double click on the prompt before it, ms. */
const POINTER_MS = 500;

export function PromptCard({ view, asked }: { view: View; asked: Asked }) {
  const { model } = view;
  const rig = model.rig as Rig;
  const title = useRef<HTMLHeadingElement>(null);
  const since = useRef(performance.now());
  const isLost = view.link === "lost";
  const [isCannot, setCannot] = useState(false);
  const run = rig.run;
  const [asking, answer] = useAsking(
    () => post(`runs/${run?.id ?? ""}/answer?step=${encodeURIComponent(asked.step)}`),
    false,
  );
  useEffect(() => {
    since.current = performance.now();
    title.current?.focus({ preventScroll: true });
    beep();
  }, [asked.step]);
  // A press counts from when it was made: it may have waited while the page was drawn.
  const hasStood = (event: Event, ms: number) => event.timeStamp - since.current >= ms;
  const [isReady, setReady] = useState(false);
  useEffect(() => {
    setReady(false);
    const timer = setTimeout(() => setReady(true), POINTER_MS);
    return () => clearTimeout(timer);
  }, [asked.step]);
  useEffect(() => {
    const onKey = (event: KeyboardEvent) => {
      const target = event.target as Element | null;
      const isElsewhere = target?.closest("input, textarea, select, button, a, dialog, summary");
      if (event.key !== "Enter" || event.repeat || isElsewhere || isLost || !hasStood(event, STOOD_MS)) return;
      event.preventDefault();
      answer();
    };
    addEventListener("keydown", onKey);
    return () => removeEventListener("keydown", onKey);
  });
  const isSample = asked.what === "place_sample";
  const askedMs = wallMs(rig, rig.state_since_s);
  const waited = Math.max(0, rig.rig_time_s - rig.state_since_s);
  const next = run?.next_prompt;
  return (
    <section class="card prompt" role="alertdialog" aria-labelledby="prompt-title" aria-describedby="prompt-note">
      <div class="prompt-picture">
        <PromptDrawing what={asked.what} sample={isSample ? asked.sample : model.sample} orientation={isSample ? model.orientation ?? "front/back" : asked.orientation} />
      </div>
      <div class="prompt-text">
        <p class="ask-word"><Icon name="hand" size={18} /> For you: prompt {asked.number} of {asked.prompts}, asked {clock(askedMs)} <span class="soft">({duration(waited)} ago)</span></p>
        <h2 id="prompt-title" ref={title} tabIndex={-1}>{isSample ? <>Put sample <em>{asked.sample}</em> under the probe</> : <>Turn the sensor to <em>{asked.orientation}</em></>}</h2>
        <ol class="steps">
          {isSample ? <><li>Take away what lies under the probe.</li><li>Lay sample <b class="label-word">{asked.sample}</b> on the stage, its middle under the probe.</li><li>Take your hands away, then press Done.</li></>
            : <><li>{rig.prompt}</li><li>Leave the sample as it lies.</li><li>Take your hands away, then press Done.</li></>}
        </ol>
        <div class="buttons answer-bar">
          <button type="button" class="primary done" disabled={isLost} aria-disabled={!isReady} onClick={(event) => { if (hasStood(event, event.detail === 0 ? STOOD_MS : POINTER_MS)) answer(); }}><Icon name="tick" size={26} />Done</button>
          <button type="button" class="cannot" disabled={isLost} onClick={() => setCannot(!isCannot)} aria-expanded={isCannot}>Cannot be done…</button>
        </div>
        <Said asking={asking} />
        {isCannot && run && <div class="buttons"><AskButton icon="pause" send={() => post(`runs/${run.id}/pause`)} isDone={run.is_pausing}>Pause after this answer</AskButton><AskButton icon="abort" send={() => post(`runs/${run.id}/abort`)}>Abort the run, keep its touches</AskButton></div>}
        <p class="soft"><kbd>Enter</kbd> here, on any other open page or over HTTP{operator() ? `. Signed: ${operator()}` : ""}</p>
        <div class="two" id="prompt-note">
          <div><h3>Until you answer</h3><p><strong>{isLost ? "The link is lost, and another person may have answered: keep your hands away." : "Nothing moves until somebody answers or stops the rig."}</strong> The probe is {rig.probe}{rig.linear_mm === undefined ? "" : ` at ${fixed(rig.linear_mm, 3)} mm`}. rigd cannot see what lies on the bench: it records your word.</p></div>
          <div><h3>After that</h3><p>{next?.touches === 0 ? <>At once you are asked: {next.prompt}</> : next ? <>rigd goes on by itself with {next.touches} {next.touches === 1 ? "touch" : "touches"}, <strong>about {duration(next.in_s)}</strong>. Then: {next.prompt}</> : "rigd goes on by itself to the end of the run."}</p></div>
        </div>
      </div>
    </section>
  );
}

/** One short tone, where the browser allows it. */
export function beep(): void {
  if (!navigator.userActivation?.hasBeenActive) return;
  try {
    const audio = new AudioContext();
    const [tone, gain] = [audio.createOscillator(), audio.createGain()];
    tone.frequency.value = 660;
    gain.gain.setValueAtTime(0.15, audio.currentTime);
    gain.gain.exponentialRampToValueAtTime(0.001, audio.currentTime + 0.5);
    tone.connect(gain).connect(audio.destination);
    tone.start();
    tone.stop(audio.currentTime + 0.5);
    tone.onended = () => void audio.close();
  } catch {
    // No sound card, no sound; the title of the page says it too.
  }
}

// ---- Latched ----------------------------------------------------------------------------------------

export function FaultCard({ view }: { view: View }) {
  const { model } = view;
  const rig = model.rig as Rig;
  const { fault } = rig;
  if (!fault) return null;
  const story = model.fault?.cause === fault.cause ? model.fault : undefined;
  const isClear = rig.probe === "clear";
  const at = rig.linear_mm === undefined ? "Its height is not known." : `The tip was last read back at ${fixed(rig.linear_mm, 3)} mm.`;
  const where = isClear ? "Clear of the sample." : rig.probe === "in contact"
    ? `Perhaps in contact${model.sample ? ` with sample ${model.sample}` : ""}: no read-back has shown it clear.`
    : `Not known${model.sample ? `, perhaps still in sample ${model.sample}` : ""}.`;
  // The words of the interface for programs, as the buttons of this page.
  const hint = fault.hint
    .replace("POST /api/v1/acknowledge", "acknowledge below")
    .replace("POST /api/v1/commission asks", "the card below asks")
    .replace('POST /api/v1/home with {"nothing_below_probe": true}', "Home below")
    .replace("POST /api/v1/stop", "Stop all");
  // A person who has looked below the probe may have the stage homed.
  const needsLook = fault.kind === "not_homed" || fault.kind === "position_jumped";
  const isUntrusted = needsLook || fault.kind === "position_lost";
  // An acknowledgement does not open a bench that nobody has commissioned.
  const isNew = fault.kind === "not_commissioned";
  const steps = hint.split(/; (?=and |then |check )|(?<=\.) /);
  const cause = fault.cause.charAt(0).toUpperCase() + fault.cause.slice(1);
  const [head, ...rest] = cause.split(": ");
  return (
    <main class="fault" id="main">
      <section class="card bad-card" role="alert" aria-labelledby="fault-title">
        <div class="fault-text">
          <p class="bad-word"><Icon name="fault" size={18} /> {clock(wallMs(rig, story?.rig_s ?? rig.state_since_s))}{story?.step ? `, at ${story.step}` : ""}</p>
          <h2 id="fault-title">{fault.kind === "not_homed" ? "The linear stage has lost its position" : rest.length > 0 && (head?.length ?? 0) < 60 ? head : cause}</h2>
          <dl>
            {(fault.kind === "not_homed" || (rest.length > 0 && (head?.length ?? 0) < 60)) && <><dt>What happened</dt><dd>{rest.join(": ")}</dd></>}
            <dt>Where the probe is</dt><dd><strong class={isClear ? "good-word" : "bad-word"}>{where}</strong> {at}</dd>
            <dt>What to do</dt><dd>{steps.length > 1 ? <ol class="steps">{steps.map((step) => <li key={step}>{step}</li>)}</ol> : hint}</dd>
          </dl>
          {needsLook && <HomeAfterLook key={`${rig.session} ${rig.state_since_s}`} isLost={view.link === "lost"} isDone={rig.state !== "latched"} />}
          {!isNew && <div class="answer-bar fault-bar">
            <AskButton class={isUntrusted ? "" : "primary done"} icon="up" send={() => post("acknowledge")} isDone={rig.state !== "latched"} disabled={view.link === "lost"}>{isUntrusted ? "Acknowledge and look again" : isClear ? "Acknowledge and prepare" : "Acknowledge and retract"}</AskButton>
            <p class="soft">Acknowledges the fault{operator() ? `, signed ${operator()}` : ""}. {isUntrusted ? "Both axes are asked again where they are; without a position that can be trusted nothing moves." : `The probe moves to its clear position; then the rotary stage is homed if it has no position, and turns to level.${isClear ? "" : " Keep your hands away."}`} A run does not go on by itself: continue it on its page in <a href="#/runs">Runs</a>.</p>
          </div>}
        </div>
        <div>
          <Bench model={model} />
          {story && (
            <>
              <h3>First cause, then what followed</h3>
              <ol class="story">
                <li class="first"><time>{clock(wallMs(rig, story.rig_s))}</time> {fault.cause}</li>
                {story.after.map((h) => <li key={h.key}><time>{clock(wallMs(rig, h.rig_s))}</time> {h.text}</li>)}
              </ol>
            </>
          )}
        </div>
        {story && story.frames.length > 0 && <FrameList frames={story.frames} rig={rig} />}
      </section>
      {isNew && <CommissionCard view={view} />}
    </main>
  );
}

/** Homes a linear stage that has lost its position, once a person has stated what no device can see: for this latch, and while the link stands. */
function HomeAfterLook({ isLost, isDone }: { isLost: boolean; isDone: boolean }) {
  const [isSeen, setSeen] = useState(false);
  // Meanwhile somebody may have laid a sample under the probe.
  useEffect(() => { if (isLost) setSeen(false); }, [isLost]);
  const send = () => post("home", { type: "application/json", text: JSON.stringify({ nothing_below_probe: true }) });
  return (
    <div class="home-look">
      <label class="check"><input type="checkbox" checked={isSeen} onChange={(event) => setSeen(event.currentTarget.checked)} /> I have seen that nothing is below the probe, down to the end of its travel.</label>
      <AskButton class="primary done" icon="rig" send={send} isDone={isDone} disabled={!isSeen || isLost} why="Look first, then say so above.">Home the linear stage</AskButton>
    </div>
  );
}

/** The bytes as text where all of them are letters and signs, such as SCPI; else in hexadecimal. */
export function legible(hex: string): string {
  const bytes = (hex.match(/../g) ?? []).map((byte) => parseInt(byte, 16));
  const isText = bytes.length > 0 && bytes.every((byte) => (byte >= 32 && byte < 127) || byte === 10 || byte === 13);
  return isText ? bytes.map((byte) => (byte === 10 ? "␊" : byte === 13 ? "␍" : String.fromCharCode(byte))).join("") : hex.replace(/(..)/g, "$1 ").trim();
}

export function FrameList({ frames, rig, title = "The last frames on the ports", isOpen = false }: { frames: { port: string; frames: { rig_us: number; is_sent: boolean; hex: string }[] }[]; rig: Rig; title?: string; isOpen?: boolean }) {
  const count = frames.reduce((sum, port) => sum + port.frames.length, 0);
  return (
    <details class="frames" open={isOpen}>
      <summary>{title} <span class="soft">({count})</span></summary>
      {frames.map(({ port, frames: list }) => (
        <div key={port}><h3>{port}</h3>
          <ol tabIndex={0} aria-label={`Frames on ${port}`}>{list.slice(-40).map((frame) => <li key={`${frame.rig_us}${frame.hex}`}><time>{clock(wallMs(rig, frame.rig_us / 1e6))}.{String(Math.floor((frame.rig_us / 1000) % 1000)).padStart(3, "0")}</time> <span aria-label={frame.is_sent ? "sent" : "received"}>{frame.is_sent ? "→" : "←"}</span> <code>{legible(frame.hex)}</code></li>)}</ol></div>
      ))}
    </details>
  );
}
