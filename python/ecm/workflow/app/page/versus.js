// Measured over model, and their difference below. A wipe shows the model of before at its left.

import {glide, sized, stamp, ticks, tip} from "./canvas.js";
import {colours, rgb} from "./colours.js";
import {column, label} from "./columns.js";
import {el, number} from "./dom.js";
import {term} from "./help.js";
import {line, spread} from "./panel.js";
import {POSE, WRENCH} from "./scene.js";
import {marked, onMark} from "./selection.js";

const LEFT = 58, RIGHT = 14, TOP = 26, GAP = 30, NAMED = 48, BOTTOM = 38, UPPER = 0.6, MANY = 1500, NEAR = 12;
const FONT = "12px system-ui, DejaVu Sans, sans-serif";
const last = {component: null, variable: null};

// Columns by their names in the form of the residuals of a comparison; `left` of each component, where a model says it.
export function asMeasured(columns, row, {left = null, floor = null} = {}) {
  const names = WRENCH.filter(name => columns[name]), measured = names.map(name => columns[name]);
  const variables = Object.fromEntries(Object.entries(columns).filter(([name]) => !names.includes(name)));
  return {row, worst: [], strongest: Object.keys(variables).slice(-1), variables, measured,
    kinds: {wrench: {columns: names, values: left ?? measured.map(() => row.map(() => null)), floor}}};
}

