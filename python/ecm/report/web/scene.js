// What the space of a table shows: the body at rest, bent into some poses, the frames, the rows.

import {axesOf, bent, farApart, profileOf} from "./bend.js";
import {glide} from "./canvas.js";
import {colours, rgb, scaleOf} from "./colours.js";
import {el, number} from "./dom.js";
import {bodyColour, space} from "./space.js";
import {mark, marked, onMark} from "./selection.js";

export const POSE = ["x_m", "y_m", "z_m", "theta_x_rad", "theta_y_rad", "theta_z_rad"];
export const WRENCH = ["fx_N", "fy_N", "fz_N", "tau_x_Nm", "tau_y_Nm", "tau_z_Nm"];
export const mm = values => values.map(v => v * 1e3);
export const hasSpace = columns => POSE.slice(0, 3).every(name => columns[name]);
const FEW = 4;
const HOW = "Drag turns. A click or a tap marks one row, shift and drag or “Mark a box” those in a box.";

// `values` of the rows colour them; `title` and `unit` say what they are; `forces`: draw them, too. `gap`: how far the
// model puts the top from where it was measured, six columns in m and rad, `now` and, where it was fitted again, `before`.
export function workspace(view, rows, columns, values, {title, unit, forces = false, name, gap = null}) {
  const pose = POSE.map(key => columns[key]);
  if (!hasSpace(columns)) {
    return el("div", {class: "waiting"}, "No picture in space: the table has not all of x, y and z.");
  }
  const full = pose.every(Boolean), profile = profileOf(view), force = forces ? forcesOf(columns, profile) : null;
  const largest = quantile(values, 0.98), scale = scaleOf(largest);
  const [x, y, z] = pose.slice(0, 3).map(mm);
  const order = values.map((_, i) => i).sort((a, b) => (values[b] ?? 0) - (values[a] ?? 0));
  const apart = full && gap ? gapOf(gap, profile.length) : null, worst = apart?.largest ?? order[0] ?? 0;
  const some = full ? farApart(pose.slice(0, 3), apart ? 1 : FEW, worst) : [];
  const place = new Map(rows.map((row, i) => [row, i]));
  const inMm = ({points, triangles}, colour, alpha) => ({points: points.map(mm), triangles, colour, alpha});
  const drawn = space(name, {onpick: row => mark([row]), onbox: mark});

  function show(keep = false) {
    const at = [...marked].flatMap(row => place.has(row) ? [place.get(row)] : []).slice(0, 3);
    const bodies = apart ? [] : [inMm(bent(profile, [profile.length, 0, 0, 0, 0, 0]), bodyColour(), at.length ? 0.25 : 0.4)];
    const frames = view.frames.map(frame => ({name: frame.name, origin: mm(frame.origin_m),
      axes: frame.axes, size: 300 * profile.length}));
    const lines = [];
    for (const [k, i] of (full ? (at.length ? at : some) : []).entries()) {
      const here = pose.map(values => values[i]);
      // Of bodies that were not asked for, one is solid: four in one place hide each other.
      bodies.push(inMm(bent(profile, here), apart ? bodyColour() : scale(values[i]), at.length || k === 0 ? 1 : 0.4));
      frames.push({name: "", origin: [x[i], y[i], z[i]], axes: axesOf(here.slice(3)), size: 180 * profile.length});
      if (apart) {
        const there = here.map((v, k) => v + apart.at(k, i)), second = rgb(colours().second);
        bodies.push(inMm(bent(profile, there), second, 0.45));
        frames.push({name: "", origin: mm(there.slice(0, 3)), axes: axesOf(there.slice(3)), size: 180 * profile.length});
        lines.push({from: [x[i], y[i], z[i]], to: mm(there.slice(0, 3)), colour: second});
      }
      if (force) lines.push({from: [x[i], y[i], z[i]], colour: scale(largest),
        to: [x, y, z].map((values_, k) => values_[i] + force.scale * force.columns[k][i])});
    }
    drawn.set({bodies, frames, lines, points: {x, y, z, row: rows,
      colour: values.map(scale),
      text: i => `row ${rows[i]}: ${title} ${number(values[i])} ${unit}; at ${number(x[i])}, `
        + `${number(y[i])}, ${number(z[i])} mm`}}, keep);
  }
  // The panels are drawn first: a brush is seen there at once.
  let asked = false;
  onMark(() => {
    if (!asked) requestAnimationFrame(() => setTimeout(() => { asked = false; show(); }));
    asked = true;
  });
  show();
  if (apart && gap.before) glide(along => { apart.share = along; show(true); }, 1600);
  return el("div", {}, drawn.node, apart?.slider(show),
    scaleBar(title, largest, unit),
    el("p", {class: "hint"}, apart ? `Solid is the measured pose, orange where the model puts it: of the row that is off most, or of up to three `
      + `marked ones. ${HOW}` : full
      ? "Bent bodies: poses far apart, or up to three marked ones; between its two end frames the shape "
        + `is sketched. ${HOW}` : HOW));
}

export const scaleBar = (title, largest, unit) => el("div", {class: "scale", role: "img",
  "aria-label": `Colours from 0 to ${number(largest)} ${unit}`}, `${title}: 0`, el("i"), `${number(largest)} ${unit}`);

const GAP = 0.15;  // of the mechanism's length: how large the largest gap is drawn at first

// Gaps between measured and modelled poses, enlarged by a slider; `share` of the way from before to now.
function gapOf({now, before = null}, length) {
  const size = i => Math.hypot(...now.slice(0, 3).map(column => column[i] ?? 0), ...now.slice(3).map(column => length * (column[i] ?? 0)));
  const most = of => of[0].reduce((found, _, i) => Math.max(found, Math.hypot(...of.map((column, k) => (k < 3 ? 1 : length) * (column[i] ?? 0)))), 1e-9);
  const first = Math.max(1, Math.min(1000, GAP * length / most(before ?? now)));
  let factor = Number(first.toPrecision(1));
  return {
    share: before ? 0 : 1,
    largest: now[0].reduce((best, _, i) => size(i) > size(best) ? i : best, 0),
    at(k, i) { return factor * ((1 - this.share) * (before?.[k][i] ?? now[k][i] ?? 0) + this.share * (now[k][i] ?? 0)); },
    slider(show) {
      const said = el("output", {for: "enlarged"}), say = () => { said.textContent = factor < 1.5 ? "as it is" : `${number(factor, 2)} times as large`; };
      const input = el("input", {type: "range", id: "enlarged", min: 0, max: 3, step: 0.02, value: Math.log10(factor),
        oninput: () => { factor = 10 ** Number(input.value); say(); show(true); }, onchange: () => show()});
      say();
      return el("div", {class: "row slider"}, el("label", {for: "enlarged"}, "The gap is drawn"), input, said);
    },
  };
}

// Forces as lines: the largest is four tenths of the mechanism long.
function forcesOf(columns, {length}) {
  const found = ["fx_N", "fy_N", "fz_N"].map(name => columns[name]);
  if (!found.every(Boolean)) return null;
  const largest = found[0].reduce((most, v, i) => Math.max(most, Math.hypot(v, found[1][i], found[2][i])), 1e-9);
  return {columns: found, scale: 400 * length / largest};
}

function quantile(values, share) {
  const sorted = values.filter(v => v !== null).sort((a, b) => a - b);
  return sorted.length ? sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))] : 1;
}
