// Before a start: what a protocol would do here, and the start itself.
import { useEffect, useState } from "preact/hooks";
import { asWritten, clock, day, degrees, duration, fixed, range } from "./format.ts";
import { differences, type Change } from "./changes.ts";
import { BenchDrawing, Timeline } from "./drawings.tsx";
import { Icon } from "./icons.tsx";
import { QueuePanel } from "./queue.tsx";
import { AskButton } from "./shell.tsx";
import { get, noted, operator, post, reasonOf, Refused, setOperator, text, useRead, type Body, type View } from "./store.ts";
import type { Plan, Problem, Rig, RunEntry, Since } from "./wire.ts";

/** A protocol that can be chosen: the one rigd was started with, one of an earlier run, or a file. */
interface Choice { key: string; title: string; from: string; toml: string | undefined; last: RunEntry | undefined; good?: RunEntry | undefined; /** When the run began that is asked for again. */ began?: string }

/** What a check has found, or why it has found nothing. */
type Checked = { plan: Plan } | { problem: Problem } | { why: string };

/** The status of an answer that finds faults in the protocol. Another one says nothing about it. */
const FAULTY = 422;

/** What a person takes to change a sample, s, until the run itself says it better. */
const ANSWER_S = 30;

const bodyOf = (choice: Choice): Body | undefined =>
  choice.toml === undefined ? undefined : { type: "application/toml", text: choice.toml };

export function Protocols({ view, again }: { view: View; again: string | undefined }) {
  const [chosen, choose] = useState(again === undefined ? undefined : `again ${again}`);
  const [asked, setAsked] = useState<Choice>();
  const [why, setWhy] = useState<string>();
  const [files, setFiles] = useState<Choice[]>([]);
  const status = view.model.run?.status;
  // Another session is a daemon that was started again, perhaps with another protocol.
  const session = view.model.rig?.session;
  const [read, unread] = useRead(load, [status, session]);
  // They may be those of the daemon before.
  const choices = unread === undefined ? read : undefined;
  useEffect(() => {
    if (again === undefined) return;
    let isOver = false;
    choose(`again ${again}`);
    setWhy(undefined);
    asRun(again).then((found) => { if (!isOver) setAsked(found); }, (error: unknown) => { if (!isOver) setWhy(reasonOf(error)); });
    return () => { isOver = true; };
  }, [again, session]);
  const all = [...(asked ? [asked] : []), ...files, ...(choices ?? [])];
  // What is not there is not replaced by another protocol.
  const choice = chosen === undefined ? all[0] : all.find((c) => c.key === chosen);
  const openFile = async (file: File | undefined) => {
    if (!file) return;
    const toml = await file.text();
    const added = { key: `file ${file.name} ${toml.length}`, title: file.name, from: "a file on this computer", toml, last: undefined };
    setFiles((old) => [added, ...old.filter((c) => c.key !== added.key)]);
    choose(added.key);
  };
  return (
    <main class="protocols" id="main">
      <section class="card" aria-label="Protocols">
        <h2>Protocols</h2>
        <ul class="choices">
          {all.map((c) => (
            <li key={c.key}><button type="button" aria-pressed={c === choice} onClick={() => choose(c.key)}>
              <strong>{c.title}</strong><span class="soft">{c.from}</span>
              <span class="soft">{c.began !== undefined ? day(c.began) : c.last ? `last run: ${c.last.name}, ${day(c.last.started_at)}` : "never run here"}</span>
            </button></li>
          ))}
        </ul>
        {choices && all.length === 0 && <p class="soft">None is loaded. Open a protocol file, such as smoke.toml.</p>}
        {unread !== undefined && <p class="refusal" role="alert">The protocols could not be read: {unread}</p>}
        <label class="file">Open a file…<input type="file" accept=".toml,application/toml,text/plain" onChange={(event) => void openFile(event.currentTarget.files?.[0])} /></label>
        <QueuePanel view={view} />
      </section>
      {!choice && chosen === `again ${again}` && (
        <section class="card" aria-label="Check">{why === undefined ? <p class="soft">The protocol of the run is being read…</p> : <p class="refusal" role="alert">The protocol of this run cannot be offered: {why}</p>}</section>
      )}
      {choice && <Check key={`${session} ${choice.key} ${choice.toml}`} choice={choice} view={view} />}
    </main>
  );
}

