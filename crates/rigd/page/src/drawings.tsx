// Drawings of what is: the bench, the timeline, the shifts. Everything in them is a read-back, a
// plan or a result; nothing is predicted.
import { decimalsOfAll, degrees, fixed } from "./format.ts";
import { shape } from "./icons.tsx";
import { depthMm, type Model, type Touch } from "./model.ts";
import { extent, linear, ticks } from "./scale.ts";
import { useWidth } from "./size.ts";
import { rows, timeline, wordsOf, type Group } from "./timeline.ts";
import type { Direction, Limits, Plan, Rig } from "./wire.ts";

// ---- The bench, from the side -----------------------------------------------------------------------

const PX = 4.2;
const [BASE_Y, AXIS_X] = [214, 178];

/** Where a height on the linear stage is drawn. */
const y = (mm: number) => BASE_Y - mm * PX;

interface Pose { linear_mm: number | undefined; rotary_deg: number | undefined; sample: string | undefined; isUnknown: boolean; isClear: boolean; depth: number | undefined }

export function BenchDrawing({ limits, pose, isPlain }: { limits: Limits; pose: Pose; isPlain?: boolean }) {
  const { linear_mm, rotary_deg, sample, isUnknown, depth } = pose;
  const tipY = y(linear_mm ?? limits.linear_mm.rest);
  const tilt = rotary_deg ?? 0;
  const surface = y(limits.surface_mm);
  const pivot = surface + limits.surface_above_pivot_mm * PX;
  const isNoHeight = linear_mm === undefined;
  const where = isNoHeight ? "at an unknown height" : `at ${fixed(linear_mm, 3)} mm`;
  const name = `The bench from the side: the tip of the probe ${where}, the sample tilted by ${rotary_deg === undefined ? "an unknown angle" : degrees(rotary_deg)}${depth === undefined ? "" : `, ${fixed(depth, 3)} mm deep`}`;
  return (
    <svg class={`bench${isUnknown || isNoHeight ? " unsure" : ""}`} viewBox={isPlain ? "0 0 300 250" : "0 0 400 250"} role="img" aria-label={name}>
      <g class="grid">
        {[0, 10, 20, 30, 40].map((mm) => <g key={mm}><path d={`M34 ${y(mm)}h8`} /><text x="29" y={y(mm) + 4} text-anchor="end">{mm}</text></g>)}
        <text x="29" y={y(46)} text-anchor="end">mm</text>
      </g>
      <rect class="rail" x="42" y={y(45)} width="8" height={45 * PX} />
      <rect class="forbidden" x="42" y={y(limits.linear_mm.min)} width="8" height={limits.linear_mm.min * PX} />
      <g class="clear-line"><path d={`M52 ${y(limits.linear_mm.rest)}h26`} /><text x="81" y={y(limits.linear_mm.rest) + 4}>clear</text></g>
      <rect class="metal" x="118" y="16" width="10" height="212" />
      <g class="moves" style={{ transform: `rotate(${tilt}deg)`, transformOrigin: `${AXIS_X + 20}px ${pivot}px` }}>
        <circle class="metal" cx={AXIS_X + 20} cy={pivot} r="30" />
        <path class="stroke" d={`M${AXIS_X + 20} ${pivot + 12}v16`} />
        <rect class="metal" x={AXIS_X - 60} y={surface + 34} width="160" height="6" />
        <rect class="flesh" x={AXIS_X - 54} y={surface} width="148" height="34" rx="3" />
        {sample !== undefined && <g><rect class="label" x={AXIS_X + 60} y={surface + 7} width={12 + 9 * sample.length} height="21" rx="4" /><text class="label-text" x={AXIS_X + 66 + 4.5 * sample.length} y={surface + 22} text-anchor="middle">{sample}</text></g>}
      </g>
      <g class="moves" style={{ transform: `translateY(${tipY}px)` }}>
        <rect class="metal" x="110" y="-66" width="26" height="36" rx="3" />
        <rect class="metal" x="136" y="-54" width="120" height="11" rx="3" />
        <rect class="metal" x="244" y="-50" width="18" height="26" rx="3" />
        <rect class="bimorph" x={AXIS_X + 16} y="-36" width="54" height="6" rx="2" />
        <path class="stroke" d={`M${AXIS_X + 20} -30V-5`} />
        <circle class="tip" cx={AXIS_X + 20} cy="-4" r="4.5" />
      </g>
      {!isNoHeight && <g class="moves" style={{ transform: `translateY(${tipY}px)` }}><path class="pointer" d="M53 0l9-5v10z" /><text class="value" x="65" y={Math.abs(linear_mm - limits.linear_mm.rest) < 3 ? 18 : 4}>{fixed(linear_mm, 3)}{isUnknown ? "?" : ""}</text></g>}
      {!isPlain && <Magnifier depth={depth} isUnknown={isUnknown} isClear={pose.isClear} tilt={tilt} />}
      <text class="value" x={AXIS_X + 20} y="247" text-anchor="middle">{rotary_deg === undefined ? "tilt unknown" : `tilt ${fixed(rotary_deg, 2)}°`}</text>
    </svg>
  );
}

