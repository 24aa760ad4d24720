// Stage 5: the ladder of errors, its parameters, undo, and the sealed truth.

import {button, el, number, table} from "./dom.js";
import {axis, colours, draw as plot} from "./plots.js";

export async function draw(root, state, app) {
  const history = state.fit?.history ?? [];
  const place = el("div", {class: "plot", role: "img", "aria-label": "Error over noise of each fit"});
  root.append(el("p", {}, "Each fit is a rung: its error over the noise, on the fitted rows and on "
    + "poses that were held out. 1 is the noise floor."), place);
  const names = history.length ? history.map(item => item.name) : state.rungs.map(item => item.name);
  root.append(table("The ladder of errors, in units of the noise", ["fit", "fitted rows", "held out", "test"],
    history.length
      ? history.map(item => [item.name, item.train, item.held_out, item.test])
      : state.rungs.map(item => [item.name, item.train, null, ""])));
  for (const effect of state.fit?.effects ?? []) {
    root.append(table(`${effect.id}${effect.frozen ? ", frozen" : ""}`,
      ["parameter", "value", "± standard deviation", "unit"],
      effect.parameters.map(p => [p.name, p.value, p.sd, p.unit])),
    el("div", {class: "row"},
      button(`Remove ${effect.id}`, () => app.step("refit", {remove: [effect.id]})),
      effect.frozen ? null : button(`Freeze ${effect.id}`, () => app.step("refit", {freeze: [effect.id]}))));
  }
  if (state.sealed) root.append(sealed(state, app));
  const {mark, second, soft} = colours(), x = names.map((name, i) => `${i + 1} ${name}`);
  const line = (key, name, color, symbol, dash) => ({type: "scatter", mode: "lines+markers", x, name,
    y: history.length ? history.map(item => item[key]) : state.rungs.map(item => item[key] ?? null),
    marker: {size: 10, symbol, color}, line: {color, dash}});
  await plot(place, [line("train", "fitted rows", mark, "circle", "solid"),
    line("held_out", "held out", second, "square", "dash")],
  {showlegend: true, legend: {orientation: "h", y: 1.12}, xaxis: axis("", {type: "category"}),
    yaxis: axis("error over noise", {rangemode: "tozero"}),
    shapes: [{type: "line", xref: "paper", x0: 0, x1: 1, y0: 1, y1: 1,
      line: {dash: "dot", color: soft}}],
    annotations: [{xref: "paper", x: 1, y: 1, text: "noise floor", showarrow: false, yshift: 10,
      xanchor: "right"}]});
}

function sealed(state, app) {
  if (state.truth) {
    return el("p", {class: "lead", id: "truth"}, "Hidden was: ", state.truth.effects.map(effect =>
      `${effect.id} (${effect.parameters.size !== undefined
        ? `${number(effect.parameters.size)} ${effect.parameters.unit}` : ""})`).join(", ") || "nothing",
    state.truth.score ? `. The diagnosis was ${state.truth.score.correct ? "right" : "wrong"}.` : ".");
  }
  return el("div", {class: "row"},
    button("Open the sealed truth", () => app.step("reveal"), {id: "reveal"}),
    el("span", {class: "soft"}, "shows what was hidden in the simulated campaign, and spoils the game"));
}
