import assert from "node:assert/strict";
import test from "node:test";
import { differences } from "./changes.ts";
import { rows, timeline, wordsOf } from "./timeline.ts";
import { admittance, inverse } from "./circuit.ts";
import { doubts } from "./doubts.ts";
import { asWritten, clock, decimalsOf, decimalsOfAll, degrees, duration, fixed, measured, range } from "./format.ts";
import { empty, stateOf, sweepOf, withEvent, withLive, withRig } from "./model.ts";
import { Parser } from "./sse.ts";
import { extent, ticks } from "./scale.ts";
import type { LiveNews, Plan, Reading, Rig } from "./wire.ts";

const rig = (over: Partial<Rig> = {}): Rig => ({
  name: "bench 2", state: "idle", probe: "clear", rig_time_s: 1, unix_ms: 0, state_since_s: 0, session: "a",
  is_simulated: false, is_virtual_time: false, devices: [],
  limits: { linear_mm: { min: 8, max: 45, rest: 30 }, rotary_deg: { min: -50, max: 50, rest: 0 }, surface_mm: 10, surface_above_pivot_mm: 4 },
  ...over,
});
const reading = (started_s: number): Reading => ({
  frequency_hz: 140, resistance_ohm: 1, reactance_ohm: 2, started_s, settle_s: 0, integration_s: 0,
});
const news = (over: Partial<LiveNews>): LiveNews => ({
  sweep: 1, purpose: "touch", min_hz: 130, max_hz: 260, target_sigma_hz: 0.1, time_limit_s: 30,
  from: [0, 0], readings: [], estimates: [], ...over,
});

test("events are the same wherever the stream is cut", () => {
  const text = "id: 7\nevent: rig\ndata: {\"a\":1}\n\n: comment\n\ndata: x\r\ndata: y\r\n\r\n";
  const whole = new Parser().push(text);
  assert.deepEqual(whole, [
    { id: "7", event: "rig", data: '{"a":1}' },
    { id: undefined, event: "message", data: "x\ny" },
  ]);
  for (let cut = 0; cut <= text.length; cut++) {
    const parser = new Parser();
    assert.deepEqual([...parser.push(text.slice(0, cut)), ...parser.push(text.slice(cut))], whole, `cut at ${cut}`);
  }
});

test("digits are cut to the uncertainty", () => {
  const rows: [number, number, string, string][] = [
    [175.1037, 0.083, "175.10", "0.08"], [175.1037, 0.0123, "175.104", "0.012"],
    [34.5678, 2.4, "35", "2"], [-0.004, 0.03, "0.00", "0.03"], [-5.25, 0.3, "−5.3", "0.3"],
    [0.6691, 0.0196, "0.67", "0.02"],
  ];
  for (const [value, sigma, text, sigmaText] of rows) {
    assert.deepEqual(measured(value, sigma), { value: text, sigma: sigmaText });
  }
  assert.equal(decimalsOf(0), 2);
  assert.equal(fixed(-0.001, 2), "0.00");
});

test("what somebody has written is shown as it was, and ticks can be told apart", () => {
  assert.deepEqual([0.75, 8.25, -60, 2.4000000000000004, 0].map(asWritten), ["0.75", "8.25", "−60", "2.4", "0"]);
  assert.deepEqual([[0, 0.05, 0.1], [0, 20, 40], []].map(decimalsOfAll), [2, 0, 0]);
});

