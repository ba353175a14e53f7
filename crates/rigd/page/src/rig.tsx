// The rig: who its devices are, moves by hand, a single sweep, and what happened.
import { useState } from "preact/hooks";
import { asWritten, clock, fixed } from "./format.ts";
import { CalibrateCard } from "./calibrate.tsx";
import { CommissionCard } from "./commission.tsx";
import { Bench } from "./drawings.tsx";
import { SensorCard } from "./sensor.tsx";
import { FrameList, SweepCard, wallMs } from "./now.tsx";
import { AskButton, Said } from "./shell.tsx";
import { post, useAsking, usePoll, type View } from "./store.ts";
import type { AxisLimits, Frames, Health, Identified, Rig } from "./wire.ts";

export function RigPage({ view }: { view: View }) {
  const { model } = view;
  const rig = model.rig as Rig;
  const off = view.link === "lost" ? "the link is lost" : rig.state !== "idle" ? `the rig is ${rig.state}` : undefined;
  return (
    <main class="rig" id="main">
      <CommissionCard view={view} />
      <Devices rig={rig} off={off} />
      <section class="card by-hand" aria-label="Move by hand">
        <h2>Move by hand</h2>
        <div class="two-columns">
          <Bench model={model} isPlain />
          <div class="axes">
            <Axis title="Height" axis="linear" unit="mm" decimals={3} steps={[0.01, 0.1, 1, 10]} at={rig.linear_mm} limits={rig.limits.linear_mm} more="up" less="down" off={off} />
            <Axis title="Tilt" axis="rotary" unit="°" decimals={2} steps={[0.1, 1, 5, 15]} at={rig.rotary_deg} limits={rig.limits.rotary_deg} more="front" less="back"
              off={off ?? (rig.probe === "clear" ? undefined : `the sample turns only under a clear probe, and it is ${rig.probe}`)} />
          </div>
        </div>
        <div class="row">
          <p class="soft">One press, one move, then the read-back. {off ? <strong>Off: {off}.</strong> : "A move beyond a limit is refused."}</p>
          <AskButton icon="up" disabled={off !== undefined} why={off} send={() => post("moves", { type: "application/json", text: JSON.stringify({ axis: "linear", to: rig.limits.linear_mm.rest }) })}>Retract to {asWritten(rig.limits.linear_mm.rest)} mm</AskButton>
        </div>
      </section>
      <section class="card events" aria-label="What happened">
        <h2>What happened, newest first</h2>
        {model.happenings.length === 0 ? <p class="soft">Nothing since this page was opened.</p> : (
          <ol tabIndex={0} aria-label="What happened, newest first">{model.happenings.map((h) => <li key={h.key}><time>{rig.is_virtual_time ? `${fixed(h.rig_s, 1)} s` : clock(wallMs(rig, h.rig_s))}</time> <span class={h.tone === "bad" ? "bad-word" : h.tone === "ask" ? "ask-word" : ""}>{h.text}</span></li>)}</ol>
        )}
      </section>
      <SensorCard off={off} />
      <CalibrateCard />
      <SweepForm off={off} />
      <SweepCard model={model} />
      <Console rig={rig} />
    </main>
  );
}

/** Who the devices are, how they have answered, and a button that asks them again. */
function Devices({ rig, off }: { rig: Rig; off: string | undefined }) {
  const [asked, set] = useState<{ at: number; found: Identified[] }>();
  const identify = () => post<Identified[]>("identify").then((found) => set({ at: Date.now(), found: found ?? [] }));
  return (
    <section class="card devices" aria-label="Devices">
      {rig.devices.map(({ role, identity, health }) => {
        const again = asked?.found.find((one) => one.role === role);
        return (
          <div key={role}><h2 class="device">{role.charAt(0).toUpperCase() + role.slice(1)}</h2><p>{identity}</p>
            <p class="soft">{role === "linear stage" ? limitsOf(rig.limits.linear_mm, "mm") : role === "rotary stage" ? limitsOf(rig.limits.rotary_deg, "°") : rig.is_simulated ? "simulated, in the bytes of the real one" : "identified when rigd was started"}</p>
            <p class="soft counts">{healthOf(health).map(({ text, isBad }, i) => <span key={i} class={isBad ? "ask-word" : ""}>{i > 0 && " · "}{text}</span>)}</p>
            {asked && again && <p role="status" class={again.trouble || !again.is_as_known ? "bad-word" : "good-word"}>{clock(asked.at)}: {identifiedAs(again)}</p>}
          </div>
        );
      })}
      <div class="row">
        <p class="soft">Counts since rigd was started. Identify asks each device again who it is; nothing moves.{off && <strong> Off: {off}.</strong>}</p>
        <AskButton icon="rig" disabled={off !== undefined} why={off} send={identify}>Identify</AskButton>
      </div>
    </section>
  );
}

