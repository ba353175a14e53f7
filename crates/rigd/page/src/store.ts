// The link to the daemon and what the page knows. One stream of events for everything; commands
// are asked for, and change nothing until the daemon says so.
import { useEffect, useState } from "preact/hooks";
import { Share } from "./share.ts";
import { Parser, type Message } from "./sse.ts";
import { empty, withEvent, withLive, withPlan, withRig, type Model } from "./model.ts";
import type { Event, LiveNews, Note, Plan, Problem, Rig, RunDetail } from "./wire.ts";

/** Without a word for so long, the link is late, and then lost, ms. rigd speaks once a second. */
const LATE_MS = 2000;
const LOST_MS = 5000;
/** A command that is not answered in this time is said to be unanswered, ms. */
const ANSWER_MS = 2000;
const RETRY_MS = 1000;
/** What is asked and not answered in this time is given up, ms. The journal of a long run takes seconds. */
const GIVE_UP_MS = 20_000;
/** How many records of this session come at first, ms. */
const BACK = 100;

export type Link = "connecting" | "live" | "late" | "lost";

let model: Model = empty();
let link: Link = "connecting";
/** When the last word came, by the clock of this computer since the page was opened, ms. */
let heard = performance.now();
let lastId: string | undefined;
const listeners = new Set<() => void>();
let isScheduled = false;

/** Draws at the next frame, once for all that came before it. A hidden page draws now and then. */
function changed(): void {
  if (isScheduled) return;
  isScheduled = true;
  const draw = () => {
    isScheduled = false;
    for (const listener of listeners) listener();
  };
  if (document.hidden) setTimeout(draw, 250);
  else requestAnimationFrame(draw);
}

export interface View { model: Model; link: Link; sinceMs: number; needsToken: boolean }

let needsToken = false;
const view = (): View => ({ model, link, sinceMs: performance.now() - heard, needsToken });

export function useView(): View {
  const [now, set] = useState(view);
  useEffect(() => {
    const listener = () => set(view());
    listeners.add(listener);
    listener();
    return () => void listeners.delete(listener);
  }, []);
  return now;
}

// ---- The token and the operator, where there are any ------------------------------------------------

// A browser that blocks the data of sites refuses the storage itself.
export const stored = (key: string) => {
  try { return localStorage.getItem(key) ?? ""; } catch { return ""; }
};
export const keep = (key: string, value: string) => {
  try { localStorage.setItem(key, value); } catch { /* A browser that keeps nothing is asked again. */ }
};

