// Eight tabs of one browser share one stream of events: a stop leaves from each, and no tab is left without the stream.
import assert from "node:assert/strict";
import { button, browser, serve, state, tab } from "./support.mjs";

const TABS = 8;

/** The streams that a tab has open. */
function streamsOf(page) {
  const open = new Set();
  const isStream = (request) => request.url().includes("/api/v1/events");
  page.on("request", (request) => { if (isStream(request)) open.add(request); });
  for (const end of ["requestfinished", "requestfailed"]) page.on(end, (request) => open.delete(request));
  page.on("close", () => open.clear());
  return open;
}

async function opened(base, count, before = () => undefined) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 720 }, reducedMotion: "reduce" });
  await context.addInitScript(before);
  const tabs = [];
  context.on("page", (page) => tabs.push({ page, streams: streamsOf(page) }));
  for (let n = 0; n < count; n += 1) await tab(context, base);
  return { context, tabs };
}

const all = (tabs, word) => Promise.all(tabs.map(({ page }) => state(page, word)));
const streams = (tabs) => tabs.map((one) => one.streams.size);
const sum = (numbers) => numbers.reduce((total, number) => total + number, 0);

export async function stoppedWithEightTabs() {
  const { base, child } = await serve("tabs", (text) => text.replace('person = "answers"', 'person = "waits"'));
  const { context, tabs } = await opened(base, TABS);
  await all(tabs, "Ready");
  assert.equal(sum(streams(tabs)), 1, `streams: ${streams(tabs)}`);
  await button(tabs[TABS - 1].page, /^Stop all/).click();
  await all(tabs, "Latched, nothing moves");
  await button(tabs[2].page, /^Acknowledge/).click();
  await all(tabs, "Ready");
  // The journal's records reach a tab that only follows, each once, also those from before it was opened.
  await tabs[TABS - 1].page.keyboard.press("4");
  const events = tabs[TABS - 1].page.getByRole("region", { name: "What happened" });
  await events.getByText("stop, asked by", { exact: false }).waitFor();
  assert.equal(await events.getByText("stop, asked by", { exact: false }).count(), 1);
  // The tab with the stream is closed: another one takes it over.
  const [holder] = tabs.splice(tabs.findIndex((one) => one.streams.size > 0), 1);
  await holder.page.close();
  await button(tabs[0].page, /^Stop all/).click();
  await all(tabs, "Latched, nothing moves");
  assert.equal(sum(streams(tabs)), 1, `streams: ${streams(tabs)}`);
  // The browser is about to freeze the tab with the stream. A browser without windows freezes none: the tab is told so.
  const [frozen] = tabs.splice(tabs.findIndex((one) => one.streams.size > 0), 1);
  const told = (what) => frozen.page.evaluate((name) => void document.dispatchEvent(new Event(name)), what);
  await told("freeze");
  await button(tabs[0].page, /^Acknowledge/).click();
  await all(tabs, "Ready");
  assert.equal(sum(streams(tabs)), 1, `streams: ${streams(tabs)}`);
  await told("resume");
  tabs.push(frozen);
  await all(tabs, "Ready");
  assert.equal(sum(streams(tabs)), 1, `streams: ${streams(tabs)}`);
  await saysWhenNothingComes(tabs, child);
  await context.close();
}

/** A daemon that stands still is silent in each tab. */
async function saysWhenNothingComes(tabs, child) {
  for (const { page } of tabs) page.isExpecting = (text) => /Failed to load resource|net::ERR/.test(text);
  child.kill("SIGSTOP");
  await all(tabs, "Link lost");
  await button(tabs[0].page, /Stop all\s+may not arrive/).waitFor();
  child.kill("SIGCONT");
  await all(tabs, "Ready");
  assert.equal(sum(streams(tabs)), 1, `streams: ${streams(tabs)}`);
}

/** A tab that gives no sign, though the browser lets it keep the stream, loses it to one that is seen. */
export async function takenFromASilentTab() {
  const { base } = await serve("silent-tab", (text) => text);
  const { context, tabs } = await opened(base, 2);
  await all(tabs, "Ready");
  const holder = tabs.find((one) => one.streams.size > 0);
  const other = tabs.find((one) => one !== holder);
  // Its script stands still, as behind a dialog of the browser.
  const still = holder.page.evaluate(() => alert("still"));
  const dialog = await holder.page.waitForEvent("dialog");
  await button(other.page, /^Stop all/).click();
  await state(other.page, "Latched, nothing moves");
  assert.equal(other.streams.size, 1);
  await dialog.dismiss();
  await still;
  await state(holder.page, "Latched, nothing moves");
  await holder.page.waitForFunction(() => document.querySelector(".link.live"));
  assert.equal(sum(streams(tabs)), 1, `streams: ${streams(tabs)}`);
  await context.close();
}

/** In a browser without locks each tab has a stream of its own. */
export async function ownStreams() {
  const { base } = await serve("own-streams", (text) => text);
  const { context, tabs } = await opened(base, 2, () => { delete Navigator.prototype.locks; });
  await all(tabs, "Ready");
  assert.deepEqual(streams(tabs), [1, 1]);
  await button(tabs[1].page, /^Stop all/).click();
  await all(tabs, "Latched, nothing moves");
  await context.close();
}
