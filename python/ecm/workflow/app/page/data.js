// Stage 1: a table is dropped, read, drawn beside the mechanism, and checked.

import {busy, idle, post, upload, view} from "./api.js";
import {column, label, measured, ownFiles, readable} from "./columns.js";
import {describe} from "./describe.js";
import {button, el, number, table, waiting} from "./dom.js";
import {term} from "./help.js";
import {live, measures} from "./live.js";
import {mapping} from "./mapping.js";
import {hasSpace, workspace} from "./scene.js";
import {asMeasured, versus} from "./versus.js";

export async function draw(root, state, app) {
  if (measures(state)) root.append(live(state));
  else if (!state.data.length && !state.dropped.length) root.append(empty(state, app));
  if (state.check) root.append(...checkResult(state, app));
  if (!state.check && !measures(state) && state.running && (state.data.length || state.dropped.length))
    root.append(waiting("The table is being read and checked …"));
  const unread = !state.running && (!state.check || !measured(state.check));
  if (state.dropped.length && unread) root.append(mapping(state, app));
  if (state.imported) root.append(imported(state.imported));
  if (state.data.length && !measures(state)) root.append(describe(state, app));
  if (state.dropped.length && !unread) root.append(otherwise(state, app));
  if (state.data.length) root.append(el("p", {class: "rests", id: "tables"}, `Tables of this session: ${state.data.map(item => item.name).join(", ")}.`));
  if (state.data.length && state.check) await picture(root, state);
  if (state.data.length || state.dropped.length) root.append(el("details", {}, el("summary", {}, "Bring in another table"), dropZone(state, app)));
}

function empty(state, app) {
  const example = (name, text, style = "") => button(text, () => app.step("example", {name}),
    {class: style, id: `example-${name}`, disabled: busy(state)});
  return el("div", {}, dropZone(state, app), el("div", {class: "cards"},
    el("div", {class: "card"}, el("h3", {}, "No data yet?"),
      el("p", {}, "Begin with the example: a soft neck, a measured campaign of about 90 rows, and one hidden effect to find."),
      el("div", {class: "row"}, example("neck", "Open the neck", "first"))),
    el("div", {class: "card"}, el("h3", {}, "Simpler examples"),
      el("p", {}, "Tables as a rig of one, three or six degrees of freedom would write them."),
      el("div", {class: "row"}, example("1", "1 axis"), example("3", "3 axes"), example("6", "6 axes"))),
    el("div", {class: "card"}, el("h3", {}, "What a table needs"),
      el("p", {}, "One row per reading: at least one column of the ", term("pose"), " and one of the ", term("wrench"),
        ". Names and units are guessed: mm or m, degrees or radians, rotation vectors, quaternions or Euler angles."))));
}

function dropZone(state, app) {
  const more = el("input", {type: "checkbox", id: "more"});
  const input = el("input", {type: "file", id: "file", multiple: true, class: "hidden", tabindex: "-1", "aria-hidden": "true",
    onchange: () => take(input.files)});
  const told = el("p", {id: "upload", hidden: true, role: "status"});
  const take = files => app.act(async () => {
    // Tables or logs dropped together are runs of one; a description belongs to the last of them.
    const last = file => /\.toml$/i.test(file.name), given = [...files].sort((a, b) => last(a) - last(b));
    for (const [i, file] of given.entries()) {
      if (i) await idle();
      await upload(file, more.checked || i > 0, part => {
        told.hidden = false;
        told.textContent = `${file.name}: ${Math.round(100 * part)} % is here${given.length > 1 ? `, file ${i + 1} of ${given.length}` : ""}`;
      });
    }
  });
  const zone = el("div", {class: "drop",
    ondragover: event => { event.preventDefault(); zone.classList.add("over"); },
    ondragleave: () => zone.classList.remove("over"),
    ondrop: event => {
      event.preventDefault();
      zone.classList.remove("over");
      take(event.dataTransfer.files);
    }},
  el("p", {}, el("strong", {}, "Drop tables or logs here")),
  el("p", {class: "soft"}, "CSV, Parquet, MAT, HDF5, MCAP or another log, up to 2 GB; several become runs of one table. A description beside them "
    + "belongs to the last. Nothing leaves this machine."),
  button("Choose files", () => input.click(), {id: "choose"}), input, told,
  state.data.length ? el("p", {}, more, el("label", {for: "more"}, " as another run of the same data")) : null);
  return zone;
}

