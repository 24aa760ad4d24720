// Stage 7: files, the exported controller, and the commands that do the same.

import {busy, text} from "./api.js";
import {ownFiles, readable} from "./columns.js";
import {button, choices, copy, el} from "./dom.js";
import {help} from "./help.js";
import {isCopy} from "./recorded.js";

const WHAT = [[/^script\.sh$/, "the commands as a script"], [/^steps\.jsonl$/, "journal of all steps"],
  [/^model-/, "model"], [/^compare-.*html$/, "report: where it fails"], [/^found-.*html$/, "report: what is missing"],
  [/^(data|upload)-.*csv$/, "table"], [/^next-/, "plan of the next experiment"], [/^(fit|refit)-/, "fit report"],
  [/^check-/, "check of the table"], [/^import-/, "import report"], [/^compare-/, "comparison"],
  [/^found-/, "diagnosis"], [/^truth-/, "opened truth"], [/^export-/, "controller"]];
const meaning = name => WHAT.find(([pattern]) => pattern.test(name))?.[1] ?? "";

// The language stays chosen when the page is drawn again.
let to = "c";
// What the loop of the controller moves: without it a mass is assumed, and the export says so.
const moved = {mass: "", inertia: ""};
const LOAD = [["mass", "Mass of platform and load", "kg"], ["inertia", "Its moment of inertia", "kg m²"]];

export async function draw(root, state, app) {
  const link = (name, words = name) => isCopy ? el("span", {}, words)
    : el("a", {href: address(name), target: name.endsWith(".html") ? "_blank" : null}, words);
  const report = state.diagnosis ? `found-${state.diagnosis.step}.html` : state.compare ? `compare-${state.compare.step}.html` : null;
  const cards = [["Report", report], ["Model", state.model], ["Script", "script.sh"]];
  const undone = new Set(state.steps.filter(step => step.status === "done" && !step.counts).map(step => step.number));
  const counts = name => !undone.has(Number(/^[a-z]+-(\d+)/.exec(name)?.[1]));
  const list = names => el("ul", {}, names.map(name => el("li", {}, link(name), el("span", {class: "soft"}, ` ${meaning(name)}${ownFiles(name) === name ? "" : ` ${ownFiles(name)}`}`))));
  const kept = state.files.filter(counts), left = state.files.filter(name => !counts(name));
  const script = el("pre", {tabindex: "0", id: "script"});
  root.append(
    el("div", {class: "cards"}, cards.filter(([, name]) => name).map(([title, name]) =>
      el("div", {class: "card"}, el("h3", {}, title), link(name), el("p", {class: "soft"}, meaning(name))))),
    el("h3", {}, "Controller", help("controller")),
    el("div", {class: "row"}, choices("Language", "language", [["c", "C"], ["rust", "Rust"], ["mujoco", "MuJoCo"]],
      value => { to = value; }, to)),
    el("div", {class: "fields"}, LOAD.map(([key, words, unit]) => el("label", {}, el("span", {}, `${words} (assumed where empty)`),
      el("input", {type: "number", id: `export-${key}`, min: 0, step: "any", value: moved[key], oninput: event => { moved[key] = event.target.value; }}),
      el("small", {class: "soft"}, unit)))),
    el("div", {class: "row"}, button("Export", () => app.step("export", {to, ...to === "mujoco" ? {} : moved}), {class: "first", id: "export", disabled: busy(state)})),
    ...controller(state, link),
    ...isCopy ? [] : [el("h3", {}, "The whole session"), el("p", {}, el("a", {href: "/api/report", target: "_blank", id: "report"}, "Report of the session"),
      ", to print: ladder, before and after, parameters, commands. ", el("a", {href: "/api/copy", download: `${state.folder}.html`, id: "copy"}, "One page to mail"),
      ": it shows all this without ecm, to read. ", el("a", {href: "/api/zip", download: `${state.folder}.zip`, id: "zip"}, "All its files"),
      ", to go on with elsewhere: unpack them, and open the folder with ", el("code", {}, "ecm app --session FOLDER"), ".")],
    el("h3", {}, "The same as commands"),
    el("p", {}, el("code", {}, "sh script.sh NEW_FOLDER"), ", saved in the session folder, writes the same files, byte for byte."), script,
    button("Copy the commands", event => copy(script.textContent, said => { event.target.textContent = said; }),
      {id: "copy-script"}),
    el("details", {}, el("summary", {}, `All files of the session (${kept.length})`), list(kept)),
    left.length ? el("details", {}, el("summary", {}, `Of steps that were undone (${left.length})`), list(left)) : "");
  script.textContent = await text("/files/script.sh");
}

// The files of the last export, and what it says of them.
function controller(state, link) {
  if (!state.export) return [];
  const folder = `export-${state.export.step}/`;
  return [el("ul", {class: "files", "aria-label": "Files of the controller"}, state.files.filter(name => name.startsWith(folder))
    .map(name => el("li", {}, link(name, name.slice(folder.length))))),
  el("ul", {}, state.export.sentences.map(text => el("li", {}, readable(text))))];
}

const address = name => `/files/${name.split("/").map(encodeURIComponent).join("/")}`;
