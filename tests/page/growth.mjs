// A page left open for hours: twenty events a second, faster than they happen, and what the page keeps.
//
// Usage: growth.mjs RIGD DIRECTORY_FOR_PICTURES [HOURS]      1 h if left out
//
// Everything but the stream of events comes from a daemon. The stream repeats a run of that daemon, record by
// record, each time under another id; in between come the state of the rig and the readings of each sweep.
import assert from "node:assert/strict";
import { createServer, request } from "node:http";
import { once } from "node:events";
import { keeper, run, serve, visit } from "./support.mjs";

const HOURS = Number(process.argv[4] ?? 1);
const PER_SECOND = 20;
/** Events on the way to the page at a time. */
const BATCH = 200;
/** What the page keeps is read after each of these parts. */
const PARTS = 6;
/** It may grow by this much from the first half to the second, in which the browser still compiles what it runs often. */
const GROWTH_MB = 0.8;
/** The page shows some 500 nodes; what is replaced counts until the browser collects it, at most 1563 in what was seen. */
const NODES = 4000;

/** The records of a run of the daemon. */
async function recorded(base) {
  // The address is known a moment before the rig is ready.
  for (let asked = 0; !(await fetch(`${base}/readyz`)).ok; asked += 1) assert.ok(asked < 10_000, "the rig is not ready");
  const answer = await fetch(`${base}/api/v1/runs`, { method: "POST" });
  const begun = await answer.json();
  assert.ok(answer.ok, begun.detail);
  const events = await fetch(`${base}/api/v1/events?back=2000`);
  const reader = events.body.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  while (!text.includes("event: run_finished")) text += (await reader.read()).value ?? assert.fail("the stream ended");
  await reader.cancel();
  const lines = await (await fetch(`${base}/api/v1/runs/${begun.id}/export?format=jsonl`)).text();
  return { id: begun.id, records: lines.trim().split("\n").map((line) => JSON.parse(line)) };
}

/** The events of one run after another, without end: [name, id, data]. */
function* endless(rig, { id, records }) {
  const [seconds] = [records.at(-1).rig_us / 1e6];
  const between = Math.max(1, Math.round((seconds * PER_SECOND) / records.length) - 1);
  let [event, sweeps, at] = [0, 0, rig.rig_time_s];
  for (let run = 0; ; run += 1) {
    const name = `${id.slice(0, -12)}${run.toString(16).padStart(12, "0")}`;
    const touches = records.filter((one) => one.record.kind === "touch_result").length;
    let done = 0;
    for (const { seq, rig_us, record } of records) {
      const { readings = [] } = record;
      for (let part = 0; part < between; part += 1) {
        at += 1 / PER_SECOND;
        const under_way = {
          id: name, protocol: "smoke", step: done, steps: touches, touches_planned: touches, touches_measured: done, touches_refused: 0,
          doing: `touch ${done}`, is_pausing: false, elapsed_s: rig_us / 1e6, remaining_s: [1, seconds], learned_from_touches: 0,
        };
        yield ["rig", undefined, { ...rig, state: "running", rig_time_s: at, linear_mm: 30 - 20 * Math.abs(Math.sin(at)), run: under_way }];
      }
      if (record.kind === "sweep") sweeps += 1;
      for (let from = 0; from < readings.length; from += 3) {
        const part = readings.slice(from, from + 3).map(({ started_s, ...reading }) => ({ ...reading, started_s }));
        const estimate = { readings: from + part.length, resonance_hz: 140 + Math.random(), sigma_hz: 1 / (1 + from) };
        yield ["live_sweep", undefined, { sweep: sweeps, purpose: record.purpose, min_hz: 125, max_hz: 160, target_sigma_hz: 0.02, time_limit_s: 30, from: [from, from / 3], readings: part, estimates: [estimate] }];
      }
      if (record.kind === "touch_result") done += 1;
      event += 1;
      yield [record.kind, event, { run: name, seq, rig_us: rig_us + at * 1e6, record }];
    }
  }
}

/** The daemon behind another stream of events. The reader gets `count` events at a time. */
async function standIn(base, id) {
  let [page, begin] = [];
  const isRead = new Promise((resolve) => { begin = resolve; });
  const server = createServer((asked, answer) => {
    if (asked.url.startsWith("/api/v1/events")) {
      answer.writeHead(200, { "Content-Type": "text/event-stream", "Cache-Control": "no-store" });
      answer.flushHeaders();
      page = answer;
      begin();
      return;
    }
    const path = asked.url.replace(new RegExp(`${id.slice(0, -12)}[0-9a-f]{12}`), id);
    const to = request(`${base}${path}`, { method: asked.method, headers: { accept: asked.headers.accept ?? "*/*" } }, (from) => { answer.writeHead(from.statusCode, from.headers); from.pipe(answer); });
    asked.pipe(to);
  });
  server.unref();
  server.listen(0, "127.0.0.1");
  await once(server, "listening");
  const send = async (text) => { if (!page.write(text)) await once(page, "drain"); };
  return { server, address: `http://127.0.0.1:${server.address().port}`, send, isRead };
}

const line = ([event, id, data]) => `${id === undefined ? "" : `id: ${id}\n`}event: ${event}\ndata: ${JSON.stringify(data)}\n\n`;

await run(async () => {
  const { base } = await serve("growth", (text) => text);
  const rig = await (await fetch(`${base}/api/v1/rig`)).json();
  const recording = await recorded(base);
  const { server, address, send, isRead } = await standIn(base, recording.id);
  const page = await visit(address);
  page.isExpecting = (text) => text.includes("net::ERR");
  await isRead;
  const [kept, events, total] = [await keeper(page), endless(rig, recording), Math.round(HOURS * 3600 * PER_SECOND)];
  const [began, found] = [Date.now(), []];
  let sent = 0;
  for (let part = 1; part <= PARTS; part += 1) {
    // To the end of a run, so that what is kept of one does not count.
    for (let last = ""; sent < (total * part) / PARTS || last !== "run_finished";) {
      let text = "";
      for (let n = 0; n < BATCH && (n === 0 || last !== "run_finished"); n += 1, sent += 1) {
        const next = events.next().value;
        text += line(next);
        [last] = next;
      }
      await send(text);
    }
    // The page has drawn everything when it shows this name.
    const name = `${sent} events`;
    await send(line(["rig", undefined, { ...rig, name }]));
    await page.getByText(name, { exact: true }).waitFor({ timeout: 300_000 });
    found.push({ sent, ...await kept() });
  }
  const seconds = (Date.now() - began) / 1000;
  for (const { sent, megabytes, nodes } of found) console.log(`${sent} events, ${(sent / PER_SECOND / 3600).toFixed(2)} h: ${megabytes.toFixed(2)} MB, ${nodes} nodes`);
  console.log(`${(sent / seconds).toFixed(0)} events a second`);
  // A part of the stream that is still being read counts now and then, whatever was collected: the least of each half. In the
  // first part the page still fills what it keeps of a bounded number of events.
  const least = (what, parts) => Math.min(...parts.map((part) => part[what]));
  const [first, last] = [found.slice(1, PARTS / 2), found.slice(PARTS / 2)];
  const growth = least("megabytes", last) - least("megabytes", first);
  assert.ok(growth < GROWTH_MB, `the page keeps ${growth.toFixed(2)} MB more in the second half`);
  assert.ok(least("nodes", last) <= NODES, `the page keeps ${least("nodes", last)} nodes`);
  await page.context().close();
});