test("what the report holds against a run stands beside its values", () => {
  const row = { status: "measured", is_reference_steady: true };
  const sound = { is_sound: true, touch_results: [row, { ...row, is_reference_steady: null }], model: { verdict: "holds" }, calibration: { is_beyond_description: false }, daily_check: { verdict: "accepted" } };
  const of = (results: object) => doubts({ results: { ...sound, ...results } } as unknown as Parameters<typeof doubts>[0]);
  assert.deepEqual(of({}), []);
  assert.deepEqual(of({ model: null, calibration: null, daily_check: null }), []);
  for (const [results, word] of [
    [{ is_sound: false }, "do not use the results"], [{ model: { verdict: "rejected" } }, "rejected"], [{ model: { verdict: "strained" } }, "strained"],
    [{ calibration: { is_beyond_description: true } }, "known samples"], [{ daily_check: { verdict: "not to be trusted" } }, "not to be trusted"],
    [{ touch_results: [{ ...row, is_reference_steady: false }] }, "jumped after 1 touch,"],
  ] as const) {
    const said = of(results);
    assert.equal(said.length, 1);
    assert.ok(said[0]?.includes(word), said[0]);
  }
});

test("durations are read at a glance", () => {
  assert.deepEqual([6.2, 89, 780, 6720].map(duration), ["6 s", "89 s", "13 min", "1 h 52"]);
  assert.equal(range([1920, 2940]), "32 to 49 min");
  assert.equal(range([70, 130]), "70 s to 2 min");
  assert.equal(range([60.1, 60.2]), "about 60 s");
  assert.equal(degrees(30), "30°");
  assert.equal(degrees(12.345), "12.3°");
  assert.match(clock(0), /^\d\d:\d\d:\d\d$/);
});

test("a circuit far from its resonance is its capacitor, and at it nearly its resistance", () => {
  const circuit = { resonance_hz: 140, quality_factor: 30, static_capacitance_f: 27e-9, capacitance_ratio: 0.07, loss_tangent: 0 };
  const far = admittance(circuit, 14000);
  assert.ok(Math.abs(far.im / (2 * Math.PI * 14000 * 27e-9) - 1) < 1e-4);
  const at = admittance(circuit, 140);
  assert.ok(Math.abs(at.re / (2 * Math.PI * 140 * 27e-9 * 0.07 * 30) - 1) < 1e-9);
  const back = inverse(inverse(at));
  assert.ok(Math.abs(back.re - at.re) < 1e-12 && Math.abs(back.im - at.im) < 1e-12);
});

test("ticks are round and inside, and a range of nothing is a range", () => {
  assert.deepEqual(ticks(130, 260, 6), [140, 160, 180, 200, 220, 240, 260]);
  assert.deepEqual(ticks(0, 1, 2), [0, 0.5, 1]);
  assert.deepEqual(ticks(1, 1, 5), [1]);
  assert.deepEqual(extent([]), [0, 1]);
  assert.deepEqual(extent([1, Number.NaN, 3], 0), [1, 3]);
});

test("readings that come in pieces, twice or again make one sweep", () => {
  let model = withLive(empty(), news({ readings: [reading(1), reading(2)] }));
  model = withLive(model, news({ from: [2, 0], readings: [reading(3)], estimates: [{ readings: 3, resonance_hz: 140, sigma_hz: 1 }] }));
  assert.equal(model.sweep?.readings.length, 3);
  // After a reconnection the sweep comes again from its beginning.
  model = withLive(model, news({ readings: [reading(1), reading(2), reading(3), reading(4)] }));
  assert.deepEqual(model.sweep?.readings.map((r) => r.started_s), [1, 2, 3, 4]);
  model = withLive(model, news({ sweep: 2, readings: [reading(9)] }));
  assert.equal(model.sweep?.readings.length, 1);
});

test("a sweep is over whichever tells it first, its last reading or the journal", () => {
  const readings = [reading(1), reading(2)];
  const outcome = { status: "accepted" as const, resonance_hz: 141, sigma_hz: 0.1 };
  const event = { run: "r", seq: 1, rig_us: 1, record: { kind: "sweep" as const, number: 1, purpose: "touch" as const, readings, outcome } };
  const [early, late] = [news({ readings: readings.slice(0, 1) }), news({ from: [1, 0], readings: readings.slice(1) })];
  const orders = [
    withEvent(withLive(withLive(empty(), early), late), event),
    withLive(withEvent(withLive(empty(), early), event), late),
    withLive(withLive(withEvent(empty(), event), early), late),
  ];
  for (const model of orders) {
    assert.deepEqual(model.sweep?.outcome, { resonance_hz: 141, sigma_hz: 0.1 });
    assert.equal(model.sweep?.readings.length, 2);
  }
  // The sweep after it is another one.
  const next = withLive(orders[0] ?? empty(), news({ sweep: 2, readings: [reading(3)] }));
  assert.equal(next.sweep?.outcome, undefined);
});

