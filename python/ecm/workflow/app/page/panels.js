// The residual of every component against one variable: menus, panels, and the rows marked in all.

import {glide} from "./canvas.js";
import {column, label} from "./columns.js";
import {button, choices, copy, el} from "./dom.js";
import {help, term} from "./help.js";
import {panel} from "./panel.js";
import {mark, marked, onMark, untilForgotten} from "./selection.js";

const KINDS = {noise: "over noise", wrench: "wrench", pose: "as pose error"};
const LISTED = 400;
// The variable and the kind stay chosen in the next stage.
const last = {variable: null, kind: null};

// `moved`: where the points of a component lie under what is looked at, at some places; null: where they were measured.
export function residualPanels(residuals, {moved = () => null, places = [], onglide = () => {}, leave = null} = {}) {
  const variable = el("select", {id: "variable", onchange: () => { last.variable = variable.value; show(); }},
    residuals.strongest.map((name, i) => el("option", {value: name},
      label(name) + (i === 0 && residuals.follows.length ? " (strongest)" : ""))));
  if (residuals.strongest.includes(last.variable)) variable.value = last.variable;
  let kind = last.kind in residuals.kinds ? last.kind : Object.keys(residuals.kinds)[0], panels = [], end = () => {};
  const kinds = choices("Show the error", "kind-of-residual",
    Object.keys(residuals.kinds).map(name => [name, KINDS[name]]), value => { kind = last.kind = value; show(); }, kind);
  const grid = el("div", {class: "panels", role: "group", "aria-label": "Residuals of each component"});
  const live = el("p", {class: "hidden", "aria-live": "polite"});
  const rows = el("div", {class: "row marked"});
  const node = el("div", {},
    el("div", {class: "row"}, el("label", {for: "variable"}, "Against"), variable,
      el("span", {}, "shown"), kinds, help(KINDS[kind])),
    el("p", {class: "hint"}, ...residuals.kinds.wrench.floor ? ["The shaded band is the ", term("noise floor"), ". "] : [],
      "Bars at the right count the rows. Drag a box, or a finger sideways, to mark rows in all figures; arrow keys and space do the same."),
    rows, grid, live);
  const place = new Map(residuals.row.map((row, i) => [row, i]));
  const chosenIndices = () => [...marked].flatMap(row => place.has(row) ? [place.get(row)] : []);

  function show() {
    const chosen = residuals.kinds[kind], {words, unit, scale} = column(variable.value);
    const x = residuals.variables[variable.value].map(v => v === null ? null : v * scale);
    node.querySelector(".row .help").replaceWith(help(KINDS[kind]));
    while (panels.length < chosen.columns.length)
      panels.push(panel({onbrush, say: text => { live.textContent = text; }}));
    panels = panels.slice(0, chosen.columns.length);
    grid.replaceChildren(...panels.map(item => item.node));
    chosen.columns.forEach((name, j) => {
      const of = chosen.units?.[j] ?? "";
      panels[j].set({x, y: chosen.values[j], row: residuals.row, title: column(name).words,
        unit: of || "times the noise", yTitle: of ? `[${of}]` : "[times the noise]",
        xTitle: unit ? `${words} [${unit}]` : words, floor: chosen.floor?.[j] ?? null,
        onesided: kind === "pose"});
    });
    showMarks();
    look();
  }

  // Null: the page took the finger, and the marks stay as they were.
  function onbrush(indices, done) {
    if (!indices) showMarks();
    else if (done) mark(indices.map(i => residuals.row[i]));
    else for (const item of panels) item.mark(indices);
  }

  function showMarks() {
    const indices = chosenIndices(), list = [...marked].sort((a, b) => a - b);
    for (const item of panels) item.mark(indices);
    if (!list.length) {
      rows.replaceChildren(el("span", {class: "hint"}, "No row is marked."));
      return;
    }
    const text = list.slice(0, LISTED).join(", ") + (list.length > LISTED ? " …" : "");
    rows.replaceChildren(...[el("output", {id: "marked-rows"},
      `${list.length} ${list.length === 1 ? "row" : "rows"} marked: ${text}`),
    button("Copy numbers", () => copy(list.join(", "), said => { live.textContent = said; })),
    leave ? button("Leave them out and fit again (X)", () => leave(list), {id: "leave-out"}) : null, button("Clear", () => mark([]))].filter(Boolean));
  }

  // One key for the marked rows, wherever the focus is but where a person writes.
  function onkey(event) {
    if (event.key.toLowerCase() === "x" && marked.size && !event.ctrlKey && !event.metaKey && !event.altKey
      && !event.target.matches("input:not([type=checkbox]):not([type=radio]), select, textarea")) leave([...marked].sort((a, b) => a - b));
  }
  if (leave) document.addEventListener("keydown", onkey, untilForgotten());

  // Lets the points slide to where they lie now.
  function look() {
    end();
    panels.forEach((item, j) => item.aim(moved(kind, j), places));
    end = glide(share => {
      for (const item of panels) item.slide(share);
      onglide(share);
    });
  }

  onMark(showMarks);
  return {node, show, look};
}
