// The runs of this rig, and what one of them found.
import { useEffect, useState } from "preact/hooks";
import { asWritten, day, degrees, duration, ending, fixed, stiffness } from "./format.ts";
import { ShiftCharts } from "./drawings.tsx";
import { Icon, SampleMark } from "./icons.tsx";
import { touchOfRow, type LiveSweep } from "./model.ts";
import { Legend } from "./now.tsx";
import { Amend } from "./refused.tsx";
import { NarrowingPlot, SweepPlots } from "./plots.tsx";
import { Compare } from "./compare.tsx";
import { doubts } from "./doubts.ts";
import { AskButton, Confirm, DialogStop } from "./shell.tsx";
import { get, isChange, noted, open, post, reasonOf, useRead, type Body, type View } from "./store.ts";
import type { Direction, Note, Notes, RunDetail, RunEntry, Sweep, TouchRow } from "./wire.ts";

/** What a run found that cannot be continued is asked for once. */
const known = new Map<string, RunDetail>();
const KNOWN_MAX = 200;

async function detailOf(run: RunEntry): Promise<RunDetail> {
  const found = known.get(run.id);
  if (found) return found;
  const detail = await get<RunDetail>(`runs/${run.id}`);
  if (detail.status !== "running" && !detail.is_resumable && known.size < KNOWN_MAX) known.set(run.id, detail);
  return detail;
}

/** Rows whose figures are read at once; more are read when they are asked for. */
const PAGE = 12;

export function Runs({ view }: { view: View }) {
  const [details, setDetails] = useState<Map<string, RunDetail>>(new Map());
  const [wanted, setWanted] = useState("");
  const [count, setCount] = useState(PAGE);
  const [notes, setNotes] = useNotes();
  const [picked, setPicked] = useState<string[]>([]);
  const pick = (id: string) => setPicked((old) => (old.includes(id) ? old.filter((one) => one !== id) : [...old, id].slice(-2)));
  const pair = picked.map((id) => details.get(id)).filter((detail) => detail !== undefined).sort((a, b) => a.started_at.localeCompare(b.started_at));
  const status = view.model.run?.status;
  const id = view.model.run?.id;
  const [runs, unread] = useRead(async () => (await get<RunEntry[]>("runs")).sort((a, b) => b.started_at.localeCompare(a.started_at)), [status, id]);
  const shown = (runs ?? []).filter((run) => `${run.name} ${run.protocol} ${ending(run.status)} ${run.archived_to === undefined ? "" : "archived"} ${day(run.started_at)} ${notes?.[run.id]?.note ?? ""} ${notes?.[run.id]?.is_starred ? "starred" : ""}`.toLowerCase().includes(wanted.toLowerCase()));
  const page = shown.slice(0, count);
  useEffect(() => {
    let isOver = false;
    // One after the other: the journal is read for each.
    void (async () => {
      for (const run of page) {
        if (isOver) return;
        // Its readings are not here.
        if (run.archived_to !== undefined) continue;
        const detail = await detailOf(run).catch(() => undefined);
        if (detail && !isOver) setDetails((old) => (old.get(run.id) === detail ? old : new Map(old).set(run.id, detail)));
      }
    })();
    return () => { isOver = true; };
  }, [runs, wanted, count]);
  return (
    <main class="runs" id="main">
      {pair[0] && pair[1] && <Compare a={pair[0]} b={pair[1]} onClose={() => setPicked([])} />}
      <section class="card" aria-label="Runs">
        <div class="row find"><label class="hidden" for="find">Find a run</label><input id="find" type="search" placeholder="Find: name, day, end, note, starred" value={wanted} onInput={(event) => setWanted(event.currentTarget.value)} /><span class="soft">{runs ? runs.length === 1 ? "1 run" : `${runs.length} runs` : unread === undefined && "reading…"}</span></div>
        {unread !== undefined && <p class="refusal" role="alert">The runs could not be read: {unread}</p>}
        {runs?.length === 0 && <p>No runs yet. <a href="#/protocols">Start with smoke.</a></p>}
        {page.length > 0 && (
          <div class="scroll"><table class="run-list">
            <thead><tr><th scope="col">run</th><th scope="col">shift by angle</th><th scope="col">end</th><th scope="col">measured</th><th scope="col">took</th><th scope="col">compare</th></tr></thead>
            <tbody>{page.map((run) => <RunRow key={run.id} run={run} detail={details.get(run.id)} note={noteIn(notes, run.id)} onNote={(note) => setNotes(run.id, note)} isPicked={picked.includes(run.id)} onPick={() => pick(run.id)} />)}</tbody>
          </table></div>
        )}
        {shown.length > count && <button type="button" onClick={() => setCount(count + PAGE)}>Show {Math.min(PAGE, shown.length - count)} more</button>}
        <p class="soft"><a href="/api/v1/checks/trend" target="_blank" rel="noopener">Trend of the daily check</a></p>
      </section>
    </main>
  );
}