test("a refused touch is kept with its reason, and never as a value", () => {
  const touch = { step: "main/5/left/0/1", phase: "main" as const, sample: "5", pose: { direction: "left" as const, angle_deg: 0 }, repeat: 1 };
  const event = (seq: number, record: object) => ({ run: "r", seq, rig_us: seq, record }) as Parameters<typeof withEvent>[1];
  let model = withEvent(empty(), event(1, { kind: "run_started", protocol: { name: "smoke" } }));
  model = withEvent(model, event(2, { kind: "touch_refused", touch, reason: "no resonance in the window" }));
  const kept = model.run?.touches.get(touch.step);
  assert.equal(kept?.status, "refused");
  assert.equal(kept?.shift_hz, undefined);
  assert.match(model.happenings[0]?.text ?? "", /refused, no resonance/);
  // Events of another run change nothing.
  assert.equal(withEvent(model, { ...event(3, { kind: "run_finished", status: "completed" }), run: "q" }).run?.status, undefined);
});

test("the sweep of a refused touch is its own, and not the one before", () => {
  const event = (seq: number, record: object) => ({ run: "r", seq, rig_us: seq, record }) as Parameters<typeof withEvent>[1];
  const begin = (seq: number, step: string) => event(seq, { kind: "step_started", step, action: { action: "touch", sample: "5" } });
  const swept = (purpose: string) => event(3, { kind: "sweep", number: 1, purpose, readings: [reading(1)], outcome: { status: "refused", reason: "no resonance" } });
  const before = withEvent(withEvent(empty(), event(1, { kind: "run_started", protocol: { name: "smoke" } })), begin(2, "main/5/front/0/1"));
  const live = withLive(before, news({ readings: [reading(1)] }));
  const after = withEvent(live, swept("touch"));
  assert.equal(sweepOf(after, "main/5/front/0/1")?.readings.length, 1);
  // In whichever order the readings and the record come.
  assert.equal(sweepOf(withLive(withEvent(before, swept("touch")), news({ readings: [reading(1)] })), "main/5/front/0/1")?.readings.length, 1);
  // The next touch, the same one again, or a free resonance has none yet.
  assert.equal(sweepOf(after, "main/5/front/45/1"), undefined);
  assert.equal(sweepOf(withEvent(after, begin(4, "main/5/front/45/1")), "main/5/front/45/1"), undefined);
  assert.equal(sweepOf(withEvent(after, begin(4, "main/5/front/0/1")), "main/5/front/0/1"), undefined);
  assert.equal(sweepOf(withEvent(after, event(4, { kind: "refusal_answered", step: "main/5/front/0/1", answer: "repeat", by: "x" })), "main/5/front/0/1"), undefined);
  assert.equal(sweepOf(withEvent(withLive(before, news({ purpose: "no_load", readings: [reading(1)] })), swept("no_load")), "main/5/front/0/1"), undefined);
});

test("another session forgets the one before", () => {
  const before = withLive(withRig(empty(), rig()), news({ readings: [reading(1)] }));
  assert.equal(withRig(before, rig({ session: "b" })).sweep, undefined);
});

