// What is always there: the band, the state, Stop all, the tabs; and the keys that work everywhere.
import { useEffect, useRef, useState } from "preact/hooks";
import type { ComponentChildren } from "preact";
import { clock, fixed } from "./format.ts";
import { Icon, ProbeIcon, type IconName } from "./icons.tsx";
import { depthMm, stateOf, type Model } from "./model.ts";
import { get, keep, operator, post, reasonOf, setToken, stopAll, stored, useAsking, useView, type Asking, type Link, type View } from "./store.ts";

export type Tab = "now" | "protocols" | "runs" | "rig";
export const TABS: { tab: Tab; label: string; icon: IconName }[] = [
  { tab: "now", label: "Now", icon: "now" },
  { tab: "protocols", label: "Protocols", icon: "list" },
  { tab: "runs", label: "Runs", icon: "runs" },
  { tab: "rig", label: "Rig", icon: "rig" },
];

export function Tabs({ tab, place }: { tab: Tab; place: "band" | "bar" }) {
  return (
    <nav class={`tabs ${place}`} aria-label={place === "band" ? "Pages" : "Pages, at the bottom"}>
      {TABS.map((t) => (
        <a key={t.tab} href={`#/${t.tab}`} aria-current={t.tab === tab ? "page" : undefined}>
          {place === "bar" && <Icon name={t.icon} size={22} />}{t.label}
        </a>
      ))}
    </nav>
  );
}

export function Band({ view, tab }: { view: View; tab: Tab }) {
  const { rig } = view.model;
  const kind = rig?.is_simulated ? "simulated" : "real";
  return (
    <header class={`band ${rig ? kind : "unknown"}`}>
      <span class="name">{rig?.name ?? "rigd"}</span>
      {rig && <span class={`kind ${kind}`}>{kind.toUpperCase()}</span>}
      {rig && <span class="kind-note">{rig.is_simulated ? `no bench is moved${rig.is_virtual_time ? "; time runs fast" : ""}` : "this page moves the bench"}</span>}
      <Tabs tab={tab} place="band" />
      <LinkWord view={view} />
      <Clock unixMs={rig?.unix_ms} sinceMs={view.sinceMs} link={view.link} />
    </header>
  );
}

function LinkWord({ view: { link, sinceMs } }: { view: View }) {
  const seconds = sinceMs / 1000;
  const word = { connecting: "connecting", live: "live", late: "late", lost: "no link" }[link];
  const note = link === "live" ? "" : link === "connecting" ? "" : ` ${fixed(seconds, 0)} s`;
  return <span class={`link ${link}`}><span class="dot" aria-hidden="true" />{word}{note}</span>;
}

/** The clock of the rig, in the time zone of the browser. */
function Clock({ unixMs, sinceMs, link }: { unixMs: number | undefined; sinceMs: number; link: Link }) {
  const [, tick] = useState(0);
  useEffect(() => {
    const timer = setInterval(() => tick((n) => n + 1), 500);
    return () => clearInterval(timer);
  }, []);
  if (unixMs === undefined) return null;
  const now = unixMs + (link === "live" ? 0 : sinceMs);
  const minutes = -new Date(now).getTimezoneOffset();
  const sign = minutes < 0 ? "−" : "+";
  const offset = `UTC${sign}${fixed(Math.floor(Math.abs(minutes) / 60), 0)}${minutes % 60 ? `:${Math.abs(minutes % 60)}` : ""}`;
  return <time class="clock" title={offset} dateTime={new Date(now).toISOString()}>{clock(now)}</time>;
}

const STATE_ICON: Record<string, IconName> = { busy: "play", ask: "alert", good: "check", bad: "fault", plain: "alert" };

export function StateRow({ view }: { view: View }) {
  const { model, link, sinceMs, needsToken } = view;
  const isLost = link === "lost";
  // While the stream goes on, the state is known whatever a request was answered.
  const isOut = needsToken && (isLost || !model.rig);
  const state = stateOf(model);
  const lostAt = clock(Date.now() - sinceMs);
  const word = isOut ? "Token needed" : isLost ? (model.rig ? "Link lost" : "No link") : state.word;
  const reason = isOut ? `rigd last answered that it needs a token from this browser.${model.rig ? ` What is grey is as of ${lostAt}.` : ""}`
    : isLost ? `No word from rigd since ${lostAt} (${fixed(sinceMs / 1000, 0)} s). ${model.rig ? "It does not need this page to go on. What is grey is old." : "Is it running?"}`
    : state.reason;
  return (
    <section class={`state ${isLost || isOut ? "lost" : state.tone}`} aria-label="State of the rig">
      <div class="state-word" role="status" aria-live="polite" aria-atomic="true">
        <Icon name={isLost || isOut ? "alert" : model.rig?.state === "paused" || model.rig?.run?.is_pausing ? "pause" : STATE_ICON[state.tone] ?? "alert"} size={38} />
        <div><h1>{word}</h1><p class="reason" title={reason}>{reason}</p></div>
      </div>
      {model.rig && <ProbeCard model={model} isLost={isLost} lostAt={lostAt} />}
      <StopButton view={view} />
    </section>
  );
}

