// The check of the free sensor: its record, a button that begins it, and what it has found.
import { useState } from "preact/hooks";
import { fixed, measured } from "./format.ts";
import { AskButton } from "./shell.tsx";
import { post, usePoll } from "./store.ts";
import type { Calibrated, SensorCheck } from "./wire.ts";

/** How often it is asked for while the page is shown, ms. Other people begin checks too. */
const ASK_MS = 2000;

/** What a person reads for the names of a record. */
const NAMES: Record<string, string> = {
  "sensor.resonance": "Resonance",
  "sensor.drift": "Drift",
  "sensor.level": "From the lowest level to the highest",
  "sensor.quality": "Quality",
  "sensor.coupling": "Coupling",
  "sensor.capacitance": "Capacitance",
  "sensor.loss": "Loss",
  "geometry.surface_mm": "Surface",
  "geometry.surface_above_pivot_mm": "Surface above the rotary axis",
  "geometry.probe_beside_pivot_mm": "Probe beside the rotary axis",
  "geometry.probe_radius_mm": "Radius of the ball",
  "rotary.zero_deg": "Zero of the rotary stage",
  "touches.height": "Height",
  "touches.trend": "From the first touch to the last",
  "touches.scatter": "Scatter of a touch",
  "analyzer.latency_s": "Latency",
  "latency.scatter": "Scatter of a touch",
};

export function SensorCard({ off }: { off: string | undefined }) {
  const [check, set] = usePoll<SensorCheck>("commission/sensor", ASK_MS);
  const [minutes, setMinutes] = useState("10");
  if (!check) return null;
  const send = (path: string, body: object) => () =>
    post<SensorCheck>(`commission/sensor${path}`, { type: "application/json", text: JSON.stringify(body) }).then((now) => now && set(now));
  const { is_under_way, sweeps, refused, found, trouble, record, why, remedy } = check;
  return (
    <section class="card sensor" aria-label="Free sensor">
      <h2>Free sensor</h2>
      <p>{record ? <>The record of {record.made}, {record.person}, holds.</> : <>No record holds: <span class="ask-word">{why ?? "never made"}</span>.</>}</p>
      {is_under_way && <p role="status">Watching for {check.minutes} min: {sweeps} sweeps, {refused} refused.</p>}
      {found && <Found found={found} remedy={remedy} />}
      {trouble && <p class="bad-word" role="status">The last check has no record: {trouble}.</p>}
      <div class="row">
        {is_under_way
          ? <AskButton send={send("/abort", {})}>Abort the check</AskButton>
          : <>
            <label>for, min<input type="number" min={1} max={1440} step={1} value={minutes} onInput={(event) => setMinutes(event.currentTarget.value)} /></label>
            <AskButton icon="play" send={send("", { minutes: Number(minutes) })} disabled={off !== undefined} why={off}>Check the sensor</AskButton>
          </>}
        <p class="soft">Sweeps at three levels, and surveys. The probe stays clear, and no sample is needed.</p>
      </div>
    </section>
  );
}

function Found({ found: { verdict, reason, values }, remedy }: { found: Calibrated; remedy: string }) {
  return (
    <div>
      <p role="status">The last check: {verdict === "accepted" ? <span class="good-word">accepted</span> : <span class="bad-word">{verdict}: {reason}. If it stays so: {remedy}.</span>}</p>
      <Values values={values} />
    </div>
  );
}

/** The values of a record with their standard uncertainties. */
export function Values({ values }: { values: Calibrated["values"] }) {
  return <table><tbody>{values.map(({ name, value, standard_uncertainty, unit }) => <tr key={name}><th scope="row">{NAMES[name] ?? name}</th><td>{withSigma(value, standard_uncertainty)}{unit === "1" ? "" : ` ${unit}`}</td></tr>)}</tbody></table>;
}

function withSigma(value: number, sigma: number): string {
  if (!(sigma > 0)) return fixed(value, 3);
  const text = measured(value, sigma);
  return `${text.value} ± ${text.sigma}`;
}
