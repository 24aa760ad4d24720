// Stage 4: the verdict, and every effect with what it would explain.

import {busy, view} from "./api.js";
import {chance, effectName, inPage, parameterName, quantity, readable} from "./columns.js";
import {button, el, number, waiting} from "./dom.js";
import {term} from "./help.js";
import {linearFit} from "./linear.js";
import {knowsNoise, share} from "./noise.js";
import {residualPanels} from "./panels.js";
import {wayOut} from "./remedy.js";

const FIRST = 8, MOST = 3;  // effects that are shown at once; parameters of one
// What a person has ticked stays ticked while the model stays.
let kept = {model: null, ticked: new Set()};
// Error that the browser foresaw for a set of effects that is fitted now.
export const foreseen = {effects: "", error: null};

export async function draw(root, state, app) {
  const found = state.diagnosis;
  root.append(found ? verdict(found, state, app) : ask(state, app));
  const wait = waiting("Computing what each effect would explain …");
  root.append(wait);
  const [effects, residuals] = await Promise.all([view("effects", state), view("residuals", state)]);
  wait.remove();
  const linear = linearFit(effects), held = (state.fit?.effects ?? []).map(({id}) => id).filter(linear.has);
  if (kept.model !== state.model) kept = {model: state.model, ticked: new Set(held)};
  const {ticked} = kept, now = linear.fit(held), error = errorOf(state, effects, linear, now);
  let last = null;  // the fit that is shown
  let pointed = null;  // the effect that is pointed at: as if its tick were turned
  const turned = id => new Set(ticked.has(id) ? [...ticked].filter(other => other !== id) : [...ticked, id]);
  const shown = () => last ??= linear.fit(pointed === null ? ticked : turned(pointed));
  const panels = residualPanels(residuals, {...moves(linear, residuals, now, shown), onglide: share => count.glide(share), leave: app.leaveOut});
  const count = counter(error);
  const hint = el("p", {class: "hint", "aria-live": "polite"});
  const fitAgain = el("div", {class: "row"});
  const look = (id, node = null) => {
    [pointed, last] = [id, null];
    for (const other of root.querySelectorAll(".effects li")) other.classList.toggle("seen", other === node);
    hint.textContent = id === null && same(ticked, held) ? "Point at an effect, or go there with the Tab key: the points slide to what "
      + "it would leave, before it is added. Tick several: base and effects are fitted together, in this page."
      : id === null ? `With ${names(ticked)}, fitted linearly in this page.`
        : `${ticked.has(id) ? "Without" : "With"} ${effectName(id)}: what is left of the residual. Faint: as fitted.`;
    count.aim(shown());
    panels.look();
  };
  const refit = () => {
    const add = [...ticked].filter(id => !held.includes(id)), remove = held.filter(id => !ticked.has(id));
    Object.assign(foreseen, {effects: [...ticked].sort().join(), error: effects.other_base ? null : count.text(linear.fit(ticked))});
    app.go("add");
    return app.step("refit", {add, remove});
  };
  const ticks = () => {
    fitAgain.replaceChildren(...same(ticked, held) ? [] : [
      button(`Fit ${ticked.size ? `with ${names(ticked)}` : "the base alone"}`, refit, {class: "first", id: "fit-ticked", disabled: busy(state)}),
      button("As it is fitted now", () => { ticked.clear(); for (const id of held) ticked.add(id); ticks(); look(null); }, {id: "untick"})]);
    shares(root, effects, linear, ticked);
  };
  const tick = id => {
    if (ticked.has(id)) ticked.delete(id); else ticked.add(id);
    ticks();
    look(null);
  };
  root.append(el("div", {class: "split preview"},
    el("section", {"aria-label": "Effects"}, el("h3", {}, "Effects that can be tested, by ", term("gain")),
      list(effects, found, state, app, {look, tick, ticked})),
    el("div", {class: "sticky"}, el("h3", {}, "Residual, and what an effect leaves of it"), count.node, hint, fitAgain, panels.node)));
  root.append(...[untestable((found ?? state.check)?.not_testable)].filter(Boolean));
  panels.show();
  ticks();
  look(null);
}

const names = ids => [...ids].map(effectName).join(" and ") || "the base alone";
const same = (ticked, held) => ticked.size === held.length && held.every(id => ticked.has(id));

// The error of a linear fit in the unit of the page. Of another base than the model's: of a fit of that base.
function errorOf(state, effects, linear, now) {
  const known = knowsNoise(state), base = linear.fit([]);
  if (effects.other_base)
    return {of: fit => known ? fit.error : 100 * fit.error / base.error,
      unit: `${known ? "times the noise" : "% of the error of the base"}, on a fit of ${readable(effects.base)}`, start: base};
  const error = known ? state.compare.whitened_rms : share(state, state.compare.rmse);
  return {of: fit => error * fit.error / (now.error || 1), unit: known ? "times the noise" : "% of the spread", start: now};
}

// The error as a large number that counts while the points slide.
function counter({of, unit, start}) {
  const value = el("output", {id: "error-now"}), before = of(start);
  let from = before, to = before, at = before;
  const node = el("p", {class: "counter"}, el("span", {class: "value"}, value, " ", el("small", {}, unit)));
  const text = v => v < 10 ? v.toFixed(2) : number(v);
  return {node, text: fit => text(of(fit)), aim(fit) { [from, to] = [at, of(fit)]; }, glide(along) {
    at = from + along * (to - from);
    value.textContent = Math.abs(to - before) < 5e-3 * before && along === 1 ? text(at) : `${text(before)} → ${text(at)}`;
  }};
}