function ProbeCard({ model, isLost, lostAt }: { model: Model; isLost: boolean; lostAt: string }) {
  const rig = model.rig;
  if (!rig) return null;
  const words = { clear: "Clear", "in contact": "In contact", unknown: "Unknown" };
  const depth = depthMm(model);
  const height = rig.linear_mm === undefined ? "height unknown" : `tip at ${fixed(rig.linear_mm, 3)} mm`;
  const note = isLost ? `at ${lostAt}`
    : rig.probe === "unknown" ? `${model.sample ? `perhaps in sample ${model.sample}, ` : ""}${height}`
    : rig.probe === "in contact" && depth !== undefined ? `${fixed(depth, 3)} mm deep${model.sample ? ` in sample ${model.sample}` : ""}`
    : rig.probe === "in contact" ? `or close to it, ${height}` : height;
  return (
    <div class={`probe ${rig.probe.replace(" ", "-")}`} aria-label="Probe" role="group">
      <ProbeIcon probe={isLost ? "unknown" : rig.probe} />
      <div><strong>{isLost ? `Was ${words[rig.probe].toLowerCase()}` : words[rig.probe]}</strong><span>{note}</span></div>
    </div>
  );
}

let isStopAsked = false;

/** Sends a stop; what came of it is for the button to say. */
const stopping = () => {
  isStopAsked = true;
  return stopAll().finally(() => { isStopAsked = false; });
};

function StopButton({ view }: { view: View }) {
  const state = view.model.rig?.state;
  const isLost = view.link === "lost";
  const [asking, go] = useAsking(stopping, state === "latched" || state === "retracting");
  // Kept across renders: the readings of a sweep draw the page again between two presses.
  const last = useRef(-Infinity);
  useEffect(() => {
    const onKey = (event: KeyboardEvent) => {
      if (event.key !== "Escape" || event.repeat) return;
      if (event.timeStamp - last.current < 1000) {
        last.current = -Infinity;
        go();
      } else last.current = event.timeStamp;
    };
    addEventListener("keydown", onKey, { capture: true });
    return () => removeEventListener("keydown", onKey, { capture: true });
  });
  const note = asking.at === "asked" ? (asking.isLate ? "no answer: press again, or use the emergency stop" : "asked…")
    : asking.at === "refused" ? asking.why : isLost ? "may not arrive: use the emergency stop" : undefined;
  return (
    <>
      <button type="button" class={`stop${isLost ? " outlined" : ""}`} onClick={go}>
        <Icon name="stop" size={26} /><span class="stop-word">Stop all</span>{" "}
        {note === undefined ? <kbd>Esc Esc</kbd> : <span class="stop-note">{note}</span>}
      </button>
      <span class="hidden" role="status">{note}</span>
    </>
  );
}

export const isStopping = () => isStopAsked;

/** A stop inside a modal dialog, which makes the large button inert; and what came of it. */
export function DialogStop() {
  const { model } = useView();
  const isStopped = model.rig?.state === "latched" || model.rig?.state === "retracting";
  return <p class="dialog-stop"><AskButton icon="stop" send={stopping} isDone={isStopped}>Stop all</AskButton>{isStopped && <span role="status"> {stateOf(model).word}</span>}</p>;
}

// ---- Buttons that ask -------------------------------------------------------------------------------

interface AskButtonProps {
  children: ComponentChildren;
  send: () => Promise<unknown>;
  /** Whether the daemon reports what was asked for. */
  isDone?: boolean;
  disabled?: boolean;
  why?: string | undefined;
  class?: string;
  icon?: IconName;
}

/** A button that says that it was asked, until the daemon says that it is so. */
export function AskButton({ children, send, isDone, disabled, why, icon, ...rest }: AskButtonProps) {
  const [isSent, setSent] = useState(false);
  const [asking, go] = useAsking(() => { setSent(false); return send().then(() => setSent(true)); }, isDone ?? isSent);
  return (
    <span class="ask-button">
      <button type="button" class={rest.class ?? ""} disabled={disabled} title={disabled ? why : undefined} onClick={go} aria-busy={asking.at === "asked"}>
        {icon && <Icon name={icon} />}{children}
      </button>
      <Said asking={asking} />
    </span>
  );
}

export function Said({ asking }: { asking: Asking }) {
  if (asking.at === "rest") return null;
  if (asking.at === "refused") return <span class="said bad" role="alert">{asking.why}</span>;
  return <span class="said" role="status">{asking.isLate ? "asked; no answer yet, press again to ask again" : "asked…"}</span>;
}

