// Small line charts: the ladder of errors, and the learning curve.

import {glide} from "./canvas.js";
import {number} from "./dom.js";
import {figure} from "./figure.js";

// lines: [{name, values, colour: "mark" or "second", dash, square}] over the labels; floor: what lies below is noise.
// `log`: each step up is as many times as much; `begins`: labels at which a line begins anew; `grow`: the last
// label's points fall or rise from the values of the one before.
export function chart({title, labels, lines, floor = null, xTitle = "", yTitle, log = false, begins = [], grow = false}) {
  const last = labels.length - 1, parts = [...new Set([0, ...begins])];
  const all = [...lines.flatMap(line => line.values), floor].filter(v => v > 0), high = Math.max(1e-9, ...all);
  const range = log ? [Math.log10(Math.min(high, ...all) / 1.4), Math.log10(1.45 * high)] : [0, 1.12 * high];
  const x = labels.map((text, i) => labels.indexOf(text) === i ? text : `${i + 1} ${text}`), moved = [];
  const data = lines.flatMap(({name, values, colour, dash = "solid", square}) => parts.map((from, k) => {
    const end = parts[k + 1] ?? labels.length, y = values.slice(from, end), look = {color: `var(--${colour})`};
    const text = y.map(v => v === null ? "" : v < 10 ? v.toFixed(2) : number(v)), [before, now] = [values[last - 1] ?? null, values[last] ?? null];
    if (end === labels.length && before !== null && now !== null) moved.push(share => { y[y.length - 1] = before + share * (now - before); });
    return {name, x: x.slice(from, end), y, text, showlegend: k === 0, mode: "lines+markers+text", textposition: square ? "top center" : "bottom center",
      line: {...look, dash, width: 2.5}, marker: {...look, symbol: square ? "square" : "circle", size: 11}};
  }));
  const longest = Math.max(0, ...x.map(text => text.length)), more = 7 * longest * x.length > 400 ? 3.6 * longest : 0;  // long names are tilted
  const drawn = figure({data, layout: {height: 330 + more, showlegend: true, margin: {t: 52, b: 48 + more}, xaxis: {title: {text: xTitle}}, yaxis: {type: log ? "log" : "linear", range, title: {text: yTitle}},
    shapes: floor === null ? [] : [{y1: floor, label: {text: "noise floor"}}]}}, {label: title});
  drawn.node.classList.add("ladder");
  if (grow && last > 0) glide(share => { for (const move of moved) move(share); drawn.draw(); }, 900);
  return drawn.node;
}
