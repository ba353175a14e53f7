// The commissioning of a new bench: the step with its picture and limit, one question at a time, and what was seen.
import { useState } from "preact/hooks";
import { AskButton } from "./shell.tsx";
import { post, usePoll, type View } from "./store.ts";
import type { Commission, CommissionQuestion, CommissionStep } from "./wire.ts";

/** How often it is asked for while it is shown, ms. Other people answer too. */
const ASK_MS = 1000;

/** Nothing where no step is missing, none is under way, and none was made since the daemon was started. */
export function CommissionCard({ view }: { view: View }) {
  const [commission, set] = usePoll<Commission>("commission", ASK_MS);
  if (!commission || view.model.rig?.fault?.kind !== "not_commissioned" && !commission.under_way && commission.said.length === 0) return null;
  const isLost = view.link === "lost";
  const send = (path: string, body: object) => () =>
    post<Commission>(`commission${path}`, { type: "application/json", text: JSON.stringify(body) }).then((now) => now && set(now));
  const { under_way, question, steps, said } = commission;
  const step = steps.find((one) => one.step === (under_way ?? steps.find((missing) => !missing.is_held)?.step));
  return (
    <section class="card commission" aria-label="Commissioning">
      <h2>Commissioning</h2>
      <ol>{steps.map((one) => <li key={one.step} aria-current={one.step === under_way ? "step" : undefined}><strong>{one.step}</strong> <span class={one.is_held ? "good-word" : "ask-word"}>{stateOf(one, under_way)}</span></li>)}</ol>
      {step && <StepOf step={step} />}
      {question && <Question key={question.number} question={question} isLost={isLost} send={(answer) => send("/answer", { question: question.number, answer })()} />}
      {said.length > 0 && <ol class="heard soft" aria-label="What was said and seen, newest first" tabIndex={0}>{said.map((text, index) => <li key={index}>{text}</li>).reverse()}</ol>}
      {under_way
        ? <AskButton send={send("/abort", {})} disabled={isLost}>Abort this step</AskButton>
        : step && <AskButton class="primary" icon="play" send={send("", {})} disabled={isLost}>Begin with “{step.step}”</AskButton>}
    </section>
  );
}

function stateOf({ step, is_held, made, person, why }: CommissionStep, underWay: string | null): string {
  if (step === underWay) return "under way";
  return is_held ? `accepted ${made ?? ""}, ${person ?? ""}` : `missing: ${why ?? "never made"}`;
}

function StepOf({ step }: { step: CommissionStep }) {
  return (
    <div>
      <p>{step.shows.charAt(0).toUpperCase() + step.shows.slice(1)}. Accepted when {step.accepted_when}.</p>
      <pre aria-label={`Picture of the step ${step.step}`} tabIndex={0}>{step.picture}</pre>
      <p class="soft">If it fails: {step.remedy}.</p>
    </div>
  );
}

/** A press is one answer. A reading is typed. */
function Question({ question, isLost, send }: { question: CommissionQuestion; isLost: boolean; send: (answer: string) => Promise<unknown> }) {
  const [reading, set] = useState("");
  return (
    <div class="question" role="alert">
      <p><strong>{question.text}</strong></p>
      <div class="row">
        {question.choices.map((choice) => <AskButton key={choice} class="primary" send={() => send(choice)} disabled={isLost}>{choice}</AskButton>)}
        {question.choices.length === 0 && <>
          <label>Reading <input type="text" inputMode="decimal" value={reading} placeholder={question.expected} onInput={(event) => set(event.currentTarget.value)} /></label>
          <AskButton class="primary" send={() => send(reading)} disabled={isLost || reading.trim() === ""} why="no reading is typed">Answer</AskButton>
        </>}
      </div>
    </div>
  );
}
