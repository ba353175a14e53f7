// Presses that must do nothing: those meant for an earlier card, and those of a key that only pauses.
import assert from "node:assert/strict";
import { button, passed, serve, state, visit } from "./support.mjs";

const rigOf = async (base) => (await fetch(`${base}/api/v1/rig`)).json();

/** The second press of a double click on Done comes when the next prompt has the button at the same place. */
export async function doneTwice() {
  const { base } = await serve("twice", (text) => text.replace('person = "answers"', 'person = "waits"'));
  const page = await visit(base);
  const answers = [];
  page.on("request", (request) => { if (request.url().includes("/answer?")) answers.push(decodeURIComponent(request.url().split("step=")[1])); });
  await state(page, "Ready");
  await button(page, "Start smoke").click();
  await page.getByRole("heading", { name: "Put sample 1 under the probe" }).waitFor();
  await page.evaluate(() => {
    window.pressed = new Promise((done) => {
      new MutationObserver((_, observer) => {
        if (!document.getElementById("prompt-title")?.textContent.startsWith("Turn the sensor")) return;
        observer.disconnect();
        document.querySelector("button.done").dispatchEvent(new MouseEvent("click", { bubbles: true, detail: 2 }));
        done();
      }).observe(document.body, { subtree: true, childList: true, characterData: true });
    });
  });
  await button(page, /^Done$/).click();
  await page.evaluate(() => window.pressed);
  assert.equal(answers.length, 1, `answered: ${answers}`);
  assert.equal((await rigOf(base)).asked.what, "turn_sensor");
  // A press that is meant for it answers it.
  const pressed = Date.now();
  await button(page, /^Done$/).click();
  await passed(page, "Running", pressed);
  assert.equal(answers.length, 2, `answered: ${answers}`);
  await page.context().close();
}

/** A second P does not go on, a lost link sends no P, and what rigd refuses is said. */
export async function onlyPauses() {
  const { base, child } = await serve("pauses", (text) => text.replace('person = "answers"', 'person = "waits"'));
  const page = await visit(base);
  const sent = [];
  page.on("request", (request) => { if (/\/(pause|resume)$/.test(request.url())) sent.push(request.url().split("/").at(-1)); });
  await state(page, "Ready");
  await button(page, "Start smoke").click();
  await page.getByRole("heading", { name: "Put sample 1 under the probe" }).waitFor();
  page.isExpecting = (text) => /409|Failed to load resource|net::ERR/.test(text);
  await page.route("**/pause", (route) => route.fulfill({ status: 409, json: { title: "busy", status: 409, detail: "the rig is busy", hint: "press again" } }));
  await page.keyboard.press("p");
  await page.getByRole("alert").getByText("the rig is busy; press again").waitFor();
  await page.unroute("**/pause");
  child.kill("SIGSTOP");
  await state(page, "Link lost");
  await page.keyboard.press("p");
  assert.deepEqual(sent, ["pause"]);
  child.kill("SIGCONT");
  await page.getByText("live", { exact: true }).waitFor();
  await page.keyboard.press("p");
  await page.waitForFunction(async () => (await (await fetch("/api/v1/rig")).json()).run.is_pausing);
  await button(page, "Go on").waitFor();
  await page.keyboard.press("p");
  assert.ok((await rigOf(base)).run.is_pausing);
  assert.deepEqual(sent, ["pause", "pause"]);
  await page.context().close();
}
