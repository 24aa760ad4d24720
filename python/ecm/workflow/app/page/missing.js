// Stage 4: the verdict, and every effect with what it would explain.

import {view} from "./api.js";
import {button, el, number} from "./dom.js";
import {residualPanels} from "./fails.js";
import {onMark} from "./selection.js";

export async function draw(root, state, app) {
  const found = state.diagnosis;
  root.append(found
    ? el("p", {class: "lead", id: "verdict", "data-verdict": found.verdict}, found.sentence)
    : el("div", {class: "row"}, button("Diagnose", () => app.step("diagnose"),
      {class: "first", id: "diagnose", disabled: Boolean(state.running)}),
    el("span", {class: "soft"}, "tests every effect of the catalogue on these rows")));
  if (found) for (const warning of found.warnings) root.append(el("p", {class: "error"}, warning));
  const waiting = el("p", {class: "soft"}, "Computing what each effect would explain …");
  root.append(waiting);
  const [effects, residuals] = await Promise.all([view("effects", state), view("residuals", state)]);
  waiting.remove();

  let hovered = null;
  const place = new Map(effects.row.map((row, i) => [row, i]));
  const panels = residualPanels(residuals, state, (chosen, j) => {
    if (hovered === null || chosen === residuals.kinds.pose) return null;
    const values = effects.effects[hovered].values[j];
    const scale = chosen === residuals.kinds.noise ? noiseOf(residuals, j) : null;
    return residuals.row.map((row, i) => {
      const at = place.get(row);
      return at === undefined ? null : values[at] / (scale ? scale[i] : 1);
    });
  });
  onMark(() => panels.show());
  const look = id => { if (hovered !== id) { hovered = id; panels.show(); } };
  const named = new Set((found?.answer ?? []).flat());
  const ranks = new Map((found?.ranking ?? []).map(item => [item.id, item]));
  const list = el("ul", {class: "effects", "aria-label": "Effects that can be tested"},
    Object.entries(effects.effects).map(([id, item]) => {
      const rank = ranks.get(id);
      return el("li", {class: named.has(id) ? "named" : "", onmouseenter: () => look(id),
        onfocusin: () => look(id)},
      el("div", {}, el("strong", {}, id), named.has(id) ? " (the verdict)" : "",
        el("div", {class: "soft"}, item.what),
        rank ? el("small", {}, `${rank.parameter ?? "size"} ${number(rank.size)} ± ${number(rank.sd)} `
          + `${rank.unit}, p = ${number(rank.p, 2)}`) : null),
      el("meter", {min: 0, max: 1, value: Math.max(0, item.share), title: "share of the residual",
        "aria-label": `${id} explains ${Math.round(100 * item.share)} % of the residual`}),
      button("Add", () => { app.go("add"); return app.step("refit", {add: [id]}); },
        {"data-add": id, "aria-label": `Add ${id} and fit again`, disabled: Boolean(state.running)}));
    }));
  root.append(
    el("p", {}, "Point at an effect: the crosses show what it would explain, before it is added."),
    panels.node, el("h3", {}, "Effects that can be tested"), list);
  if (found) root.append(untestable(found));
  await panels.show();
}

// The noise of each row, from the residual in both units.
function noiseOf(residuals, j) {
  const {noise, wrench} = residuals.kinds;
  return wrench.values[j].map((value, i) => value / noise.values[j][i]);
}

function untestable(found) {
  return el("details", {}, el("summary", {}, `Not testable with these data (${found.not_testable.length})`),
    el("ul", {}, found.not_testable.map(item =>
      el("li", {}, el("strong", {}, item.id), `: ${item.reason}; record ${item.record}`))));
}
