// The live plots: what changes with every reading. Drawn by uPlot on a canvas.
import uPlot from "uplot";
import { useEffect, useRef } from "preact/hooks";
import { admittance, impedanceOf, inverse, magnitude, phaseDeg, type Complex } from "./circuit.ts";
import { decimalsOfAll, fixed } from "./format.ts";
import { extent, linear, ticks } from "./scale.ts";
import { useWidth } from "./size.ts";
import type { LiveSweep } from "./model.ts";

const FONT = '12px system-ui, -apple-system, "Segoe UI", sans-serif';
const dark = matchMedia("(prefers-color-scheme: dark)");

/** A colour of the theme, as it is now. */
const ink = (name: string) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

function axis(label: string, space: number, size: number): uPlot.Axis {
  return {
    stroke: () => ink("soft"), font: FONT, labelFont: FONT, label, labelSize: label ? 16 : 0, labelGap: 0, space, size, gap: 4,
    grid: { stroke: () => ink("edge"), width: 1 }, ticks: { show: false },
    values: (_, splits) => splits.map((v) => fixed(v, decimalsOfAll(splits))),
  };
}

interface PlotProps {
  height: number;
  name: string;
  options: Omit<uPlot.Options, "width" | "height">;
  data: uPlot.AlignedData;
  ranges: { x: [number, number]; y: [number, number] };
}

/** One uPlot, made once and given new data. */
function Plot({ height, name, options, data, ranges }: PlotProps) {
  const [ref, width] = useWidth<HTMLDivElement>();
  const plot = useRef<uPlot | undefined>(undefined);
  const last = useRef(ranges);
  last.current = ranges;
  useEffect(() => {
    if (!ref.current || width === 0) return;
    const scales: uPlot.Scales = {
      x: { time: false, range: () => last.current.x },
      y: { range: () => last.current.y },
    };
    const made = new uPlot({ ...options, width, height, scales, legend: { show: false }, cursor: { show: false } }, data, ref.current);
    plot.current = made;
    const redraw = () => made.redraw(false, true);
    dark.addEventListener("change", redraw);
    return () => {
      dark.removeEventListener("change", redraw);
      made.destroy();
      plot.current = undefined;
    };
  }, [width, height]);
  useEffect(() => plot.current?.setData(data), [data, ranges.x[0], ranges.x[1], ranges.y[0], ranges.y[1]]);
  const style = { height: `${height}px` };
  return <div class="plot" ref={ref} style={style} role="img" aria-label={name} />;
}

const CURVE_POINTS = 240;

/** |Z| and phase of a sweep, its readings and the circuit that explains them. */
export function SweepPlots({ sweep, height }: { sweep: LiveSweep; height: number }) {
  const frequencies = new Set<number>();
  if (sweep.circuit) {
    for (let i = 0; i <= CURVE_POINTS; i++) {
      frequencies.add(sweep.min_hz + ((sweep.max_hz - sweep.min_hz) * i) / CURVE_POINTS);
    }
  }
  const at = new Map<number, Complex[]>();
  for (const reading of sweep.readings) {
    const list = at.get(reading.frequency_hz) ?? [];
    list.push(impedanceOf(reading));
    at.set(reading.frequency_hz, list);
    frequencies.add(reading.frequency_hz);
  }
  const newest = sweep.readings.at(-1);
  const x: number[] = [];
  const rows: { curve: Complex | null; reading: Complex | null; isLast: boolean }[] = [];
  for (const f of [...frequencies].sort((a, b) => a - b)) {
    const curve = sweep.circuit ? inverse(admittance(sweep.circuit, f)) : null;
    const readings = at.get(f) ?? [null];
    for (const reading of readings) {
      x.push(f);
      const isLast = reading !== null && newest?.frequency_hz === f && reading === readings.at(-1);
      rows.push({ curve, reading, isLast });
    }
  }
  const series = (value: (z: Complex) => number): uPlot.AlignedData => [
    x,
    rows.map(({ curve }) => (curve ? value(curve) : null)),
    rows.map(({ reading }) => (reading ? value(reading) : null)),
    rows.map(({ reading, isLast }) => (reading && isLast ? value(reading) : null)),
  ];
  const kilo = series((z) => magnitude(z) / 1000);
  const phase = series(phaseDeg);
  // Readings that had not settled lie far away. Where a circuit is known, it says what to show.
  const rangeOf = (data: uPlot.AlignedData) => {
    const shown = sweep.circuit ? data[1] : data[2];
    return extent([...(shown ?? [])].filter((v): v is number => v !== null), sweep.circuit ? 0.2 : 0.08);
  };
  const x01: [number, number] = [sweep.min_hz, sweep.max_hz];
  const found = useRef<LiveSweep | undefined>(undefined);
  found.current = sweep;
  const options = (label: string, xLabel: string): PlotProps["options"] => ({
    padding: [8, 16, 0, 0],
    pxAlign: false,
    axes: [axis(xLabel, 56, xLabel ? 22 : 20), axis(label, 28, 42)],
    series: [
      {},
      { stroke: () => ink("ink"), width: 1.5, points: { show: false } },
      { stroke: () => ink("busy"), paths: () => null, points: { show: true, size: 6, width: 1.5, fill: () => ink("card") } },
      { stroke: () => ink("busy"), paths: () => null, points: { show: true, size: 11, width: 1.5, fill: () => ink("busy") } },
    ],
    hooks: { drawAxes: [(u) => found.current && markResonance(u, found.current)] },
  });
  const text = `${sweep.readings.length} readings from ${fixed(sweep.min_hz, 0)} to ${fixed(sweep.max_hz, 0)} Hz`;
  return (
    <>
      <Plot name={`Impedance: ${text}`} height={Math.round(height * 0.54)} options={options("|Z| kΩ", "")} data={kilo} ranges={{ x: x01, y: rangeOf(kilo) }} />
      <Plot name={`Phase: ${text}`} height={Math.round(height * 0.46)} options={options("phase °", "Hz")} data={phase} ranges={{ x: x01, y: rangeOf(phase) }} />
    </>
  );
}

