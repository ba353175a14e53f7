// Requests that get no answer: they are given up, and they do not pile up.
import assert from "node:assert/strict";
import { button, serve, state, visit } from "./support.mjs";

const after = async (page, ms) => page.waitForFunction((until) => performance.now() > until, await page.evaluate((wait) => performance.now() + wait, ms), { timeout: ms + 10_000 });

export async function silentRequests() {
  const { base, child } = await serve("silent", (text) => text);
  const page = await visit(base);
  await state(page, "Ready");
  await button(page, "Start smoke").waitFor();
  // The time limit of what is read, in a third of the time.
  await page.evaluate(() => {
    const timeout = AbortSignal.timeout.bind(AbortSignal);
    AbortSignal.timeout = (ms) => timeout(ms / 3);
  });
  let asked = 0;
  page.isExpecting = (text) => /Failed to load resource|net::ERR/.test(text);
  await page.route("**/api/v1/queue", () => { asked += 1; });
  await after(page, 5000);
  assert.equal(asked, 1, "the queue is asked for every 2 s, and never twice at a time");
  await after(page, 7000);
  assert.equal(asked, 2, "a request without an answer is given up");
  await page.unroute("**/api/v1/queue");
  // Nor does an attempt to listen wait for ever.
  let attempts = 0;
  await page.route("**/api/v1/events*", () => { attempts += 1; });
  child.kill("SIGSTOP");
  await state(page, "Link lost");
  child.kill("SIGCONT");
  for (let n = 0; n < 4 && attempts < 2; n += 1) await after(page, 3000);
  assert.ok(attempts >= 2, `${attempts} attempts to listen`);
  await page.unroute("**/api/v1/events*");
  await state(page, "Ready");
  // A hidden tab asks for nothing.
  const seen = [];
  await page.evaluate(() => Object.defineProperty(document, "hidden", { get: () => true }));
  page.on("request", (request) => seen.push(request.url()));
  await after(page, 2500);
  assert.deepEqual(seen, []);
  await page.context().close();
}
