// What the tests of the page share: a daemon on the simulated rig, and a browser that complains.
import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { mkdirSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { chromium } from "playwright-core";

export const [rigd, shots] = process.argv.slice(2);
export const config = join(import.meta.dirname ?? new URL(".", import.meta.url).pathname, "../../config");
const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
const executablePath = process.env.CHROMIUM ?? "/usr/bin/chromium";
export const work = mkdtempSync(join(tmpdir(), "rigd-page-"));
const children = [];

/** A daemon on the simulated rig. */
export async function serve(name, change, { protocol = "smoke", listen = "127.0.0.1:0" } = {}) {
  const directory = join(work, name);
  mkdirSync(directory);
  const rig = join(directory, "rig.toml");
  const text = readFileSync(join(config, "rigs/simulated.toml"), "utf8");
  writeFileSync(rig, change(text.replace("../scenes/paper.toml", join(config, "scenes/paper.toml"))));
  const args = ["serve", join(config, `protocols/${protocol}.toml`), "--rig", rig, "--data", join(directory, "data"), "--listen", listen];
  const child = spawn(rigd, args, { stdio: ["ignore", "ignore", "pipe"] });
  children.push(child);
  let said = "";
  const base = await new Promise((resolve, reject) => {
    child.stderr.on("data", (data) => {
      said += data;
      const found = /http:\/\/[\d.]+:\d+/.exec(said);
      if (found) resolve(found[0]);
    });
    child.on("exit", (code) => reject(new Error(`rigd ended with ${code}: ${said}`)));
  });
  return { base, child };
}

export const browser = await chromium.launch({ executablePath, args: ["--no-sandbox"] });
export const complaints = [];

/** A page whose errors, and whose requests to anybody else, fail the test. */
export async function visit(base, { width = 1440, height = 900, colorScheme = "light" } = {}) {
  return tab(await browser.newContext({ viewport: { width, height }, colorScheme, reducedMotion: "reduce" }), base);
}

/** One more page of a browser, as `visit`. */
export async function tab(context, base, isExpecting = () => false) {
  const page = await context.newPage();
  page.isExpecting = isExpecting;
  // While the page is written: its files from a directory, in place of those inside rigd.
  if (process.env.PAGE_DIST) {
    const types = { "index.html": "text/html", "page.js": "text/javascript", "page.css": "text/css", "icon.svg": "image/svg+xml" };
    for (const [file, contentType] of Object.entries(types)) {
      const path = join(process.env.PAGE_DIST, file);
      await page.route(`${base}/${file.replace("index.html", "")}`, (route) => route.fulfill({ path, contentType }));
    }
  }
  page.on("console", (message) => {
    if (["error", "warning"].includes(message.type()) && !page.isExpecting(message.text())) complaints.push(`console: ${message.text()}`);
  });
  page.on("pageerror", (error) => complaints.push(`page error: ${error.message}`));
  page.on("request", (request) => {
    const url = new URL(request.url());
    if (url.origin !== base && url.protocol !== "blob:") complaints.push(`foreign request: ${request.url()}`);
  });
  await page.goto(base);
  await page.evaluate(() => {
    // When each word of the state stood on the screen, and how many readings a sweep had there. What
    // is shown for a moment only is looked up in here: between two looks from outside it can pass.
    window.seen = [];
    window.readings = new Set();
    const note = () => requestAnimationFrame(() => {
      window.seen.push([document.querySelector("h1")?.textContent, Date.now()]);
      const shown = /^Impedance: (\d+) readings/.exec(document.querySelector('[aria-label^="Impedance:"]')?.ariaLabel);
      if (shown) window.readings.add(Number(shown[1]));
    });
    new MutationObserver(note).observe(document.body, { subtree: true, childList: true, characterData: true, attributeFilter: ["aria-label"] });
  });
  return page;
}

export const state = (page, word) => page.getByRole("heading", { level: 1, name: word, exact: true }).waitFor({ timeout: 60_000 });
/** A state that may have passed already: it stood on the screen at or after this moment, ms. */
export const passed = (page, word, since) => page.waitForFunction(([wanted, from]) => window.seen.some(([text, ms]) => text === wanted && ms >= from), [word, since], { timeout: 60_000 });
/** As long as a card must have stood on the screen before an Enter answers it. */
export const stood = (page, word) => page.waitForFunction((wanted) => window.seen.some(([text, ms]) => text === wanted && Date.now() - ms > 1000), word, { timeout: 60_000 });
export const button = (page, name) => page.getByRole("button", { name });

/** No violation of accessibility, in both themes and three sizes, with a picture of each. */
export async function look(page, name) {
  const sizes = { wide: [1440, 900], small: [1280, 720], phone: [390, 844] };
  for (const colorScheme of ["light", "dark"]) {
    await page.emulateMedia({ colorScheme, reducedMotion: "reduce" });
    for (const [size, [width, height]] of Object.entries(sizes)) {
      await page.setViewportSize({ width, height });
      await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
      await page.screenshot({ path: join(shots, `${name}-${size}-${colorScheme}.png`) });
      const overflow = await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);
      assert.ok(overflow <= 0, `${name} is ${overflow} px wider than the ${size} screen`);
      if (size === "small") continue;
      await page.evaluate(axe);
      const { violations } = await page.evaluate(() => window.axe.run(document, { resultTypes: ["violations"] }));
      for (const { id, nodes } of violations) {
        complaints.push(`axe: ${name}, ${size}, ${colorScheme}: ${id}: ${nodes.map((node) => `${node.target} ${node.any[0]?.message ?? ""}`).slice(0, 3).join("; ")}`);
      }
    }
  }
  await page.setViewportSize({ width: sizes.wide[0], height: sizes.wide[1] });
  await page.emulateMedia({ colorScheme: "light", reducedMotion: "reduce" });
}

/** What the page keeps, after its garbage was collected: megabytes of JavaScript, and nodes of the document. */
export async function keeper(page) {
  const session = await page.context().newCDPSession(page);
  await session.send("Performance.enable");
  return async () => {
    // What one collection frees may keep more of it alive until the next.
    for (let n = 0; n < 3; n += 1) await session.send("HeapProfiler.collectGarbage");
    const { metrics } = await session.send("Performance.getMetrics");
    const of = (name) => metrics.find((metric) => metric.name === name).value;
    return { megabytes: of("JSHeapUsedSize") / 1e6, nodes: of("Nodes") };
  };
}

/** Runs a test, leaves a picture of where it failed, and ends its daemons. */
export async function run(test) {
  try {
    await test();
    assert.deepEqual(complaints, []);
  } catch (error) {
    for (const context of browser.contexts()) {
      for (const page of context.pages()) await page.screenshot({ path: join(shots, "failed.png") }).catch(() => undefined);
    }
    console.error(complaints.join("\n"));
    throw error;
  } finally {
    await browser.close();
    // A daemon that stands still would not hear that it is to end.
    const ended = children.map((child) => child.exitCode === null && child.signalCode === null ? new Promise((resolve) => child.once("exit", resolve)) : undefined);
    for (const child of children) for (const signal of ["SIGCONT", "SIGTERM"]) child.kill(signal);
    // A daemon writes to its directory until it has ended.
    await Promise.all(ended);
    rmSync(work, { recursive: true, force: true });
  }
}
