// One scatter panel: points over a variable, the noise band, a histogram at its right side, a brush.

import {pointer, sized, stamp, ticks, tip} from "./canvas.js";
import {colours, rgb} from "./colours.js";
import {el, number} from "./dom.js";

const FINGER = 24, MOUSE = 10, TRACE = 0.3;
const LEFT = 52, RIGHT = 46, TOP = 24, BOTTOM = 34, BINS = 28, MANY = 1500;
const FONT = "12px system-ui, DejaVu Sans, sans-serif";

// data: {x, y, xTitle, yTitle, title, floor, row, onesided}; brush(indices, done) is told the marked.
export function panel({onbrush, say}) {
  const base = el("canvas", {"aria-hidden": "true"});
  const over = el("canvas", {tabindex: "0", role: "application", "aria-roledescription": "figure"});
  const node = el("figure", {class: "panel"}, base, over);
  let data = null, low = [0, 0], high = [1, 1], width = 0, height = 0;
  // Where the points are, while they lie elsewhere than they were measured; from where to where they go.
  let moved = null, start = null, to = null, going = [], chosen = [], box = null, cursor = -1, order = null, asked = false;
  const now = () => moved ?? data.y;

  const px = v => LEFT + (v - low[0]) / (high[0] - low[0]) * (width - LEFT - RIGHT);
  const py = v => height - BOTTOM - (v - low[1]) / (high[1] - low[1]) * (height - TOP - BOTTOM);
  const redrawBase = sized(base, drawBase), redrawOver = sized(over, drawOver);
  const ask = () => {
    if (!asked) { asked = true; requestAnimationFrame(() => { asked = false; redrawOver(); }); }
  };

  function set(next) {
    data = next;
    moved = start = to = null;
    order = null;
    cursor = -1;
    over.setAttribute("aria-label", `${data.title}, ${data.yTitle} over ${data.xTitle}. `
      + "Arrow keys go from row to row, space marks, escape clears.");
    [low[0], high[0]] = spread(data.x, 0);
    [low[1], high[1]] = spread(data.y, data.floor ?? 0, data.onesided);
    redrawBase();
    redrawOver();
  }

  function drawBase(context, w, h) {
    [width, height] = [w, h];
    context.clearRect(0, 0, w, h);
    if (!data) return;
    const palette = colours(), right = w - RIGHT, bottom = h - BOTTOM;
    context.font = FONT;
    if (data.floor) {
      const top = py(data.floor), end = py(data.onesided ? low[1] : -data.floor);
      context.fillStyle = palette.band;
      context.fillRect(LEFT, top, right - LEFT, end - top);
    }
    context.lineWidth = 1;
    axes(context, palette, right, bottom);
    // Points that are elsewhere leave a trace where they were measured.
    context.globalAlpha = moved ? TRACE : 1;
    dots(context, data.x, data.y, null, palette.point, 2.6);
    bars(context, data.y, palette.point);
    context.globalAlpha = 1;
    context.fillStyle = palette.ink;
    context.font = `600 13px system-ui, sans-serif`;
    context.fillText(data.title, LEFT, 14);
  }

  function axes(context, palette, right, bottom) {
    context.strokeStyle = palette.line;
    context.fillStyle = palette.soft;
    context.textAlign = "right";
    for (const value of ticks(low[1], high[1], 4)) {
      const y = Math.round(py(value)) + 0.5;
      line(context, LEFT, y, right, y);
      context.fillText(number(value, 6), LEFT - 6, y + 4);
    }
    context.textAlign = "center";
    for (const value of ticks(low[0], high[0], Math.max(3, (right - LEFT) / 70)))
      context.fillText(number(value, 6), px(value), bottom + 14);
    context.fillText(data.xTitle, (LEFT + right) / 2, bottom + 29);
    context.textAlign = "right";
    context.fillText(data.yTitle, right + RIGHT, 14);
    context.textAlign = "left";
    context.strokeStyle = palette.soft;
    line(context, LEFT, bottom, right, bottom);
  }

  // Points, of the indices `which` or all.
  function dots(context, x, y, which, colour, r, full = which !== null) {
    const n = which ? which.length : x.length;
    if (n > MANY) {
      const ink = rgb(colour), seen = which ?? x.map((_, i) => i);
      stamp(context, seen.filter(i => x[i] !== null && y[i] !== null),
        {x: i => px(x[i]), y: i => py(y[i]), ink: () => ink, size: full ? 2.2 : 1.6});
      return;
    }
    context.strokeStyle = context.fillStyle = colour;
    context.lineWidth = 1.3;
    for (let k = 0; k < n; k += 1) {
      const i = which ? which[k] : k;
      if (x[i] === null || y[i] === null) continue;
      context.beginPath();
      context.arc(px(x[i]), py(y[i]), r, 0, 7);
      if (full) context.fill(); else context.stroke();
    }
  }

  // Counts of y in even bins, beside the panel.
  function bars(context, values, colour) {
    const counts = new Array(BINS).fill(0), size = (high[1] - low[1]) / BINS;
    for (const v of values) if (v !== null)
      counts[Math.min(BINS - 1, Math.max(0, Math.floor((v - low[1]) / size)))] += 1;
    const most = Math.max(1, data.most ?? 0, ...counts);
    if (!data.most) data.most = most;
    context.fillStyle = colour;
    const tall = (height - TOP - BOTTOM) / BINS;
    counts.forEach((count, k) => context.fillRect(width - RIGHT + 4,
      py(low[1] + (k + 1) * size), (RIGHT - 8) * count / most, Math.max(1, tall - 1)));
  }

  function drawOver(context, w, h) {
    context.clearRect(0, 0, w, h);
    if (!data) return;
    const palette = colours();
    context.font = FONT;
    context.save();
    context.beginPath();
    context.rect(LEFT - 5, TOP - 5, w - LEFT - RIGHT + 10, h - TOP - BOTTOM + 10);
    context.clip();
    if (moved) dots(context, data.x, moved, going, palette.second, 2.6, false);
    if (chosen.length) dots(context, data.x, now(), chosen, palette.second, 4.2);
    context.restore();
    if (chosen.length) bars(context, chosen.map(i => now()[i]), palette.second);
    else if (moved) bars(context, going.map(i => moved[i]), palette.second);
    pointer(context, palette, cursor >= 0 && [px(data.x[cursor]), py(now()[cursor])], 7, box);
  }

  function inside() {
    const [x0, x1] = [box[0], box[2]].sort((a, b) => a - b), [y0, y1] = [box[1], box[3]].sort((a, b) => a - b);
    const found = [];
    for (let i = 0; i < data.x.length; i += 1) {
      if (data.x[i] === null || now()[i] === null) continue;
      const x = px(data.x[i]), y = py(now()[i]);
      if (x >= x0 && x <= x1 && y >= y0 && y <= y1) found.push(i);
    }
    return found;
  }

  function nearest(x, y, within) {
    let best = -1, distance = within ** 2;
    for (let i = 0; i < data.x.length; i += 1) {
      const d = (px(data.x[i]) - x) ** 2 + (py(now()[i]) - y) ** 2;
      if (d < distance) { distance = d; best = i; }
    }
    return best;
  }

  const text = i => `row ${data.row[i]}: ${data.title} ${number(now()[i])} ${data.unit}, `
    + `${data.xTitle} ${number(data.x[i], 4)}`;
  let from = null;
  over.addEventListener("pointerdown", event => {
    if (event.button !== 0 || !event.isPrimary) return; // a menu or a second finger is no drag
    from = [event.offsetX, event.offsetY];
    over.setPointerCapture(event.pointerId);
  });
  over.addEventListener("pointermove", event => {
    if (from) {
      const {offsetX: x, offsetY: y} = event;
      // A finger that goes sideways marks all rows between, since up and down moves the page.
      const flat = event.pointerType === "touch" && Math.abs(y - from[1]) < FINGER;
      box = flat ? [from[0], TOP, x, height - BOTTOM] : [...from, x, y];
      onbrush(inside(), false);
    } else {
      const i = nearest(event.offsetX, event.offsetY, MOUSE);
      tip(i < 0 ? "" : text(i), event);
    }
  });
  over.addEventListener("pointerleave", event => tip("", event));
  over.addEventListener("pointerup", event => {
    if (!from) return;
    const i = nearest(event.offsetX, event.offsetY, event.pointerType === "touch" ? FINGER : MOUSE);
    const moved = Math.hypot(event.offsetX - from[0], event.offsetY - from[1]) > 5;
    const found = box && moved ? inside() : i < 0 ? [] : [i];
    from = box = null;
    onbrush(found, true);
  });
  over.addEventListener("pointercancel", () => { from = box = null; onbrush(null, true); });
  over.addEventListener("keydown", event => {
    if (!data) return;
    order ??= data.x.map((_, i) => i).sort((a, b) => data.x[a] - data.x[b]);
    const at = order.indexOf(cursor);
    const next = {ArrowRight: at + 1, ArrowLeft: at - 1, Home: 0, End: order.length - 1}[event.key];
    if (next !== undefined) {
      cursor = order[Math.min(order.length - 1, Math.max(0, next))];
      if (event.shiftKey) onbrush([...new Set([...chosen, cursor])], true);
      say(text(cursor));
    } else if (event.key === " " && cursor >= 0) {
      onbrush(chosen.includes(cursor) ? chosen.filter(i => i !== cursor) : [...chosen, cursor], true);
    } else if (event.key === "Escape") onbrush([], true);
    else return;
    event.preventDefault();
    ask();
  });
  over.addEventListener("blur", () => { cursor = -1; ask(); });

  return {node, set,
    mark(indices) { chosen = indices; ask(); },
    // Where the points at some places shall go, null for where they were measured; `slide` moves them there.
    aim(values, places) {
      if (values === null && moved === null) return;
      const rest = moved === null;
      if (rest) {
        going = places;
        moved = new Array(data.y.length).fill(null);
        for (const i of going) moved[i] = data.y[i];
      }
      start = moved.slice();
      to = values;
      if (rest) redrawBase();
    },
    slide(share) {
      if (moved === null) return;
      const end = to ?? data.y;
      for (const i of going) moved[i] = end[i] === null || start[i] === null ? end[i] : start[i] + share * (end[i] - start[i]);
      if (share === 1 && to === null) {
        moved = null;
        redrawBase();
      }
      redrawOver();
    }};
}

export function spread(values, least, onesided = false) {
  let low = Infinity, high = -Infinity;
  for (const v of values) if (v !== null) { low = Math.min(low, v); high = Math.max(high, v); }
  if (!Number.isFinite(low)) [low, high] = [0, 1];
  if (least) { high = Math.max(high, 1.15 * least); low = onesided ? 0 : Math.min(low, -1.15 * least); }
  const room = 0.05 * (high - low) || Math.abs(high) * 0.05 || 1;
  return [onesided ? 0 : low - room, high + room];
}

export function line(context, x0, y0, x1, y1) {
  context.beginPath();
  context.moveTo(x0, y0);
  context.lineTo(x1, y1);
  context.stroke();
}