/** The tip in the surface, ten times as large. */
function Magnifier({ depth, isUnknown, isClear, tilt }: { depth: number | undefined; isUnknown: boolean; isClear: boolean; tilt: number }) {
  const [cx, cy, r, ball] = [340, 76, 52, 24];
  // The ball has a radius of half a millimetre or so.
  const into = Math.min(40, (depth ?? 0) * 48);
  const isIn = depth !== undefined;
  return (
    <g>
      <clipPath id="lens"><circle cx={cx} cy={cy} r={r} /></clipPath>
      <g clip-path="url(#lens)">
        {isIn && <g class="moves" style={{ transform: `rotate(${tilt}deg)`, transformOrigin: `${cx}px ${cy}px` }}><rect class="flesh" x={cx - 90} y={cy + ball - into} width="180" height="120" /></g>}
        <rect class="stroke-fill" x={cx - 2.5} y={cy - r} width="5" height={r - ball} />
        <circle class={isUnknown ? "lens-unknown" : "metal"} cx={cx} cy={cy} r={ball} />
        {isUnknown && <text class="question" x={cx} y={cy + 9} text-anchor="middle">?</text>}
      </g>
      <circle class="lens" cx={cx} cy={cy} r={r} />
      <text class="value" x={cx} y={cy + r + 18} text-anchor="middle">{isUnknown ? "depth unknown" : isIn ? `${fixed(depth, 3)} mm deep` : isClear ? "clear" : "depth unknown"}</text>
    </g>
  );
}

export function Bench({ model, isPlain }: { model: Model; isPlain?: boolean }) {
  const rig = model.rig as Rig;
  const isUnknown = rig.probe === "unknown";
  const depth = rig.probe === "in contact" ? depthMm(model) : undefined;
  const pose = { linear_mm: rig.linear_mm, rotary_deg: rig.rotary_deg, sample: model.sample, isUnknown, isClear: rig.probe === "clear", depth };
  return <BenchDrawing limits={rig.limits} pose={pose} {...(isPlain ? { isPlain } : {})} />;
}

// ---- The timeline -----------------------------------------------------------------------------------

export function Timeline({ plan, touches, now }: { plan: Plan; touches: ReadonlyMap<string, Touch>; now: string | undefined }) {
  const [ref, width] = useWidth<HTMLDivElement>();
  const groups = timeline(plan, touches, now);
  const total = groups.reduce((sum, group) => sum + group.cells.length + 1, 0);
  const lines = rows(groups, Math.max(10, width / total >= 5 ? total : Math.floor(width / 6)));
  const longest = Math.max(1, ...lines.map((line) => line.reduce((sum, g) => sum + g.cells.length + 1, -1)));
  const pitch = Math.min(26, width / longest);
  const rowHeight = 64;
  return (
    <div ref={ref} class="timeline">
      {width > 0 && (
        <svg width={width} height={lines.length * rowHeight} role="img" aria-label={wordsOf(groups)}>
          {lines.map((line, i) => <TimelineRow key={i} line={line} pitch={pitch} top={i * rowHeight} />)}
        </svg>
      )}
    </div>
  );
}

function TimelineRow({ line, pitch, top }: { line: Group[]; pitch: number; top: number }) {
  let x = 0;
  const gap = pitch > 4 ? 1.5 : 0.5;
  return (
    <g>
      {line.map((group, g) => {
        const from = x;
        x += (group.cells.length + 1) * pitch;
        const room = group.cells.length * pitch;
        return (
          <g key={g}>
            {group.label.length * 6.5 < room + 4 && <text class="axis" x={from} y={top + 12}>{group.label}</text>}
            {group.cells.map((cell, c) => {
              const left = from + c * pitch;
              const w = Math.max(1, pitch - gap);
              const mid = left + w / 2;
              return (
                <g key={cell.step}>
                  <title>{`${cell.name}: ${cell.state}`}</title>
                  {cell.needsPerson && (pitch >= 8
                    ? <path class={`need ${cell.state === "to come" ? "" : "past"}`} d={`M${mid - 4} ${top + 18}h8l-4 6z`} />
                    : <rect class={`need ${cell.state === "to come" ? "" : "past"}`} x={left} y={top + 19} width={w} height="4" />)}
                  <rect class={`cell ${cell.state.replace(" ", "-")}`} x={left} y={top + 28} width={w} height="30" rx={Math.min(2, w / 3)} />
                  {cell.state === "refused" && <path class="refused-mark" d={`M${mid - 3} ${top + 40}l6 6m0-6l-6 6`} />}
                </g>
              );
            })}
          </g>
        );
      })}
    </g>
  );
}

