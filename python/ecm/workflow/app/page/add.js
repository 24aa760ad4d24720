// Stage 5: the ladder of errors, its parameters, undo, and the sealed truth.

import {chart} from "./chart.js";
import {column, effectName, parameterName, unitText} from "./columns.js";
import {button, el, number, table} from "./dom.js";
import {help, term} from "./help.js";

export function draw(root, state, app) {
  const rungs = rungsOf(state);
  root.append(el("p", {class: "lead"}, sentence(rungs)),
    el("div", {class: "split"},
      el("section", {"aria-label": "Parameters"}, el("h3", {}, "Effects in the model"),
        ...parameters(state, app), state.sealed ? sealed(state, app) : null),
      el("section", {"aria-label": "The ladder of errors"}, el("h3", {}, "The ladder of errors", help("held out")),
        chart({title: `Error over noise of each fit: ${rungs.map(rung => `${rung.name} ${number(rung.train)}`).join(", ")}`,
          labels: rungs.map(rung => rung.name), floor: 1, yTitle: "error [times the noise]",
          lines: [{name: "fitted rows", values: rungs.map(rung => rung.train), colour: "mark"},
            {name: "held out", values: rungs.map(rung => rung.held), colour: "second", dash: "7 5", square: true}]}),
        table("The rungs of the ladder, in times the noise", ["fit", "fitted rows", "held out", el("span", {}, "is the change real?", help("is the change real?"))],
          rungs.map(rung => [rung.name, rung.train, rung.held, rung.test])))),
    compare(state));
}

// The history of the last fit knows held-out errors; without one there is the base only.
function rungsOf(state) {
  const history = state.fit?.history ?? [];
  if (history.length) return history.map(item => ({name: effectName(item.name), train: item.train,
    held: item.held_out, test: typeof item.test === "string" ? item.test : ""}));
  return state.rungs.map(item => ({name: effectName(item.name), train: item.train, held: null, test: ""}));
}

function sentence(rungs) {
  const first = rungs[0], last = rungs.at(-1);
  if (rungs.length < 2) return "The base alone. Add an effect under “What is missing”: the ladder then grows by a rung.";
  const held = first.held && last.held;
  const [from, to] = held ? [first.held, last.held] : [first.train, last.train];
  return `${last.name}: the error on ${held ? "held-out poses" : "the fitted rows"} went from ${from.toFixed(2)} to `
    + `${to.toFixed(2)} times the noise. ${to < 1.1 ? "That is the noise floor: nothing is left to find in these rows."
      : "1 is the noise floor."}`;
}

function parameters(state, app) {
  const effects = state.fit?.effects ?? [], off = Boolean(state.running);
  if (!effects.length) return [el("div", {class: "waiting"}, "No effect has been added yet.")];
  return effects.map(effect => el("div", {class: "card"},
    el("h3", {}, effectName(effect.id), effect.frozen ? el("span", {class: "tag"}, "frozen") : null),
    effect.parameters.map(p => el("p", {}, el("span", {class: "soft"}, `${parameterName(p.name)} `),
      el("span", {class: "value"}, number(p.value), " ",
        el("small", {}, p.sd ? `± ${number(p.sd, 2)} ` : "", unitText(p.unit), help("plus minus"))),
      p.sd ? el("span", {class: "soft"}, ` 95 %: ${number(p.value - 1.96 * p.sd)} to ${number(p.value + 1.96 * p.sd)}`) : null)),
    el("div", {class: "row"},
      button("Remove", () => app.step("refit", {remove: [effect.id]}),
        {disabled: off, "aria-label": `Remove ${effectName(effect.id)}`}),
      effect.frozen ? null : el("span", {}, button("Freeze", () => app.step("refit", {freeze: [effect.id]}),
        {disabled: off, "aria-label": `Freeze ${effectName(effect.id)}`}), help("frozen")))));
}

// Two rungs beside each other, component by component.
function compare(state) {
  const rungs = state.rungs.filter(rung => rung.rmse);
  if (rungs.length < 2) return el("span");
  const entries = rungs.map((rung, i) => [String(i), `${i + 1} ${effectName(rung.name)}`]);
  const select = (id, chosen) => el("select", {id, onchange: () => show()},
    entries.map(([value, text], i) => el("option", {value, selected: i === chosen}, text)));
  const before = select("rung-before", rungs.length - 2), after = select("rung-after", rungs.length - 1);
  const place = el("div");
  const show = () => {
    const [a, b] = [rungs[before.value], rungs[after.value]];
    place.replaceChildren(table("Error of each component (root mean square over the fitted rows)",
      ["component", "unit", a.name, b.name, "change [%]"].map(effectName),
      Object.keys(a.rmse).map(name => [column(name).words, column(name).unit, a.rmse[name], b.rmse[name] ?? null,
        100 * (b.rmse[name] / a.rmse[name] - 1)])));
  };
  show();
  return el("section", {"aria-label": "Two rungs compared"}, el("h3", {}, "Compare two rungs"),
    el("div", {class: "row"}, el("label", {for: "rung-before"}, "From"), before,
      el("label", {for: "rung-after"}, "to"), after), place);
}

function sealed(state, app) {
  const node = el("section", {class: "card", "aria-label": "Sealed truth"}, el("h3", {}, term("sealed", "Sealed truth")));
  if (state.truth) {
    const {effects, score} = state.truth;
    node.append(el("p", {id: "truth"}, "Hidden was: ", el("strong", {}, effects.map(effect => {
      const size = effect.parameters?.size;
      return effectName(effect.id) + (size !== undefined ? ` (${number(size)} ${unitText(effect.parameters.unit ?? "")})` : "");
    }).join(", ") || "nothing"), score ? `. The diagnosis was ${score.correct ? "right" : "wrong"}.` : "."));
  } else {
    node.append(el("p", {}, "What the simulated rig hid. Opening it shows the answer for good: diagnose first."),
      button("Open the sealed truth", () => app.step("reveal"), {id: "reveal", disabled: Boolean(state.running)}));
  }
  return node;
}
