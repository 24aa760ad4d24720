// What the space of a table shows: the body at rest, bent into some poses, the frames, the rows.

import {axesOf, bent, farApart, profileOf} from "./bend.js";
import {css, scaleOf} from "./colours.js";
import {el, number} from "./dom.js";
import {bodyColour, space} from "./space.js";
import {mark, marked, onMark} from "./selection.js";

export const POSE = ["x_m", "y_m", "z_m", "theta_x_rad", "theta_y_rad", "theta_z_rad"];
export const WRENCH = ["fx_N", "fy_N", "fz_N", "tau_x_Nm", "tau_y_Nm", "tau_z_Nm"];
export const mm = values => values.map(v => v * 1e3);
const FEW = 4;
const HOW = "Drag turns. A click or a tap marks one row, shift and drag or “Mark a box” those in a box.";

// `values` of the rows colour them; `title` and `unit` say what they are; `forces`: draw them, too.
export function workspace(view, rows, columns, values, {title, unit, forces = false, name}) {
  const pose = POSE.map(key => columns[key]);
  if (!pose.slice(0, 3).every(Boolean)) {
    return el("div", {class: "waiting"}, "No picture in space: the table has not all of x, y and z.");
  }
  const full = pose.every(Boolean), profile = profileOf(view), force = forces ? forcesOf(columns, profile) : null;
  const largest = quantile(values, 0.98), scale = scaleOf(largest);
  const [x, y, z] = pose.slice(0, 3).map(mm);
  const order = values.map((_, i) => i).sort((a, b) => (values[b] ?? 0) - (values[a] ?? 0));
  const some = full ? farApart(pose.slice(0, 3), FEW, order[0] ?? 0) : [];
  const place = new Map(rows.map((row, i) => [row, i]));
  const inMm = ({points, triangles}, colour, alpha) => ({points: points.map(mm), triangles, colour, alpha});
  const drawn = space(name, {onpick: row => mark([row]), onbox: mark});

  function show() {
    const at = [...marked].flatMap(row => place.has(row) ? [place.get(row)] : []).slice(0, 3);
    const bodies = [inMm(bent(profile, [profile.length, 0, 0, 0, 0, 0]), bodyColour(), at.length ? 0.25 : 0.4)];
    const frames = view.frames.map(frame => ({name: frame.name, origin: mm(frame.origin_m),
      axes: frame.axes, size: 300 * profile.length}));
    const lines = [];
    for (const [k, i] of (full ? (at.length ? at : some) : []).entries()) {
      const here = pose.map(values => values[i]);
      // Of bodies that were not asked for, one is solid: four in one place hide each other.
      bodies.push(inMm(bent(profile, here), scale(values[i]), at.length || k === 0 ? 1 : 0.4));
      frames.push({name: "", origin: [x[i], y[i], z[i]], axes: axesOf(here.slice(3)), size: 180 * profile.length});
      if (force) lines.push({from: [x[i], y[i], z[i]], colour: css(scale(largest)),
        to: [x, y, z].map((values_, k) => values_[i] + force.scale * force.columns[k][i])});
    }
    drawn.set({bodies, frames, lines, points: {x, y, z, row: rows,
      colour: values.map(scale),
      text: i => `row ${rows[i]}: ${title} ${number(values[i])} ${unit}; at ${number(x[i])}, `
        + `${number(y[i])}, ${number(z[i])} mm`}});
  }
  // The panels are drawn first: a brush is seen there at once.
  let asked = false;
  onMark(() => {
    if (!asked) requestAnimationFrame(() => setTimeout(() => { asked = false; show(); }));
    asked = true;
  });
  show();
  return el("div", {}, drawn.node,
    el("div", {class: "scale", role: "img", "aria-label": `Colours from 0 to ${number(largest)} ${unit}`},
      `${title}: 0`, el("i"), `${number(largest)} ${unit}`),
    el("p", {class: "hint"}, full
      ? "Bent bodies: poses far apart, or up to three marked ones; between its two end frames the shape "
        + `is sketched. ${HOW}` : HOW));
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