// ---- Shift against angle ----------------------------------------------------------------------------

const DIRECTIONS: Direction[] = ["front", "back", "left"];

export interface LiveTouch { step: string; shift_hz: number; sigma_hz: number }

interface ShiftProps {
  samples: string[];
  touches: Touch[];
  /** The last good run of the same protocol, dashed. */
  before?: Touch[] | undefined;
  /** The touch that is being measured, by its present estimate. */
  live?: LiveTouch | undefined;
  nowStep?: string | undefined;
  height: number;
}

export function ShiftCharts({ samples, touches, before = [], live, nowStep, height }: ShiftProps) {
  const main = touches.filter((touch) => touch.phase === "main");
  const blind = touches.filter((touch) => touch.phase === "blind");
  const hasBlind = blind.some((touch) => touch.status !== "not_reached" || touch.step === nowStep);
  const directions = DIRECTIONS.filter((d) => main.some((touch) => touch.direction === d));
  const values = [...main, ...blind, ...before].flatMap((t) => (t.status === "measured" && t.shift_hz !== undefined ? [t.shift_hz - 2 * (t.sigma_hz ?? 0), t.shift_hz + 2 * (t.sigma_hz ?? 0)] : []));
  const [low, high] = extent([0, ...values, ...(live ? [live.shift_hz] : [])], 0.06);
  const ys: [number, number] = [Math.min(0, low), high];
  return (
    <div class="shifts">
      {directions.map((direction) => (
        <Panel key={direction} title={direction} samples={samples} ys={ys} height={height} live={live} nowStep={nowStep}
          touches={main.filter((t) => t.direction === direction)} before={before.filter((t) => t.phase === "main" && t.direction === direction)}
          xOf={(t) => t.angle_deg} xLabel={(v) => degrees(v)} isJoined />
      ))}
      {hasBlind && (
        <Panel title="blind, in order" samples={samples} ys={ys} height={height} live={live} nowStep={nowStep} touches={blind} before={[]}
          xOf={(t) => t.repeat} xLabel={(v) => fixed(v, 0)} isJoined={false} />
      )}
    </div>
  );
}

interface PanelProps {
  title: string; samples: string[]; touches: Touch[]; before: Touch[]; ys: [number, number]; height: number;
  live: LiveTouch | undefined; nowStep: string | undefined;
  xOf: (touch: Touch) => number; xLabel: (value: number) => string; isJoined: boolean;
}

