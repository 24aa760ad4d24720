// Stage 4: the verdict, and every effect with what it would explain.

import {busy, view} from "./api.js";
import {chance, effectName, parameterName, quantity, readable} from "./columns.js";
import {button, el, number, waiting} from "./dom.js";
import {term} from "./help.js";
import {residualPanels} from "./panels.js";
import {wayOut} from "./remedy.js";

const FIRST = 8;

export async function draw(root, state, app) {
  const found = state.diagnosis;
  root.append(found ? verdict(found, state, app) : ask(state, app));
  const wait = waiting("Computing what each effect would explain …");
  root.append(wait);
  const [effects, residuals] = await Promise.all([view("effects", state), view("residuals", state)]);
  wait.remove();
  const panels = residualPanels(residuals, {explained: explanation(effects, residuals)});
  const name = el("p", {class: "hint", "aria-live": "polite"}, "Point at an effect, or go there with the Tab "
    + "key: orange crosses show what it would explain, before it is added.");
  const look = (id, node) => {
    for (const other of root.querySelectorAll(".effects li")) other.classList.toggle("seen", other === node);
    name.textContent = `Orange: what ${effectName(id)} would explain of the residual.`;
    panels.look(id);
  };
  root.append(el("div", {class: "split preview"},
    el("section", {"aria-label": "Effects"}, el("h3", {}, "Effects that can be tested, by ", term("gain")),
      list(effects, found, state, app, look)),
    el("div", {class: "sticky"}, el("h3", {}, "Residual, and what the effect explains"), name, panels.node)));
  root.append(...[untestable((found ?? state.check)?.not_testable)].filter(Boolean));
  panels.show();
}

function ask(state, app) {
  return el("div", {class: "lead"}, el("p", {}, "No verdict yet. The diagnosis tests every effect alone and "
    + "in sets, on rows and on held-out poses."),
  button("Diagnose", () => app.step("diagnose"),
    {class: "first", id: "diagnose", disabled: busy(state)}));
}

function verdict(found, state, app) {
  const {before, after} = found.held_out ?? {}, known = !found.noise?.is_residual;
  const rests = [
    `${found.ranking.length} effects tested, ${found.not_testable.length} not testable with this table`,
    known ? `noise from ${found.noise.source}` : "nothing is known of the noise",
    ...found.checks.filter(check => check.accepted).map(check =>
      `${effectName(check.id)}: chance of this by accident ${chance(check.p_holm)}, chosen in `
      + `${Math.round(100 * check.chosen_share)} % of repetitions`),
    before && after && found.effects.length
      ? known ? `error on held-out poses ${before.toFixed(2)} → ${after.toFixed(2)} times the noise`
        : `error on held-out poses ${Math.round(100 * (1 - after / before))} % less` : null,
  ].filter(Boolean);
  const unknown = found.unknown, inside = new Set((state.fit?.effects ?? []).map(effect => effect.id));
  const named = found.verdict === "named" ? found.answer.flat().filter(id => !inside.has(id)) : [];
  const other = otherBase(found);
  return el("div", {}, el("div", {class: "lead", id: "verdict", "data-verdict": found.verdict},
    el("strong", {}, term("verdict", "Verdict")), el("p", {}, readable(found.summary.missing)), named.length === 0 ? null
    : button(`Add ${named.map(effectName).join(" and ")}${to(other)}`, () => add(app, state, named, other),
      {id: "add-named", class: "first", disabled: busy(state)})),
  el("p", {}, el("strong", {}, "Next: "), readable(found.summary.next)),
  el("p", {class: "rests"}, readable(found.sentence)),
  el("p", {class: "rests"}, "It rests on: ", rests.join("; "), "."),
  found.warnings.map(text => el("div", {class: "warning"}, text)),
  (found.look_alikes ?? []).map(item => el("p", {class: "rests"},
    `${effectName(item.id)} looks the same as ${item.what}. To tell them apart: ${item.apart}.`)),
  unknown ? own(unknown, found.family) : null);
}

// An unknown: what it follows, and a file to begin with.
function own(unknown, family) {
  const draft = unknown.skeleton ?? "";
  const link = el("a", {download: "my_effect.py",
    href: URL.createObjectURL(new Blob([draft], {type: "text/x-python"}))}, "Save as my_effect.py");
  return el("section", {class: "card", id: "unknown"}, el("h3", {}, family
    ? `It follows ${readable(family.driver)}, in a form of its own` : "No effect of the catalogue explains it"),
    unknown.words ? el("p", {}, readable(unknown.words)) : null,
    unknown.variables?.length ? el("p", {}, `It follows: ${unknown.variables.map(readable).join(", ")}.`) : null,
    unknown.nearest ? el("p", {class: "soft"}, `Nearest effect: ${effectName(String(unknown.nearest.id ?? unknown.nearest))}.`) : null,
    draft ? [el("p", {}, "A first draft of an effect of your own, which runs as it is:"),
      el("pre", {tabindex: "0"}, draft), el("p", {}, link, ", install it as an entry point ecm.effects "
        + "(docs/own_effect.md), and start ecm app again: it is then ranked like all others.")] : null);
}

