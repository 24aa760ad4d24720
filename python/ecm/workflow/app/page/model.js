// Stage 2: kind and size of the model, the fit and its report.

import {button, el} from "./dom.js";

const KINDS = [
  ["physics", "Physics: FEM of the described body, modulus and Poisson's ratio fitted"],
  ["energy4", "Symmetric energy of degree 4"],
  ["energy6", "Symmetric energy of degree 6"],
  ["energy6-general", "Energy of degree 6 without symmetry"],
  ["choose", "Choose: the one that predicts held-out poses best"],
  ["linear", "Linear: one stiffness matrix"],
  ["cubic", "Cubic polynomial"],
];

export function draw(root, state, app) {
  const kind = el("select", {id: "kind"}, KINDS.map(([name, text]) =>
    el("option", {value: name, selected: state.rungs[0]?.name === name}, text)));
  const curve = el("input", {type: "checkbox", id: "curve"});
  root.append(
    el("p", {}, "The model says which wrench holds the mechanism at a pose."),
    el("div", {class: "row"}, el("label", {for: "kind"}, "Kind"), kind,
      el("label", {for: "curve"}, curve, " also say how many poses are enough"),
      button("Fit", () => app.step("fit", {model: kind.value, curve: curve.checked}),
        {class: "first", id: "fit", disabled: Boolean(state.running)})));
  if (state.fit) {
    root.append(el("h3", {}, "Fit report"),
      el("ul", {}, state.fit.sentences.map(text => el("li", {}, text))));
  }
  if (state.compare) {
    root.append(el("p", {class: "lead"}, state.compare.sentence),
      button("See where it fails", () => app.go("fails"), {class: "first", id: "to-fails"}));
  }
}
