// Stage 6: the experiments that would tell more, with their minutes and chances.

import {button, el, table} from "./dom.js";

export function draw(root, state, app) {
  const found = state.diagnosis;
  if (found.next_experiment.length) {
    root.append(table("Experiments, the best first", ["what to do", "minutes", "chance to be right"],
      found.next_experiment.map(item => [item.action, item.minutes, item.p_correct])));
  } else {
    root.append(el("p", {class: "lead"}, "No further experiment is needed for this verdict."));
  }
  for (const item of found.look_alikes ?? [])
    root.append(el("p", {}, el("strong", {}, item.id), `: ${item.what}. To tell: ${item.apart}.`));
  if (state.next_plan) {
    root.append(el("div", {class: "row"},
      el("a", {href: `/files/${state.next_plan}`, download: true}, "Download the plan"),
      state.simulated ? button("Run it on the simulated rig", () => app.step("campaign"),
        {class: "first", id: "campaign", disabled: Boolean(state.running)}) : null));
  }
}
