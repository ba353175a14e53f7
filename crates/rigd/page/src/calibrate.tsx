// Calibrations by the touches of a run: which run, what it shows, and what follows.
import { useState } from "preact/hooks";
import { Values } from "./sensor.tsx";
import { AskButton } from "./shell.tsx";
import { post } from "./store.ts";
import type { Calibrated } from "./wire.ts";

type Kind = "blocks" | "touches" | "pin" | "latency";

/** Each kind: its name, the protocol of its run, and what the run shows. */
const KINDS: Record<Kind, { title: string; protocol: string; shows: string }> = {
  blocks: { title: "Geometry and screw, by blocks", protocol: "block", shows: "Touches on a hard flat block at several tilts show surface, rotary axis and the error of the screw; a second block shows the zero of the rotary stage." },
  touches: { title: "Touches that repeat", protocol: "touches", shows: "Ten touches at one place of a hard block show how well a surface is found again." },
  pin: { title: "Radius of the ball, by a pin", protocol: "pin", shows: "Touches on a gauge pin at several tilts show the radius of the ball. Evaluate blocks before." },
  latency: { title: "Latency, by two speeds", protocol: "latency", shows: "Descents at two speeds show how much later than it says the analyzer integrates." },
};

export function CalibrateCard() {
  const [kind, setKind] = useState<Kind>("blocks");
  const [run, setRun] = useState("latest");
  const [raised, setRaised] = useState({ run: "", by_mm: "10" });
  const [pin, setPin] = useState("2");
  const [made, set] = useState<{ kind: Kind; found: Calibrated }>();
  const body = {
    run,
    ...(kind === "pin" ? { pin_radius_mm: Number(pin) } : {}),
    ...(kind === "blocks" && raised.run ? { raised: [{ run: raised.run, by_mm: Number(raised.by_mm) }] } : {}),
  };
  const send = () => post<Calibrated>(`commission/${kind}`, { type: "application/json", text: JSON.stringify(body) }).then((found) => found && set({ kind, found }));
  const { protocol, shows } = KINDS[kind];
  return (
    <section class="card sensor" aria-label="Calibration by a run">
      <h2>Calibration by a run</h2>
      <div class="row">
        <label>what<select value={kind} onChange={(event) => setKind(event.currentTarget.value as Kind)}>{Object.entries(KINDS).map(([key, { title }]) => <option key={key} value={key}>{title}</option>)}</select></label>
        <label>run<input value={run} placeholder={`${protocol}-1`} onInput={(event) => setRun(event.currentTarget.value)} /></label>
        {kind === "blocks" && <>
          <label>run on a second block<input value={raised.run} placeholder="may stay empty" onInput={(event) => setRaised({ ...raised, run: event.currentTarget.value })} /></label>
          {raised.run && <label>it is higher by, mm<input type="number" step="any" value={raised.by_mm} onInput={(event) => setRaised({ ...raised, by_mm: event.currentTarget.value })} /></label>}
        </>}
        {kind === "pin" && <label>radius of the pin, mm<input type="number" step="any" min={0} value={pin} onInput={(event) => setPin(event.currentTarget.value)} /></label>}
        <AskButton send={send} disabled={run === ""} why="name a run">Evaluate</AskButton>
      </div>
      <p class="soft">{shows} Run its protocol first: {protocol}.toml. Nothing moves here.</p>
      {made && <Made title={KINDS[made.kind].title} found={made.found} />}
    </section>
  );
}

function Made({ title, found: { verdict, reason, values, file } }: { title: string; found: Calibrated }) {
  const text = { accepted: "accepted", "rig file": `not as the rig file says: ${reason}` }[verdict] ?? `${verdict}: ${reason}`;
  return (
    <div>
      <p role="status">{title}: <span class={verdict === "accepted" ? "good-word" : "bad-word"}>{text}</span>. Record: {file}</p>
      <Values values={values} />
    </div>
  );
}
