import "uplot/dist/uPlot.min.css";
import "./style.css";
import { RefusedCard } from "./refused.tsx";
import { render } from "preact";
import { useEffect, useState } from "preact/hooks";
import { FaultCard, Progress, PromptCard, Running, SweepCard } from "./now.tsx";
import { Protocols } from "./protocols.tsx";
import { RigPage } from "./rig.tsx";
import { RunPage, Runs } from "./runs.tsx";
import { Band, isSingleKey, KeysDialog, LeaseLine, PauseKey, StateRow, TABS, Tabs, TokenDialog, type Tab } from "./shell.tsx";
import { follow, useView, type View } from "./store.ts";

interface Place { tab: Tab; id: string | undefined }

function placeOf(hash: string): Place {
  const [, tab, id] = hash.replace(/^#/, "").split("/");
  const known = TABS.find((t) => t.tab === tab)?.tab ?? "now";
  return { tab: known, id: id === undefined || id === "" ? undefined : decodeURIComponent(id) };
}

function Page() {
  const view = useView();
  const [place, setPlace] = useState(placeOf(location.hash));
  const [hasKeys, setKeys] = useState(false);
  useEffect(() => {
    const onHash = () => setPlace(placeOf(location.hash));
    const onKey = (event: KeyboardEvent) => {
      if (!isSingleKey(event)) return;
      const tab = TABS[Number(event.key) - 1];
      if (tab) location.hash = `#/${tab.tab}`;
      else if (event.key === "?") setKeys(true);
    };
    addEventListener("hashchange", onHash);
    addEventListener("keydown", onKey);
    return () => { removeEventListener("hashchange", onHash); removeEventListener("keydown", onKey); };
  }, []);
  const { rig } = view.model;
  useEffect(() => {
    const name = rig?.name ?? "rigd";
    const asked = rig?.asked;
    document.title = view.link === "lost" ? `✕ no link: ${name}`
      : asked ? `● ${asked.what === "place_sample" ? `Sample ${asked.sample}` : "Turn sensor"}: ${name}`
      : rig?.state === "latched" ? `■ Latched: ${name}` : name;
  }, [rig?.name, rig?.state, rig?.asked?.step, view.link]);
  return (
    <div class={`page${view.link === "lost" ? " old" : ""}${rig?.asked || rig?.fault ? " has-bar" : ""}`}>
      <a class="skip" href="#main">To the content</a>
      <Band view={view} tab={place.tab} />
      <StateRow view={view} />
      {rig?.run && <PauseKey key={rig.run.id} view={view} />}
      {rig?.lease && <LeaseLine name={rig.lease.name} />}
      {rig?.journal_error !== undefined && <p class="alarm" role="alert">The journal cannot be written: {rig.journal_error}. Nothing can begin. Check the disk of the data directory, and start rigd again when the probe is clear.</p>}
      {rig?.silence && <p class="alarm" role="alert">{rig.silence.message}. What to do: {rig.silence.hint}.</p>}
      <Screen view={view} place={place} />
      <Tabs tab={place.tab} place="bar" />
      {hasKeys && <KeysDialog onClose={() => setKeys(false)} />}
      {view.needsToken && <TokenDialog />}
    </div>
  );
}

function Screen({ view, place }: { view: View; place: Place }) {
  const { rig } = view.model;
  if (!rig) return <main id="main" class="waiting"><p class="soft">This page shows the rig as soon as rigd answers.</p></main>;
  // A prompt is answered on any page.
  if (rig.refused) return <main class="prompting" id="main"><RefusedCard view={view} refused={rig.refused} key={rig.state_since_s} /><Progress view={view} isSmall /></main>;
  if (rig.asked) return <main class="prompting" id="main"><PromptCard view={view} asked={rig.asked} key={rig.asked.step} /><Progress view={view} isSmall /></main>;
  if (rig.state === "latched" && place.tab === "now") return <FaultCard view={view} />;
  if (rig.run && place.tab === "now") return <Running view={view} />;
  if (place.tab === "runs") return place.id === undefined ? <Runs view={view} /> : <RunPage key={place.id} id={place.id} view={view} />;
  if (place.tab === "rig") return <RigPage view={view} />;
  if (place.tab === "now" && rig.state === "running") return <main id="main" class="idle"><SweepCard model={view.model} /></main>;
  // When nothing is under way, what comes next is a start.
  return <Protocols view={view} again={place.tab === "protocols" ? place.id : undefined} />;
}

const root = document.getElementById("page");
if (root) render(<Page />, root);
void follow();
