// A new bench is commissioned on the page: the card asks, and an abort ends the step.
import { readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { button, config, look, serve, visit, work } from "./support.mjs";

export async function commissionedOnThePage() {
  const scene = join(work, "new-bench.toml");
  writeFileSync(scene, readFileSync(join(config, "scenes/new-bench.toml"), "utf8"));
  const { base } = await serve("new-bench", (text) => text.replace(join(config, "scenes/paper.toml"), scene).replace('person = "answers"', 'person = "waits"'));
  const page = await visit(base);
  await page.getByRole("heading", { name: "The rig is not commissioned" }).waitFor();
  const card = page.getByRole("region", { name: "Commissioning" });
  await card.getByText("missing: never made").first().waitFor();
  await look(page, "commission");
  await button(page, "Begin with “stop”").click();
  await card.getByText("Take sample and dish away.", { exact: false }).waitFor();
  await look(page, "commission-question");
  await card.getByRole("button", { name: "yes", exact: true }).click();
  // Each motion is a question too.
  await card.getByText("May it?", { exact: false }).or(card.getByText("Press the emergency stop.", { exact: false })).waitFor();
  await button(page, "Abort this step").click();
  await card.getByText("step stop: aborted").waitFor();
  await page.context().close();
}