const NO_NOTE: Note = { note: "", is_starred: false };

type ChangeNote = (id: string, change: Partial<Note>) => Promise<void>;

/** After this time the notes are asked for again if they did not come, ms. */
const AGAIN_MS = 2000;

/** The notes about runs, unknown until they are read, and how one is changed. The page shows what rigd has. */
function useNotes(): [Notes | undefined, ChangeNote] {
  const [notes, set] = useState<Notes>();
  useEffect(() => {
    let timer = 0;
    const load = () => void get<Notes>("notes").then(set, () => { timer = window.setTimeout(load, AGAIN_MS); });
    load();
    return () => clearTimeout(timer);
  }, []);
  // Another person may have written since: what is not changed is sent as it is now.
  const change: ChangeNote = async (id, part) => {
    const now = await get<Notes>("notes");
    await noted(id, { ...NO_NOTE, ...now[id], ...part });
    await get<Notes>("notes").then(set, () => undefined);
  };
  return [notes, change];
}

const noteIn = (notes: Notes | undefined, id: string) => notes && (notes[id] ?? NO_NOTE);

interface NoteProps { note: Note | undefined; onNote: (change: Partial<Note>) => Promise<void> }

function Star({ name, note, onNote }: NoteProps & { name: string }) {
  const [why, setWhy] = useState("");
  const isOn = note?.is_starred === true;
  const press = () => { setWhy(""); onNote({ is_starred: !isOn }).catch((error: unknown) => setWhy(reasonOf(error))); };
  return <><button type="button" class={`star${isOn ? " on" : ""}`} aria-pressed={isOn} aria-label={`Star ${name}`} disabled={!note} onClick={press}>{isOn ? "★" : "☆"}</button>{why && <span class="said bad" role="alert">{why}</span>}</>;
}

/** A note of a person, kept when the field is left. */
function NoteField({ note, onNote }: NoteProps) {
  const [text, setText] = useState<string>();
  const [said, setSaid] = useState("");
  const keep = () => {
    if (!note || text === undefined) return;
    // Nor does the refusal of another text stay.
    if (text === note.note) return setSaid("");
    setSaid("asked…");
    onNote({ note: text }).then(() => setSaid("kept"), (error: unknown) => setSaid(reasonOf(error)));
  };
  return (
    <p class="note-field"><label for="note">Note, kept beside the journal</label>
      <textarea id="note" rows={1} maxLength={2000} disabled={!note} value={text ?? note?.note ?? ""} onInput={(event) => setText(event.currentTarget.value)} onBlur={keep} />
      <span class="said" role="status">{note ? said : "being read…"}</span></p>
  );
}

interface RowProps extends NoteProps { run: RunEntry; detail: RunDetail | undefined; isPicked: boolean; onPick: () => void }

function RunRow({ run, detail, note, onNote, isPicked, onPick }: RowProps) {
  const results = detail?.results;
  return (
    <tr>
      <th scope="row"><a href={`#/runs/${run.id}`}>{run.name}</a><Star name={run.name} note={note} onNote={onNote} /><br /><span class="soft">{day(run.started_at)}</span>{note?.note && <><br /><span class="note-text">{note.note}</span></>}</th>
      <td>{results && <Thumbnail rows={results.touch_results} />}</td>
      <td><EndChip status={run.status} />{run.archived_to !== undefined && <><br /><span class="soft" title={run.archived_to}>archived</span></>}</td>
      <td>{results && <><Share measured={results.touches_measured} refused={results.touches_refused} planned={results.touches_planned} />
        {results.touches_measured} of {results.touches_planned}{results.touches_refused > 0 && <span class="refused-word">, ✕ {results.touches_refused}</span>}</>}</td>
      <td>{results && duration(results.rig_seconds)}</td>
      <td><input type="checkbox" checked={isPicked} disabled={!detail} aria-label={`Compare ${run.name}`} onChange={onPick} /></td>
    </tr>
  );
}

