// Small line charts as SVG: the ladder of errors, and the learning curve.

import {glide, ticks} from "./canvas.js";
import {colours} from "./colours.js";
import {el, number} from "./dom.js";
import {svg} from "./figure.js";

// lines: [{name, values, colour: "mark" or "second", dash, square}] over the labels; floor: a dotted line.
// `log`: each step up is as many times as much; `begins`: labels at which a line begins anew; `grow`: the last
// label's points come from those of the one before.
export function chart({title, labels, lines, floor = null, yTitle, log = false, begins = [], grow = false}) {
  const picture = svg("svg", {class: "ladder", role: "img", "aria-label": title});
  const node = el("div", {}, picture);
  const all = lines.flatMap(line => line.values).filter(v => v !== null && v !== undefined && (v > 0 || !log));
  const range = [...all, ...floor === null ? [] : [floor]];
  const high = 1.12 * Math.max(1e-9, ...range), low = log ? Math.min(...range, high) / 1.4 : 0;
  const at = log ? v => Math.log(Math.max(v, low) / low) / Math.log(1.3 * high / low) : v => v / high;
  const last = labels.length - 1;
  const grown = (values, share) => share === 1 || values[last - 1] === null || values[last] === null ? values
    : values.map((v, i) => i === last ? values[last - 1] + share * (v - values[last - 1]) : v);
  const draw = share => {
    const width = node.clientWidth, height = 320, left = 46, right = 24, top = 46, bottom = 46;
    if (!width) return;
    const palette = colours(), room = width - left - right, each = room / labels.length;
    const x = i => left + each * (i + 0.5) - (i === last ? each * (1 - share) : 0);
    const y = v => height - bottom - at(v) * (height - top - bottom);
    picture.setAttribute("viewBox", `0 0 ${width} ${height}`);
    picture.replaceChildren();
    const put = (...of) => picture.append(svg(...of));
    for (const v of log ? decades(low, 1.3 * high) : ticks(0, high, 5)) {
      put("line", {x1: left, x2: width - right, y1: y(v), y2: y(v), stroke: palette.line});
      put("text", {x: left - 8, y: y(v) + 4, "text-anchor": "end"}, number(v));
    }
    put("text", {x: 4, y: 14}, yTitle);
    if (floor !== null) {
      put("rect", {x: left, y: y(floor), width: room, height: height - bottom - y(floor), fill: palette.band});
      put("line", {x1: left, x2: width - right, y1: y(floor), y2: y(floor), stroke: palette.soft,
        "stroke-dasharray": "2 4", "stroke-width": 2});
      put("text", {x: left + 8, y: y(floor) + 18}, "noise floor");
    }
    const letters = Math.max(6, Math.floor(each / 8));
    labels.forEach((text, i) => put("text", {x: left + each * (i + 0.5), y: height - bottom + 20, "text-anchor": "middle",
      opacity: i === last ? share : 1}, text.length > letters ? `${text.slice(0, letters - 1)}…` : text));
    lines.forEach((line, k) => series(put, {...line, values: grown(line.values, share)}, {x, y, palette, k, left, begins}));
  };
  new ResizeObserver(() => draw(1)).observe(node);
  if (grow && last > 0) glide(draw, 900);
  return node;
}

// 1, 2 and 5 times the powers of ten between two numbers; of many the powers alone.
function decades(low, high) {
  const found = [];
  for (let power = Math.floor(Math.log10(low)); 10 ** power <= high; power += 1)
    for (const k of high / low > 200 ? [1] : [1, 2, 5]) found.push(k * 10 ** power);
  return found.filter(v => v >= low && v <= high);
}

function series(put, line, {x, y, palette, k, left, begins}) {
  const colour = palette[line.colour];
  const at = line.values.flatMap((v, i) => v === null || v === undefined ? [] : [[x(i), y(v), v, i]]);
  const path = at.map(([a, b, , i], n) => `${n === 0 || begins.includes(i) ? "M" : "L"}${a},${b}`).join("");
  put("path", {d: path, fill: "none", stroke: colour, "stroke-width": 2.5, "stroke-dasharray": line.dash ?? "none"});
  for (const [a, b, v] of at) {
    if (line.square) put("rect", {x: a - 5, y: b - 5, width: 10, height: 10, fill: colour});
    else put("circle", {cx: a, cy: b, r: 6, fill: colour});
    put("text", {x: a, y: line.square ? b - 12 : b + 22, "text-anchor": "middle", "font-weight": 600},
      v < 10 ? v.toFixed(2) : number(v));
  }
  const start = left + 150 * k;
  put("line", {x1: start, x2: start + 26, y1: 32, y2: 32, stroke: colour, "stroke-width": 2.5,
    "stroke-dasharray": line.dash ?? "none"});
  if (line.square) put("rect", {x: start + 8, y: 27, width: 10, height: 10, fill: colour});
  else put("circle", {cx: start + 13, cy: 32, r: 6, fill: colour});
  put("text", {x: start + 34, y: 36}, line.name);
}
