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
