// The columns of a dropped file: what each of them is, as guessed, or as the person says.

import {busy, get} from "./api.js";
import {column} from "./columns.js";
import {button, el, number, waiting} from "./dom.js";
import {term} from "./help.js";
import {POSE, WRENCH} from "./scene.js";

const UNITS = {m: ["mm", "m", "cm", "in"], rad: ["deg", "rad"], N: ["N", "kN", "mN", "gf", "lbf"],
  Nm: ["N m", "N mm", "gf cm", "lbf in"], s: ["s", "ms", "min"], degC: ["degC", "K"]};
const ROTATIONS = [["", "guess"], ["rotvec", "rotation vector"], ["wxyz", "quaternion w x y z"], ["xyzw", "quaternion x y z w"],
  ["xyz", "angles about fixed x, y, z"], ["XYZ", "angles about turning x, y, z"], ["zyx", "angles about fixed z, y, x"],
  ["ZYX", "angles about turning z, y, x"]];
const ROTATION_WORDS = ["rotation", "euler", "clinical", "quaternion", "matrix"];
const AXES = [["", "none"], ["x", "x"], ["y", "y"], ["z", "z"]];
const options = (entries, chosen = "") => entries.map(([value, text]) => el("option", {value, selected: value === chosen}, text));
const UNUSED = "-", OWN = "own";
// A name that no reader takes for a pose or a wrench; columns that differ in signs only differ by their place.
const ownName = (name, columns) => {
  const plain = text => `own_${text.replace(/[^A-Za-z0-9]+/g, "_").replace(/^_|_$/g, "").toLowerCase()}`;
  const alike = columns.filter(other => plain(other.name) === plain(name));
  return alike.length > 1 ? `${plain(name)}_${alike.findIndex(other => other.name === name) + 1}` : plain(name);
};
const kindOf = name => name.slice(name.lastIndexOf("_") + 1);

// What was chosen for these files stays when the page is drawn again, as after an import that failed.
let kept = {};

export function mapping(state, app) {
  const files = state.dropped.join("\n");
  if (kept.files !== files) kept = {files};
  const place = el("div", {}, waiting("Reading the names of the columns …")), picks = [];
  const map = el("textarea", {id: "map", rows: 3, cols: 40, placeholder: "x_m=Position X:mm\nfx_N=Force 1"});
  const keep = node => {
    if (kept[node.id] !== undefined) node.value = kept[node.id];
    node.addEventListener("change", () => { kept[node.id] = node.value; });
    return node;
  };
  const value = id => document.getElementById(id).value.trim();
  const run = () => app.step("import", {
    ignore: picks.flatMap(pick => pick().ignore ?? []),
    map: [...picks.flatMap(pick => pick().map ?? []), ...map.value.split("\n").map(line => line.trim()).filter(Boolean)],
    units: value("units"), rotation: value("rotation"), axis: value("axis"), group: value("group"),
  });
  const names = el("datalist", {id: "group-names"});
  get("/api/view/log").then(found => {
    place.replaceChildren(listed(found.columns, picks));
    names.append(...found.columns.map(item => el("option", {value: item.name})));
  },
    error => place.replaceChildren(el("p", {class: "soft"}, `The columns cannot be listed: ${error.message}`)));
  return el("section", {"aria-label": "Columns of the file"}, el("h3", {}, "What the columns are"),
    state.dropped.length > 1 ? el("p", {id: "dropped"}, `${state.dropped.length} files, read in the same way and joined as runs: `
      + `${state.dropped.join(", ")}.`) : null,
    el("p", {}, "Names and units are guessed; what you choose here goes first. A table needs at least one column of the ",
      term("pose"), " and one of the ", term("wrench"), "."), place,
    el("div", {class: "row"}, el("label", {for: "rotation"}, "The rotation is"), keep(el("select", {id: "rotation"}, options(ROTATIONS))),
      el("label", {for: "axis"}, "Axis of columns that name none"), keep(el("select", {id: "axis"}, options(AXES))),
      el("label", {for: "units"}, "Units where unstated"), keep(el("input", {id: "units", placeholder: "mm,deg,N,N mm"})),
      el("label", {for: "group"}, "Column that tells experiments apart"),
      keep(el("input", {id: "group", list: "group-names", placeholder: "none: one experiment"})), names),
    el("details", {}, el("summary", {}, "Write it instead, one column a line, as NAME=COLUMN:UNIT"),
      el("div", {class: "row"}, el("label", {for: "map"}, "Columns"), keep(map))),
    button("Import", run, {class: "first", id: "import", disabled: busy(state)}));
}

function listed(columns, picks) {
  const names = [...POSE, ...WRENCH, "time_s", "temperature_degC"];
  return el("ul", {class: "mapped", "aria-label": "Columns of the file: what each is, and its unit"},
    columns.map(item => {
      const turned = ROTATION_WORDS.includes(item.quantity);
      const guess = item.standard ? column(item.standard).words : turned ? "rotation" : item.quantity ? `${item.quantity}, which axis?` : "your own";
      const unit = el("select", {"aria-label": `Unit of ${item.name}`, onchange: () => { kept[`unit ${item.name}`] = unit.value; }});
      const what = el("select", {"aria-label": `What ${item.name} is`, onchange: () => {
        kept[`what ${item.name}`] = what.value;
        units();
      }}, options([["", `guess: ${guess}`], [UNUSED, "not used"], ...item.standard || item.quantity ? [[OWN, "your own"]] : [], ...names.map(name => [name, column(name).words])], kept[`what ${item.name}`]));
      const units = () => {
        const said = [UNUSED, OWN].includes(what.value);
        const standard = said ? "" : what.value || item.standard, own = said ? [] : standard ? UNITS[kindOf(standard)] ?? [] : turned ? UNITS.rad : [];
        unit.replaceChildren(...options([["", item.unit ? `stated: ${item.unit}` : own.length ? "not stated" : "–"],
          ...own.map(word => [word.replaceAll(" ", ""), word])], kept[`unit ${item.name}`]));
        unit.disabled = !own.length || (!standard && turned);
      };
      units();
      picks.push(() => {
        if (what.value === UNUSED) return {ignore: [item.name]};
        const standard = what.value === OWN ? ownName(item.name, columns) : what.value || (unit.value ? item.standard : "");
        return standard ? {map: [`${standard}=${item.name}${what.value !== OWN && unit.value ? `:${unit.value}` : ""}`]} : {};
      });
      return el("li", {}, el("div", {}, el("strong", {}, item.name), " ",
        el("span", {class: "soft"}, `${number(item.range[0])} to ${number(item.range[1])}`)), what, unit);
    }));
}
