// A browser that needs a token is told so, and a dialog does not stand in the way of a stop.
import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { join } from "node:path";
import { button, look, rigd, serve, state, tab, visit, work } from "./support.mjs";

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
  await asksNothing(page);
  // Another tab of this browser logs in.
  const other = await tab(page.context(), base, page.isExpecting);
  await other.getByRole("textbox", { name: "Token" }).fill(token);
  await button(other, "Use it").click();
  for (const one of [page, other]) {
    await one.getByRole("dialog").waitFor({ state: "detached" });
    await state(one, "Latched, nothing moves");
  }
  // The same while the stream goes on: a tab that came by a link says so, and a look from this one finds it out.
  await refused(page, "runs", dialog);
  await other.reload();
  await dialog.waitFor({ state: "detached" });
  await refused(page, "rig", dialog);
  await page.evaluate(() => dispatchEvent(new Event("focus")));
  await dialog.waitFor({ state: "detached" });
  await page.context().close();
}

/** A page that shows the dialog asks for nothing: each answer would be an error on the console. */
async function asksNothing(page) {
  const asked = [];
  const note = (request) => asked.push(request.url());
  page.on("request", note);
  await page.waitForFunction((from) => performance.now() > from + 5000, await page.evaluate(() => performance.now()));
  page.off("request", note);
  assert.deepEqual(asked, []);
}

/** What is read for another screen is answered with 401 once, and the dialog stands. */
async function refused(page, screen, dialog) {
  await page.route("**/api/v1/**", (route) => route.fulfill({ status: 401, json: { title: "token", status: 401, detail: "a token is needed" } }));
  await page.evaluate((hash) => { location.hash = hash; }, `#/${screen}`);
  await dialog.waitFor();
  await state(page, "Latched, nothing moves");
  await asksNothing(page);
  await page.unroute("**/api/v1/**");
}
