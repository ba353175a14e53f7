// A refused touch: its sweep, why, and what to do about it.
import { useEffect, useRef, useState } from "preact/hooks";
import { clock } from "./format.ts";
import { Icon } from "./icons.tsx";
import { sweepOf } from "./model.ts";
import { SweepPlots } from "./plots.tsx";
import { AskButton } from "./shell.tsx";
import { beep, wallMs } from "./now.tsx";
import { isChange, operator, post, type View } from "./store.ts";
import type { RefusedTouch, Rig, TouchRow } from "./wire.ts";

const ANSWERS: [RefusedTouch["answers"][number], string, "play" | "tick" | "abort"][] = [
  ["widen", "Widen the window and repeat", "play"], ["repeat", "Repeat", "play"],
  ["skip", "Skip: keep it refused, go on", "tick"], ["abort", "Abort the run, keep its touches", "abort"],
];

/** Asks what to do after a touch was refused. The probe is clear, and nothing moves until the answer. */
export function RefusedCard({ view, refused }: { view: View; refused: RefusedTouch }) {
  const { model } = view;
  const rig = model.rig as Rig;
  const title = useRef<HTMLHeadingElement>(null);
  useEffect(() => { title.current?.focus({ preventScroll: true }); beep(); }, [refused.step, rig.state_since_s]);
  const say = (answer: string) => () => post(`runs/${rig.run?.id ?? ""}/answer?step=${encodeURIComponent(refused.step)}&refused=${answer}`);
  const sweep = sweepOf(model, refused.step);
  return (
    <section class="card refused-card" role="alertdialog" aria-labelledby="refused-title" aria-describedby="refused-why">
      <p class="ask-word"><Icon name="hand" size={18} /> For you, asked {clock(wallMs(rig, rig.state_since_s))}</p>
      <h2 id="refused-title" class="title" ref={title} tabIndex={-1}>Touch {refused.step} was refused</h2>
      <p id="refused-why" class="refusal">{refused.reason}</p>
      {sweep ? <><h3>Sweep in contact of touch {refused.step}</h3><SweepPlots sweep={sweep} height={240} /></> : <p class="soft">This page has no sweep of this touch.</p>}
      <div class="buttons">
        {ANSWERS.map(([answer, text, icon]) => (
          <AskButton key={answer} class={answer === "widen" ? "primary" : ""} icon={icon} send={say(answer)} disabled={view.link === "lost"} why="The link is lost.">{text}</AskButton>
        ))}
      </div>
      <p class="soft"><strong>{view.link === "lost" ? "The link is lost, and another person may have answered: keep your hands away." : "Nothing moves until somebody answers or stops the rig."}</strong> The probe {view.link === "lost" ? "was" : "is"} {rig.probe}. Here, in the terminal or over HTTP{operator() ? `. Signed: ${operator()}` : ""}</p>
    </section>
  );
}

/** Measures a touch of a run again, or leaves it out; the old outcome is kept. */
export function Amend({ run, row, rig, onDone }: { run: { id: string; status: string }; row: TouchRow; rig: Rig | undefined; onDone: () => void }) {
  const [why, setWhy] = useState("");
  const isUnderWay = rig?.run?.id === run.id;
  const isAhead = isUnderWay && row.status === "not_reached";
  const [isChanged, setChanged] = useState(false);
  const send = (what: "redo" | "skip", more = {}) => () =>
    post(`runs/${run.id}/${what}`, { type: "application/json", text: JSON.stringify({ step: row.step, why, ...more }) }).then(
      () => { if (what === "redo") location.hash = "#/"; else onDone(); },
      (error: unknown) => { if (isChange(error)) setChanged(true); throw error; },
    );
  const missing = why.trim() === "" ? "Write why first." : "";
  const busy = isUnderWay ? "The run is under way." : rig?.state === "idle" ? "" : "The rig must be ready.";
  return (
    <form class="amend" onSubmit={(event) => event.preventDefault()}>
      <label for="amend-why">Why is it measured again, or left out? (kept in the journal{operator() ? `, signed ${operator()}` : ""})</label>
      <input id="amend-why" maxLength={300} value={why} onInput={(event) => setWhy(event.currentTarget.value)} />
      <div class="buttons">
        <AskButton icon="play" send={send("redo")} disabled={missing !== "" || busy !== ""} why={missing || busy}>Measure again</AskButton>
        {isChanged && <AskButton send={send("redo", { accept_changes: true })} disabled={missing !== "" || busy !== ""} why={missing || busy}>Measure again with these changes</AskButton>}
        <AskButton icon="cross" send={send("skip")} disabled={missing !== "" || (isUnderWay && !isAhead)} why={missing || "It has begun."}>{isAhead ? "Leave it out of this run" : "Leave it out"}</AskButton>
        {(missing || (busy && !isAhead)) && <span class="soft">{missing || busy}</span>}
      </div>
    </form>
  );
}
