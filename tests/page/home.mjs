// A linear stage that has lost its position may home downwards: nothing moves until a person has looked.
import assert from "node:assert/strict";
import { button, look, serve, state, visit } from "./support.mjs";

export async function homedAfterALook() {
  // Drives that count steps know no position after they were switched on.
  const { base } = await serve("home", (text) => text.replace('person = "answers"', 'person = "waits"')
    .replaceAll('register_map = "oriental-az"', 'register_map = "leadshine-pr"'));
  const page = await visit(base);
  await state(page, "Latched, nothing moves");
  const rig = async () => (await fetch(`${base}/api/v1/rig`)).json();
  const first = await rig();
  assert.equal(first.fault.kind, "not_homed");
  const home = button(page, "Home the linear stage");
  assert.ok(await home.isDisabled(), "nobody has looked");
  await page.getByRole("alert").getByText(/Home below/).first().waitFor();
  await look(page, "home");
  // An acknowledgement without the statement homes nothing.
  await button(page, /^Acknowledge/).click();
  let again = await rig();
  for (let n = 0; n < 2000 && (again.state !== "latched" || again.state_since_s === first.state_since_s); n += 1) again = await rig();
  assert.deepEqual([again.state, again.fault?.kind, again.probe], ["latched", "not_homed", "unknown"]);
  await state(page, "Latched, nothing moves");
  await page.getByLabel(/I have seen that nothing is below the probe/).check();
  await home.click();
  await state(page, "Ready");
  const after = await rig();
  assert.deepEqual([after.probe, after.linear_mm, after.fault], ["clear", after.limits.linear_mm.rest, undefined]);
  await page.context().close();
}