/** What rigd takes as a name. With another one it would refuse every command, also a stop. */
export const isName = (name: string) => /^[\p{Alphabetic}\p{N} .\-_@'\\]{1,64}$/u.test(name) && name.trim() === name;
export const operator = () => {
  const name = stored("operator");
  return isName(name) ? name : "";
};
export const setOperator = (name: string) => { keep("operator", name.trim()); changed(); };
/** The daemon keeps the token's client in a cookie that this page cannot read. */
export async function setToken(token: string): Promise<void> {
  await ask("session", { method: "POST", headers: headers({ Authorization: `Bearer ${token.trim()}` }), signal: limit() });
  enter();
  share.enters();
}

/** This browser has been let in: what waited for that goes on. */
function enter(): void {
  needsToken = false;
  wake();
  changed();
}

let isLooking = false;

/** Asks once whether this browser has been let in, by a link or in another tab. */
async function look(): Promise<void> {
  if (isLooking) return;
  isLooking = true;
  try {
    await ask("session", reading());
    enter();
    share.enters();
  } catch {
    // The dialog stays, or comes.
  } finally {
    isLooking = false;
  }
}

function headers(more: Record<string, string> = {}): Record<string, string> {
  const name = operator();
  return {
    ...more,
    // A header is made of bytes, and those of the name are UTF-8.
    ...(name ? { "X-Operator": String.fromCharCode(...new TextEncoder().encode(name)) } : {}),
  };
}

// ---- The stream -------------------------------------------------------------------------------------

interface Known { model: Model; lastId: string | undefined; link: Link; sinceMs: number; needsToken: boolean }

const share = new Share<Known>({
  hold,
  hear,
  known: () => ({ ...view(), lastId }),
  enter,
  adopt: (known) => {
    ({ model, lastId } = known);
    // The tab that leads may not know yet that this one came by a link.
    if (!known.needsToken) needsToken = false;
    else if (!needsToken) void look();
    heard = performance.now() - known.sinceMs;
    link = known.link;
    watch();
    changed();
  },
});

/** Follows the daemon for as long as the page is open. */
export async function follow(): Promise<void> {
  setInterval(watch, 250);
  addEventListener("focus", () => { if (needsToken) void look(); });
  await share.run();
}

/** Ends the wait for a token. */
let wake = () => {};

/** Listens again and again, while this tab is the one that does; without a token not before the browser has been let in. */
async function hold(signal: AbortSignal): Promise<void> {
  while (!signal.aborted) {
    const status = await listen(signal).catch(() => undefined);
    if (signal.aborted) return;
    await new Promise<void>((resolve) => {
      wake = resolve;
      if (status === 401 && needsToken) signal.addEventListener("abort", () => resolve(), { once: true });
      else setTimeout(resolve, RETRY_MS);
    });
  }
}

let abort: AbortController | undefined;
/** When the last attempt to listen began, as `heard`. */
let tried = performance.now();

/** The status of the answer, when the stream has ended. */
async function listen(signal: AbortSignal): Promise<number> {
  const attempt = new AbortController();
  abort = attempt;
  signal.addEventListener("abort", () => attempt.abort(), { once: true, signal: attempt.signal });
  tried = performance.now();
  const more: Record<string, string> = lastId === undefined ? {} : { "Last-Event-ID": lastId };
  const url = `/api/v1/events?live=true&back=${BACK}`;
  try {
    const response = await fetch(url, { headers: headers(more), signal: attempt.signal, cache: "no-store" });
    if (response.status === 401) { needsToken = true; share.tell(); changed(); }
    if (!response.ok || !response.body) return response.status;
    // Another tab may have logged this browser in.
    needsToken = false;
    // The others go on from where this stream does.
    share.tell();
    const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
    const parser = new Parser();
    for (;;) {
      const { done, value } = await reader.read();
      if (done || signal.aborted) return response.status;
      handOn(parser.push(value));
    }
  } finally {
    attempt.abort();
  }
}

function handOn(messages: Message[]): void {
  hear(messages);
  share.heard(messages);
}

function hear(messages: Message[]): void {
  heard = performance.now();
  link = "live";
  for (const message of messages) take(message);
  changed();
}

function take({ id, event, data }: Message): void {
  if (event === "rig") {
    const before = model;
    model = withRig(model, JSON.parse(data) as Rig);
    if (before.rig && before.rig.session !== model.rig?.session) lastId = undefined;
  } else if (event === "live_sweep") {
    model = withLive(model, JSON.parse(data) as LiveNews);
  } else if (id !== undefined) {
    lastId = id;
    model = withEvent(model, JSON.parse(data) as Event);
  }
  if (model.run && !model.run.plan) void loadRun(model.run.id);
}

const loading = new Set<string>();

/** Until this tab is looked at, or has the stream: a stop must not wait behind what hidden tabs read. */
async function needed(): Promise<void> {
  while (document.hidden && share.isFollowing) await new Promise((resolve) => setTimeout(resolve, RETRY_MS));
}

/** The plan of a run, and what the page missed of it. */
async function loadRun(id: string): Promise<void> {
  if (loading.has(id)) return;
  loading.add(id);
  try {
    await needed();
    const [plan, detail] = await Promise.all([get<Plan>(`runs/${id}/plan`), get<RunDetail>(`runs/${id}`)]);
    model = withPlan(model, id, plan, detail);
    changed();
  } catch {
    // It is asked for again with the next event, though not at once.
    setTimeout(() => loading.delete(id), RETRY_MS);
    return;
  }
  loading.delete(id);
}

function watch(): void {
  share.tick();
  const now = performance.now();
  const since = now - heard;
  const next = since > LOST_MS ? "lost" : since > LATE_MS ? (link === "connecting" ? link : "late") : link;
  // Also an attempt to connect again may get no answer for ever.
  if (now - Math.max(heard, tried) > LOST_MS) abort?.abort();
  if (next !== link || next !== "live") {
    link = next;
    changed();
  }
}

// ---- Requests ---------------------------------------------------------------------------------------

/** What the daemon says when it does not do something. */
export class Refused extends Error {
  constructor(readonly problem: Problem) {
    super(problem.detail);
  }
}

async function ask(path: string, init: RequestInit): Promise<Response> {
  const response = await fetch(`/api/v1/${path}`, { ...init, cache: "no-store" });
  if (response.ok) return response;
  if (response.status === 401) { needsToken = true; changed(); }
  const problem = await response.json().catch(() => ({
    title: response.statusText, status: response.status, detail: `rigd answered ${response.status}`,
  })) as Problem;
  throw new Refused(problem);
}

const limit = () => AbortSignal.timeout(GIVE_UP_MS);
const reading = () => ({ headers: headers(), signal: limit() });

/** Nothing is read while the dialog asks for a token: rigd would answer the same. */
async function read(path: string): Promise<Response> {
  if (needsToken) throw new Refused({ title: "unauthorized", status: 401, detail: "this daemon asks for a token" });
  return ask(path, reading());
}

export const get = async <T>(path: string): Promise<T> => (await read(path)).json() as Promise<T>;

export const text = async (path: string): Promise<string> => (await read(path)).text();

/** What the daemon has, asked for again and again while it is shown: one request at a time, and none in a hidden tab. */
export function usePoll<T>(path: string, every_ms: number): [T | undefined, (found: T | undefined) => void] {
  const [found, set] = useState<T>();
  useEffect(() => {
    let isPending = false;
    const ask = () => {
      if (isPending || document.hidden) return;
      isPending = true;
      get<T>(path).then(set, () => undefined).finally(() => { isPending = false; });
    };
    ask();
    const timer = setInterval(ask, every_ms);
    return () => clearInterval(timer);
  }, [path, every_ms]);
  return [found, set];
}

/** After this time what did not come is asked for again, ms. */
const AGAIN_MS = 2000;

/** Whether a later try may give what this one did not: there was no answer, no token, or a fault of the daemon. */
const mayComeLater = (error: unknown) => !(error instanceof Refused) || error.problem.status === 401 || error.problem.status >= 500;

/** What is read when something in `of` changes, and why the last try has not given it. What an earlier one gave stays. */
export function useRead<T>(read: () => Promise<T>, of: unknown[]): [T | undefined, string | undefined] {
  const [found, set] = useState<T>();
  const [why, setWhy] = useState<string>();
  useEffect(() => {
    let isOver = false;
    let timer = 0;
    const later = () => { timer = window.setTimeout(() => (document.hidden ? later() : ask()), AGAIN_MS); };
    const ask = () => void read().then(
      (now) => { if (!isOver) { set(() => now); setWhy(undefined); } },
      (error: unknown) => {
        if (isOver) return;
        setWhy(reasonOf(error));
        if (mayComeLater(error)) later();
      },
    );
    ask();
    return () => { isOver = true; clearTimeout(timer); };
  }, of);
  return [found, why];
}

/** A link to what the daemon has, opened as a file. */
export async function open(path: string, name: string): Promise<void> {
  const blob = await (await ask(path, { headers: headers() })).blob();
  const url = URL.createObjectURL(blob);
  const link = document.createElement("a");
  link.href = url;
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(url), 60_000);
}

