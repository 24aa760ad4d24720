// Stage 3: the residual in the workspace and against every variable; a brush marks rows everywhere.

import {view} from "./api.js";
import {button, el, number, table, waiting} from "./dom.js";
import {column, effectName, label, readable} from "./columns.js";
import {help} from "./help.js";
import {knowsNoise, share} from "./noise.js";
import {residualPanels} from "./panels.js";
import {hasSpace, workspace} from "./scene.js";
import {mark} from "./selection.js";
import {versus} from "./versus.js";

export async function draw(root, state, app) {
  root.append(el("p", {class: "lead"}, readable(state.compare.sentence)));
  const wait = waiting("Computing the residuals …");
  root.append(wait);
  const first = state.rungs.length > 1 ? state.rungs[0] : null;
  const [residuals, poses, before] = await Promise.all([view("residuals", state), view("poses", state),
    first && view("residuals", state, first.model)]);
  wait.remove();
  root.append(el("p", {class: "rests"}, readable(residuals.sentence), help("signature"), " ", residuals.said),
    figures(state, residuals),
    versus(residuals, effectName(state.rungs.at(-1).name), {before: first && {residuals: before, name: effectName(first.name)}}).node);
  const panels = residualPanels(residuals, {leave: app.leaveOut});
  // A table of one axis has no picture in space: the figures take its place.
  const place = hasSpace(residuals.variables) && el("section", {"aria-label": "The mechanism in its measured poses"},
    workspace(poses, residuals.row, residuals.variables, residuals.size,
      {title: "largest residual", unit: knowsNoise(state) ? "times the noise" : "times the model's own error", name: "Measured poses, coloured by residual",
        gap: gapOf(residuals)}));
  root.append(el("div", {class: place ? "split" : ""},
    place ? el("div", {class: "sticky"}, el("h3", {}, "In the workspace"), place) : null,
    el("section", {"aria-label": "Residuals over a variable"}, el("h3", {}, "Residual over every variable", help("residual")), panels.node)),
  worst(residuals, knowsNoise(state)),
  el("div", {class: "row"}, button("What is missing?", () => app.go("missing"), {class: "first", id: "to-missing"})));
  panels.show();
}

export const gapOf = residuals => residuals.kinds.pose ? {now: residuals.change} : null;

function figures(state, residuals) {
  const {whitened_rms: error, pose_error: pose, rmse} = state.compare;
  const value = (size, unit, text, name) => el("div", {class: "card"},
    el("div", {class: "value"}, size, " ", el("small", {}, unit)), el("div", {class: "soft"}, text, help(name)));
  return el("div", {class: "cards values"},
    ...knowsNoise(state) ? [value(error.toFixed(2), "times the noise", "error of the model", "over noise")] : unknown(state, rmse, value),
    pose?.position_mm ? value(pose.position_mm.median.toFixed(2), "mm, median", "position that is off", "as pose error") : null,
    pose?.rotation_deg ? value(pose.rotation_deg.median.toFixed(2), "deg, median", "rotation that is off", "as pose error") : null,
    value(String(state.compare.rows), "rows", "measured poses compared", "pose"));
}

// Without a noise: the largest error of a force and of a moment, and the share of the spread.
function unknown(state, rmse, value) {
  const largest = unit => Object.entries(rmse).filter(([name]) => column(name).unit === unit).sort((a, b) => b[1] - a[1])[0];
  const sized = ["N", "N m"].flatMap(unit => {
    const found = largest(unit);
    return found ? [value(number(found[1]), unit, `error of the model, ${column(found[0]).words}`, "noise not known")] : [];
  });
  const own = share(state, rmse);
  return own === null ? sized : [...sized, value(number(own), "% of the spread", "error of the model", "noise not known")];
}

function worst(residuals, known) {
  const press = row => ({tabindex: "0", onclick: () => mark([row]),
    onkeydown: event => { if (event.key === "Enter") mark([row]); }});
  return el("details", {}, el("summary", {}, "The rows with the largest residual"),
    table("Click on a row, or press Enter, to mark it in the figures",
      ["row", `residual [times the ${known ? "noise" : "model's own error"}]`, "component"],
      residuals.worst.map(item => [item.row, item.whitened, label(item.component)]),
      {row: i => press(residuals.worst[i].row)}));
}
