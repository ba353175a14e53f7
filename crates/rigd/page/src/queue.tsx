// The queue: what waits for the rig, in order, and what each entry asks of a person.
import { day, duration } from "./format.ts";
import { AskButton } from "./shell.tsx";
import { post, remove, usePoll, type View } from "./store.ts";
import type { Queue, QueueEntry } from "./wire.ts";

/** How often the queue is asked for while it is shown, ms. Other people change it too. */
const ASK_MS = 2000;

export function QueuePanel({ view }: { view: View }) {
  const [queue, set] = usePoll<Queue>("queue", ASK_MS);
  if (!queue) return null;
  const change = (path: string, body?: object) => () =>
    post<Queue>(`queue${path}`, body && { type: "application/json", text: JSON.stringify(body) }).then(set);
  const isLost = view.link === "lost";
  return (
    <section class="queue" aria-label="Queue">
      <h2>Queue</h2>
      <p class={queue.hold ? "soft" : "good-word"} role="status">{queue.hold ? `Held: ${queue.hold.reason}.` : "Released: entries begin one after the other."}</p>
      {queue.missed > 0 && <p class="bad-word" role="alert">{queue.missed === 1 ? "One entry has missed its deadline" : `${queue.missed} entries have missed their deadlines`}. </p>}
      {queue.late.length > 0 && <ul class="bad-word">{queue.late.map((late) => <li key={late.run}>{late.protocol} ended {duration((late.ended_unix_ms - late.deadline_unix_ms) / 1000)} after its deadline, {day(new Date(late.deadline_unix_ms).toISOString())}</li>)}</ul>}
      <ol>
        {queue.entries.map((entry, index) => (
          <li key={entry.number}>
            <Entry entry={entry} />
            <div class="row">
              {index > 0 && <AskButton send={change(`/${entry.number}/move`, { place: index })} disabled={isLost}>Earlier</AskButton>}
              {index + 1 < queue.entries.length && <AskButton send={change(`/${entry.number}/move`, { place: index + 2 })} disabled={isLost}>Later</AskButton>}
              <AskButton send={() => remove<Queue>(`queue/${entry.number}`).then(set)} disabled={isLost}>Cancel</AskButton>
            </div>
          </li>
        ))}
      </ol>
      {queue.entries.length === 0 ? <p class="soft">No protocol waits.</p>
        : <p>{duration(queue.duration_s)} in all. {queue.prompts === 0 ? "Nobody is asked for anything." : queue.prompts === 1 ? "A person is needed once." : `A person is needed ${queue.prompts} times.`}</p>}
      {queue.hold
        ? <AskButton class="primary" icon="play" send={change("/release")} disabled={isLost || queue.entries.length === 0} why="no protocol waits">Release the queue</AskButton>
        : <AskButton send={change("/hold")} disabled={isLost}>Hold the queue</AskButton>}
    </section>
  );
}

function Entry({ entry }: { entry: QueueEntry }) {
  const first = entry.prompts[0];
  return (
    <div>
      <strong>{entry.protocol}</strong> <span class="soft">{duration(entry.duration_s)}, {entry.by}</span>
      {entry.note && <p class="soft">{entry.note}</p>}
      {entry.deadline_unix_ms !== undefined && <p class={entry.is_missed ? "bad-word" : "soft"}>{entry.is_missed ? "could not end" : "must have ended"} by {day(new Date(entry.deadline_unix_ms).toISOString())}</p>}
      {entry.late_s !== undefined && !entry.is_missed && <p class="bad-word">would end {duration(entry.late_s)} after that, even if released now</p>}
      {entry.fault !== undefined && <p class="bad-word">cannot run here: {entry.fault}</p>}
      {first && (
        <details>
          <summary>{entry.prompts.length === 1 ? "a person is needed once" : `a person is needed ${entry.prompts.length} times`}, first after {duration(first.after_s)}</summary>
          <ul>{entry.prompts.map((asked, index) => <li key={index}>after {duration(asked.after_s)}: {asked.prompt}</li>)}</ul>
        </details>
      )}
    </div>
  );
}
