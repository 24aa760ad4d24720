// Stage 3: the residual in the workspace and against every variable; a brush marks rows everywhere.

import {view} from "./api.js";
import {button, el, table, waiting} from "./dom.js";
import {label, readable} from "./columns.js";
import {help} from "./help.js";
import {residualPanels} from "./panels.js";
import {workspace} from "./scene.js";
import {mark} from "./selection.js";

export async function draw(root, state, app) {
  root.append(el("p", {class: "lead"}, readable(state.compare.sentence)));
  const wait = waiting("Computing the residuals …");
  root.append(wait);
  const [residuals, poses] = await Promise.all([view("residuals", state), view("poses", state)]);
  wait.remove();
  root.append(el("p", {class: "rests"}, readable(residuals.sentence), help("signature"), " ", residuals.said),
    figures(state, residuals));
  const panels = residualPanels(residuals);
  const place = el("section", {"aria-label": "The mechanism in its measured poses"},
    workspace(poses, residuals.row, residuals.variables, residuals.size,
      {title: "largest residual", unit: "times the noise", name: "Measured poses, coloured by residual"}));
  root.append(el("div", {class: "split"},
    el("div", {class: "sticky"}, el("h3", {}, "In the workspace"), place),
    el("section", {"aria-label": "Residuals over a variable"}, el("h3", {}, "Residual over every variable", help("residual")), panels.node)),
  worst(residuals),
  el("div", {class: "row"}, button("What is missing?", () => app.go("missing"), {class: "first", id: "to-missing"})));
  panels.show();
}

function figures(state, residuals) {
  const {whitened_rms: error, pose_error: pose} = state.compare;
  const value = (size, unit, text, name) => el("div", {class: "card"},
    el("div", {class: "value"}, size, " ", el("small", {}, unit)), el("div", {class: "soft"}, text, help(name)));
  return el("div", {class: "cards values"},
    value(error.toFixed(2), "times the noise", "error of the model", "over noise"),
    pose?.position_mm ? value(pose.position_mm.median.toFixed(2), "mm, median", "position that is off", "as pose error") : null,
    pose?.rotation_deg ? value(pose.rotation_deg.median.toFixed(2), "deg, median", "rotation that is off", "as pose error") : null,
    value(String(state.compare.rows), "rows", "measured poses compared", "pose"));
}

function worst(residuals) {
  const press = row => ({tabindex: "0", onclick: () => mark([row]),
    onkeydown: event => { if (event.key === "Enter") mark([row]); }});
  return el("details", {}, el("summary", {}, "The rows with the largest residual"),
    table("Click on a row, or press Enter, to mark it in the figures",
      ["row", "residual [times the noise]", "component"],
      residuals.worst.map(item => [item.row, item.whitened, label(item.component)]),
      {row: i => press(residuals.worst[i].row)}));
}
