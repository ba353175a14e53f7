// A narrow screen cuts nothing off that a person has to press.
import assert from "node:assert/strict";
import { join } from "node:path";
import { button, serve, shots, state, visit } from "./support.mjs";

/** The longest word of the button of a latched rig, on a telephone. */
export async function acknowledgedOnATelephone() {
  const { base } = await serve("narrow", (text) => text);
  const page = await visit(base, { width: 390, height: 844 });
  await state(page, "Ready");
  await button(page, /^Stop all/).click();
  await state(page, "Latched, nothing moves");
  for (const width of [390, 320]) {
    await page.setViewportSize({ width, height: 844 });
    const acknowledge = button(page, "Acknowledge and prepare");
    await page.screenshot({ path: join(shots, `narrow-${width}.png`) });
    const box = await acknowledge.boundingBox();
    assert.ok(box.x >= 0 && box.x + box.width <= width, `at ${width} px the button ends at ${box.x + box.width} px`);
    const text = await acknowledge.evaluate((element) => element.scrollWidth - element.clientWidth);
    assert.ok(text <= 0, `at ${width} px the words are ${text} px wider than their button`);
  }
  await button(page, "Acknowledge and prepare").click();
  await state(page, "Ready");
  await page.context().close();
}
