// A browser that needs a token is told so, and a dialog does not stand in the way of a stop.
import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { join } from "node:path";
import { button, look, rigd, serve, state, visit, work } from "./support.mjs";

export async function needsToken() {
  const { base } = await serve("token", (text) => text.replace('person = "answers"', 'person = "waits"'));
  const page = await visit(base);
  await state(page, "Ready");
  // The list of keys leaves a stop within reach.
  await page.keyboard.press("?");
  await page.getByRole("dialog").getByRole("button", { name: "Stop all" }).click();
  await page.getByRole("dialog").getByRole("status").getByText("Latched, nothing moves").waitFor();
  await look(page, "stopped-in-dialog");
  const made = spawnSync(rigd, ["token", "new", "ada", "--data", join(work, "token", "data")], { encoding: "utf8" });
  const token = /^\s*(\S{30,})\s*$/m.exec(made.stdout)?.[1] ?? assert.fail(`${made.stdout}${made.stderr}`);
  page.isExpecting = (text) => text.includes("401");
  await page.reload();
  const dialog = page.getByRole("dialog", { name: "This daemon asks for a token" });
  await dialog.waitFor();
  await state(page, "Token needed");
  for (let n = 0; n < 3; n += 1) {
    await page.keyboard.press("Escape");
    await dialog.waitFor();
    // Two of them in one second are a stop.
    await page.waitForFunction((from) => performance.now() > from + 1000, await page.evaluate(() => performance.now()));
  }
  assert.ok(await dialog.isVisible());
  assert.equal(await page.getByText("Is it running?", { exact: false }).count(), 0);
  await look(page, "token");
  // Another tab of this browser logs in.
  const status = await page.evaluate(async (secret) => (await fetch("/api/v1/session", { method: "POST", headers: { Authorization: `Bearer ${secret}` } })).status, token);
  assert.ok(status < 300, `status ${status}`);
  await dialog.waitFor({ state: "detached" });
  await state(page, "Latched, nothing moves");
  // The same while the stream goes on.
  await page.route("**/api/v1/**", (route) => route.fulfill({ status: 401, json: { title: "token", status: 401, detail: "a token is needed" } }));
  await page.evaluate(() => { location.hash = "#/runs"; });
  await dialog.waitFor();
  await state(page, "Latched, nothing moves");
  await page.unroute("**/api/v1/**");
  await dialog.waitFor({ state: "detached" });
  await page.context().close();
}
