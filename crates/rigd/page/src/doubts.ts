// What the report of a run holds against its values.
import type { RunDetail } from "./wire.ts";

/** Each in a sentence; the report has the reasons. */
export function doubts({ results }: RunDetail): string[] {
  const jumped = results.touch_results.filter((row) => row.is_reference_steady === false).length;
  const verdict = results.model?.verdict;
  const isChecked = results.daily_check == null || results.daily_check.verdict === "accepted";
  const all: [boolean, string][] = [
    [!results.is_sound, "The checker found something in the journal: do not use the results before it is explained."],
    [verdict === "rejected", "The model is rejected: every stiffness is by a model that these touches contradict."],
    [verdict === "strained", "The model is strained: the residuals add to the uncertainty of every stiffness."],
    [results.calibration?.is_beyond_description === true, "The factor of the known samples is not that of the description of the sensor."],
    [!isChecked, `The last daily check of the bench before the run says: ${results.daily_check?.verdict ?? ""}.`],
    [jumped > 0, `‡ The free resonance jumped after ${jumped} ${jumped === 1 ? "touch" : "touches"}, before the next reference: the shift may be wrong by it.`],
  ];
  return all.flatMap(([is, text]) => (is ? [text] : []));
}