function EndChip({ status }: { status: string }) {
  const [tone, icon] = status.startsWith("completed") ? ["good", "check"] as const : status === "running" ? ["busy", "play"] as const
    : status === "faulted" ? ["bad", "fault"] as const : ["ask", "cross"] as const;
  return <span class={`chip ${tone}`}><Icon name={icon} size={16} />{ending(status)}</span>;
}

function Share({ measured, refused, planned }: { measured: number; refused: number; planned: number }) {
  const of = (n: number) => (100 * n) / Math.max(1, planned);
  return <svg class="share" width="110" height="9" aria-hidden="true"><rect class="cell" width="100%" height="9" /><rect class="span" width={`${of(measured)}%`} height="9" /><rect class="refused-fill" x={`${of(measured)}%`} width={`${of(refused)}%`} height="9" /></svg>;
}

function Thumbnail({ rows }: { rows: TouchRow[] }) {
  const main = rows.filter((row) => row.phase === "main" && row.shift_hz != null);
  const directions = [...new Set(rows.filter((r) => r.phase === "main").map((row) => row.direction))];
  const samples = [...new Set(rows.map((row) => row.sample))];
  const most = Math.max(1, ...main.map((row) => row.shift_hz ?? 0));
  return (
    <svg class="thumbnail" width={44 * Math.max(1, directions.length)} height="34" aria-hidden="true">
      {directions.map((direction, d) => samples.map((sample, s) => {
        const of = main.filter((row) => row.direction === direction && row.sample === sample).sort((a, b) => a.angle_deg - b.angle_deg);
        const path = of.map((row, i) => `${i ? "L" : "M"}${d * 44 + 3 + (36 * row.angle_deg) / 45} ${31 - (28 * (row.shift_hz ?? 0)) / most}`).join("");
        return path && <path key={`${direction}${sample}`} class={`line s${s % 5}`} d={path} />;
      }))}
    </svg>
  );
}

// ---- One run ----------------------------------------------------------------------------------------

