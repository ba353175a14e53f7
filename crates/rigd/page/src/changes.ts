// What differs between two protocols.

export interface Change { key: string; before: string | undefined; now: string | undefined }

/** The keys whose values differ between two protocols, by their sections. */
export function differences(before: string, now: string): Change[] {
  const [a, b] = [valuesOf(before), valuesOf(now)];
  const keys = [...new Set([...a.keys(), ...b.keys()])];
  return keys.filter((key) => a.get(key) !== b.get(key)).map((key) => ({ key, before: a.get(key), now: b.get(key) }));
}

function valuesOf(toml: string): Map<string, string> {
  const values = new Map<string, string>();
  let section = "";
  for (const raw of toml.split("\n")) {
    const line = raw.replace(/^\s+/, "");
    const header = /^\[+([^\]]+)\]+/.exec(line);
    if (header) section = `${header[1]?.trim() ?? ""}.`;
    const pair = /^([\w.-]+)\s*=\s*((?:"[^"]*"|[^#])*)/.exec(line);
    if (pair) values.set(section + (pair[1] ?? ""), (pair[2] ?? "").trim());
  }
  return values;
}