/** Asks once more before something that cannot be taken back. */
export function Confirm({ title, text, yes, send, onClose, isDone }: { title: string; text: string; yes: string; send: () => Promise<unknown>; onClose: () => void; isDone: boolean }) {
  const ref = useRef<HTMLDialogElement>(null);
  useEffect(() => { if (ref.current && !ref.current.open) ref.current.showModal(); }, []);
  useEffect(() => { if (isDone) onClose(); }, [isDone]);
  return (
    <dialog ref={ref} class="card" aria-labelledby="confirm-title" onClose={onClose}>
      <h2 id="confirm-title">{title}</h2>
      <p>{text}</p>
      <div class="buttons">
        <AskButton class="primary" send={send} isDone={isDone}>{yes}</AskButton>
        <button type="button" onClick={onClose}>Go on as before</button>
      </div>
      <DialogStop />
    </dialog>
  );
}

// ---- Keys -------------------------------------------------------------------------------------------

const KEYS: [string, string][] = [
  ["Esc Esc", "Stop all, anywhere"], ["Enter", "Done, when something is asked of you"],
  ["1 2 3 4", "Now, Protocols, Runs, Rig"], ["P", "pause; going on needs the button"], ["?", "this list"],
];

const hasSingleKeys = () => stored("single-keys") !== "off";

/** Whether a key is pressed for the page itself, and not for a field, a dialog or the browser. */
export const isSingleKey = (event: KeyboardEvent) =>
  !(event.target as Element | null)?.closest("input, textarea, select, dialog") && !event.ctrlKey && !event.metaKey && !event.altKey && !event.repeat && hasSingleKeys();

/** The key P pauses a run. It never goes on: a second press by mistake would start motion. */
export function PauseKey({ view }: { view: View }) {
  const { rig } = view.model;
  const isPaused = rig?.state === "paused" || rig?.run?.is_pausing === true;
  const [asking, pause] = useAsking(() => post(`runs/${rig?.run?.id ?? ""}/pause`), isPaused);
  useEffect(() => {
    const onKey = (event: KeyboardEvent) => {
      if (event.key.toLowerCase() === "p" && rig?.run && !isPaused && view.link !== "lost" && isSingleKey(event)) pause();
    };
    addEventListener("keydown", onKey);
    return () => removeEventListener("keydown", onKey);
  });
  return asking.at === "rest" || isPaused ? null : <p class="lease">Pause: <Said asking={asking} /></p>;
}

export function KeysDialog({ onClose }: { onClose: () => void }) {
  const ref = useRef<HTMLDialogElement>(null);
  const [isOn, setOn] = useState(hasSingleKeys());
  useEffect(() => { if (ref.current && !ref.current.open) ref.current.showModal(); }, []);
  return (
    <dialog ref={ref} class="card" aria-labelledby="keys-title" onClose={onClose}>
      <h2 id="keys-title">Keys</h2>
      <dl class="keys">{KEYS.map(([key, what]) => <div key={key}><dt><kbd>{key}</kbd></dt><dd>{what}</dd></div>)}</dl>
      <label class="check"><input type="checkbox" checked={isOn} onChange={(event) => { const on = event.currentTarget.checked; keep("single-keys", on ? "on" : "off"); setOn(on); }} /> single keys (1 2 3 4, P, ?)</label>
      <div class="buttons"><button type="button" onClick={onClose}>Close</button></div>
      <DialogStop />
    </dialog>
  );
}

/** Who operates the rig, where clients have tokens; the others watch, and may take over. */
export function LeaseLine({ name }: { name: string }) {
  const [me, setMe] = useState<string>();
  useEffect(() => { get<{ name: string }>("session").then((client) => setMe(client.name)).catch(() => undefined); }, [name, operator()]);
  if (me === undefined) return null;
  if (me === name) return <p class="lease soft">You operate the rig.</p>;
  const takeOver = () => post("lease", { type: "application/json", text: '{"take_over": true}' });
  return <p class="lease"><strong>{name}</strong> operates the rig; you watch, and can stop it. <AskButton send={takeOver}>Take over</AskButton></p>;
}

export function TokenDialog() {
  const ref = useRef<HTMLDialogElement>(null);
  const [why, setWhy] = useState("");
  useEffect(() => { if (ref.current && !ref.current.open) ref.current.showModal(); }, []);
  return (
    // Escape does not take it away: without a token the page shows nothing. Chromium closes it at the second Escape.
    <dialog ref={ref} class="card" aria-labelledby="token-title" onCancel={(event) => event.preventDefault()} onClose={(event) => event.currentTarget.showModal()}>
      <form onSubmit={(event) => { event.preventDefault(); setToken(String(new FormData(event.currentTarget).get("token") ?? "")).catch((error: unknown) => setWhy(reasonOf(error))); }}>
        <h2 id="token-title">This daemon asks for a token</h2>
        <p><code>rigd open</code> on the computer of the daemon lets a browser in without it; <code>rigd token new</code> makes one. This browser stays in for twelve hours.</p>
        <label>Token<input name="token" type="password" autocomplete="off" required /></label>
        {why && <p class="said bad" role="alert">{why}</p>}
        <div class="buttons"><button class="primary">Use it</button></div>
      </form>
      <DialogStop />
    </dialog>
  );
}