function Panel({ title, samples, touches, before, ys, height, live, nowStep, xOf, xLabel, isJoined }: PanelProps) {
  const [ref, width] = useWidth<HTMLDivElement>();
  const box = { left: 34, right: 12, top: 8, bottom: 38 };
  const [w, h] = [Math.max(1, width - box.left - box.right), height - box.top - box.bottom];
  const xs = [...new Set(touches.map(xOf))].sort((a, b) => a - b);
  const span: [number, number] = xs.length > 1 ? [xs[0] ?? 0, xs.at(-1) ?? 1] : [(xs[0] ?? 0) - 1, (xs[0] ?? 0) + 1];
  const pad = (span[1] - span[0]) * 0.06;
  const x = linear([span[0] - pad, span[1] + pad], [box.left, box.left + w]);
  const yy = linear(ys, [box.top + h, box.top]);
  const marks = ticks(...ys, h / 34);
  const decimals = decimalsOfAll(marks);
  const labels = isJoined ? xs : ticks(span[0], span[1], Math.max(2, w / 60));
  const index = (touch: Touch) => Math.max(0, samples.indexOf(touch.sample));
  const done = touches.filter((t) => t.status === "measured" && t.shift_hz !== undefined);
  const refused = touches.filter((t) => t.status === "refused");
  const now = touches.find((t) => t.step === nowStep && t.status === "not_reached");
  const path = (of: Touch[]) => of.map((t, i) => `${i ? "L" : "M"}${x(xOf(t)).toFixed(1)} ${yy(t.shift_hz ?? 0).toFixed(1)}`).join("");
  const bySample = (of: Touch[]) => samples.map((sample) => of.filter((t) => t.sample === sample && t.shift_hz !== undefined).sort((a, b) => xOf(a) - xOf(b)));
  const words = `${title}: ${done.length} measured, ${refused.length} refused of ${touches.length} touches.`;
  return (
    <figure class="panel">
      <figcaption>{title}</figcaption>
      <div ref={ref} style={{ height: `${height}px` }}>
        {width > 0 && (
          <svg width={width} height={height} role="img" aria-label={`Frequency shift, ${words}`}>
            <g class="grid">
              {marks.map((t) => <g key={t}><path d={`M${box.left} ${yy(t)}h${w}`} /><text x={box.left - 6} y={yy(t) + 4} text-anchor="end">{fixed(t, decimals)}</text></g>)}
              {labels.map((t) => <text key={t} x={x(t)} y={box.top + h + 16} text-anchor="middle">{xLabel(t)}</text>)}
            </g>
            {now && <rect class="now-band" x={x(xOf(now)) - 9} y={box.top} width="18" height={h} rx="4" />}
            {isJoined && bySample(before).map((of, i) => of.length > 1 && <path key={`b${i}`} class="before" d={path(of)} />)}
            {isJoined && bySample(done).map((of, i) => of.length > 1 && <path key={`l${i}`} class={`line s${i % 5}`} d={path(of)} />)}
            {done.map((t) => {
              const [cx, cy, s] = [x(xOf(t)), yy(t.shift_hz ?? 0), index(t)];
              const bar = Math.abs(yy(2 * (t.sigma_hz ?? 0)) - yy(0));
              return <g key={t.step} class={`s${s % 5}`}><title>{`sample ${t.sample}, ${xLabel(xOf(t))}: ${fixed(t.shift_hz ?? 0, 2)} ± ${fixed(t.sigma_hz ?? 0, 2)} Hz`}</title><path class="bar" d={`M${cx} ${cy - bar}v${2 * bar}`} /><path class="mark" d={shape(s, cx, cy, isJoined ? 4.5 : 3.5)} /></g>;
            })}
            {now && live && live.step === now.step && <circle class="live-mark" cx={x(xOf(now))} cy={yy(live.shift_hz)} r="7" />}
            {refused.map((t, i) => (
              <g key={t.step} class="refused-mark">
                <title>{`sample ${t.sample}, ${xLabel(xOf(t))}: refused, ${t.reason ?? ""}`}</title>
                <path d={`M${x(xOf(t)) - 12} ${box.top + h + 24}l7 7m0-7l-7 7`} />
                <text x={x(xOf(t)) - 1} y={box.top + h + 32}>{refused.findIndex((r) => xOf(r) === xOf(t)) === i ? refused.filter((r) => xOf(r) === xOf(t)).map((r) => r.sample).join(",") : ""}</text>
              </g>
            ))}
          </svg>
        )}
      </div>
    </figure>
  );
}

// ---- What a person is to do, seen from above --------------------------------------------------------

export function PromptDrawing({ what, sample, orientation }: { what: "place_sample" | "turn_sensor"; sample: string | undefined; orientation: string }) {
  const isLeft = orientation === "left";
  const isTurning = what === "turn_sensor";
  const label = sample === undefined ? "?" : sample;
  return (
    <svg class="above" viewBox="0 0 420 420" role="img"
      aria-label={isTurning ? `Seen from above: the sensor turns a quarter, to ${orientation}` : `Seen from above: sample ${label} lies under the probe`}>
      <circle class="dotted" cx="210" cy="170" r="150" />
      <rect class={`flesh${isTurning ? "" : " placed"}`} x="120" y="80" width="180" height="180" rx="10" />
      <g><rect class="label" x={250 - 9 * Math.max(0, label.length - 1)} y="206" width={38 + 18 * Math.max(0, label.length - 1)} height="42" rx="6" /><text class="sample-text" x={269} y="237" text-anchor="middle">{label}</text></g>
      <g transform={`rotate(${isLeft ? -90 : 0} 210 170)`} class={isTurning ? "" : "quiet"}>
        <rect class="metal" x="190" y="4" width="40" height="38" rx="4" />
        <rect class="bimorph" x="199" y="40" width="22" height="136" rx="3" />
        <circle class="tip" cx="210" cy="168" r="10" />
      </g>
      {isTurning && <g transform={`rotate(${isLeft ? 0 : -90} 210 170)`}><rect class="ghost" x="199" y="14" width="22" height="150" rx="3" /></g>}
      {isTurning && (isLeft
        ? <path class="arrow" d="M186 52A126 126 0 0 0 92 140m-14 -8l12 18 18-12" />
        : <path class="arrow" d="M90 152A126 126 0 0 1 180 56m-16 -14l20 13-12 19" />)}
      <text class="caption" x={isTurning ? (isLeft ? 70 : 210) : 210} y={isTurning ? (isLeft ? 215 : 22) : 288} text-anchor="middle">{isTurning ? orientation : "under the probe"}</text>
      <path class="metal" d="M120 396c0-62 180-62 180 0z" />
      <text class="caption" x="210" y="386" text-anchor="middle">you</text>
      <text class="axis" x="210" y="414" text-anchor="middle">seen from above</text>
    </svg>
  );
}
