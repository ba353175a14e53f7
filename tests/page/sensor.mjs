// The free sensor is checked on the page: the card says what was found, and the record that holds.
import { button, look, serve, visit } from "./support.mjs";

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
  await page.context().close();
}