/** The protocol of a run, as it was run. */
async function asRun(id: string): Promise<Choice> {
  const [runs, toml] = await Promise.all([get<RunEntry[]>("runs"), text(`runs/${id}/protocol`)]);
  const run = runs.find((one) => one.id === id);
  const good = runs.filter((one) => one.protocol === run?.protocol && one.status === "completed").sort((a, b) => a.started_at.localeCompare(b.started_at)).at(-1);
  return { key: `again ${id}`, title: run?.protocol ?? id, from: `as run in ${run?.name ?? id}`, toml, last: undefined, good, began: run?.started_at ?? "" };
}

/** The loaded protocol, and the last version of every other that was run. */
async function load(): Promise<Choice[]> {
  const [runs, loaded] = await Promise.all([
    get<RunEntry[]>("runs"),
    // None is loaded.
    post<Plan>("protocols/check").catch((error: unknown) => { if (error instanceof Refused && error.problem.status === FAULTY) return undefined; throw error; }),
  ]);
  const last = new Map<string, RunEntry>();
  const good = new Map<string, RunEntry>();
  for (const run of [...runs].sort((a, b) => a.started_at.localeCompare(b.started_at))) {
    last.set(run.protocol, run);
    if (run.status === "completed") good.set(run.protocol, run);
  }
  const choices: Choice[] = [];
  if (loaded) {
    choices.push({ key: "loaded", title: loaded.protocol, from: "rigd was started with it", toml: undefined, last: last.get(loaded.protocol), good: good.get(loaded.protocol) });
    last.delete(loaded.protocol);
  }
  const others = [...last.values()].reverse().slice(0, 12);
  const tomls = await Promise.all(others.map((run) => text(`runs/${run.id}/protocol`).catch((error: unknown) => { if (error instanceof Refused) return undefined; throw error; })));
  others.forEach((run, i) => {
    const toml = tomls[i];
    if (toml !== undefined) choices.push({ key: `protocol ${run.protocol}`, title: run.protocol, from: "as it was run last", toml, last: run, good: good.get(run.protocol) });
  });
  return choices;
}

function Check({ choice, view }: { choice: Choice; view: View }) {
  const [checked, set] = useState<Checked>();
  const [attempt, setAttempt] = useState(1);
  useEffect(() => {
    set(undefined);
    post<Plan>("protocols/check", bodyOf(choice)).then(
      (plan) => { if (plan) set({ plan }); },
      (error: unknown) => set(error instanceof Refused && error.problem.status === FAULTY ? { problem: error.problem } : { why: reasonOf(error) }),
    );
  }, [attempt]);
  const plan = checked && "plan" in checked ? checked.plan : undefined;
  const good = plan && choice.good;
  const [since, sinceUnread] = useRead(async () => good && get<Since>(`runs/${good.id}/changes`), [plan]);
  const [changes, changesUnread] = useRead(async () => good && differences(await text(`runs/${good.id}/protocol`), plan.protocol_toml), [plan]);
  const rig = view.model.rig as Rig;
  if (!checked) return <section class="card" aria-label="Check"><p class="soft">rigd is checking {choice.title}…</p></section>;
  if ("why" in checked) {
    return (
      <section class="card" aria-label="Check">
        <p class="refusal" role="alert">{choice.title} could not be checked: {checked.why}</p>
        <button type="button" onClick={() => setAttempt(attempt + 1)}>Check again</button>
      </section>
    );
  }
  if ("problem" in checked) return <Faults title={choice.title} problem={checked.problem} />;
  return (
    <>
      <CheckedPlan plan={checked.plan} rig={rig} good={choice.good} changes={changes} since={since} unread={changesUnread ?? sinceUnread} />
      <Start plan={checked.plan} view={view} freeBytes={since?.free_bytes} />
    </>
  );
}

function Faults({ title, problem }: { title: string; problem: Problem }) {
  return (
    <section class="card faults wide" aria-label="Check">
      <div class="row"><h2 class="title">{title}</h2><span class="chip bad"><Icon name="cross" size={16} />cannot run here</span></div>
      <p>{problem.detail}{problem.hint ? `; ${problem.hint}` : ""}</p>
      {problem.faults && (
        <table class="fault-table"><thead><tr><th scope="col">line</th><th scope="col">column</th><th scope="col">what</th><th scope="col">what to do</th></tr></thead>
          <tbody>{problem.faults.map((f) => <tr key={`${f.line}:${f.column}:${f.message}`}><td>{f.line}</td><td>{f.column}</td><td>{f.message}</td><td>{f.suggestion ?? ""}</td></tr>)}</tbody></table>
      )}
    </section>
  );
}

