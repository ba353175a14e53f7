// Numbers and times as people read them.

const MINUS = "−";

export function fixed(value: number, decimals: number): string {
  const text = Math.abs(value).toFixed(decimals);
  return value < 0 && Number(text) !== 0 ? MINUS + text : text;
}

/** A number that somebody has written, such as a limit: with its own digits, up to six. */
export function asWritten(value: number): string {
  const text = String(Math.abs(Number(value.toPrecision(6))));
  return value < 0 && text !== "0" ? MINUS + text : text;
}


/** Decimals with which all of these values can be told apart. */
export function decimalsOfAll(values: number[]): number {
  return Math.max(0, ...values.map((value) => (String(Number(value.toPrecision(9))).split(".")[1] ?? "").length));
}

/** Decimals that show an uncertainty with one digit, or two when the first is 1. */
export function decimalsOf(sigma: number): number {
  if (!(sigma > 0)) return 2;
  const exponent = Math.floor(Math.log10(sigma));
  const leading = sigma / 10 ** exponent;
  return Math.min(6, Math.max(0, (leading < 1.95 ? 1 : 0) - exponent));
}

/** A value and its uncertainty, with digits cut to it. */
export function measured(value: number, sigma: number): { value: string; sigma: string } {
  const decimals = decimalsOf(sigma);
  return { value: fixed(value, decimals), sigma: fixed(sigma, decimals) };
}

/** `6 s`, `50 s`, `13 min`, `1 h 52`. */
export function duration(seconds: number): string {
  const s = Math.max(0, seconds);
  if (s < 90) return `${Math.round(s)} s`;
  const minutes = Math.round(s / 60);
  if (minutes < 90) return `${minutes} min`;
  return `${Math.floor(minutes / 60)} h ${String(minutes % 60).padStart(2, "0")}`;
}

/** `32 to 49 min`; one value where both ends read the same. */
export function range([least, most]: [number, number]): string {
  const [from, to] = [duration(least), duration(most)];
  if (from === to) return `about ${to}`;
  const unit = (text: string) => text.replace(/^[\d ]+/, "");
  const isPlain = !from.includes("h") && unit(from) === unit(to);
  return isPlain ? `${from.replace(/ .*/, "")} to ${to}` : `${from} to ${to}`;
}

export function clock(unixMs: number, withSeconds = true): string {
  const date = new Date(unixMs);
  const two = (n: number) => String(n).padStart(2, "0");
  const minutes = `${two(date.getHours())}:${two(date.getMinutes())}`;
  return withSeconds ? `${minutes}:${two(date.getSeconds())}` : minutes;
}

export function day(text: string): string {
  const date = new Date(text);
  if (Number.isNaN(date.getTime())) return text;
  const names = date.toLocaleDateString("en-GB", { weekday: "short", day: "numeric", month: "short" });
  return `${names.replace(",", "")} ${clock(date.getTime(), false)}`;
}

/** Blind angles are random and have many digits. */
export function degrees(angle: number): string {
  return `${fixed(angle, Number.isInteger(angle) ? 0 : 1)}°`;
}

/** How a run ended, in a word for people. */
export function ending(status: string): string {
  return status === "completed_with_refusals" ? "completed, some refused" : status.replaceAll("_", " ");
}

/** Young's modulus, in kPa where MPa would begin with a zero after the point. */
export function stiffness(mpa: number, sigma: number): { value: string; sigma: string; unit: string } {
  return mpa < 0.1
    ? { ...measured(mpa * 1000, sigma * 1000), unit: "kPa" }
    : { ...measured(mpa, sigma), unit: "MPa" };
}
