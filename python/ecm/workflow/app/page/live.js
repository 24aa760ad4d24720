// A measurement while it goes on, of a rig or of the simulated one: planned poses are faint, each reading is a point as
// soon as it is there; beside them what the rows say so far.

import {get} from "./api.js";
import {axesOf, bent, profileOf} from "./bend.js";
import {colours, faded, rgb, scaleOf} from "./colours.js";
import {readable} from "./columns.js";
import {el, number} from "./dom.js";
import {help, term} from "./help.js";
import {hasSpace, mm, POSE, scaleBar, WRENCH} from "./scene.js";
import {bodyColour, space} from "./space.js";
import {asMeasured, versus} from "./versus.js";

const EVERY_MS = 150, LOST_MS = 1500;
const PLANNED = 0.7;  // of the grey of a planned pose: three times as light or dark as the ground
const SAID = 50;  // findings that are listed
const FREE = ["offset", "unloaded"];  // readings of the sensor alone
const OLD_S = 20;

export const measures = state => Boolean(state.following) || (state.running !== null
  && (state.steps.find(step => step.number === state.running.step)?.command ?? "").startsWith("ecm campaign "));

export function live(state) {
  const own = Boolean(state.following), count = el("p", {class: "hint", id: "live"});
  const drawn = space("Planned poses, and the readings as they come"), bar = el("div"), figure = el("div");
  const cards = el("div", {class: "cards values", id: "so-far"}), trouble = el("div", {role: "status"});
  const findings = el("ul", {id: "findings", "aria-label": "What was found, the last first"});
  const picture = el("div", {}, drawn.node, bar), both = el("div", {class: "split"}, picture, figure);
  const node = el("section", {"aria-label": "Readings as they come"},
    el("h3", {}, own ? `${state.following}, row by row` : "The simulated rig measures, ", own ? null : term("readings", "reading by reading")),
    trouble, count, own ? cards : null, own ? both : picture, own ? findings : null);
  let known = null, over = null, shown = "";

  const look = async () => {
    if (shown && !node.isConnected) return;
    const found = await get(`/api/live?after=${known ? known.rows.length : 0}`).catch(() => ({of: null}));
    if (found.begun) known = found;
    else if (!known || found.run !== known.run) known = null;  // another run, or one that tells all again
    else known = {...found, begun: known.begun, rows: [...known.rows, ...found.rows]};
    const now = known && `${known.run} ${known.rows.length}`;
    if (known && now !== shown) show();
    say();
    shown = now ?? "none";
    setTimeout(look, found.of === null ? LOST_MS : EVERY_MS);
  };

  function show() {
    const rows = readings(known.rows), worth = valuesOf(known.begun, rows);
    const seen = hasSpace(known.begun.poses) ? sceneOf(known.begun, rows, worth) : null;
    if (seen) drawn.set(seen);
    picture.hidden = !seen;
    both.className = seen ? "split" : "";
    bar.replaceChildren(...rows.length && own ? [scaleBar(worth.title, worth.largest, worth.unit)] : []);
    if (!own || !rows.length) return;
    const residuals = residualsOf(known.begun, rows, known.rows.at(-1));
    if (over) over.set(residuals);
    else figure.replaceChildren((over = versus(residuals, "the model")).node);
    cards.replaceChildren(...figures(known.begun, known.rows, rows));
    const said = known.rows.flatMap(item => item.findings).reverse();
    findings.replaceChildren(...said.slice(0, SAID).map(text => el("li", {}, readable(text))));
  }

  function say() {
    const rows = known?.rows ?? [], n = rows.length;
    const old = known?.age_s > OLD_S ? ` The last one came ${Math.round(known.age_s)} s ago.` : "";
    const [, size, unit, words] = n ? sizeOf(known.begun) : [];
    if (n) count.textContent = `${n} ${n === 1 ? "reading" : "readings"} so far${own ? ` of ${rows.at(-1).of}` : ""}; the last ${words} is `
      + `${number(size(rows.at(-1)))} ${unit}.${picture.hidden ? "" : " Faint points are planned."}${known.ended ? "" : old}`;
    else count.textContent = !own ? "The forces at the planned poses are computed first."
      : known ? "The rig has begun; no reading is there yet." : `Nothing is measured yet: ecm measure PLAN --rig BENCH.toml --out ${state.following} begins it.`;
    trouble.className = known?.ended ? "warning" : "";
    trouble.textContent = known?.ended ? `The measurement has stopped: ${readable(known.ended)}. All readings are kept; the same command goes on.` : "";
  }
  say();
  look();
  return node;
}

// Whether a rig measures forces, the size of what it measures, the unit and the word.
function sizeOf({columns = WRENCH}) {
  const force = columns.some(name => name.endsWith("_N"));
  return [force, ({wrench}) => Math.hypot(...force ? wrench.slice(0, 3) : wrench.slice(3)), ...force ? ["N", "force"] : ["N m", "moment"]];
}