// The base that names are against, where it is another than the model's: what a verdict promises is reached on it.
function otherBase(found) {
  const {name = "", base = "", is_base: same} = found?.model ?? {};
  return same || name.split("+")[0] === base ? "" : base;
}

// The base is fitted first where it is another one.
function add(app, state, ids, base) {
  app.go("add");
  if (!base) return app.step("refit", {add: ids});
  const kept = (state.fit?.effects ?? []).map(effect => effect.id);
  return app.step("fit", {model: base, then: {verb: "refit", add: [...kept, ...ids]}});
}

const to = base => base ? ` to a fit of ${readable(base)}` : "";

function list(effects, found, state, app, look) {
  const named = new Set((found?.answer ?? []).flat());
  const ranks = new Map((found?.ranking ?? []).map(item => [item.id, item]));
  const alike = id => [...new Set((found?.confusable ?? []).filter(set => set.includes(id)).flat())].filter(other => other !== id);
  const inside = new Set((state.fit?.effects ?? []).map(effect => effect.id));
  const other = otherBase(found);
  const items = Object.entries(effects.effects).map(([id, item], i) => [named.has(id) || i < FIRST, entry(id, item)]);
  const few = items.filter(([large]) => large), rest = items.filter(([large]) => !large);
  const group = (some, name) => el("ul", {class: "effects", "aria-label": name}, some.map(([, node]) => node));
  return el("div", {}, group(few, "Effects that can be tested"),
    rest.length ? el("details", {}, el("summary", {}, `${rest.length} more that explain less`),
      group(rest, "Effects that explain less")) : null);

  function entry(id, item) {
    const base = named.has(id) ? other : "", refused = base ? null : state.refused[id];
    const rank = ranks.get(id), like = alike(id), share = Math.max(0, item.share);
    const fill = el("i");
    fill.style.width = `${Math.min(100, 100 * share)}%`;
    const node = el("li", {class: named.has(id) ? "named" : "", onmouseenter: () => look(id, node),
      onfocusin: () => look(id, node)},
    el("div", {}, el("strong", {}, effectName(id)),
      named.has(id) ? el("span", {class: "tag verdict"}, "verdict") : null,
      el("span", {class: "tag"}, item.side === "measurement"
        ? "of the measurement" : "of the mechanism"),
      el("div", {class: "soft"}, item.what),
      rank ? el("small", {class: "soft"}, tested(rank)) : null,
      like.length ? el("div", {class: "soft alike"}, `This table cannot tell it from ${like.map(effectName).join(", ")}.`) : null,
      el("div", {class: "gain", role: "img",
        "aria-label": `explains ${Math.round(100 * share)} percent of the squared residual`},
      el("b", {}, fill), `${(100 * share).toFixed(share < 0.1 ? 1 : 0)} %`)),
    refused ? null : button(inside.has(id) ? "Added" : "Add", () => add(app, state, [id], base),
      {"data-add": id, "aria-label": `Add ${effectName(id)}${to(base)} and fit again`, class: named.has(id) ? "first" : "",
        disabled: busy(state) || inside.has(id)}),
    refused ? el("div", {class: "refused"}, el("span", {class: "tag"}, "was refused"), ` ${refused.message}`,
      ...wayOut(refused.remedy, state, app)) : null);
    return node;
  }
}

function tested({parameter, size, sd, unit, p}) {
  const [value, words] = quantity(size, unit);
  return `${parameterName(parameter ?? "size")} ${number(value)} ± ${number(quantity(sd, unit)[0])} ${words}; `
    + `chance of this by accident ${chance(p)}`;
}

// Values of an effect on the rows of the residuals, in the unit shown; null as a pose error, and in a
// component that never varies.
function explanation(effects, residuals) {
  const place = new Map(effects.row.map((row, i) => [row, i])), {noise, wrench} = residuals.kinds;
  return (id, kind, j) => {
    const values = kind === "pose" ? null : effects.effects[id].values[effects.columns.indexOf(wrench.columns[j])];
    if (!values) return null;
    return residuals.row.map((row, i) => {
      const at = place.get(row);
      if (at === undefined) return null;
      const scaled = kind === "noise" ? values[at] * noise.values[j][i] / wrench.values[j][i] : values[at];
      return Number.isFinite(scaled) ? scaled : null;
    });
  };
}

export function untestable(items) {
  if (!items?.length) return null;
  const needs = new Map();  // effects that lack the same are one line
  for (const {id, reason, record} of items) {
    const key = `${reason}. Record ${record}`;
    needs.set(key, {reason, record, ids: [...needs.get(key)?.ids ?? [], id]});
  }
  return el("details", {open: true}, el("summary", {}, el("strong", {}, `Not testable with this table (${items.length})`)),
    el("ul", {}, [...needs.values()].map(({ids, reason, record}) => el("li", {}, el("strong", {}, ids.map(effectName).join(", ")),
      `: ${reason}. Record `, el("code", {}, record)))));
}
