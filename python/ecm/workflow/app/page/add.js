// Stage 5: the ladder of errors, its parameters, undo, and the sealed truth.

import {busy, view} from "./api.js";
import {chart} from "./chart.js";
import {chance, column, effectName, parameterName, quantity} from "./columns.js";
import {button, el, number, table, waiting} from "./dom.js";
import {gapOf} from "./fails.js";
import {help, term} from "./help.js";
import {foreseen} from "./missing.js";
import {knowsNoise, share} from "./noise.js";
import {hasSpace, workspace} from "./scene.js";
import {versus} from "./versus.js";

export async function draw(root, state, app) {
  const rungs = rungsOf(state), known = knowsNoise(state), unit = known ? "times the noise" : "% of the spread";
  const own = rungs.slice(rungs.findLastIndex(rung => rung.base)), grow = rungs.length > seen.rungs && state.folder === seen.folder;
  if (state.compare || !state.running) seen = {folder: state.folder, rungs: rungs.length};
  const space = el("section", {"aria-label": "Measured and modelled in space"}), over = el("div");
  root.append(el("p", {class: "lead"}, sentence(own, known, unit), confirmed(state)),
    el("div", {class: "split even"},
      el("div", {}, el("section", {"aria-label": "The ladder of errors"}, el("h3", {}, "The ladder of errors", help("held out")),
        chart({title: `Error of each fit, ${unit}: ${rungs.map(rung => `${rung.name} ${number(rung.train)}`).join(", ")}`,
          labels: rungs.map(rung => rung.name), floor: known ? 1 : null, yTitle: `error [${unit}]`, log: true, grow,
          begins: rungs.flatMap((rung, i) => rung.base ? [i] : []),
          lines: [{name: "fitted rows", values: rungs.map(rung => rung.train), colour: "mark"},
            {name: "held out", values: rungs.map(rung => rung.held), colour: "second", dash: "dash", square: true}]})), over), space),
    table(`The rungs of the ladder, in ${unit}`, ["fit", "fitted rows", "held out", el("span", {}, "is the change real?", help("is the change real?"))],
      rungs.map(rung => [rung.name, rung.train, rung.held, rung.test])),
    el("div", {class: "split even"},
      el("section", {class: "stack", "aria-label": "Parameters"}, el("h3", {}, "Effects in the model"), ...parameters(state, app)),
      el("div", {class: "stack"}, state.sealed ? sealed(state, app) : null, compare(state))),
    el("div", {class: "row"}, button(own.length < 2 ? "What is missing?" : "What else is missing?", () => app.go("missing"),
      {id: "to-missing", class: "first"}), button("To the results", () => app.go("out"), {id: "to-out"})));
  if (state.compare) await figures(state, space, over, grow);
}

// Before and after the last change: the gap in space goes home, and the wipe goes over.
async function figures(state, space, over, grow) {
  space.append(waiting("Computing the residuals …"));
  const last = state.rungs.at(-1), earlier = state.rungs.at(-2);
  const [now, poses, before] = await Promise.all([view("residuals", state), view("poses", state), earlier && view("residuals", state, earlier.model)]);
  const gap = gapOf(now), was = before?.kinds.pose && before.row.length === now.row.length ? before.change : null;
  space.replaceChildren();
  const shown = gap && hasSpace(now.variables);
  if (shown) space.append(el("h3", {}, "Measured, and where the model puts it"), workspace(poses, now.row, now.variables, now.size,
    {title: "largest residual", unit: knowsNoise(state) ? "times the noise" : "times the model's own error",
      name: "The measured pose and that of the model", gap: grow && was ? {...gap, before: was} : gap}));
  if (!shown) space.replaceWith(over);
  over.append(versus(now, effectName(last.name), {grow, before: earlier ? {residuals: before, name: effectName(earlier.name)} : null}).node);
}

const MANY = 3;  // parameters from which on they are a table
let seen = {folder: "", rungs: Infinity};

// The server's errors over one noise; where none is known, in the same ratio over the readings' spread.
function rungsOf(state) {
  return state.tried.map(({name, is_base: base, rmse, over_noise: over, held_out: held, test}) => {
    const train = knowsNoise(state) ? over : share(state, rmse);
    return {name: effectName(name), base, train, test: real(test), held: held === null || train === null ? null : train * held / over};
  });
}

// Beside what the page foresaw by its linear fit, what the fit gives.
function confirmed(state) {
  const held = (state.fit?.effects ?? []).map(({id}) => id).sort().join();
  if (foreseen.error === null || foreseen.effects !== held || !state.compare) return null;
  const given = knowsNoise(state) ? state.compare.whitened_rms : share(state, state.compare.rmse);
  return el("span", {id: "confirmed"}, ` The page foresaw ${foreseen.error}; the fit gives ${given < 10 ? given.toFixed(2) : number(given)}.`);
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
    effect.parameters.length < MANY ? effect.parameters.map(parameter) : table("Values, ± standard deviation; 95\u00a0% of the time the true one lies between the last two",
      ["", "value", "±", "unit", "from", "to"], effect.parameters.map(({name, value: own, sd: spread, unit}) => {
        const [value, words] = quantity(own, unit), [sd] = quantity(spread, unit);
        return [parameterName(name), value, sd, words, value - 1.96 * sd, value + 1.96 * sd];
      })),
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
