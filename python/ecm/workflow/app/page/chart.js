// Small line charts as SVG: the ladder of errors, and the learning curve.

import {ticks} from "./canvas.js";
import {colours} from "./colours.js";
import {el, number} from "./dom.js";

const NAME = "http://www.w3.org/2000/svg";
const svg = (tag, attributes = {}, text = null) => {
  const node = document.createElementNS(NAME, tag);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  if (text !== null) node.textContent = text;
  return node;
};

// lines: [{name, values, colour: "mark" or "second", dash, square}] over the labels; floor: a dotted line.
export function chart({title, labels, lines, floor = null, yTitle}) {
  const picture = svg("svg", {class: "ladder", role: "img", "aria-label": title});
  const node = el("div", {}, picture);
  const all = lines.flatMap(line => line.values).filter(v => v !== null && v !== undefined);
  const high = 1.12 * Math.max(floor ?? 0, ...all, 1e-9);
  const draw = () => {
    const width = node.clientWidth, height = 320, left = 46, right = 24, top = 46, bottom = 46;
    if (!width) return;
    const palette = colours(), room = width - left - right;
    const x = i => left + room * (labels.length === 1 ? 0.5 : (i + 0.5) / labels.length);
    const y = v => height - bottom - v / high * (height - top - bottom);
    picture.setAttribute("viewBox", `0 0 ${width} ${height}`);
    picture.replaceChildren();
    const put = (...of) => picture.append(svg(...of));
    for (const v of ticks(0, high, 5)) {
      put("line", {x1: left, x2: width - right, y1: y(v), y2: y(v), stroke: palette.line});
      put("text", {x: left - 8, y: y(v) + 4, "text-anchor": "end"}, number(v));
    }
    put("text", {x: 4, y: 14}, yTitle);
    if (floor !== null) {
      put("rect", {x: left, y: y(floor), width: room, height: y(0) - y(floor), fill: palette.band});
      put("line", {x1: left, x2: width - right, y1: y(floor), y2: y(floor), stroke: palette.soft,
        "stroke-dasharray": "2 4", "stroke-width": 2});
      put("text", {x: left + 8, y: y(floor) + 18}, "noise floor");
    }
    const letters = Math.max(6, Math.floor(room / labels.length / 8));
    labels.forEach((text, i) => put("text", {x: x(i), y: height - bottom + 20, "text-anchor": "middle"},
      text.length > letters ? `${text.slice(0, letters - 1)}…` : text));
    lines.forEach((line, k) => series(put, line, {x, y, palette, k, left}));
  };
  new ResizeObserver(draw).observe(node);
  return node;
}

function series(put, line, {x, y, palette, k, left}) {
  const colour = palette[line.colour];
  const at = line.values.flatMap((v, i) => v === null || v === undefined ? [] : [[x(i), y(v), v]]);
  put("polyline", {points: at.map(([a, b]) => `${a},${b}`).join(" "), fill: "none", stroke: colour,
    "stroke-width": 2.5, "stroke-dasharray": line.dash ?? "none"});
  for (const [a, b, v] of at) {
    if (line.square) put("rect", {x: a - 5, y: b - 5, width: 10, height: 10, fill: colour});
    else put("circle", {cx: a, cy: b, r: 6, fill: colour});
    put("text", {x: a, y: line.square ? b - 12 : b + 22, "text-anchor": "middle", "font-weight": 600},
      v.toFixed(2));
  }
  const start = left + 150 * k;
  put("line", {x1: start, x2: start + 26, y1: 32, y2: 32, stroke: colour, "stroke-width": 2.5,
    "stroke-dasharray": line.dash ?? "none"});
  if (line.square) put("rect", {x: start + 8, y: 27, width: 10, height: 10, fill: colour});
  else put("circle", {cx: start + 13, cy: 32, r: 6, fill: colour});
  put("text", {x: start + 34, y: 36}, line.name);
}