function checkResult(state, app) {
  const {check} = state, open = state.pending.length, parts = [];
  const bare = !measured(check);
  parts.push(el("p", {class: "lead"}, bare ? "No column is known as a pose and none as a wrench, or one of the two is missing: say below what the "
    + "columns are."
    : open ? `${open} ${open === 1 ? "warning" : "warnings"} to look at before going on.`
    : `The check passes: ${check.rows} rows, ${check.columns.length} columns, ${check.repeated_poses} poses measured more `
      + `than once; ${check.testable.length} effects can be tested.`));
  for (const warning of check.warnings) {
    const pending = state.pending.includes(warning);
    parts.push(el("div", {class: warning === check.misread?.sentence ? "error" : "warning"}, readable(warning), "\n",
      /\[leave_out\]: marked/.test(warning) && !pending ? el("em", {}, "Undo brings them back.") : pending ? button("I take responsibility for this", () => app.act(() => post("/api/accept", {warning})))
        : el("em", {}, "You took responsibility for this.")));
  }
  for (const remark of check.remarks ?? []) parts.push(el("p", {class: "soft"}, readable(remark)));
  parts.push(el("div", {class: "row"}, button("Go on to the model", () => app.go("model"),
    {class: "first", id: "to-model", disabled: open > 0 || bare})));
  return parts;
}

async function picture(root, state) {
  const {check} = state, found = el("section", {"aria-label": "Columns"}, el("h3", {}, "Columns"), columns(check));
  if (!measured(check)) {
    root.append(found);
    return;
  }
  const wait = waiting("Drawing the poses …");
  const side = el("section", {"aria-label": "Measured poses"}, el("h3", {}, "Measured poses, beside the ", term("frames")), wait);
  root.append(el("div", {class: "split"}, side, found));
  const poses = await view("poses", state);
  if (!hasSpace(poses.columns)) {
    const {node} = versus(asMeasured(poses.columns, poses.row), "");
    node.append(el("p", {class: "hint"}, poses.said));
    side.replaceWith(node);
    return;
  }
  const force = ["fx_N", "fy_N", "fz_N"].map(name => poses.columns[name]);
  const has = force.every(Boolean), any = Object.keys(poses.columns)[0];
  const size = has ? force[0].map((v, i) => Math.hypot(v, force[1][i], force[2][i])) : poses.columns[any] ?? [];
  wait.replaceWith(workspace(poses, poses.row, poses.columns, size, {
    title: has ? "force" : label(any), unit: has ? "N" : "", name: "Measured poses with their forces",
    forces: has}),
  el("p", {class: "hint"}, `Lines are the measured forces on the top. A wrong axis, sign or offset shows as bodies `
    + `that fold, or points away from the top of the body at rest. ${poses.said}`));
}

function columns(check) {
  const role = {covariate: "your own: offered as a cause"};
  return table("What was found; values in the units shown", ["column", "from", "to", "distinct values", "what it is"],
    check.columns.map(c => {
      const {scale} = column(c.name), of = v => typeof v === "number" ? number(v * scale) : v;
      return [label(c.name), of(c.min), of(c.max), c.distinct, role[c.role] ?? c.role];
    }));
}

// The file is read for its columns when somebody asks for them.
function otherwise(state, app) {
  const node = el("details", {ontoggle: () => {
    if (node.children.length === 1) node.append(mapping(state, app));
  }}, el("summary", {}, "Read the columns in another way"));
  return node;
}

function imported(found) {
  return el("details", {open: true}, el("summary", {}, `How the columns of ${ownFiles(found.source)} were read`),
    table("The table of the session, in metres, radians, N and N m", ["column", "read from"],
      Object.entries(found.columns).map(([name, from]) => [name, from])),
    el("ul", {}, (found.notes ?? []).map(text => el("li", {}, readable(text)))));
}