export interface Body { type: "application/json" | "application/toml"; text: string }

export const noted = (id: string, note: Note) =>
  ask(`runs/${id}/note`, { method: "PUT", headers: headers({ "Content-Type": "application/json" }), body: JSON.stringify(note), signal: limit() });

export async function post<T = unknown>(path: string, body?: Body, key?: string): Promise<T | undefined> {
  const more: Record<string, string> = {
    ...(body ? { "Content-Type": body.type } : {}),
    ...(key ? { "Idempotency-Key": key } : {}),
  };
  const init: RequestInit = { method: "POST", headers: headers(more), signal: limit() };
  if (body) init.body = body.text;
  const answer = await (await ask(path, init)).text();
  return answer ? (JSON.parse(answer) as T) : undefined;
}

/** Takes something away, and gives what is left. */
export async function remove<T>(path: string): Promise<T> {
  return (await ask(path, { method: "DELETE", headers: headers(), signal: limit() })).json() as Promise<T>;
}

/** Stops everything. Sent whatever the link is thought to be, and never given up: it may still arrive. */
export const stopAll = () => ask("stop", { method: "POST", headers: headers() });

/** Whether rigd refuses because something at the rig has changed since the run. */
export const isChange = (error: unknown) => error instanceof Refused && error.problem.title === "changed";

// ---- A control that asks ----------------------------------------------------------------------------

export type Asking =
  | { at: "rest" }
  | { at: "asked"; isLate: boolean }
  | { at: "refused"; why: string };

/**
 * A command as a person sees it: asked, then either what the daemon reports, or why not. `isDone`
 * says whether the daemon has reported it; until then the control says that it was asked.
 */
export function useAsking(send: () => Promise<unknown>, isDone: boolean): [Asking, () => void] {
  const [asking, set] = useState<Asking>({ at: "rest" });
  useEffect(() => {
    if (isDone && asking.at === "asked") set({ at: "rest" });
  }, [isDone, asking.at]);
  useEffect(() => {
    if (asking.at !== "asked" || asking.isLate) return;
    const timer = setTimeout(() => set({ at: "asked", isLate: true }), ANSWER_MS);
    return () => clearTimeout(timer);
  }, [asking]);
  const go = () => {
    if (asking.at === "asked" && !asking.isLate) return;
    set({ at: "asked", isLate: false });
    // What throws before it is asked is an answer too.
    Promise.resolve().then(send).then(
      () => { if (isDone) set({ at: "rest" }); },
      (error: unknown) => set({ at: "refused", why: reasonOf(error) }),
    );
  };
  return [asking, go];
}

export function reasonOf(error: unknown): string {
  if (!(error instanceof Refused)) return "No answer from rigd.";
  const { detail, hint } = error.problem;
  return hint ? `${detail}; ${hint}` : detail;
}
