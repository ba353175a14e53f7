// One stream for all tabs of a browser. It opens six connections to a daemon over HTTP/1.1, and each
// stream keeps one: with a stream in every tab the sixth would leave none for a stop.
//
//   follows ── the lock is free, or its holder gives a seen tab no sign ──► leads
//   leads ── another tab takes the lock, or the browser freezes this one ──► follows
//
// The tab that leads hands on what it hears. What a message means is for the store.
import type { Message } from "./sse.ts";

/** The build of the page: tabs with another one may mean something else by their words. */
declare const BUILD: string;

/** Without a sign of the tab that leads in so many of its own ticks, a tab that is seen takes the stream: 2 s, but not while the computer stood still. */
const SIGN_TICKS = 8;

/** What a tab does with the stream, where `Known` is what it has learned so far. */
export interface Tab<Known> {
  /** Keeps the stream open until the signal is aborted. */
  hold(signal: AbortSignal): Promise<void>;
  hear(messages: Message[]): void;
  /** Another tab says that the browser was let in. */
  enter(): void;
  known(): Known;
  adopt(known: Known): void;
}

/** Each word carries who says it. `leads` comes only from a tab that is seen: a browser slows the others down. */
type Word<Known> = { from: string } & (
  | { kind: "joins" }
  | { kind: "leads" }
  | { kind: "enters" }
  | { kind: "heard"; messages: Message[] }
  | { kind: "known"; known: Known }
);

export class Share<Known> {
  readonly #tab: Tab<Known>;
  readonly #name = `rigd stream ${BUILD}`;
  readonly #id = String(Math.random());
  #channel = "locks" in navigator && "BroadcastChannel" in globalThis ? new BroadcastChannel(this.#name) : undefined;
  #isLeading = false;
  /** No other tab has said anything yet. */
  #isAlone = true;
  /** The tab whose `known` was taken; what others have heard does not fit to it. */
  #leader: string | undefined;
  #ticks = 0;
  #isTaking = false;
  #turn = new AbortController();
  #awake: Promise<unknown> = Promise.resolve();

  constructor(tab: Tab<Known>) {
    this.#tab = tab;
    if (!this.#channel) return;
    this.#channel.onmessage = ({ data }: MessageEvent<Word<Known>>) => this.#take(data);
    document.addEventListener("freeze", () => {
      this.#awake = new Promise((resolve) => document.addEventListener("resume", resolve, { once: true }));
      this.#turn.abort();
    });
  }

  /** Whether another tab has the stream. */
  get isFollowing(): boolean {
    return this.#channel !== undefined && !this.#isLeading;
  }

  /** Leads and follows for as long as the page is open. */
  async run(): Promise<void> {
    if (!this.#channel) return this.#keepOwn();
    this.#say({ kind: "joins" });
    for (;;) {
      await this.#awake;
      const turn = new AbortController();
      this.#turn = turn;
      let isGranted = false;
      const lead = () => { isGranted = true; return this.#lead(turn.signal); };
      const options: LockOptions = this.#isTaking ? { steal: true } : { signal: turn.signal };
      this.#isTaking = false;
      await navigator.locks.request(this.#name, options, lead).catch(() => undefined);
      this.#isLeading = false;
      // A browser that grants no locks: this tab keeps a stream of its own.
      if (!isGranted && !turn.signal.aborted) return this.#keepOwn();
      turn.abort();
    }
  }

  /** Gives a sign, or looks for one. Called several times a second. */
  tick(): void {
    if (!this.#channel) return;
    if (this.#isLeading) {
      if (!document.hidden) this.#say({ kind: "leads" });
      return;
    }
    if (this.#leader === undefined) this.#say({ kind: "joins" });
    if (document.hidden) return;
    this.#ticks += 1;
    if (this.#ticks < SIGN_TICKS) return;
    this.#ticks = 0;
    this.#isTaking = true;
    this.#turn.abort();
  }

  heard(messages: Message[]): void {
    this.#say({ kind: "heard", messages });
  }

  /** Tells the other tabs that the browser was let in. */
  enters(): void {
    this.#say({ kind: "enters" });
  }

  /** Tells the other tabs all that this one knows. */
  tell(): void {
    this.#say({ kind: "known", known: this.#tab.known() });
  }

  #keepOwn(): Promise<void> {
    this.#channel?.close();
    this.#channel = undefined;
    return this.#tab.hold(new AbortController().signal);
  }

  async #lead(signal: AbortSignal): Promise<void> {
    // The lock came too late.
    if (signal.aborted) return;
    this.#isLeading = true;
    this.#leader = undefined;
    const ended = new Promise((resolve) => signal.addEventListener("abort", resolve));
    void this.#tab.hold(signal);
    await ended;
  }

  #take(word: Word<Known>): void {
    this.#isAlone = false;
    if (word.kind === "enters") return this.#tab.enter();
    if (this.#isLeading) {
      if (word.kind === "joins") this.tell();
      return;
    }
    if (word.kind === "joins") return;
    this.#ticks = 0;
    if (word.kind === "known") {
      this.#leader = word.from;
      this.#tab.adopt(word.known);
    } else if (word.from !== this.#leader) {
      this.#say({ kind: "joins" });
    } else if (word.kind === "heard") {
      this.#tab.hear(word.messages);
    }
  }

  #say(word: { [K in Word<Known>["kind"]]: Omit<Extract<Word<Known>, { kind: K }>, "from"> }[Word<Known>["kind"]]): void {
    // Words that nobody hears take memory until the browser has dropped them.
    if (this.#isAlone && word.kind !== "joins") return;
    this.#channel?.postMessage({ ...word, from: this.#id });
  }
}
