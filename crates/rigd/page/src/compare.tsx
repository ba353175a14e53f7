// Two runs beside each other: stiffness, shifts, and what they found otherwise.
import { useEffect, useRef } from "preact/hooks";
import { doubts } from "./doubts.ts";
import { day, fixed, measured } from "./format.ts";
import { SampleMark } from "./icons.tsx";
import type { RunDetail, TouchRow } from "./wire.ts";

/** A difference counts as one beyond this many of its standard deviations. */
const CLEAR_SIGMAS = 3;

interface Row { sample: string; a: number; b: number; sigma: number }

/** The stiffness of the samples that both runs measured, MPa. */
export function stiffnessRows(a: RunDetail, b: RunDetail): Row[] {
  return a.results.stiffness.flatMap((one) => {
    const other = b.results.stiffness.find((s) => s.sample === one.sample);
    // One that sets the scale alone has no uncertainty: it is no measurement.
    if (one.stiffness_mpa == null || other?.stiffness_mpa == null || one.sets_scale || other.sets_scale) return [];
    return [{ sample: one.sample, a: one.stiffness_mpa, b: other.stiffness_mpa, sigma: Math.hypot(one.sigma_mpa ?? 0, other.sigma_mpa ?? 0) }];
  });
}

/** The touches at the same step whose shifts differ most for their uncertainty. */
export function shiftRows(a: RunDetail, b: RunDetail): { row: TouchRow; other: TouchRow; sigmas: number }[] {
  const others = new Map(b.results.touch_results.map((row) => [row.step, row]));
  const pairs = a.results.touch_results.flatMap((row) => {
    const other = others.get(row.step);
    if (row.phase !== "main" || row.shift_hz == null || other?.shift_hz == null || other.sample !== row.sample) return [];
    const sigma = Math.hypot(row.shift_sigma_hz ?? 0, other.shift_sigma_hz ?? 0);
    return [{ row, other, sigmas: sigma > 0 ? (other.shift_hz - row.shift_hz) / sigma : 0 }];
  });
  return pairs.sort((x, y) => Math.abs(y.sigmas) - Math.abs(x.sigmas));
}

export function verdict(rows: Row[]): string {
  if (rows.length === 0) return "No sample has a stiffness in both runs.";
  const differing = rows.filter((row) => Math.abs(row.b - row.a) > CLEAR_SIGMAS * row.sigma);
  if (differing.length === 0) return `The stiffness of ${rows.length === 1 ? "the sample" : `all ${rows.length} samples`} agrees within ${CLEAR_SIGMAS} σ.`;
  return `The stiffness differs by more than ${CLEAR_SIGMAS} σ for sample ${differing.map((row) => row.sample).join(", ")}.`;
}

export function Compare({ a, b, onClose }: { a: RunDetail; b: RunDetail; onClose: () => void }) {
  const [rows, shifts] = [stiffnessRows(a, b), shiftRows(a, b)];
  const samples = a.results.stiffness.map((s) => s.sample);
  const ref = useRef<HTMLElement>(null);
  // It stands above the list, out of sight of the box that was ticked last.
  useEffect(() => ref.current?.scrollIntoView({ block: "center" }), [a.id, b.id]);
  return (
    <section ref={ref} class="card compare" aria-label="Compare two runs">
      <div class="row"><h2>{a.name} and {b.name}</h2><button type="button" onClick={onClose}>Close</button></div>
      {[a, b].flatMap((run) => doubts(run).map((doubt) => <p key={`${run.id} ${doubt}`} class="refused-word">{run.name}: {doubt}</p>))}
      <p><strong>{verdict(rows)}</strong></p>
      {a.protocol !== b.protocol && <p class="refused-word">They are runs of two protocols: {a.protocol} and {b.protocol}.</p>}
      {rows.length > 0 && (
        <div class="scroll" tabIndex={0} role="region" aria-label="Stiffness of both runs"><table class="compare-table">
          <thead><tr><th scope="col">stiffness, MPa</th><th scope="col">{a.name}<br /><span class="soft">{day(a.started_at)}</span></th><th scope="col">{b.name}<br /><span class="soft">{day(b.started_at)}</span></th><th scope="col">difference</th><th scope="col">in σ</th></tr></thead>
          <tbody>{rows.map((row) => {
            const difference = measured(row.b - row.a, row.sigma);
            return <tr key={row.sample}><th scope="row"><SampleMark index={samples.indexOf(row.sample)} /> sample {row.sample}</th><td>{measured(row.a, row.sigma).value}</td><td>{measured(row.b, row.sigma).value}</td><td>{difference.value} ± {difference.sigma}</td><td>{row.sigma > 0 ? fixed((row.b - row.a) / row.sigma, 1) : "unknown"}</td></tr>;
          })}</tbody>
        </table></div>
      )}
      {shifts.length > 0 && (
        <>
          <h3>Shifts that differ most, of {shifts.length} touches at the same pose</h3>
          <ul class="reasons">{shifts.slice(0, 5).map(({ row, other, sigmas }) => <li key={row.step}>{`sample ${row.sample}, ${row.direction} ${fixed(row.angle_deg, 0)}°: ${fixed(row.shift_hz ?? 0, 2)} Hz and ${fixed(other.shift_hz ?? 0, 2)} Hz, ${fixed(sigmas, 1)} σ`}</li>)}</ul>
        </>
      )}
      {a.results.no_load_hz != null && b.results.no_load_hz != null && <p class="soft">Free resonance {fixed(a.results.no_load_hz, 3)} Hz and {fixed(b.results.no_load_hz, 3)} Hz. Measured {a.results.touches_measured} of {a.results.touches_planned} and {b.results.touches_measured} of {b.results.touches_planned} touches.</p>}
    </section>
  );
}