function CheckedPlan({ plan, rig, good, changes, since, unread }: { plan: Plan; rig: Rig; good: RunEntry | undefined; changes: Change[] | undefined; since: Since | undefined; unread: string | undefined }) {
  const persons_s = rig.is_simulated ? 0 : plan.prompts * ANSWER_S;
  const [least, most] = [plan.duration_s * 0.7, plan.duration_s * 1.3 + persons_s];
  const sensor = { depth: undefined, isUnknown: false, isClear: true, sample: plan.samples[0] };
  const poses = [
    { title: "Highest", linear_mm: plan.linear_mm[1], rotary_deg: 0 },
    { title: "Farthest tilt", linear_mm: plan.linear_mm[1], rotary_deg: Math.abs(plan.rotary_deg[0]) > plan.rotary_deg[1] ? plan.rotary_deg[0] : plan.rotary_deg[1] },
    { title: "Lowest tip", linear_mm: plan.linear_mm[0], rotary_deg: 0 },
  ];
  return (
    <section class="card check-card" aria-label="Check">
      <div class="row"><h2 class="title">{plan.protocol}</h2><span class="chip good"><Icon name="check" size={16} />can run on {rig.name}</span></div>
      <dl class="figures">
        <div><dt>Duration</dt><dd>{range([least, most])}</dd><dd class="soft">{duration(plan.duration_s)} of rig as planned{persons_s ? `, ${ANSWER_S} s a prompt` : ""}{rig.is_virtual_time ? "; the rig's time runs fast here" : ""}</dd></div>
        {!rig.is_virtual_time && <div><dt>If started now, ends</dt><dd>{clock(rig.unix_ms + least * 1000, false)} to {clock(rig.unix_ms + most * 1000, false)}</dd></div>}
        <div><dt>Touches</dt><dd>{plan.touches}</dd><dd class="soft">of samples {plan.samples.join(", ")}; {plan.no_loads} free resonances</dd></div>
        <div><dt>Prompts</dt><dd>{plan.prompts}</dd><dd class="soft">{rig.is_simulated ? "of the simulated person, unless the rig file says otherwise" : "for you, at the bench"}</dd></div>
        {plan.is_slip_checked === false && <div><dt>Check of slip</dt><dd class="refused-word">none</dd><dd class="soft">slip_mm = 0: steps lost in a touch will not show</dd></div>}
      </dl>
      <h3>When you are needed</h3>
      <Timeline plan={plan} touches={new Map()} now={undefined} />
      <h3>Extremes, within the limits of {rig.name}</h3>
      <div class="extremes">
        <Extreme title="Tip" span={plan.linear_mm} limits={[rig.limits.linear_mm.min, rig.limits.linear_mm.max]} unit="mm" />
        <Extreme title="Tilt" span={plan.rotary_deg} limits={[rig.limits.rotary_deg.min, rig.limits.rotary_deg.max]} unit="°" />
        <Extreme title="Depth" span={[0, plan.indentation_mm]} limits={[0, plan.max_indentation_mm]} unit="mm" />
      </div>
      <div class="extremes drawn">{poses.map((pose) => <figure key={pose.title}><figcaption class="soft">{pose.title}: {fixed(pose.linear_mm, 3)} mm, {degrees(pose.rotary_deg)}</figcaption><BenchDrawing limits={rig.limits} pose={{ ...sensor, linear_mm: pose.linear_mm, rotary_deg: pose.rotary_deg }} isPlain /></figure>)}</div>
      <h3>{good ? `Changed since ${good.name}, the last complete run` : "No complete run of this protocol here yet"}</h3>
      {good && <Changes changes={changes} since={since} unread={unread} />}
    </section>
  );
}

/** What differs from the last complete run, as far as it is read. */
function Changes({ changes, since, unread }: { changes: Change[] | undefined; since: Since | undefined; unread: string | undefined }) {
  const count = (changes?.length ?? 0) + (since?.changes.length ?? 0);
  return (
    <>
      {unread !== undefined && <p class="refusal" role="alert">{changes || since ? "Not all of it could be read" : "It could not be read"}: {unread}</p>}
      {!changes && unread === undefined && <p class="soft">It is being read…</p>}
      {changes && count === 0 && (since || unread === undefined) && <p class="soft">{since ? "Nothing: protocol, rig file, software and devices are the same." : "Nothing in the protocol."}</p>}
      {count > 0 && (
        <table class="changes"><tbody>
          {changes?.map((c) => <tr key={c.key}><th scope="row"><code>{c.key}</code></th><td>{c.before ?? "not there"} → <strong>{c.now ?? "gone"}</strong></td></tr>)}
          {since?.changes.map((c) => <tr key={c.what}><th scope="row">{c.what}</th><td>{c.was === c.is ? <strong>another text, also named {c.is}</strong> : <>{c.was} → <strong>{c.is}</strong></>}</td></tr>)}
        </tbody></table>
      )}
    </>
  );
}