// Rows of the table with their number there: the sensor's zero has none.
const readings = rows => rows.filter(item => item.kind !== FREE[0]).map((item, i) => ({...item, number: i + 1}))
  .filter(item => !FREE.includes(item.kind));

// What colours the points: the distance from the model, else the size of the force.
function valuesOf(begun, rows) {
  const [, size, unit, words] = sizeOf(begun), modelled = rows.some(item => item.model), of = modelled ? item => item.model_N ?? 0 : size;
  const values = rows.map(of);
  return {values, unit: modelled ? "N" : unit, largest: values.reduce((most, v) => Math.max(most, v), 1e-9),
    title: modelled ? "from the model" : words};
}

function figures(begun, all, rows) {
  const card = (size, unit, text, name) => el("div", {class: "card"},
    el("div", {class: "value"}, size, " ", el("small", {}, unit)), el("div", {class: "soft"}, text, name ? help(name) : null));
  const last = all.at(-1), with_ = rows.filter(item => item.model), of = key => number(median(with_.map(item => item[key])), 2);
  const [force] = sizeOf(begun), both = (begun.columns ?? WRENCH).some(name => name.endsWith("_Nm"));
  const moment = both ? `and ${number(last.noise_Nm, 2)} N m: ` : "";
  return [card(`${last.visit} of ${last.of}`, "", `visits, ${number((last.time_s - all[0].time_s) / 60, 2)} min`),
    last.noise_N === null ? card("–", "", "noise of one reading: known after five repeats", "noise floor")
      : force ? card(number(last.noise_N, 2), "N", `${moment}noise of one reading`, "noise floor")
        : card(number(last.noise_Nm, 2), "N m", "noise of one reading", "noise floor"),
    ...with_.length ? [card(of("model_N"), "N, median", `from the model; the last row ${number(with_.at(-1).model_N, 2)} N`, "residual"),
      card(of("model_mm"), "mm, median", `from the model; the last row ${number(with_.at(-1).model_mm, 2)} mm`, "as pose error")] : [],
    ...last.goal ? [card(last.goal.text, "", ["is the goal", ...last.goal.words].join("; "))] : []];
}

const median = values => values.toSorted((a, b) => a - b)[values.length >> 1];

// As those of a comparison. The noise of a component: that of the force, or of the moment, over the three axes.
function residualsOf({columns}, rows, {noise_N: force, noise_Nm: moment}) {
  const own = names => names.map((name, k) => [name, k]).filter(([name]) => columns.includes(name)), wrench = own(WRENCH);
  return asMeasured(Object.fromEntries([...own(POSE).map(([name, k]) => [name, rows.map(item => item.pose[k])]),
    ...wrench.map(([name, k]) => [name, rows.map(item => item.wrench[k])]), ["time_s", rows.map(item => item.time_s - rows[0].time_s)]]),
  rows.map(item => item.number), {left: wrench.map(([, k]) => rows.map(item => item.model ? item.wrench[k] - item.model[k] : null)),
    floor: force === null ? null : wrench.map(([, k]) => (k < 3 ? force : moment) / Math.sqrt(3))});
}

function sceneOf(begun, rows, {values, largest, title, unit}) {
  const profile = profileOf(begun), n = rows.length;
  const scale = scaleOf(largest), {soft, wash} = colours();
  const planned = faded(rgb(soft), rgb(wash), PLANNED);
  const [x, y, z] = [0, 1, 2].map(k => mm([...begun.poses[POSE[k]], ...rows.map(item => item.pose[k])]));
  const body = (pose, colour, alpha) => {
    const {points, triangles} = bent(profile, pose);
    return {points: points.map(mm), triangles, colour, alpha};
  };
  const bodies = [body([profile.length, 0, 0, 0, 0, 0], bodyColour(), n ? 0.25 : 0.4)];
  const frames = begun.frames.map(frame => ({name: frame.name, origin: mm(frame.origin_m), axes: frame.axes, size: 300 * profile.length}));
  if (n) {
    const now = rows[n - 1].pose;
    bodies.push(body(now, scale(values[n - 1]), 1));
    frames.push({name: "", origin: mm(now.slice(0, 3)), axes: axesOf(now.slice(3)), size: 180 * profile.length});
  }
  const before = x.length - n;
  return {bodies, frames, points: {x, y, z, row: x.map((_, i) => i < before ? -1 - i : rows[i - before].number),
    colour: x.map((_, i) => i < before ? planned : scale(values[i - before])),
    text: i => i < before ? `planned: ${number(x[i])}, ${number(y[i])}, ${number(z[i])} mm`
      : `row ${rows[i - before].number}: ${title} ${number(values[i - before])} ${unit}`}};
}
