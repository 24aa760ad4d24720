// A figure in the dict form of ecm.report.figures as SVG: points, lines, bars and a map of text, in panels.

import {ticks, tip} from "./canvas.js";
import {el, number} from "./dom.js";

const NAME = "http://www.w3.org/2000/svg";
export const svg = (tag, attributes = {}, text = null) => {
  const node = document.createElementNS(NAME, tag);
  for (const [key, value] of Object.entries(attributes)) if (value !== null) node.setAttribute(key, value);
  if (text !== null) node.textContent = text;
  return node;
};
// Colours of the figures that a theme replaces by its own.
const OWN = {"#1c2430": "--ink", "#000000": "--ink", "white": "--paper", "#ffffff": "--paper", "#e4e8ed": "--line",
  "#0072b2": "--point", "#d55e00": "--second", "#8a94a2": "--soft"};
const themed = colour => OWN[colour] ? `var(${OWN[colour]})` : colour;
const DASH = {dash: "7 5", dot: "2 4", dashdot: "7 4 2 4", longdash: "12 6"};
// Texts of the figures are escaped, and bold by a tag.
const plain = text => String(text ?? "").replace(/<br>/g, "\n").replace(/<[^>]*>/g, "")
  .replace(/&(lt|gt|amp|quot|#x27);/g, (_, name) => ({lt: "<", gt: ">", amp: "&", quot: "\"", "#x27": "'"}[name]));
const bold = text => /<b>/.test(text) ? 600 : null;

// `label` says what is drawn to who does not see it.
export function figure(spec, {onpick = () => {}, label = null} = {}) {
  const {data} = spec, layout = structuredClone(spec.layout), given = data.map(trace => ({...trace}));
  const height = layout.height ?? 420, margin = {l: 64, r: 16, t: 60, b: 48, ...layout.margin};
  const picture = svg("svg", {class: "figure", role: "img", "aria-label": label}), place = el("div", {class: "figure-place"}, picture);
  const named = () => given.filter(trace => trace.name && trace.showlegend !== false);
  const told = layout.showlegend !== false && (named().length > 1 || layout.showlegend === true);
  if (!told && !layout.title?.text && layout.xaxis?.side !== "top") margin.t = Math.min(margin.t, 28);
  const menus = (layout.updatemenus ?? []).map((menu, k) => el("select", {"aria-label": k ? "Axes and unit" : "Against", onchange: event => {
    take(menu.buttons[event.target.value].args);
  }}, menu.buttons.map((button, i) => el("option", {value: i, selected: i === menu.active}, plain(button.label)))));
  const node = el("div", {}, menus.length ? el("div", {class: "row menus"}, menus) : null, place);
  const {l: left, b: bottom} = margin;
  let chosen = null, drawn = 0;

  // What a menu changes: values of the traces, and texts of the layout.
  function take([values, texts = {}]) {
    for (const [key, arrays] of Object.entries(values)) given.forEach((trace, i) => { trace[key] = arrays[i % arrays.length]; });
    for (const [path, text] of Object.entries(texts)) layout.annotations[Number(/\d+/.exec(path)[0])].text = text;
    draw();
  }

  function draw() {
    const width = drawn = place.clientWidth;
    if (!width) return;
    picture.replaceChildren();
    picture.setAttribute("viewBox", `0 0 ${width} ${height}`);
    // Names that do not fit beside each other are tilted by 60 degrees, and need the room below and left of them.
    const names = [...new Set(given.flatMap(({type, x}) => type !== "heatmap" && typeof x?.[0] === "string" ? x.map(plain) : []))];
    const long = names.map(name => { const text = picture.appendChild(svg("text", {}, name)), size = text.getComputedTextLength(); text.remove(); return size; });
    const longest = Math.max(0, ...long), narrow = 7 * Math.max(0, ...names.map(name => name.length)) > (width - left - margin.r) / names.length;
    margin.b = Math.max(bottom, narrow ? Math.min(24 + 0.87 * longest, height / 2) : 0);
    margin.l = Math.max(left, narrow ? 16 + 0.5 * long[0] - (width - left - margin.r) / names.length / 2 : 0);
    const inner = {w: width - margin.l - margin.r, h: height - margin.t - margin.b};
    const at = {x: v => margin.l + v * inner.w, y: v => height - margin.b - v * inner.h};
    const put = (...of) => picture.appendChild(svg(...of));
    const panels = Object.keys(layout).filter(key => /^xaxis\d*$/.test(key)).map(key => panel(key.slice(5), at));
    if (!panels.length) return;
    for (const shape of layout.shapes ?? []) if (shape.label) below(shape, panels[0], put);
    for (const item of panels) axes(item, put);
    for (const trace of given) {
      const item = panels.find(one => one.id === (trace.xaxis ?? "x").slice(1)) ?? panels[0];
      ({bar: bars, heatmap: cells}[trace.type] ?? points)(trace, item, put);
    }
    for (const note of layout.annotations ?? []) plain(note.text).split("\n").forEach((line, i) => put("text", {x: at.x(note.x),
      y: at.y(note.y) + (note.yanchor === "bottom" ? -7 : 15) + 15 * i, "text-anchor": "middle", "font-weight": bold(note.text)}, line));
    if (layout.title?.text) put("text", {x: margin.l, y: 18, "font-weight": 600}, plain(layout.title.text));
    legend(put, width);
    mark();
  }

  // The place of a panel, and where a value of each axis lies.
  function panel(id, at) {
    const own = given.filter(trace => (trace.xaxis ?? "x").slice(1) === id), of = letter => layout[`${letter}axis${id}`] ?? {};
    const scale = letter => {
      const axis = of(letter), [from, to] = (axis.domain ?? [0, 1]).map(at[letter]), values = own.flatMap(trace => spanOf(trace, letter));
      const names = [...new Set(values.filter(v => typeof v === "string"))];
      if (names.length) {
        const step = (to - from) / names.length, back = axis.autorange === "reversed";
        return {from, to, names, step, axis, at: v => from + step * ((back ? names.length - 1 - names.indexOf(v) : names.indexOf(v)) + 0.5)};
      }
      const log = axis.type === "log", known = values.filter(v => Number.isFinite(v) && (!log || v > 0)).map(v => log ? Math.log10(v) : v);
      let low = known.reduce((m, v) => Math.min(m, v), Infinity), high = known.reduce((m, v) => Math.max(m, v), -Infinity);
      if (!Number.isFinite(low)) [low, high] = [0, 1];
      const pad = 0.05 * (high - low) || 0.05 * Math.abs(high) || 1, bar = letter === "y" && own.some(trace => trace.type === "bar");
      low = bar && low === 0 ? 0 : low - pad;
      high += pad;
      [low, high] = axis.range ?? [low, high];
      return {from, to, low, high, log, axis, at: v => from + ((log ? Math.log10(v) : v) - low) / (high - low) * (to - from)};
    };
    return {id, x: scale("x"), y: scale("y")};
  }

  function spanOf(trace, letter) {
    const values = trace[letter] ?? [];
    if (trace.type !== "bar") return values;
    if (letter === "y") return [0, ...values];
    return typeof values[0] === "string" ? values : values.flatMap((v, i) => [v - widthOf(trace, i) / 2, v + widthOf(trace, i) / 2]);
  }
  const widthOf = (trace, i) => trace.width?.[i] ?? trace.width ?? (trace.x.length > 1 ? Math.abs(trace.x[1] - trace.x[0]) : 1);

  function axes({x, y}, put) {
    const line = (x1, y1, x2, y2, stroke) => put("line", {x1, y1, x2, y2, stroke: `var(${stroke})`});
    const marks = (scale, many) => scale.names ? scale.names.map(name => [scale.at(name), plain(name)])
      : (scale.log ? powers(scale, many) : ticks(scale.low, scale.high, many)).map(v => [scale.at(v), number(v, 6)]);
    const top = x.axis.side === "top", edge = top ? y.to : y.from, room = Math.abs(x.to - x.from);
    const texts = marks(x, Math.max(3, room / 55)), tilt = x.names && texts.some(([, text]) => 7 * text.length > room / texts.length);
    for (const [at, text] of marks(y, Math.max(3, Math.abs(y.to - y.from) / 45))) {
      if (!y.names) line(x.from, at, x.to, at, "--line");
      put("text", {x: x.from - 7, y: at + 4, "text-anchor": "end"}, text);
    }
    for (const [at, text] of texts) {
      if (!x.names) line(at, edge, at, edge + 4, "--soft");
      put("text", tilt ? {x: at, y: edge + 14, "text-anchor": "end", transform: `rotate(-60 ${at} ${edge + 14})`}
        : {x: at, y: top ? edge - 8 : edge + 17, "text-anchor": "middle"}, text);
    }
    line(x.from, y.from, x.to, y.from, "--soft");
    line(x.from, y.from, x.from, y.to, "--soft");
    if (x.axis.title?.text) put("text", {x: (x.from + x.to) / 2, y: y.from + 36, "text-anchor": "middle"}, plain(x.axis.title.text));
    const middle = (y.from + y.to) / 2, left = x.from - 48;
    if (y.axis.title?.text) put("text", {x: left, y: middle, "text-anchor": "middle", transform: `rotate(-90 ${left} ${middle})`}, plain(y.axis.title.text));
  }

  // What lies below a value, over the whole width, with its name.
  function below({y1, label: {text}}, {x, y}, put) {
    const top = y.at(y1);
    put("rect", {x: x.from, y: top, width: x.to - x.from, height: Math.max(0, y.from - top), fill: "var(--band)"});
    put("line", {x1: x.from, x2: x.to, y1: top, y2: top, stroke: "var(--soft)", "stroke-dasharray": DASH.dot, "stroke-width": 2});
    put("text", {x: x.from + 8, y: top + (y.from - top < 20 ? -6 : 17)}, text);
  }

  function points(trace, {x, y}, put) {
    const mode = trace.mode ?? "lines", colour = themed(trace.marker?.color ?? trace.line?.color ?? "#0072b2");
    // A value that is not known leaves a gap.
    const at = trace.x.map((v, i) => [x.at(v), (trace.y[i] ?? null) === null ? NaN : y.at(trace.y[i])]), known = i => at[i] && Number.isFinite(at[i][0] + at[i][1]);
    if (mode.includes("lines")) put("path", {d: at.map(([a, b], i) => known(i) ? `${known(i - 1) ? "L" : "M"}${a},${b}` : "").join(""), fill: "none",
      stroke: themed(trace.line?.color ?? trace.marker?.color ?? "#0072b2"), "stroke-width": trace.line?.width ?? 2, "stroke-dasharray": DASH[trace.line?.dash] ?? null});
    if (!mode.includes("markers")) return;
    at.forEach(([a, b], i) => {
      if (!known(i)) return;
      if (mode.includes("text")) put("text", {x: a, y: b + (trace.textposition === "bottom center" ? 22 : -12), "text-anchor": "middle", "font-weight": 600}, plain(trace.text[i]));
      const size = trace.marker?.size?.[i] ?? trace.marker?.size ?? 6;
      const node = put(...symbol(trace.marker?.symbol ?? "circle", a, b, size / 2, colour));
      node.setAttribute("opacity", trace.marker?.opacity ?? 1);
      if (trace.meta) [node.dataset.link, node.dataset.row] = [trace.meta, trace.customdata[i]];
      node.addEventListener("pointermove", event => tip(words(trace, i), event));
      node.addEventListener("pointerleave", event => tip("", event));
      node.addEventListener("click", () => trace.meta && onpick(trace.meta, trace.customdata[i]));
    });
  }

  function words(trace, i) {
    const value = {x: trace.x[i], y: trace.y[i], text: trace.text?.[i], customdata: trace.customdata?.[i]};
    const text = (trace.hovertemplate ?? "%{x:.4g}, %{y:.4g}").replace(/<extra>.*<\/extra>/, "");
    return plain(text.replace(/%\{(\w+)(?::\.(\d)\w)?\}/g, (_, name, digits) => typeof value[name] === "number" && digits ? number(value[name], Number(digits)) : value[name] ?? ""));
  }

  function bars(trace, {x, y}, put) {
    const group = given.filter(other => other.type === "bar" && (other.xaxis ?? "x") === (trace.xaxis ?? "x"));
    const beside = x.names && layout.barmode !== "overlay" ? group.length : 1, rank = beside > 1 ? group.indexOf(trace) : 0;
    trace.x.forEach((v, i) => {
      const wide = x.names ? 0.8 * x.step / beside : Math.abs(x.at(v + widthOf(trace, i) / 2) - x.at(v - widthOf(trace, i) / 2));
      const left = x.names ? x.at(v) - 0.4 * x.step + rank * wide : x.at(v - widthOf(trace, i) / 2);
      const [top, bottom] = [y.at(trace.y[i]), y.log ? y.from : y.at(0)];
      const node = put("rect", {x: left, y: Math.min(top, bottom), width: Math.max(0.5, wide - 1), height: Math.abs(top - bottom),
        fill: themed(trace.marker?.color ?? "#0072b2"), opacity: trace.opacity ?? 1, stroke: group.indexOf(trace) % 2 ? "var(--ink)" : null});
      node.addEventListener("pointermove", event => tip(`${plain(trace.name ?? "")} ${plain(v)}: ${number(trace.y[i])}`.trim(), event));
      node.addEventListener("pointerleave", event => tip("", event));
    });
  }

  // Numbers as text, coloured by sign and size.
  function cells(trace, {x, y}, put) {
    trace.z.forEach((line, j) => line.forEach((value, i) => {
      const [a, b] = [x.at(trace.x[i]), y.at(trace.y[j])], wide = Math.abs(x.step), tall = Math.abs(y.step);
      put("rect", {x: a - wide / 2, y: b - tall / 2, width: wide, height: tall, fill: value < 0 ? "#4393c3" : "#e58368",
        opacity: Math.min(1, Math.abs(value) / (trace.zmax || 1)) * 0.75, stroke: "var(--paper)"});
      put("text", {x: a, y: b + 4, "text-anchor": "middle", "font-weight": bold(trace.text[j][i])}, plain(trace.text[j][i]));
    }));
  }

  function legend(put, width) {
    if (!told) return;
    let at = margin.l;
    const right = layout.legend?.xanchor === "right" ? width - margin.r - named().reduce((sum, {name}) => sum + 40 + 7 * plain(name).length, 0) : 0;
    at = Math.max(at, right);
    for (const trace of named()) {
      const colour = themed(trace.marker?.color ?? trace.line?.color ?? "#0072b2"), y = Math.max(14, margin.t - (layout.annotations?.length ? 44 : 24));
      if (trace.type === "bar") put("rect", {x: at, y: y - 6, width: 14, height: 12, fill: colour});
      else if ((trace.mode ?? "lines").includes("lines")) put("path", {d: `M${at - 2},${y}h20`, stroke: colour, "stroke-width": 2, "stroke-dasharray": DASH[trace.line?.dash] ?? null});
      if (trace.mode?.includes("markers")) put(...symbol(trace.marker?.symbol ?? "circle", at + 8, y, 4, colour));
      put("text", {x: at + 21, y: y + 4}, plain(trace.name));
      at += 40 + 7 * plain(trace.name).length;
    }
  }

  // The chosen rows stand out where their points have this link.
  function mark() {
    for (const node of picture.querySelectorAll("[data-row]")) {
      const of = chosen && chosen.link === node.dataset.link;
      node.classList.toggle("chosen", Boolean(of) && chosen.rows.has(node.dataset.row));
      node.classList.toggle("other", Boolean(of) && !chosen.rows.has(node.dataset.row));
    }
  }

  // What is drawn changes the height alone.
  new ResizeObserver(() => { if (place.clientWidth !== drawn) requestAnimationFrame(draw); }).observe(place);
  return {node, draw, select(link, rows) {
    chosen = rows.length ? {link, rows: new Set(rows.map(String))} : null;
    mark();
  }};
}

// 1, 2 and 5 times the powers of ten on a logarithmic axis; of many the powers alone, of few round numbers.
function powers({low, high}, many) {
  if (high - low > 2.3) return ticks(low, high, many).filter(Number.isInteger).map(v => 10 ** v);
  const found = ticks(Math.floor(low), high, 5).filter(Number.isInteger).flatMap(v => [1, 2, 5].map(k => k * 10 ** v))
    .filter(v => Math.log10(v) >= low && Math.log10(v) <= high);
  return found.length > 2 ? found : ticks(10 ** low, 10 ** high, many);
}

function symbol(name, x, y, r, colour) {
  const line = {fill: "none", stroke: colour, "stroke-width": 1.4};
  if (name.startsWith("cross-thin")) return ["path", {d: `M${x - r - 1},${y}h${2 * r + 2}M${x},${y - r - 1}v${2 * r + 2}`, ...line}];
  const look = name.endsWith("-open") ? line : {fill: colour};
  const shape = {square: `M${x - r},${y - r}h${2 * r}v${2 * r}h${-2 * r}z`, diamond: `M${x},${y - r}l${r},${r}l${-r},${r}l${-r},${-r}z`,
    "triangle-up": `M${x},${y - r}l${r},${2 * r}h${-2 * r}z`, cross: `M${x - r},${y}h${2 * r}M${x},${y - r}v${2 * r}`}[name.replace("-open", "")];
  if (!shape) return ["circle", {cx: x, cy: y, r, ...look}];
  return ["path", {d: shape, ...name === "cross" ? {...line, "stroke-width": 2.4} : look}];
}
