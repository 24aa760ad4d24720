// Stage 5: the ladder of errors, its parameters, undo, and the sealed truth.

import {busy} from "./api.js";
import {chart} from "./chart.js";
import {chance, column, effectName, parameterName, quantity} from "./columns.js";
import {button, el, number, table} from "./dom.js";
import {help, term} from "./help.js";
import {knowsNoise, share} from "./noise.js";

export function draw(root, state, app) {
  const rungs = rungsOf(state), known = knowsNoise(state), unit = known ? "times the noise" : "% of the spread";
  root.append(el("p", {class: "lead"}, sentence(rungs, known, unit)),
    el("div", {class: "split"},
      el("section", {"aria-label": "The ladder of errors"}, el("h3", {}, "The ladder of errors", help("held out")),
        chart({title: `Error of each fit, ${unit}: ${rungs.map(rung => `${rung.name} ${number(rung.train)}`).join(", ")}`,
          labels: rungs.map(rung => rung.name), floor: known ? 1 : null, yTitle: `error [${unit}]`,
          lines: [{name: "fitted rows", values: rungs.map(rung => rung.train), colour: "mark"},
            {name: "held out", values: rungs.map(rung => rung.held), colour: "second", dash: "7 5", square: true}]}),
        table(`The rungs of the ladder, in ${unit}`, ["fit", "fitted rows", "held out", el("span", {}, "is the change real?", help("is the change real?"))],
          rungs.map(rung => [rung.name, rung.train, rung.held, rung.test]))),
      el("section", {class: "stack", "aria-label": "Parameters"}, el("h3", {}, "Effects in the model"),
        ...parameters(state, app), state.sealed ? sealed(state, app) : null, compare(state))),
    el("div", {class: "row"}, button(rungs.length < 2 ? "What is missing?" : "What else is missing?", () => app.go("missing"),
      {id: "to-missing", class: "first"}), button("To the results", () => app.go("out"), {id: "to-out"})));
}

// The history of the last fit knows held-out errors; without one there is the base only. Without a noise
// it counts in one that is assumed: then the errors are those of the readings' spread.
function rungsOf(state) {
  const history = state.fit?.history ?? [], known = knowsNoise(state);
  const shares = state.rungs.map(rung => share(state, rung.rmse));
  const named = state.rungs.map((rung, i) => ({name: effectName(rung.name), train: known ? rung.train : shares[i],
    held: null, test: ""}));
  if (!history.length) return named;
  const scale = (shares.at(-1) ?? 0) / history.at(-1).train;
  return history.map(item => ({name: effectName(item.name), test: real(item.test ?? ""),
    train: known ? item.train : scale * item.train, held: known ? item.held_out : scale * item.held_out}));
}

// The server's test of a change, with the answer first.
function real(test) {
  const found = /^chi2 falls by (\S+) with (\d+) parameters more \(F = \S+, p = (\S+), BIC falls by (\S+)\)$/.exec(test);
  if (!found) return test.replace("chi2", "χ²");
  const [, fall, more, p, bic] = found;
  return `${Number(p) < 0.01 ? "yes" : "not sure"}: p ${Number(p) > 0 ? "= " : ""}${chance(p)}; χ² falls by ${fall} for ${more} `
    + `${more === "1" ? "parameter" : "parameters"} more, BIC by ${bic}`;
}

function sentence(rungs, known, unit) {
  const first = rungs[0], last = rungs.at(-1);
  if (rungs.length < 2) return "The base alone. Add an effect under “What is missing”: the ladder then grows by a rung.";
  const held = first.held && last.held;
  const [from, to] = held ? [first.held, last.held] : [first.train, last.train];
  return `${last.name}: the error on ${held ? "held-out poses" : "the fitted rows"} went from ${number(from)} to ${number(to)} ${unit}. `
    + (!known ? "Nothing is known of the noise: repeat some poses, or state it, and the page says how much of this is noise."
      : to < 1.1 ? "That is the noise floor: nothing is left to find in these rows." : "1 is the noise floor.");
}

function parameters(state, app) {
  const effects = state.fit?.effects ?? [], off = busy(state);
  if (!effects.length) return [el("div", {class: "waiting"}, "No effect has been added yet.")];
  return effects.map(effect => el("div", {class: "card"},
    el("h3", {}, effectName(effect.id), effect.frozen ? el("span", {class: "tag"}, "frozen") : null),
    effect.parameters.map(parameter),
    el("div", {class: "row"},
      button("Remove", () => app.step("refit", {remove: [effect.id]}),
        {disabled: off, "aria-label": `Remove ${effectName(effect.id)}`}),
      effect.frozen ? null : el("span", {}, button("Freeze", () => app.step("refit", {freeze: [effect.id]}),
        {disabled: off, "aria-label": `Freeze ${effectName(effect.id)}`}), help("frozen")))));
}

function parameter({name, value: own, sd: spread, unit}) {
  const [value, words] = quantity(own, unit), [sd] = quantity(spread, unit);
  return el("p", {}, el("span", {class: "soft"}, `${parameterName(name)} `),
    el("span", {class: "value"}, number(value), " ",
      el("small", {}, sd ? `± ${number(sd, 2)} ` : "", words, help("plus minus"))),
    sd ? el("span", {class: "soft"}, ` 95\u00a0%: ${number(value - 1.96 * sd)} to ${number(value + 1.96 * sd)}`) : null);
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
      const {size, unit} = effect.parameters ?? {};
      if (size === undefined) return effectName(effect.id);
      const [value, words] = quantity(size, unit ?? "1");
      return `${effectName(effect.id)} (${number(value)}${unit && unit !== "1" ? ` ${words}` : ""})`;
    }).join(", ") || "nothing"), score ? `. The diagnosis was ${score.correct ? "right" : "wrong"}.` : "."));
  } else {
    node.append(el("p", {}, "What the simulated rig hid. Opening it shows the answer for good: diagnose first."),
      button("Open the sealed truth", () => app.step("reveal"), {id: "reveal", disabled: busy(state)}));
  }
  return node;
}