/** The resonance as a line, with two standard deviations to both sides. */
function markResonance(u: uPlot, sweep: LiveSweep): void {
  const estimate = resonanceOf(sweep);
  if (!estimate) return;
  const { ctx, bbox } = u;
  const at = (hz: number) => Math.min(bbox.left + bbox.width, Math.max(bbox.left, u.valToPos(hz, "x", true)));
  const [low, middle, high] = [estimate.hz - 2 * estimate.sigma, estimate.hz, estimate.hz + 2 * estimate.sigma].map(at) as [number, number, number];
  ctx.save();
  ctx.fillStyle = ink("busy-ground");
  ctx.fillRect(low, bbox.top, high - low, bbox.height);
  ctx.strokeStyle = ink("busy");
  ctx.lineWidth = 1.5 * devicePixelRatio;
  ctx.beginPath();
  ctx.moveTo(middle, bbox.top);
  ctx.lineTo(middle, bbox.top + bbox.height);
  ctx.stroke();
  ctx.restore();
}

/** The present estimate of the resonance, or its result. */
export function resonanceOf(sweep: LiveSweep): { hz: number; sigma: number } | undefined {
  const { outcome } = sweep;
  if (outcome) return "resonance_hz" in outcome ? { hz: outcome.resonance_hz, sigma: outcome.sigma_hz } : undefined;
  const last = sweep.estimates.at(-1);
  return last && { hz: last.resonance_hz, sigma: last.sigma_hz };
}

/** The resonance ± 2 σ against the number of readings, narrowing into ± 2 σ of what is wanted. */
export function NarrowingPlot({ sweep, height }: { sweep: LiveSweep; height: number }) {
  const { estimates, target_sigma_hz } = sweep;
  const final = resonanceOf(sweep) ?? { hz: (sweep.min_hz + sweep.max_hz) / 2, sigma: 1 };
  const data: uPlot.AlignedData = [
    estimates.map((e) => e.readings),
    estimates.map((e) => e.resonance_hz + 2 * e.sigma_hz),
    estimates.map((e) => e.resonance_hz - 2 * e.sigma_hz),
    estimates.map((e) => e.resonance_hz),
  ];
  // The first estimates are far outside; the last ones are of interest.
  const late = estimates.slice(Math.floor(estimates.length / 2));
  const half = Math.max(6 * target_sigma_hz, ...late.map((e) => Math.abs(e.resonance_hz - final.hz) + 2 * e.sigma_hz));
  const limited = Math.min(half, 40 * target_sigma_hz + 4 * final.sigma);
  const wanted = useRef({ hz: 0, sigma: 0 });
  wanted.current = { hz: final.hz, sigma: target_sigma_hz };
  const options: PlotProps["options"] = {
    padding: [8, 16, 0, 0],
    pxAlign: false,
    axes: [axis("reading", 44, 22), axis("resonance ± 2 σ, Hz", 28, 58)],
    series: [
      {},
      { stroke: "transparent", points: { show: false } },
      { stroke: "transparent", points: { show: false } },
      { stroke: () => ink("busy"), width: 2, points: { show: false } },
    ],
    bands: [{ series: [1, 2], fill: () => ink("busy-ground") }],
    hooks: {
      drawAxes: [(u) => {
        const { ctx, bbox } = u;
        const { hz, sigma } = wanted.current;
        const [top, bottom] = [u.valToPos(hz + 2 * sigma, "y", true), u.valToPos(hz - 2 * sigma, "y", true)];
        ctx.save();
        ctx.fillStyle = ink("good-band");
        ctx.fillRect(bbox.left, top, bbox.width, bottom - top);
        ctx.restore();
      }],
    },
  };
  const x: [number, number] = [estimates[0]?.readings ?? 0, Math.max((estimates[0]?.readings ?? 0) + 10, (estimates.at(-1)?.readings ?? 10) + 2)];
  const name = `Resonance ± 2 σ after each reading, narrowing to σ = ${target_sigma_hz} Hz; now ${fixed(final.sigma, 3)} Hz`;
  return <Plot name={name} height={height} options={options} data={data} ranges={{ x, y: [final.hz - limited, final.hz + limited] }} />;
}