// `before`: residuals of an earlier model and its name; `grow`: the wipe goes over by itself once. Where nothing is
// modelled, what is measured is shown alone. `set` takes the residuals of more rows.
export function versus(residuals, name, {before = null, grow = false} = {}) {
  const {wrench} = residuals.kinds, canvas = el("canvas"), place = el("div", {class: "versus"}, canvas);
  const worst = wrench.columns.indexOf(residuals.worst[0]?.component);
  const component = menu("component", wrench.columns, wrench.columns[Math.max(0, worst)]);
  const variable = menu("over", Object.keys(residuals.variables), partner(component.value));
  const wipe = el("input", {type: "range", min: 0, max: 1, step: 0.01, value: before ? 0.5 : 0, id: "wipe",
    "aria-label": `The model of before at the left: ${before?.name ?? ""}`, oninput: () => ask()});
  const earlier = before && new Map(before.residuals.row.map((row, i) => [row, i]));
  let points = [], axes = null, asked = false;

  function partner(of) {
    if (last.variable in residuals.variables) return last.variable;
    const own = POSE[WRENCH.indexOf(of)];
    return own in residuals.variables ? own : residuals.strongest[0];
  }
  function menu(id, entries, chosen) {
    const key = id === "over" ? "variable" : id, now = entries.includes(last[key]) ? last[key] : chosen;
    return el("select", {id: `versus-${id}`, onchange: event => { last[key] = event.target.value; set(residuals); }},
      entries.map(value => el("option", {value, selected: value === now}, label(value))));
  }
  const hint = el("p", {class: "hint"}), title = el("h3"), redraw = sized(canvas, draw);
  const ask = () => {
    if (!asked) { asked = true; requestAnimationFrame(() => { asked = false; redraw(); }); }
  };

  function set(next) {
    residuals = next;
    const {wrench} = residuals.kinds;
    const j = wrench.columns.indexOf(component.value), x = residuals.variables[variable.value], {scale} = column(variable.value);
    const old = before?.residuals.kinds.wrench.values[j];
    points = residuals.row.flatMap((row, i) => {
      const measured = residuals.measured[j][i], left = wrench.values[j][i], was = earlier ? old[earlier.get(row)] ?? null : null;
      return x[i] === null || measured === null ? [] : [{row, x: x[i] * scale, measured, left, was}];
    });
    const floor = wrench.floor?.[j] ?? 0, lefts = points.flatMap(({left, was}) => [left, was].filter(v => v !== null));
    axes = {floor, x: spread(points.map(p => p.x), 0), modelled: lefts.length > 0,
      upper: spread(points.flatMap(p => [p.measured, p.measured - p.left, p.measured - p.was]), 0),
      lower: spread(lefts, floor)};
    title.textContent = axes.modelled ? "Measured and modelled" : "Measured";
    hint.replaceChildren(axes.modelled ? "Circles are measured, dashes are what the model says there; below is what is left."
      : "Circles are measured.",
    ...axes.floor && axes.modelled ? [" The shaded band is the ", term("noise floor"), "."] : [],
    before ? " Drag in the figure: the model of before lies at the left of the line." : "");
    ask();
  }

  function draw(context, w, h) {
    context.clearRect(0, 0, w, h);
    if (!points.length) return;
    const palette = colours(), right = w - RIGHT, bottom = h - BOTTOM;
    const gap = before ? NAMED : GAP;
    const middle = axes.modelled ? TOP + (bottom - gap - TOP) * UPPER : bottom, below = middle + gap;
    const px = v => LEFT + (v - axes.x[0]) / (axes.x[1] - axes.x[0]) * (right - LEFT);
    const py = (v, [low, high], top, end) => end - (v - low) / (high - low) * (end - top);
    const up = v => py(v, axes.upper, TOP, middle), down = v => py(v, axes.lower, below, bottom);
    const unit = column(component.value).unit, edge = LEFT + Number(wipe.value) * (right - LEFT);
    context.font = FONT;
    context.fillStyle = palette.band;
    if (axes.floor && axes.modelled) context.fillRect(LEFT, down(axes.floor), right - LEFT, down(-axes.floor) - down(axes.floor));
    scale(axes.upper, up, 5);
    if (axes.modelled) scale(axes.lower, down, 4);
    context.textAlign = "center";
    for (const v of ticks(...axes.x, Math.max(3, (right - LEFT) / 80))) context.fillText(number(v, 6), px(v), bottom + 15);
    context.fillText(label(variable.value), (LEFT + right) / 2, bottom + 31);
    context.textAlign = "left";
    if (axes.modelled) context.fillText(`difference [${unit}]`, LEFT, below - 6);
    for (const p of points) [p.px, p.up] = [px(p.x), up(p.measured)];
    if (before) {
      side(LEFT - 6, edge, p => p.was);
      side(edge, right + 6, p => p.left);
      context.strokeStyle = palette.ink;
      context.lineWidth = 1.5;
      line(context, edge, TOP, edge, bottom);
      words(before.name, edge - 8, "right");
      words(name, edge + 8, "left");
    } else side(LEFT - 6, right + 6, p => p.left);
    legend();

    function scale(range, at, count) {
      context.strokeStyle = palette.line;
      context.fillStyle = palette.soft;
      context.textAlign = "right";
      context.lineWidth = 1;
      for (const v of ticks(...range, count)) {
        const y = Math.round(at(v)) + 0.5;
        line(context, LEFT, y, right, y);
        context.fillText(number(v, 6), LEFT - 6, y + 4);
      }
    }
    // The points of one model between two places.
    function side(from, to, left) {
      if (to <= from) return;
      context.save();
      context.beginPath();
      context.rect(from, 0, to - from, h);
      context.clip();
      const seen = points.filter(p => left(p) !== null), model = p => up(p.measured - left(p));
      if (points.length > MANY) {
        const ink = [rgb(palette.point), rgb(palette.second)], at = {x: p => p.px, size: 1.8};
        stamp(context, points, {...at, y: p => p.up, ink: () => ink[0]});
        stamp(context, seen, {...at, y: model, ink: () => ink[1]});
        stamp(context, seen, {...at, y: p => down(left(p)), ink: () => ink[1]});
      } else for (const p of points) {
        const on = marked.has(p.row), y = model(p);
        circle(p.px, p.up, palette.point, on);
        if (left(p) === null) continue;
        context.lineWidth = 1.2;
        context.strokeStyle = palette.second;
        line(context, p.px, p.up, p.px, y);
        context.lineWidth = 2.4;
        line(context, p.px - 5, y, p.px + 5, y);
        circle(p.px, down(left(p)), palette.second, on);
      }
      context.restore();
    }
    function circle(x, y, colour, on) {
      context.beginPath();
      context.arc(x, y, on ? 5 : 3, 0, 7);
      context.lineWidth = 1.4;
      context.strokeStyle = context.fillStyle = colour;
      if (on) context.fill(); else context.stroke();
    }
    function words(text, x, align) {
      context.textAlign = align;
      context.fillStyle = palette.ink;
      context.font = `600 ${FONT}`;
      if (align === "right" ? x - LEFT > 60 : right - x > 60) context.fillText(text, x, middle + 16, align === "right" ? x - LEFT : right - x);
    }
    function legend() {
      context.font = FONT;
      context.textAlign = "left";
      circle(LEFT + 6, 12, palette.point, false);
      context.fillStyle = palette.ink;
      context.fillText(`measured ${column(component.value).words} [${unit}]`, LEFT + 16, 16);
      if (!axes.modelled) return;
      const at = LEFT + 32 + context.measureText(`measured ${column(component.value).words} [${unit}]`).width;
      context.strokeStyle = palette.second;
      context.lineWidth = 2.4;
      line(context, at, 12, at + 12, 12);
      context.fillText("modelled", at + 18, 16);
    }
  }

  canvas.addEventListener("pointermove", event => {
    if (before && event.buttons) {
      wipe.value = (event.offsetX - LEFT) / (place.clientWidth - LEFT - RIGHT);
      ask();
      return;
    }
    let near = null, least = NEAR ** 2;
    for (const p of points) {
      const far = (p.px - event.offsetX) ** 2 + (p.up - event.offsetY) ** 2;
      if (far < least) [near, least] = [p, far];
    }
    const modelled = near?.left === null ? "" : `, modelled ${number(near?.measured - near?.left)}`;
    tip(near ? `row ${near.row}: measured ${number(near.measured)}${modelled}` : "", event);
  });
  canvas.addEventListener("pointerleave", event => tip("", event));
  onMark(ask);
  set(residuals);
  if (before && grow) glide(share => { wipe.value = 1 - share; ask(); }, 1400);
  const node = el("section", {"aria-label": "Measured and modelled"}, title,
    el("div", {class: "row"}, el("label", {for: component.id}, "Show"), component, el("label", {for: variable.id}, "over"), variable),
    place, before ? el("div", {class: "row slider"}, el("label", {for: "wipe"}, "Before and after"), wipe) : null,
    hint);
  return {node, set};
}
