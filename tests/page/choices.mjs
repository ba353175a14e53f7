// What is started is what is shown.
import assert from "node:assert/strict";
import { once } from "node:events";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { button, config, serve, state, visit } from "./support.mjs";

/** After the daemon was started again with another protocol, that one is shown; what is sent is always the text that was checked. */
export async function startedAgain() {
  const { base, child } = await serve("before", (text) => text);
  const page = await visit(base);
  await state(page, "Ready");
  await button(page, "Start smoke").waitFor();
  page.isExpecting = (text) => /Failed to load resource|net::ERR/.test(text);
  child.kill("SIGTERM");
  await once(child, "exit");
  await serve("after", (text) => text, { protocol: "latency", listen: new URL(base).host });
  await button(page, "Start latency").waitFor();
  const [begun] = await Promise.all([page.waitForRequest((request) => request.method() === "POST" && request.url().endsWith("/runs")), button(page, "Start latency").click()]);
  assert.equal(begun.postData(), readFileSync(join(config, "protocols/latency.toml"), "utf8"));
  await page.context().close();
}

/** An older run is offered again with its own protocol, though a later run of the same name had another. */
export async function againAsRun() {
  const { base } = await serve("again", (text) => text);
  const page = await visit(base);
  await state(page, "Ready");
  const smoke = readFileSync(join(config, "protocols/smoke.toml"), "utf8");
  const older = smoke.replace("indentation_mm = 0.5", "indentation_mm = 0.4").replace('samples = ["1", "5"]', 'samples = ["5"]').split("[blind]")[0];
  for (const [number, body] of [older, smoke].entries()) {
    const answer = await fetch(`${base}/api/v1/runs`, { method: "POST", headers: { "Content-Type": "application/toml" }, body });
    assert.equal(answer.status, 202, await answer.text());
    await page.getByText(`smoke-${number + 1} ended: completed`, { exact: false }).waitFor({ timeout: 120_000 });
  }
  await page.keyboard.press("3");
  await starred(page, base);
  await page.getByRole("link", { name: "smoke-1" }).click();
  await page.route("**/runs/*/protocol", (route) => route.fulfill({ status: 404, json: { title: "not found", status: 404, detail: "the archive is not here" } }));
  page.isExpecting = (text) => text.includes("404");
  await page.getByRole("link", { name: "Run again…" }).click();
  await page.getByRole("alert").getByText("The protocol of this run cannot be offered: the archive is not here").waitFor();
  assert.equal(await button(page, /^Start/).count(), 0);
  await page.unroute("**/runs/*/protocol");
  await page.goBack();
  await page.getByRole("link", { name: "Run again…" }).click();
  await page.locator('button[aria-pressed="true"]', { hasText: "as run in smoke-1" }).waitFor();
  const [begun] = await Promise.all([page.waitForRequest((request) => request.method() === "POST" && request.url().endsWith("/runs")), button(page, "Start smoke").click()]);
  assert.equal(begun.postData(), older);
  await page.context().close();
}

/** A star leaves the note that another person has written since the page was opened, and a refused one says why. */
async function starred(page, base) {
  const star = button(page, "Star smoke-1");
  await star.waitFor();
  const [{ id }] = (await (await fetch(`${base}/api/v1/runs`)).json()).filter((run) => run.name === "smoke-1");
  const body = JSON.stringify({ note: "gel is 3 days old", is_starred: false });
  const answer = await fetch(`${base}/api/v1/runs/${id}/note`, { method: "PUT", headers: { "Content-Type": "application/json" }, body });
  assert.ok(answer.ok, await answer.text());
  await star.click();
  await page.locator('button[aria-label="Star smoke-1"][aria-pressed="true"]').waitFor();
  assert.deepEqual((await (await fetch(`${base}/api/v1/notes`)).json())[id].note, "gel is 3 days old");
  page.isExpecting = (text) => text.includes("503");
  await page.route("**/note", (route) => route.fulfill({ status: 503, json: { title: "full", status: 503, detail: "the disk is full" } }));
  await star.click();
  await page.getByRole("alert").getByText("the disk is full").waitFor();
  assert.equal(await star.getAttribute("aria-pressed"), "true");
  await page.unroute("**/note");
}
