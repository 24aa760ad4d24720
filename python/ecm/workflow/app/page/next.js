// Stage 6: the experiments that would tell more, with their minutes and chances.

import {busy} from "./api.js";
import {effectName, readable} from "./columns.js";
import {button, el} from "./dom.js";
import {help} from "./help.js";
import {live, measures} from "./live.js";
import {untestable} from "./missing.js";

// Why no experiment is proposed.
const NONE = {
  named: "No further experiment is needed for this verdict.",
  none: "No further experiment is needed for this verdict.",
  ambiguous: "No experiment of the catalogue tells these effects apart: measure again with what the list below says to record.",
  unknown: "No experiment of the catalogue would name an unknown cause. Write an effect of your own (“What is missing” has a draft), "
    + "or measure again with a column more: what this table cannot test says what to record.",
};

export function draw(root, state, app) {
  const found = state.diagnosis, off = busy(state);
  if (measures(state)) root.append(live(state));
  if (found.next_experiment.length) {
    root.append(el("ol", {class: "effects", "aria-label": "Experiments, the best first"},
      found.next_experiment.map((item, i) => experiment(item, i))));
  } else {
    const family = found.family;
    root.append(el("p", {class: "lead"}, family
      ? `To see the form of what follows ${readable(family.driver)}: ${family.experiment} (${family.minutes} min).` : NONE[found.verdict]));
  }
  for (const item of found.look_alikes ?? [])
    root.append(el("p", {class: "rests"}, `${effectName(item.id)} looks the same as ${item.what}. To tell them apart: ${item.apart}.`));
  if (state.next_plan) {
    root.append(el("div", {class: "row"},
      el("a", {href: `/files/${state.next_plan}`, download: true}, "Download the plan (CSV)"),
      state.simulated ? button("Run it on the simulated rig", () => app.step("campaign"),
        {class: "first", id: "campaign", disabled: off}) : null),
    el("p", {class: "hint"}, state.simulated
      ? "The readings of the rig are drawn as they come, and become another run of the table. Then fit again."
      : "Measure the plan on your rig, then drop the new table under “Data” as another run of the same data."));
  }
  root.append(...[untestable(found.not_testable)].filter(Boolean));
  root.append(button("To the results", () => app.go("out"), {id: "to-out"}));
}

function experiment(item, i) {
  const chance = item.p_correct, fill = el("i");
  fill.style.width = `${100 * (chance ?? 0)}%`;
  return el("li", {class: i === 0 ? "named" : ""},
    el("div", {}, el("strong", {}, readable(item.action)), i === 0 ? el("span", {class: "tag verdict"}, "best") : null,
      chance === null || chance === undefined ? null
        : el("div", {class: "gain"}, el("b", {}, fill), `${Math.round(100 * chance)} %`)),
    el("div", {}, `${item.minutes} min`, help("chance")));
}