// Where the points of a component lie: measured minus what another fit explains more than the model does. The places
// are those of the rows for which the server sent what effects explain.
function moves(linear, residuals, now, shown) {
  const {noise, wrench} = residuals.kinds, place = new Map(residuals.row.map((row, i) => [row, i]));
  const sent = linear.rows.flatMap((row, k) => place.has(row) ? [[place.get(row), k]] : []);
  return {places: sent.map(([i]) => i), moved(kind, j) {
    const fit = shown(), name = wrench.columns[j];
    if (kind === "pose" || fit.taken.join() === now.taken.join() || linear.explained(fit, name, 0) === null) return null;
    const values = new Array(residuals.row.length).fill(null);
    for (const [i, k] of sent) {
      const whole = wrench.values[j][i], left = whole - linear.explained(fit, name, k) + linear.explained(now, name, k);
      values[i] = kind === "noise" ? left * noise.values[j][i] / whole : left;
      if (!Number.isFinite(values[i])) values[i] = null;
    }
    return values;
  }};
}

// The bar of each effect: the share that it takes of what the ticked ones leave, or of what they would leave without it.
function shares(root, effects, linear, ticked) {
  const left = linear.fit(ticked).squares;
  for (const node of root.querySelectorAll(".effects li[data-effect]")) {
    const id = node.dataset.effect, on = ticked.has(id);
    const other = linear.fit(on ? [...ticked].filter(one => one !== id) : [...ticked, id]).squares;
    const part = Math.max(0, on ? 1 - left / other : 1 - other / left), gain = node.querySelector(".gain");
    gain.querySelector("i").style.width = `${100 * part}%`;
    gain.lastChild.textContent = `${(100 * part).toFixed(part < 0.1 ? 1 : 0)} %`;
    gain.setAttribute("aria-label", `explains ${Math.round(100 * part)} percent of the squared residual`);
    const found = linear.parameters(linear.fit(on ? ticked : [...ticked, id]), id);
    node.querySelector("small").textContent = found.slice(0, MOST).map(({name, unit, value, sd}) => {
      const [v, words] = quantity(value, unit);
      return `${parameterName(name)} ${number(v)}${sd === null ? "" : ` ± ${number(quantity(sd, unit)[0], 2)}`} ${words}`;
    }).join("; ") + (found.length > MOST ? " …" : "");
    node.classList.toggle("ticked", on);
    node.querySelector("input").checked = on;
  }
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
  found.warnings.map(text => el("div", {class: "warning"}, readable(text))),
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

function list(effects, found, state, app, {look, tick, ticked}) {
  const named = new Set((found?.answer ?? []).flat());
  const ranks = new Map((found?.ranking ?? []).map(item => [item.id, item]));
  const alike = id => [...new Set((found?.confusable ?? []).filter(set => set.includes(id)).flat())].filter(other => other !== id);
  const inside = new Set((state.fit?.effects ?? []).map(effect => effect.id));
  const other = otherBase(found);
  const items = Object.entries(effects.effects).map(([id, item], i) => [named.has(id) || ticked.has(id) || i < FIRST, entry(id, item)]);
  const few = items.filter(([large]) => large), rest = items.filter(([large]) => !large);
  const group = (some, name) => el("ul", {class: "effects", "aria-label": name}, some.map(([, node]) => node));
  return el("div", {}, group(few, "Effects that can be tested"),
    rest.length ? el("details", {}, el("summary", {}, `${rest.length} more that explain less`),
      group(rest, "Effects that explain less")) : null);

  function entry(id, item) {
    const base = named.has(id) ? other : "", refused = base ? null : state.refused[id];
    const rank = ranks.get(id), like = alike(id);
    const box = el("input", {type: "checkbox", id: `tick-${id}`, onchange: () => tick(id), "aria-label": `${effectName(id)} in the fit`});
    const node = el("li", {class: named.has(id) ? "named" : "", "data-effect": id, onmouseenter: () => look(id, node),
      onfocusin: event => event.target !== box && look(id, node)},
    el("div", {}, el("label", {for: box.id}, box, " ", el("strong", {}, effectName(id))),
      named.has(id) ? el("span", {class: "tag verdict"}, "verdict") : null,
      el("span", {class: "tag"}, item.side === "measurement"
        ? "of the measurement" : "of the mechanism"),
      el("div", {class: "soft"}, readable(item.what)),
      el("small", {class: "soft"}), rank ? el("small", {class: "soft chance"}, `Chance of this by accident ${chance(rank.p)}.`) : null,
      like.length ? el("div", {class: "soft alike"}, `This table cannot tell it from ${like.map(effectName).join(", ")}.`) : null,
      el("div", {class: "gain", role: "img"}, el("b", {}, el("i")), "")),
    refused ? null : button(inside.has(id) ? "Added" : "Add", () => add(app, state, [id], base),
      {"data-add": id, "aria-label": `Add ${effectName(id)}${to(base)} and fit again`, class: named.has(id) ? "first" : "",
        disabled: busy(state) || inside.has(id)}),
    refused ? el("div", {class: "refused"}, el("span", {class: "tag"}, "was refused"), ` ${refused.message}`,
      ...wayOut(refused.remedy, state, app)) : null);
    return node;
  }
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
      `: ${readable(reason)}. `, record.startsWith("[") ? `Say ${inPage(record)}` : ["Record ", el("code", {}, inPage(record))]))));
}