/** What has gone wrong is named only where it has. */
function healthOf({ requests, retries, late, corrupt, refusals, last_round_trip_ms: ms }: Health): { text: string; isBad: boolean }[] {
  const bad = ([[retries, "sent again"], [late, "late"], [corrupt, "corrupt"], [refusals, "refused"]] as const).filter(([count]) => count > 0);
  return [
    { text: `${requests.toLocaleString("en")} requests`, isBad: false },
    ...bad.map(([count, what]) => ({ text: `${count.toLocaleString("en")} ${what}`, isBad: true })),
    ...(bad.length === 0 ? [{ text: "all answered", isBad: false }] : []),
    ...(ms === undefined ? [] : [{ text: `last answer after ${ms < 100 ? fixed(ms, 1) : fixed(ms, 0)} ms`, isBad: false }]),
  ];
}

function identifiedAs({ found, is_as_known, position, trouble }: Identified): string {
  const who = found === undefined ? "not identified" : is_as_known ? "the known device answered" : `another device answered: ${found}`;
  return [who + (position ? `, at ${position}` : ""), trouble].filter(Boolean).join("; ");
}

/** How often the frames are read while the console is open, ms. */
const CONSOLE_MS = 1000;

/** What goes over the ports, to be read only. */
function Console({ rig }: { rig: Rig }) {
  const [isOpen, setOpen] = useState(false);
  return (
    <section class="card console" aria-label="Console">
      <div class="row"><h2>Console: what goes over the ports, read only</h2><button type="button" aria-expanded={isOpen} onClick={() => setOpen(!isOpen)}>{isOpen ? "Close" : "Show"}</button></div>
      {isOpen && <Ports rig={rig} />}
    </section>
  );
}

function Ports({ rig }: { rig: Rig }) {
  const [found] = usePoll<Frames>("frames", CONSOLE_MS);
  return found ? <>{found.ports.map((port) => <FrameList key={port.port} frames={[port]} rig={rig} title={port.port} isOpen />)}</> : <p class="soft">Reading…</p>;
}

const limitsOf = ({ min, max, rest }: AxisLimits, unit: string) => `soft limits ${asWritten(min)} to ${asWritten(max)} ${unit}, rests at ${asWritten(rest)} ${unit}`;

interface AxisProps { title: string; axis: "linear" | "rotary"; unit: string; decimals: number; steps: number[]; at: number | undefined; limits: AxisLimits; more: string; less: string; off: string | undefined }

function Axis({ title, axis, unit, decimals, steps, at, limits, more, less, off }: AxisProps) {
  const [step, setStep] = useState(steps[2] ?? 1);
  const move = (by: number) => () => post("moves", { type: "application/json", text: JSON.stringify({ axis, to: Number(((at ?? 0) + by).toFixed(6)) }) });
  const why = (by: number) => {
    if (off !== undefined) return off;
    if (at === undefined) return "the position is unknown";
    const to = at + by;
    return to > limits.max + 1e-9 || to < limits.min - 1e-9 ? `${fixed(to, decimals)} ${unit} is beyond the limits` : undefined;
  };
  const button = (label: string, by: number, icon: "up" | "down" | "turnLeft" | "turnRight") => (
    <AskButton icon={icon} send={move(by)} disabled={why(by) !== undefined} why={why(by)}>{label} {step} {unit}</AskButton>
  );
  return (
    <fieldset>
      <legend>{title}</legend><output class="position">{at === undefined ? "unknown" : fixed(at, decimals)} <span class="unit">{unit}</span></output>
      <div class="choice steps-of" role="group" aria-label={`${title}: by how much`}>{steps.map((s) => <button key={s} type="button" aria-pressed={s === step} onClick={() => setStep(s)}>{s}</button>)}</div>
      <div class="buttons pair">
        {axis === "linear" ? <>{button(more, step, "up")}{button(less, -step, "down")}</> : <>{button(less, -step, "turnLeft")}{button(more, step, "turnRight")}</>}
      </div>
    </fieldset>
  );
}

function SweepForm({ off }: { off: string | undefined }) {
  const [order, set] = useState({ min_hz: "120", max_hz: "165", target_sigma_hz: "0.05", time_limit_s: "30", level_v: "1" });
  const fields: [keyof typeof order, string][] = [["min_hz", "from, Hz"], ["max_hz", "to, Hz"], ["target_sigma_hz", "wanted ±, Hz"], ["time_limit_s", "at most, s"], ["level_v", "level, V"]];
  const text = JSON.stringify(Object.fromEntries(Object.entries(order).map(([key, value]) => [key, Number(value)])));
  const [isSent, setSent] = useState(false);
  const [asking, go] = useAsking(() => { setSent(false); return post("sweeps", { type: "application/json", text }).then(() => setSent(true)); }, isSent);
  return (
    <section class="card sweep-form" aria-label="Single sweep">
      <h2>Single sweep, at the present pose</h2>
      <form onSubmit={(event) => { event.preventDefault(); go(); }}>
        {fields.map(([key, label]) => <label key={key}>{label}<input type="number" step="any" required value={order[key]} onInput={(event) => set({ ...order, [key]: event.currentTarget.value })} /></label>)}
        <button class="primary" disabled={off !== undefined} title={off}>Measure</button>
      </form>
      {off !== undefined && <p class="soft">Off: {off}.</p>}
      <Said asking={asking} />
    </section>
  );
}
