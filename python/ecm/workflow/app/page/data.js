// Stage 1: a table is dropped, read, drawn beside the mechanism, and checked.

import {post, upload, view} from "./api.js";
import {button, el, label, table} from "./dom.js";
import {draw as plot, scene} from "./plots.js";

export async function draw(root, state, app) {
  root.append(dropZone(state, app));
  if (state.imported && state.imported.sentences)
    root.append(...state.imported.sentences.map(text => el("p", {}, text)));
  if (state.check) root.append(...checkResult(state, app));
  else if (state.data.length || state.dropped) root.append(mapping(state, app));
  if (state.data.length && state.check) {
    const place = el("div", {class: "plot tall", role: "img",
      "aria-label": "Measured poses beside the undeformed body and the frames"});
    const said = el("p", {class: "soft"});
    root.append(el("h3", {}, "Measured poses"), said, place);
    const poses = await view("poses", state);
    said.textContent = "Positions of the top frame, in mm, beside the undeformed body. " + poses.said;
    await plot(place, ...scene(poses, null, ""));
  }
}

function dropZone(state, app) {
  const more = el("input", {type: "checkbox", id: "more"});
  const input = el("input", {type: "file", id: "file", multiple: true,
    onchange: () => take(input.files)});
  const take = files => app.act(async () => {
    for (const file of files) await upload(file, more.checked);
  });
  const zone = el("div", {class: "drop",
    ondragover: event => { event.preventDefault(); zone.classList.add("over"); },
    ondragleave: () => zone.classList.remove("over"),
    ondrop: event => {
      event.preventDefault();
      zone.classList.remove("over");
      take(event.dataTransfer.files);
    }},
  el("p", {}, "Drop a table here: CSV, Parquet, MAT or another log; its TOML after it."),
  el("label", {for: "file"}, "or choose a file "), input,
  state.data.length ? el("p", {}, more, el("label", {for: "more"}, " as another run of the same data"))
    : null);
  return zone;
}

function checkResult(state, app) {
  const check = state.check;
  const parts = [el("p", {class: "lead"},
    `${check.rows} rows, ${check.columns.length} columns; ${check.testable.length} effects can be `
    + "tested with them.")];
  for (const warning of check.warnings) {
    const open = state.pending.includes(warning);
    parts.push(el("div", {class: "error"}, warning, " ",
      open ? button("I take responsibility", () => app.act(() => post("/api/accept", {warning})))
        : el("em", {}, "taken on")));
  }
  for (const remark of check.remarks ?? []) parts.push(el("p", {class: "soft"}, remark));
  if (state.pending.length === 0)
    parts.push(el("div", {class: "row"},
      button("Go on to the model", () => app.go("model"), {class: "first", id: "to-model"})));
  parts.push(el("details", {}, el("summary", {}, "Columns"), table("Columns of the table",
    ["column", "from", "to", "distinct values", "what it is"],
    check.columns.map(c => [label(c.name), c.min, c.max, c.distinct, c.role]))));
  return parts;
}

function mapping(state, app) {
  const field = (id, text, hint) => [el("label", {for: id}, text), el("input", {id, placeholder: hint})];
  const map = el("textarea", {id: "map", rows: 4, cols: 50,
    placeholder: "x_m=Position X:mm\nfx_N=Force 1"});
  const value = id => document.getElementById(id).value.trim();
  const run = () => app.step("import", {
    map: map.value.split("\n").map(line => line.trim()).filter(Boolean),
    units: value("units"), rotation: value("rotation"),
  });
  return el("section", {}, el("h3", {}, "Columns of your own"),
    el("p", {}, "Names and units are guessed; what is stated here goes first, one column a line."),
    el("div", {class: "row"}, el("label", {for: "map"}, "Columns"), map),
    el("div", {class: "row"}, ...field("units", "Units where unstated", "mm,deg,N,N mm"),
      ...field("rotation", "Rotation", "wxyz, xyzw, rotvec, ZYX, xyz")),
    button("Import", run, {class: "first"}));
}