test("every state has a word and a reason", () => {
  const run = { id: "r", protocol: "p", step: 3, steps: 9, touches_planned: 4, touches_measured: 1, touches_refused: 1, doing: "sample 1 of 2", is_pausing: false, elapsed_s: 1, remaining_s: [1, 2] as [number, number] };
  const of = (over: Partial<Rig>) => stateOf(withRig(empty(), rig(over)));
  assert.equal(of({}).word, "Ready");
  assert.deepEqual([of({ state: "running", run }).word, of({ state: "running", run }).reason], ["Running", "Touch 3 of 4: sample 1 of 2"]);
  assert.equal(of({ state: "running", run: { ...run, is_pausing: true } }).word, "Pausing");
  assert.equal(of({ state: "waiting for a person", run, prompt: "Put sample 1 under the probe." }).reason, "Put sample 1 under the probe.");
  assert.equal(of({ state: "latched", fault: { kind: "fault", cause: "stopped by x", hint: "h" } }).reason, "stopped by x");
  assert.equal(of({ state: "running", run, silence: { since_unix_ms: 1, message: "m", hint: "h" } }).word, "No answer");
  for (const state of ["preparing", "paused", "retracting"] as const) assert.ok(of({ state }).reason.length > 10);
});

test("a page left open does not grow", () => {
  let model = empty();
  for (let seq = 0; seq < 1000; seq++) {
    model = withEvent(model, { run: "r", seq, rig_us: seq, record: { kind: "state_changed", state: "idle" } });
  }
  assert.equal(model.happenings.length, 200);
});

test("protocols differ by their values, not by their comments", () => {
  const before = 'name = "a"\n[touch]\nindentation_mm = 0.5 # mm\n[blind]\ntrials = 6\n';
  const now = '# more\nname = "a"\n[touch]\n  indentation_mm = 0.6\n[no_load_sweep]\ncycles = 20\n';
  assert.deepEqual(differences(before, now), [
    { key: "touch.indentation_mm", before: "0.5", now: "0.6" },
    { key: "blind.trials", before: "6", now: undefined },
    { key: "no_load_sweep.cycles", before: undefined, now: "20" },
  ]);
  assert.deepEqual(differences(before, before), []);
});

test("every touch of a plan has one cell, with the prompts before it", () => {
  const touch = (step: string, sample: string, phase: "main" | "blind") =>
    ({ step, what_is_done: step, duration_s: 1, action: "touch" as const, phase, sample, repeat: 1, direction: "front" as const, angle_deg: 0 });
  const prompt = (step: string) => ({ step, what_is_done: step, duration_s: 0, action: "prompt" as const, what: "place_sample" as const, sample: "1" });
  const steps = [prompt("p1"), touch("a", "1", "main"), touch("b", "1", "main"), prompt("p2"), touch("c", "2", "main"), touch("d", "2", "blind")];
  const plan = { steps } as unknown as Plan;
  const done = new Map([["a", { status: "measured" }], ["b", { status: "refused" }]]) as unknown as Parameters<typeof timeline>[1];
  const groups = timeline(plan, done, "p2");
  assert.deepEqual(groups.map((g) => [g.label, g.cells.map((c) => `${c.needsPerson ? "▾" : ""}${c.state}`)]), [
    ["sample 1", ["▾measured", "refused"]], ["sample 2", ["▾now"]], ["blind", ["to come"]],
  ]);
  // One that is left out is never under way.
  const leftOut = new Map<string, object>([...done, ["c", { status: "skipped" }]]) as unknown as Parameters<typeof timeline>[1];
  assert.deepEqual(timeline(plan, leftOut, "p2").slice(1).map((g) => g.cells.map((c) => c.state)), [["left out"], ["now"]]);
  assert.match(wordsOf(timeline(plan, leftOut, "p2")), /1 refused, 1 left out, 0 to come/);
  const laid = rows(groups, 2).flat().flatMap((g) => g.cells.map((c) => c.step));
  assert.deepEqual(laid, ["a", "b", "c", "d"]);
});

test("the run that ended last is known also to a page opened afterwards", () => {
  const model = withRig(empty(), rig({ last_run: { id: "r", status: "completed" } }));
  assert.equal(model.run?.status, "completed");
  assert.match(stateOf(model).reason, /ended: completed/);
});
