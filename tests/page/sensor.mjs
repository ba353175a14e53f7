// The free sensor is checked on the page: the card says what was found, and the record that holds. Then a run calibrates the bench.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { button, config, look, serve, visit } from "./support.mjs";

export async function sensorOnThePage() {
  const { base } = await serve("sensor", (text) => text);
  const page = await visit(base);
  await page.getByRole("link", { name: "Rig", exact: true }).first().click();
  const card = page.getByRole("region", { name: "Free sensor" });
  await card.getByText("No record holds:", { exact: false }).waitFor();
  await card.getByLabel("for, min").fill("1");
  await button(page, "Check the sensor").click();
  await card.getByText("The last check: accepted").waitFor({ timeout: 180_000 });
  await card.getByText(/^The record of .* holds\.$/).waitFor();
  await look(page, "sensor");
  await calibrated(page, base);
  await page.context().close();
}

/** A run with descents at two speeds shows the latency, and none of the geometry. */
async function calibrated(page, base) {
  const body = readFileSync(join(config, "protocols/latency.toml"), "utf8");
  const answer = await fetch(`${base}/api/v1/runs`, { method: "POST", headers: { "Content-Type": "application/toml" }, body });
  assert.equal(answer.status, 202, await answer.text());
  await page.getByText("ended: completed", { exact: false }).first().waitFor({ timeout: 180_000 });
  await page.getByRole("link", { name: "Rig", exact: true }).first().click();
  const card = page.getByRole("region", { name: "Calibration by a run" });
  page.isExpecting = (text) => text.includes("422");
  await button(page, "Evaluate").click();
  await card.getByText("different tilts", { exact: false }).waitFor();
  await card.getByLabel("what").selectOption("latency");
  await button(page, "Evaluate").click();
  await card.getByText("Latency, by two speeds: accepted").waitFor();
  await card.getByRole("rowheader", { name: "Latency" }).waitFor();
  await look(page, "calibration");
}
