// What could not be read is said to be so: nothing is claimed about it, and it is read again.
import assert from "node:assert/strict";
import { button, serve, state, visit } from "./support.mjs";

const PROBLEM = { status: 503, json: { title: "busy", status: 503, detail: "the journal is busy" } };
const refuse = (page, path) => page.route(path, (route) => route.fulfill(PROBLEM));

export async function saysWhatIsUnread() {
  const { base } = await serve("unread", (text) => text);
  const page = await visit(base);
  page.isExpecting = (text) => text.includes("503");
  await state(page, "Ready");
  await button(page, "Start smoke").waitFor();
  await refuse(page, "**/api/v1/runs");
  await page.keyboard.press("3");
  await page.getByRole("alert").getByText("The runs could not be read: the journal is busy").waitFor();
  assert.equal(await page.getByText("reading…").count(), 0);
  await page.keyboard.press("2");
  await page.getByRole("alert").getByText("The protocols could not be read: the journal is busy").waitFor();
  assert.equal(await page.getByText("None is loaded", { exact: false }).count(), 0);
  await page.unroute("**/api/v1/runs");
  // Nor is the loaded protocol taken for none.
  await button(page, "Start smoke").waitFor();
  await refuse(page, "**/api/v1/protocols/check");
  await page.keyboard.press("3");
  await page.keyboard.press("2");
  await page.getByRole("alert").getByText("The protocols could not be read: the journal is busy").waitFor();
  await page.unroute("**/api/v1/protocols/check");
  await refuse(page, "**/api/v1/runs/*/changes");
  await refuse(page, "**/api/v1/runs/*/protocol");
  await button(page, "Start smoke").click();
  await page.getByText("smoke-1 ended: completed", { exact: false }).waitFor({ timeout: 120_000 });
  await page.getByRole("heading", { name: "Changed since smoke-1, the last complete run" }).waitFor();
  await page.getByRole("alert").getByText("It could not be read: the journal is busy").waitFor();
  assert.equal(await page.getByText(/^Nothing/).count(), 0);
  await page.unroute("**/api/v1/runs/*/changes");
  await page.unroute("**/api/v1/runs/*/protocol");
  await page.getByText("Nothing: protocol, rig file, software and devices are the same.").waitFor();
  assert.equal(await page.getByRole("alert").getByText(/could not/).count(), 0);
  await page.context().close();
}

/** The message of a failure goes with the next success, and what was read before it stays. */
export async function forgetsEarlierErrors() {
  const { base } = await serve("earlier", (text) => text);
  const page = await visit(base);
  page.isExpecting = (text) => text.includes("503");
  await state(page, "Ready");
  await button(page, "Start smoke").click();
  await page.getByText("smoke-1 ended: completed", { exact: false }).waitFor({ timeout: 120_000 });
  await page.keyboard.press("3");
  await page.getByRole("link", { name: "smoke-1" }).click();
  await page.getByRole("heading", { name: /^Planned 18 · measured 18/ }).waitFor();
  // A note that was refused, and is then as it was.
  const note = page.getByLabel(/^Note/);
  await refuse(page, "**/note");
  await note.fill("gel is 3 days old");
  await note.blur();
  const said = page.locator(".note-field").getByText("the journal is busy");
  await said.waitFor();
  await note.fill("");
  await note.blur();
  await said.waitFor({ state: "detached" });
  // The run is read again, and cannot be.
  await refuse(page, `**/api/v1/runs/${new URL(page.url()).hash.split("/").at(-1)}`);
  await button(page, /^sample 5, left 45°: \d/).click();
  await page.getByLabel(/^Why is it measured again/).fill("cracked");
  await button(page, "Leave it out").click();
  await page.getByRole("alert").getByText("the journal is busy").waitFor();
  assert.ok(await page.getByRole("heading", { name: /^Planned 18 · measured 18/ }).isVisible(), "what was read before");
  await page.unroute(`**/api/v1/runs/${new URL(page.url()).hash.split("/").at(-1)}`);
  await page.getByRole("heading", { name: /^Planned 18 · measured 17 .* skipped 1/ }).waitFor();
  assert.equal(await page.getByText("the journal is busy").count(), 0);
  await page.context().close();
}

/** A touch is measured again at a rig that has changed only after a person has said so, and a download that fails says why. */
export async function asksAboutChanges() {
  const { base } = await serve("changes", (text) => text);
  const page = await visit(base);
  page.isExpecting = (text) => /409|503/.test(text);
  await state(page, "Ready");
  await button(page, "Start smoke").click();
  await page.getByText("smoke-1 ended: completed", { exact: false }).waitFor({ timeout: 120_000 });
  await page.keyboard.press("3");
  await page.getByRole("link", { name: "smoke-1" }).click();
  await refuse(page, "**/export?format=csv");
  await button(page, "Touches, CSV").click();
  await page.getByRole("alert").getByText("touches.csv could not be read: the journal is busy").waitFor();
  await page.unroute("**/export?format=csv");
  await button(page, "Touches, CSV").click();
  await page.getByRole("alert").waitFor({ state: "detached" });
  await button(page, /^sample 5, left 45°: \d/).click();
  const asked = [];
  await page.route("**/redo", (route) => {
    asked.push(route.request().postDataJSON());
    const changed = { title: "changed", status: 409, detail: "the rig file has changed" };
    return route.fulfill(asked.length === 1 ? { status: 409, json: changed } : { status: 202, json: { id: "an amendment" } });
  });
  await page.getByLabel(/^Why is it measured again/).fill("cracked");
  const accept = button(page, "Measure again with these changes");
  assert.equal(await accept.count(), 0);
  await button(page, "Measure again").click();
  await page.getByText("the rig file has changed").waitFor();
  await accept.click();
  await page.waitForURL(`${base}/#/`);
  const step = { step: "main/5/left/45/1", why: "cracked" };
  assert.deepEqual(asked, [step, { ...step, accept_changes: true }]);
  await page.context().close();
}
