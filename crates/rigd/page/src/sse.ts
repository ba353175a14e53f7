// Server-sent events, read from a response: so that a request can carry headers, and so that the
// page knows when the last byte came.

export interface Message { id: string | undefined; event: string; data: string }

/** Cuts a stream of text into messages, wherever its pieces are cut. */
export class Parser {
  #rest = "";
  #id: string | undefined;
  #event = "message";
  #data: string[] = [];

  push(text: string): Message[] {
    const messages: Message[] = [];
    const lines = (this.#rest + text).split("\n");
    this.#rest = lines.pop() ?? "";
    for (const raw of lines) {
      const line = raw.endsWith("\r") ? raw.slice(0, -1) : raw;
      if (line === "") {
        if (this.#data.length > 0) {
          messages.push({ id: this.#id, event: this.#event, data: this.#data.join("\n") });
        }
        this.#event = "message";
        this.#data = [];
        this.#id = undefined;
        continue;
      }
      const colon = line.indexOf(":");
      const field = colon < 0 ? line : line.slice(0, colon);
      const value = colon < 0 ? "" : line.slice(colon + 1).replace(/^ /, "");
      if (field === "data") this.#data.push(value);
      else if (field === "event") this.#event = value;
      else if (field === "id") this.#id = value;
    }
    return messages;
  }
}
