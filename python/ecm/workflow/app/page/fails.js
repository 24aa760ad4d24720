// Stage 3: the residual in the workspace and against every variable; a brush marks rows everywhere.

import {view} from "./api.js";
import {button, el, label, table} from "./dom.js";
import {axis, colours, draw as plot, scene} from "./plots.js";
import {mark, marked, onMark} from "./selection.js";

export async function draw(root, state, app) {
  root.append(el("p", {class: "lead"}, state.compare.sentence));
  const waiting = el("p", {class: "soft"}, "Computing the residuals …");
  root.append(waiting);
  const [residuals, poses] = await Promise.all([view("residuals", state), view("poses", state)]);
  waiting.remove();
  const space = el("div", {class: "plot", role: "img",
    "aria-label": "Measured poses coloured by the size of their residual"});
  const rows = el("p", {class: "soft", "aria-live": "polite"});
  root.append(el("p", {}, residuals.sentence, " ", residuals.said), rows,
    el("h3", {}, "In the workspace"), space);
  const panels = residualPanels(residuals, state);
  root.append(panels.node,
    table("The worst rows of the table", ["row", "residual over noise", "component"],
      residuals.worst.map(item => [item.row, item.whitened, label(item.component)])),
    el("div", {class: "row"},
      button("What is missing?", () => app.go("missing"), {class: "first", id: "to-missing"})));
  const size = new Map(residuals.row.map((row, i) => [row, residuals.size[i]]));
  const draw3d = () => plot(space, ...scene(poses, poses.row.map(row => size.get(row) ?? null),
    "residual / noise", marked));
  onMark(() => {
    rows.textContent = marked.size
      ? `${marked.size} rows marked: ${[...marked].slice(0, 20).join(", ")}` : "";
    draw3d();
    panels.show();
  });
  await draw3d();
  space.on("plotly_click", event => {
    const row = event.points[0].customdata;
    if (row !== undefined) mark([row]);
  });
  await panels.show();
}

// Panels of all components against one variable, with menus for variable and kind.
export function residualPanels(residuals, state, preview = null) {
  const select = (id, entries) => el("select", {id, onchange: () => show()},
    entries.map(([value, text]) => el("option", {value}, text)));
  const variable = select("variable", residuals.strongest.map(name => [name, label(name)]));
  const kind = select("kind-of-residual",
    Object.entries(residuals.kinds).map(([name, item]) => [name, item.label]));
  const place = el("div", {class: "plot tall", role: "img",
    "aria-label": "Residual of each component against the chosen variable"});
  const node = el("div", {},
    el("div", {class: "row"}, el("label", {for: "variable"}, "Residual against"), variable,
      el("label", {for: "kind-of-residual"}, "shown"), kind,
      el("span", {class: "soft"}, "Drag a box or a lasso to mark rows; double click to clear.")),
    place);
  let wired = false;

  async function show() {
    const chosen = residuals.kinds[kind.value], x = residuals.variables[variable.value];
    const n = chosen.columns.length, columns = Math.min(3, n), {mark: blue, second, soft} = colours();
    const layout = {grid: {rows: Math.ceil(n / columns), columns, pattern: "independent"},
      dragmode: "select", annotations: [], shapes: [], uirevision: variable.value + kind.value};
    const data = [];
    chosen.columns.forEach((name, j) => {
      const suffix = j ? String(j + 1) : "", unit = chosen.units?.[j] ?? chosen.unit;
      layout[`xaxis${suffix}`] = axis(j >= n - columns ? label(variable.value) : "");
      layout[`yaxis${suffix}`] = axis(chosen.units ? `${name.split("_").slice(0, -1).join("_") || name} [${unit}]`
        : `${name.split("_").slice(0, -1).join("_") || name} / noise`);
      data.push({type: "scatter", mode: "markers", x, y: chosen.values[j], customdata: residuals.row,
        xaxis: `x${suffix}`, yaxis: `y${suffix}`,
        selectedpoints: marked.size
          ? residuals.row.flatMap((row, i) => marked.has(row) ? [i] : []) : null,
        selected: {marker: {color: second, size: 9}}, unselected: {marker: {opacity: 0.3}},
        marker: {size: 5, symbol: "circle-open", color: blue},
        hovertemplate: `row %{customdata}: %{y:.3g} ${unit} at %{x:.4g}<extra></extra>`});
      const floor = chosen.floor?.[j];
      if (floor) for (const sign of [-1, 1])
        layout.shapes.push({type: "line", xref: `x${suffix} domain`, yref: `y${suffix}`, x0: 0, x1: 1,
          y0: sign * floor, y1: sign * floor, line: {dash: "dot", width: 1, color: soft}});
      const explained = preview?.(chosen, j);
      if (explained) data.push({type: "scatter", mode: "markers", x, y: explained,
        xaxis: `x${suffix}`, yaxis: `y${suffix}`, hoverinfo: "skip",
        marker: {size: 6, symbol: "cross-thin-open", color: second}});
    });
    await plot(place, data, layout);
    if (!wired) {
      wired = true;
      place.on("plotly_selected", event => event
        && mark(event.points.map(point => point.customdata).filter(row => row !== undefined)));
      place.on("plotly_deselect", () => mark([]));
    }
  }
  return {node, show};
}
