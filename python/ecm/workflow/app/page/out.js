// Stage 7: files, the exported controller, and the commands that do the same.

import {button, el} from "./dom.js";

export async function draw(root, state, app) {
  const language = el("select", {id: "language"},
    [["c", "C"], ["rust", "Rust"], ["mujoco", "MuJoCo"]].map(([value, text]) => el("option", {value}, text)));
  root.append(
    el("h3", {}, "Controller"),
    el("div", {class: "row"}, el("label", {for: "language"}, "Language"), language,
      button("Export", () => app.step("export", {to: language.value}),
        {class: "first", id: "export", disabled: Boolean(state.running)})),
    el("ul", {}, (state.export?.sentences ?? []).map(text => el("li", {}, text))),
    el("h3", {}, "Files of the session"),
    el("ul", {}, state.files.map(name =>
      el("li", {}, el("a", {href: `/files/${name.split("/").map(encodeURIComponent).join("/")}`},
        name)))),
    el("h3", {}, "The same as commands"),
    el("p", {}, "sh script.sh NEW_FOLDER writes the same files, byte for byte."));
  const script = el("pre", {tabindex: "0", id: "script"});
  root.append(script);
  const response = await fetch("/files/script.sh", {cache: "no-store"});
  script.textContent = await response.text();
}