function Extreme({ title, span: [from, to], limits: [min, max], unit }: { title: string; span: [number, number]; limits: [number, number]; unit: string }) {
  const at = (value: number) => ((value - min) / (max - min || 1)) * 100;
  return (
    <div class="extreme">
      <p><strong>{title}</strong> {fixed(from, 2)} to {fixed(to, 2)} {unit}</p>
      <svg width="100%" height="10" role="img" aria-label={`${title}: from ${fixed(from, 2)} to ${fixed(to, 2)} ${unit}, limits ${min} and ${max} ${unit}`}>
        <rect class="cell" width="100%" height="10" rx="5" /><rect class="span" x={`${at(from)}%`} width={`${Math.max(1, at(to) - at(from))}%`} height="10" rx="4" />
      </svg>
      <p class="soft row"><span>limit {asWritten(min)}</span><span>{asWritten(max)} {unit}</span></p>
    </div>
  );
}

interface Check1 { text: string; isFine: boolean; isAdvice?: boolean }

/** Below this a person should look for room, bytes; rigd itself refuses a run that does not fit. */
const LOW_BYTES = 1e9;

function Start({ plan, view, freeBytes }: { plan: Plan; view: View; freeBytes: number | undefined }) {
  const [note, setNote] = useState("");
  const rig = view.model.rig as Rig;
  const [name, setName] = useState(operator());
  // One key for each intention to start: pressing twice begins one run.
  const [key, setKey] = useState(() => crypto.randomUUID?.() ?? `${Date.now()}-${Math.random()}`);
  const checks: Check1[] = [
    { text: rig.state === "idle" ? "The rig is ready" : `The rig is ${rig.state}`, isFine: rig.state === "idle" },
    { text: `The probe is ${rig.probe}${rig.linear_mm === undefined ? "" : `, ${fixed(rig.linear_mm, 3)} mm`}`, isFine: rig.probe === "clear" },
    { text: `${rig.devices.length} devices answer: ${rig.devices.map((d) => d.role).join(", ")}`, isFine: rig.devices.length >= 3 },
    { text: rig.journal_error === undefined ? "The journal can be written" : `The journal: ${rig.journal_error}`, isFine: rig.journal_error === undefined },
    ...(freeBytes === undefined ? [] : [{ text: `${fixed(freeBytes / 1e9, 1)} GB are free on the disk`, isFine: freeBytes > LOW_BYTES, isAdvice: true }]),
  ];
  const bad = checks.find((check) => !check.isFine && !check.isAdvice);
  const first = plan.steps[0];
  // What was checked and is shown, whatever the daemon has loaded since.
  const start = () => post<{ id: string }>("runs", { type: "application/toml", text: plan.protocol_toml }, key).then((begun) => {
    if (begun && note.trim()) void noted(begun.id, { note: note.trim(), is_starred: false }).catch(() => undefined); setKey(crypto.randomUUID?.() ?? `${Date.now()}-${Math.random()}`); location.hash = "#/now"; });
  const queue = () => post("queue", { type: "application/json", text: JSON.stringify({ protocol_toml: plan.protocol_toml, note: note.trim() }) });
  return (
    <section class="card start-card" aria-label="Start">
      <h2>At the bench</h2>
      <label>Operator, for the record<input value={name} maxLength={64} placeholder="your name" onInput={(event) => { setName(event.currentTarget.value); setOperator(event.currentTarget.value); }} /></label>
      <label>Note about this run<input value={note} maxLength={2000} placeholder="may stay empty" onInput={(event) => setNote(event.currentTarget.value)} /></label>
      <h3>Before you press start</h3>
      <ul class="checks">{checks.map((check) => <li key={check.text} class={check.isFine ? "good-word" : "bad-word"}><Icon name={check.isFine ? "check" : "alert"} size={18} /><span>{check.text}</span></li>)}</ul>
      <AskButton class="primary done" icon="play" send={start} isDone={rig.run !== undefined} disabled={bad !== undefined || view.link === "lost"} why={bad?.text}>Start {plan.protocol}</AskButton>
      <AskButton send={queue} disabled={view.link === "lost"}>Add to the queue</AskButton>
      <p class="soft">{bad ? `Not now: ${bad.text.toLowerCase()}.` : `First the sample turns to level under a clear probe. Then: ${first?.what_is_done ?? ""}`}</p>
    </section>
  );
}