export function RunPage({ id, view }: { id: string; view: View }) {
  const { model } = view;
  const [opened, openTouch] = useState<TouchRow>();
  const [isGivenUp, setGivenUp] = useState(false);
  const [amended, setAmended] = useState(0);
  const [notes, setNotes] = useNotes();
  const note = noteIn(notes, id);
  const made = model.run?.id === id ? [...model.run.touches.values()].filter((t) => t.status !== "not_reached").length : 0;
  const [detail, error] = useRead(() => get<RunDetail>(`runs/${id}`), [id, made, model.run?.status, isGivenUp, amended]);
  if (!detail && error !== undefined) return <main id="main"><section class="card"><p role="alert">{error}</p><p><a href="#/runs">All runs</a></p></section></main>;
  if (!detail) return <main id="main"><section class="card"><p class="soft">The journal is being read…</p></section></main>;
  const { results } = detail;
  const samples = [...new Set(results.touch_results.map((row) => row.sample))];
  const mainRows = results.touch_results.filter((row) => row.phase === "main");
  const blind = results.touch_results.filter((row) => row.phase === "blind");
  const refused = results.touch_results.filter((row) => row.status === "refused");
  const unchecked = results.touch_results.filter((row) => row.is_slip_checked === false);
  const unconfirmed = results.touch_results.filter((row) => row.is_confirmed === false);
  const recognition = results.recognition[0];
  return (
    <main class="run-page" id="main">
      {error !== undefined && <p class="refusal wide" role="alert">This is what was read before. The last try: {error}</p>}
      <div class="row head">
        <div><h2 class="title">{detail.name}<Star name={detail.name} note={note} onNote={(next) => setNotes(id, next)} /> <EndChip status={detail.status} /></h2>
          <p class="soft">{day(detail.started_at)}{detail.finished_at ? ` to ${day(detail.finished_at)}` : ""} · {detail.protocol} · {duration(results.rig_seconds)} of rig · {results.prompts} prompts answered{results.no_load_hz != null ? ` · free resonance ${fixed(results.no_load_hz, 3)} Hz` : ""}</p></div>
        <Downloads id={id} name={detail.name} />
      </div>
      <NoteField key={id} note={note} onNote={(next) => setNotes(id, next)} />
      {detail.is_resumable && <Continue detail={detail} view={view} onGivenUp={() => setGivenUp(true)} />}
      <section class="card wide" aria-label="Stiffness">
        <h2>Stiffness (Young's modulus) from shift by the model, ± σ with that of the calibration</h2>
        {unchecked.length > 0 && results.stiffness.length > 0 && <p class="refused-word">{NOT_CHECKED}</p>}
        {doubts(detail).map((doubt) => <p key={doubt} class="refused-word">{doubt}</p>)}
        {results.stiffness.length === 0 ? <p class="soft">None: too few touches were measured.</p> : (
          <div class="stiffness">{results.stiffness.map((s) => {
            const value = s.stiffness_mpa != null && s.sigma_mpa != null ? stiffness(s.stiffness_mpa, s.sigma_mpa) : undefined;
            return (
              <div key={s.sample}><h3><SampleMark index={samples.indexOf(s.sample)} /> sample {s.sample}</h3>
                <p class="value second">{value ? <>{value.value} <span class="sigma">± {value.sigma}</span> <span class="unit">{value.unit}</span></> : s.sets_scale ? <span class="soft">used for the scale</span> : <span class="refused-word">none</span>}</p>
                <p class="soft">{s.used} of {s.planned} touches{s.known_mpa != null ? ` · known: ${knownAs(s.known_mpa, value?.unit)}` : ""}</p>
                {s.planned > s.used && <p class="refused-word">{s.planned - s.used} without a value</p>}</div>
            );
          })}</div>
        )}
      </section>
      <section class="card matrix-card" aria-label="Touches">
        <h2>Planned {results.touches_planned} · measured {results.touches_measured} · refused {results.touches_refused} · {results.touches_skipped > 0 && `skipped ${results.touches_skipped} · `}not reached {results.touches_not_reached} <span class="soft">(frequency shift, Hz; open one for its sweep)</span></h2>
        {mainRows.length > 0 && <Matrix rows={mainRows} samples={samples} onOpen={openTouch} />}
        {blind.length > 0 && (
          <div class="blind"><h3>Blind touches, in order</h3>
            {recognition && <p><strong>{recognition.correct} of {recognition.trials} right, {fixed(recognition.rate * 100, 0)} %</strong> <span class="soft">(95 %: {fixed(recognition.low * 100, 0)} to {fixed(recognition.high * 100, 0)})</span></p>}
            <ol class="blind-cells">{blind.map((row) => <li key={row.step}><TouchCell row={row} label={row.status === "measured" ? (row.class == null ? "·" : row.class === row.sample ? "✓" : "✗") : undefined} onOpen={openTouch} /></li>)}</ol></div>
        )}
        {unchecked.length > 0 && <p class="refused-word">† {NOT_CHECKED}</p>}
        {refused.length > 0 && <div><h3>Refused, with reasons</h3><ul class="reasons">{refused.map((row) => <li key={row.step}><TouchLink row={row} onOpen={openTouch} /> {row.reason}</li>)}</ul></div>}
        {unconfirmed.length > 0 && <div><h3>Measured, not confirmed</h3><ul class="reasons">{unconfirmed.map((row) => <li key={row.step}><TouchLink row={row} onOpen={openTouch} /> The run ended before anything was measured after it.</li>)}</ul></div>}
      </section>
      <section class="card curves" aria-label="Shift by angle">
        <div class="row"><h2>Shift (Hz) by angle</h2><Legend samples={samples} hasBefore={false} beforeName={undefined} /></div>
        <ShiftCharts samples={samples} touches={results.touch_results.map(touchOfRow)} height={170} />
      </section>
      {opened && <SweepDialog run={detail} row={opened} view={view} onClose={() => openTouch(undefined)} onAmended={() => { known.delete(id); openTouch(undefined); setAmended(amended + 1); }} />}
    </main>
  );
}

const NOT_CHECKED = "Not checked for slip: steps that the linear stage lost in the touch would not have shown.";

/** A touch by its name, which opens its sweep. */
function TouchLink({ row, onOpen }: { row: TouchRow; onOpen: (row: TouchRow) => void }) {
  const name = row.phase === "blind" ? `blind ${row.repeat}` : `sample ${row.sample}, ${row.direction} ${degrees(row.angle_deg)}`;
  return <button type="button" class="link-button" onClick={() => onOpen(row)}>{name}</button>;
}

/** What to do with a run that was not completed. */
function Continue({ detail, view, onGivenUp }: { detail: RunDetail; view: View; onGivenUp: () => void }) {
  const [isChanged, setChanged] = useState(false);
  const [isGivingUp, setGivingUp] = useState(false);
  const state = view.model.rig?.state;
  const { touches_planned: planned, touches_not_reached: left } = detail.results;
  const why = state === "latched" ? "The rig is latched: acknowledge the fault first." : "The rig must be ready.";
  const go = (accept: boolean) => () => {
    const body: Body = { type: "application/json", text: JSON.stringify({ accept_changes: accept }) };
    return post(`runs/${detail.id}/continue`, body).then(() => { location.hash = "#/"; }, (error: unknown) => {
      if (isChange(error)) setChanged(true);
      throw error;
    });
  };
  return (
    <section class="card wide" aria-label="Continue">
      <h2>Not completed: {left} of {planned} touches are left</h2>
      <p class="soft">It goes on at the next touch without an outcome. You are asked for the sample and the sensor again, and the free resonance is measured again. Refused touches are not repeated.</p>
      <div class="buttons">
        <AskButton class="primary" icon="play" send={go(false)} disabled={state !== "idle" || view.link === "lost"} why={why}>Continue</AskButton>
        {isChanged && <AskButton send={go(true)} disabled={state !== "idle"} why={why}>Continue with these changes</AskButton>}
        <button type="button" onClick={() => setGivingUp(true)}>Give up…</button>
        {state !== "idle" && <span class="soft">{why}</span>}
      </div>
      {isGivingUp && <Confirm title="Give up this run?" yes="Give up" onClose={() => setGivingUp(false)} isDone={false}
        text="It is sealed as it is. What was measured stays, and the run cannot be continued any more."
        send={() => post(`runs/${detail.id}/give-up`).then(onGivenUp)} />}
    </section>
  );
}

/** A stiffness from another method, in the unit of the value beside it. */
const knownAs = (mpa: number, unit?: string) => ((unit ?? (mpa < 0.1 ? "kPa" : "MPa")) === "kPa" ? `${asWritten(mpa * 1000)} kPa` : `${asWritten(mpa)} MPa`);

function Downloads({ id, name }: { id: string; name: string }) {
  const base = `/api/v1/runs/${id}`;
  const [why, setWhy] = useState<string>();
  const load = (format: string, file: string) => open(`runs/${id}/export?format=${format}`, `${name}-${file}`)
    .then(() => setWhy(undefined), (error: unknown) => setWhy(`${file} could not be read: ${reasonOf(error)}`));
  const files: [string, string, string][] = [
    ["Touches, CSV", "csv", "touches.csv"], ["Sweeps, CSV", "sweeps", "sweeps.csv"],
    ["Readings, CSV", "readings", "readings.csv"], ["All tables, HDF5", "hdf5", "tables.h5"],
    ["All records, JSONL", "jsonl", "records.jsonl"],
  ];
  return (
    <div class="buttons">
      <a class="button primary" href={`${base}/report`} target="_blank" rel="noopener">Open report</a>
      {files.map(([label, format, file]) => <button key={format} type="button" onClick={() => void load(format, file)}><Icon name="down" size={16} />{label}</button>)}
      <a class="button" href={`#/protocols/${id}`}>Run again…</a>
      {why !== undefined && <p class="refusal" role="alert">{why}</p>}
    </div>
  );
}

function Matrix({ rows, samples, onOpen }: { rows: TouchRow[]; samples: string[]; onOpen: (row: TouchRow) => void }) {
  const directions = (["front", "back", "left"] as Direction[]).filter((d) => rows.some((row) => row.direction === d));
  const angles = [...new Set(rows.map((row) => row.angle_deg))].sort((a, b) => a - b);
  return (
    <div class="scroll"><table class="matrix">
      <thead>
        <tr><td></td>{directions.map((d) => <th key={d} scope="colgroup" colSpan={angles.length}>{d}</th>)}</tr>
        <tr><th scope="col">sample</th>{directions.flatMap((d) => angles.map((a) => <th key={`${d}${a}`} scope="col">{degrees(a)}</th>))}</tr>
      </thead>
      <tbody>{samples.map((sample, i) => (
        <tr key={sample}><th scope="row"><SampleMark index={i} /> {sample}</th>
          {directions.flatMap((d) => angles.map((a) => {
            const cells = rows.filter((row) => row.sample === sample && row.direction === d && row.angle_deg === a);
            return <td key={`${d}${a}`}>{cells.map((row) => <TouchCell key={row.step} row={row} label={undefined} onOpen={onOpen} />)}</td>;
          }))}</tr>
      ))}</tbody>
    </table></div>
  );
}

function TouchCell({ row, label, onOpen }: { row: TouchRow; label: string | undefined; onOpen: (row: TouchRow) => void }) {
  const [slip, jump] = [row.is_slip_checked === false, row.is_reference_steady === false];
  const mark = `${slip ? "†" : ""}${jump ? "‡" : ""}`;
  const text = label ?? (row.status === "measured" ? `${fixed(row.shift_hz ?? 0, 2)}${mark}` : row.status === "refused" ? "✕ refused" : row.status === "skipped" ? "skipped" : "not reached");
  const where = row.phase === "blind" ? `blind touch ${row.repeat}` : `sample ${row.sample}, ${row.direction} ${degrees(row.angle_deg)}`;
  const words = { "✓": "recognised", "✗": "taken for another sample", "·": "measured" }[text] ?? text;
  return <button type="button" class={`touch-cell ${row.status}${text === "✗" ? " wrong" : ""}`} title={row.reason ?? where} aria-label={`${where}: ${words}${slip ? ", not checked for slip" : ""}${jump ? ", the free resonance jumped after it" : ""}`} onClick={() => onOpen(row)}>{text}</button>;
}

/** The sweep behind a touch: its readings, and the circuit where one was found. */
function SweepDialog({ run, row, view, onClose, onAmended }: { run: RunDetail; row: TouchRow; view: View; onClose: () => void; onAmended: () => void }) {
  const [sweep, error] = useRead(async () => (row.sweep == null ? undefined : asLive(await get<Sweep>(`runs/${run.id}/sweeps/${row.sweep}`))), [row.step]);
  const outcome = sweep?.outcome;
  return (
    <dialog ref={(element) => { if (element && !element.open) element.showModal(); }} class="card sweep-dialog" aria-labelledby="sweep-title" onClose={onClose}>
      <h2 id="sweep-title">{row.phase === "blind" ? `Blind touch ${row.repeat}` : `Sample ${row.sample}`}, {row.direction} {degrees(row.angle_deg)}</h2>
      {outcome && ("reason" in outcome ? <p class="refusal">Refused: {outcome.reason}. No value is stored.</p>
        : <p>Resonance in contact {fixed(outcome.resonance_hz, 3)} ± {fixed(outcome.sigma_hz, 3)} Hz{row.shift_hz != null ? `, shift ${fixed(row.shift_hz, 3)} ± ${fixed(row.shift_sigma_hz ?? 0, 3)} Hz` : ""}.</p>)}
      {row.sweep == null && <p class="soft">{row.reason ?? "Not measured, so that there is no sweep."}</p>}
      {row.amended && <p class="soft">{row.amended}{row.earlier ? `; before: ${row.earlier}` : ""}</p>}
      {error !== undefined && <p class="refusal">{error}</p>}
      {sweep && <SweepPlots sweep={sweep} height={340} />}
      {sweep && sweep.estimates.length > 1 && <NarrowingPlot sweep={sweep} height={200} />}
      <Amend run={run} row={row} rig={view.model.rig} onDone={onAmended} />
      <div class="buttons"><button type="button" onClick={onClose}>Close</button></div>
      <DialogStop />
    </dialog>
  );
}

function asLive(sweep: Sweep): LiveSweep {
  const frequencies = sweep.readings.map((reading) => reading.frequency_hz);
  const accepted = sweep.outcome.status === "accepted" ? sweep.outcome : undefined;
  return {
    id: sweep.number, purpose: sweep.purpose, readings: sweep.readings, estimates: [],
    min_hz: Math.min(...frequencies), max_hz: Math.max(...frequencies), target_sigma_hz: 0, time_limit_s: 0,
    circuit: accepted?.circuit && { ...accepted.circuit, resonance_hz: accepted.resonance_hz },
    outcome: sweep.outcome.status === "accepted" ? { resonance_hz: sweep.outcome.resonance_hz, sigma_hz: sweep.outcome.sigma_hz } : { reason: sweep.outcome.reason },
  };
}