/** Conductance and susceptance: near the resonance a circle. */
export function CirclePlot({ sweep, height }: { sweep: LiveSweep; height: number }) {
  const [ref, width] = useWidth<HTMLDivElement>();
  const micro = ({ re, im }: Complex): [number, number] => [re * 1e6, im * 1e6];
  const points = sweep.readings.map((r) => micro(inverse(impedanceOf(r))));
  const curve: [number, number][] = [];
  if (sweep.circuit) {
    for (let i = 0; i <= 400; i++) {
      curve.push(micro(admittance(sweep.circuit, sweep.min_hz + ((sweep.max_hz - sweep.min_hz) * i) / 400)));
    }
  }
  const all = curve.length > 0 ? curve : points;
  const [g0, g1] = extent(all.map(([g]) => g), 0.12);
  const [b0, b1] = extent(all.map(([, b]) => b), 0.12);
  const box = { left: 34, right: 8, top: 18, bottom: 30 };
  const [w, h] = [Math.max(1, width - box.left - box.right), height - box.top - box.bottom];
  // One unit is as long on both axes, so that the circle is one.
  const perUnit = Math.min(w / (g1 - g0), h / (b1 - b0));
  const [gm, bm] = [(g0 + g1) / 2, (b0 + b1) / 2];
  const gs: [number, number] = [gm - w / perUnit / 2, gm + w / perUnit / 2];
  const bs: [number, number] = [bm - h / perUnit / 2, bm + h / perUnit / 2];
  const x = linear(gs, [box.left, box.left + w]);
  const y = linear(bs, [box.top + h, box.top]);
  const inside = ([g, b]: [number, number]) => g >= gs[0] && g <= gs[1] && b >= bs[0] && b <= bs[1];
  const path = curve.map(([g, b], i) => `${i ? "L" : "M"}${x(g).toFixed(1)} ${y(b).toFixed(1)}`).join("");
  const newest = points.at(-1);
  return (
    <div ref={ref} class="plot" style={{ height: `${height}px` }}>
      {width > 0 && (
        <svg width={width} height={height} role="img" aria-label={`Admittance of ${points.length} readings`}>
          <g class="grid">
            {ticks(...gs, w / 50).map((t) => <g key={`g${t}`}><path d={`M${x(t)} ${box.top}v${h}`} /><text x={x(t)} y={box.top + h + 14} text-anchor="middle">{fixed(t, 0)}</text></g>)}
            {ticks(...bs, h / 36).map((t) => <g key={`b${t}`}><path d={`M${box.left} ${y(t)}h${w}`} /><text x={box.left - 5} y={y(t) + 4} text-anchor="end">{fixed(t, 0)}</text></g>)}
            <text x={box.left - 5} y={11}>B µS</text>
            <text x={box.left + w} y={height - 3} text-anchor="end">G µS</text>
          </g>
          <path d={path} class="curve" />
          {points.filter(inside).map(([g, b], i) => <circle key={i} cx={x(g)} cy={y(b)} r="3" class="reading" />)}
          {newest && inside(newest) && <circle cx={x(newest[0])} cy={y(newest[1])} r="5.5" class="newest" />}
        </svg>
      )}
    </div>
  );
}
