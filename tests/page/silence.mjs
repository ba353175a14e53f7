// Requests that get no answer: they are given up, and they do not pile up.
import assert from "node:assert/strict";
import { join } from "node:path";
import { button, config, serve, state, visit } from "./support.mjs";

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
  await silentCommands(page);
  // Nor does an attempt to listen wait for ever.
  let attempts = 0;
  await page.route("**/api/v1/events*", () => { attempts += 1; });
  child.kill("SIGSTOP");
  await state(page, "Link lost");
  child.kill("SIGCONT");
  for (let n = 0; n < 4 && attempts < 2; n += 1) await after(page, 3000);
  assert.ok(attempts >= 2, `${attempts} attempts to listen`);
  await page.unroute("**/api/v1/events*");
  await state(page, "Latched, nothing moves");
  // A hidden tab asks for nothing.
  const seen = [];
  await page.evaluate(() => Object.defineProperty(document, "hidden", { get: () => true }));
  page.on("request", (request) => seen.push(request.url()));
  await after(page, 2500);
  assert.deepEqual(seen, []);
  await page.context().close();
}

/** A check and a command without an answer are given up as what is read is. A stop is not: it may still arrive. */
async function silentCommands(page) {
  const given = [];
  page.on("requestfailed", (request) => { if (request.method() === "POST") given.push(new URL(request.url()).pathname); });
  await page.route("**/api/v1/protocols/check", () => undefined);
  await page.getByLabel("Open a file…").setInputFiles(join(config, "protocols/smoke.toml"));
  await page.getByText("rigd is checking smoke.toml…").waitFor();
  await page.getByRole("alert").getByText("smoke.toml could not be checked: No answer from rigd.").waitFor({ timeout: 15_000 });
  assert.equal(await page.getByText("cannot run here").count(), 0);
  await page.unroute("**/api/v1/protocols/check");
  await button(page, "Check again").click();
  await page.route("**/api/v1/queue", (route) => (route.request().method() === "POST" ? undefined : route.continue()));
  await button(page, "Add to the queue").click();
  await page.getByText("asked; no answer yet, press again to ask again").waitFor();
  await page.getByRole("alert").getByText("No answer from rigd.", { exact: true }).waitFor({ timeout: 15_000 });
  await page.unroute("**/api/v1/queue");
  assert.deepEqual(given, ["/api/v1/protocols/check", "/api/v1/queue"]);
  const stop = button(page, /^Stop all/);
  await page.route("**/api/v1/stop", () => undefined);
  await stop.click();
  await after(page, 8000);
  assert.match(await stop.innerText(), /no answer: press again, or use the emergency stop/);
  assert.equal(given.length, 2, `given up: ${given}`);
  await page.unroute("**/api/v1/stop");
  await stop.click();
  await state(page, "Latched, nothing moves");
}
