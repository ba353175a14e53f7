// A cell for each touch of a plan, in groups, with what became of it and where a person is needed.
import type { Plan } from "./wire.ts";
import type { Touch } from "./model.ts";

export type CellState = "measured" | "refused" | "left out" | "now" | "to come";
export interface Cell { step: string; name: string; state: CellState; needsPerson: boolean }
export interface Group { label: string; cells: Cell[] }

export function timeline(plan: Plan, touches: ReadonlyMap<string, Touch>, now: string | undefined): Group[] {
  const groups: Group[] = [];
  let needsPerson = false;
  let isNowPassed = false;
  for (const step of plan.steps) {
    if (step.step === now) isNowPassed = true;
    if (step.action === "prompt") needsPerson = true;
    if (step.action !== "touch") continue;
    const label = step.phase === "blind" ? "blind" : `sample ${step.sample}`;
    let group = groups.at(-1);
    if (group?.label !== label) groups.push((group = { label, cells: [] }));
    const status = touches.get(step.step)?.status;
    // The touch that the step under way is, or belongs to.
    const outcome = status === "skipped" ? "left out" : status === "measured" || status === "refused" ? status : undefined;
    const isNow = isNowPassed && outcome === undefined;
    const state: CellState = outcome ?? (isNow ? "now" : "to come");
    if (isNow) isNowPassed = false;
    group.cells.push({ step: step.step, name: step.what_is_done, state, needsPerson });
    needsPerson = false;
  }
  return groups;
}

/** Groups laid out in rows of limited length; a group that is too long is cut. */
export function rows(groups: Group[], cellsMax: number): Group[][] {
  const out: Group[][] = [[]];
  let used = 0;
  for (const group of groups) {
    for (let from = 0; from < group.cells.length; from += cellsMax) {
      const cells = group.cells.slice(from, from + cellsMax);
      if (used + cells.length > cellsMax && used > 0) {
        out.push([]);
        used = 0;
      }
      out.at(-1)?.push({ label: from === 0 ? group.label : "", cells });
      used += cells.length + 1;
    }
  }
  return out;
}

export const wordsOf = (groups: Group[]): string => {
  const cells = groups.flatMap((group) => group.cells);
  const count = (state: CellState) => cells.filter((cell) => cell.state === state).length;
  const prompts = cells.filter((cell) => cell.needsPerson && cell.state === "to come").length;
  return `${cells.length} touches: ${count("measured")} measured, ${count("refused")} refused, ${count("left out") > 0 ? `${count("left out")} left out, ` : ""}${count("to come")} to come; a person is needed before ${prompts} of these.`;
};
