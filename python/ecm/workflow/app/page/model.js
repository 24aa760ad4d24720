// Stage 2: kind and size of the model, the fit and its report.

import {moved} from "./actuation.js";
import {busy, view} from "./api.js";
import {chart} from "./chart.js";
import {column, label, readable} from "./columns.js";
import {button, el, number, table, waiting} from "./dom.js";
import {help} from "./help.js";
import {POSE, WRENCH} from "./scene.js";

const KINDS = [
  ["physics", "Physics", "Finite elements of the described body; its stiffness is fitted. Best where the body is known."],
  ["energy4", "Symmetric energy, degree 4", "Few numbers, the symmetry of a round body built in. Small bending."],
  ["energy6", "Symmetric energy, degree 6", "As degree 4, for large bending."],
  ["energy6-general", "Energy of degree 6", "Without symmetry, for a body that is not round. Needs more poses."],
  ["actuated4", "Energy of pose and actuators", "Pressures and tensions are inputs beside the pose. For equal actuators round the axis of a body with both ends alike."],
  ["linear", "Linear", "One stiffness matrix. Small motions, or a first look."],
  ["cubic", "Cubic polynomial", "Any smooth wrench, without an energy behind it."],
  ["choose", "Choose for me", "Fits all kinds, keeps the one that predicts held-out poses best. Takes longest."],
];

const OF_SIX = ["physics", "energy4", "energy6", "energy6-general", "actuated4"];
const OF_POSE = ["physics", "energy4", "energy6", "energy6-general"];  // which take no inputs of actuators
const TERM = {physics: "physics", energy4: "energy", energy6: "energy", "energy6-general": "energy", choose: "held out"};

// What a person has picked stays picked when the page is drawn again.
let picked = null, curvePicked = false;

export async function draw(root, state, app) {
  const {six, body} = await known(state);
  const driven = state.check?.columns.some(({name}) => /^(pressure|tension)_\d+_/.test(name)) ?? false;
  const lacks = name => name === "actuated4" && !driven ? " Needs columns of actuators: pressure_1_Pa, tension_1_N, ..."
    : OF_POSE.includes(name) && driven ? " Takes no inputs of actuators."
    : OF_SIX.includes(name) && !six ? " Needs all six columns of the pose and of the wrench."
    : name === "physics" && !body ? " Needs the body: say under Data its shape, dimensions and modulus." : "";
  // Nothing that needs more than these data hold; of many kinds the one that predicts best.
  const first = !lacks("actuated4") ? "actuated4" : !lacks("physics") ? "physics" : "choose";
  const now = [picked, state.rungs[0]?.name].find(name => name && !lacks(name)) ?? first;
  const curve = el("input", {type: "checkbox", id: "curve", checked: curvePicked,
    onchange: () => { curvePicked = curve.checked; }});
  const kinds = el("div", {class: "cards kinds", role: "radiogroup", "aria-label": "Kind of model"},
    KINDS.map(([name, title, what]) => el("label", {class: `card ${name === now ? "chosen" : ""}`},
      el("input", {type: "radio", name: "kind", value: name, checked: name === now, disabled: Boolean(lacks(name)),
        onchange: event => {
          picked = name;
          for (const card of kinds.children) card.classList.toggle("chosen", card === event.target.parentElement);
        }}), " ", el("span", {}, el("strong", {}, title), TERM[name] ? help(TERM[name]) : null), el("div", {class: "soft"}, what,
        lacks(name) ? el("em", {}, lacks(name)) : null))));
  const fit = () => app.step("fit",
    {model: kinds.querySelector(":checked")?.value ?? now, curve: curve.checked});
  root.append(kinds, el("div", {class: "row"},
    button("Fit", fit, {class: "first", id: "fit", disabled: busy(state)}),
    el("label", {for: "curve"}, curve, " also say how many poses are enough"), help("learning curve")));
  if (state.compare) {
    root.append(el("p", {class: "lead"}, readable(state.compare.sentence)),
      button("See where it fails", () => app.go("fails"), {class: "first", id: "to-fails"}));
  }
  if (state.model && driven) {
    const wait = waiting("Looking where the body comes to rest …");
    root.append(wait);
    view("actuation", state).then(found => wait.replaceWith(...found.actuators.length ? [moved(found)] : []), error => {
      wait.textContent = error.message;
    });
  }
  const base = state.rungs[0]?.report;  // a later fit with an effect has no report of its own
  if (base) root.append(...report(base));
}

// An energy needs six coordinates of both, and physics the body.
async function known(state) {
  const {columns, outline_m: outline} = await view("poses", state);
  return {six: [...POSE, ...WRENCH].every(name => columns[name]) && !state.check.padding.length, body: Boolean(outline)};
}

function report(fit) {
  const parts = [el("h3", {}, `Fit report of the base model, ${fit.model}`),
    ...(fit.warnings ?? []).map(text => el("div", {class: "warning"}, text))];
  if (fit.components) parts.push(table("Error of each component on the fitted rows",
    ["component", "root mean square", "unit", "of its spread [%]"],
    Object.entries(fit.components).map(([name, item]) =>
      [column(name).words, item.rmse, column(name).unit, 100 * item.rmse_over_spread])));
  const {covariance, ...values} = fit.parameters ?? {};
  if (Object.keys(values).length) parts.push(trusted(values, covariance));
  if (fit.curve?.sizes) {
    parts.push(el("h3", {}, "How many poses are enough?", help("learning curve")),
      chart({title: "Error on held-out poses for growing numbers of poses", labels: fit.curve.sizes.map(String),
        log: true, floor: 1, xTitle: "number of poses", yTitle: "error [times the noise]",
        lines: [{name: "held out", values: fit.curve.error, colour: "second", square: true}]}));
  }
  parts.push(el("details", {}, el("summary", {}, "All sentences of the report"),
    el("ul", {}, (fit.sentences ?? []).map(text => el("li", {}, readable(text))))));
  return parts;
}

// Values with their errors, and which to trust.
function trusted(values, covariance) {
  const names = Object.keys(values);
  const correlated = (i, j) => covariance[i][j] / Math.sqrt(covariance[i][i] * covariance[j][j]);
  const strongest = i => {
    if (names.length < 2 || !covariance) return null;
    const [j, size] = names.flatMap((_, j) => j === i ? [] : [[j, correlated(i, j)]])
      .sort((a, b) => Math.abs(b[1]) - Math.abs(a[1]))[0];
    return `${number(size, 2)} with ${column(names[j]).words}`;
  };
  return table("Fitted values, ± standard deviation", ["value of", "fitted", "±", el("span", {}, "largest correlation", help("correlation")), "trust"],
    names.map((name, i) => {
      const {value, sd} = values[name], share = Math.abs(sd / value);
      return [label(name), number(value, 4), number(sd, 2), strongest(i),
        share < 0.02 ? `well known (${number(100 * share, 2)} %)` : share < 0.2 ? "roughly known" : "hardly known"];
    }));
}
