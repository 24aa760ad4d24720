// Bodies, frames and points in space on a canvas: turned by drag or arrow keys, nearest last drawn.

import {colours, css, rgb} from "./colours.js";
import {sized, stamp, tip} from "./canvas.js";
import {el} from "./dom.js";
import {marked} from "./selection.js";

const AXES = ["#d0460f", "#008f67", "#2a78c2"];
const WHILE_TURNING = 4000, MANY = 3000;
const START = {turn: -0.75, lift: 0.32, zoom: 1};

// scene: {points: {x, y, z, row, colour, text}, bodies: [{points, triangles, colour, alpha}],
// frames: [{origin, axes, name, size}], lines: [{from, to, colour}]}, all lengths in mm.
export function space(name, {onpick = () => {}, onbox = () => {}} = {}) {
  const canvas = el("canvas", {tabindex: "0", role: "img", "aria-label": `${name}. Arrow keys turn, `
    + "plus and minus zoom, Home looks from the start."});
  const node = el("div", {class: "space"}, canvas);
  let scene = {points: null, bodies: [], frames: [], lines: []}, eye = {...START};
  let centre = [0, 0, 0], extent = [], shown = [], turning = false, box = null, asked = false;

  const redraw = sized(canvas, draw);
  const ask = () => {
    if (!asked) { asked = true; requestAnimationFrame(() => { asked = false; redraw(); }); }
  };

  function set(next) {
    scene = {bodies: [], frames: [], lines: [], ...next};
    const all = [...scene.bodies.flatMap(body => body.points), 
      ...scene.frames.flatMap(({origin, axes, size}) => axes.map(axis => origin.map((v, m) => v + size * axis[m])))];
    const {points} = scene;
    if (points) for (let i = 0; i < points.x.length; i += 1) all.push([points.x[i], points.y[i], points.z[i]]);
    const low = [0, 1, 2].map(i => all.reduce((m, p) => Math.min(m, p[i]), Infinity));
    const high = [0, 1, 2].map(i => all.reduce((m, p) => Math.max(m, p[i]), -Infinity));
    centre = low.map((v, i) => (v + high[i]) / 2);
    extent = all.length > 2000 ? all.filter((_, i) => i % Math.ceil(all.length / 2000) === 0) : all;
    ask();
  }

  // The x axis of the base points up: the mechanism stands on its clamped face.
  function projection(width, height, {turn, lift, zoom} = eye, size = zoom * fit(width, height)) {
    const c = Math.cos(turn), s = Math.sin(turn), u = Math.cos(lift), v = Math.sin(lift);
    return ([x, y, z]) => {
      const up = x - centre[0], a = y - centre[1], b = z - centre[2];
      const right = c * a + s * b, away = -s * a + c * b;
      return [width / 2 + size * right, height / 2 - size * (u * up + v * away), u * away - v * up];
    };
  }

  // Pixels a mm with which all is seen from the start, with room at the edges.
  function fit(width, height) {
    const look = projection(0, 0, START, 1);
    const at = extent.map(look), side = k => Math.max(1e-6, ...at.map(point => Math.abs(point[k])));
    return 0.44 * Math.min(width / side(0), height / side(1));
  }

  function draw(context, width, height) {
    const project = projection(width, height), palette = colours();
    context.clearRect(0, 0, width, height);
    const items = [];
    for (const body of scene.bodies) {
      const at = body.points.map(project);
      for (const [i, j, k] of body.triangles) {
        const [a, b, c] = [at[i], at[j], at[k]];
        const facing = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if (facing > 0) continue;  // seen from behind
        items.push([(a[2] + b[2] + c[2]) / 3, body, a, b, c, light(body, i, j, k)]);
      }
    }
    for (const item of items.sort((a, b) => b[0] - a[0])) triangle(context, item);
    for (const line of scene.lines) segment(context, project(line.from), project(line.to), line.colour, 2);
    for (const frame of scene.frames) drawFrame(context, project, frame, palette);
    drawPoints(context, project, palette);
    if (box) {
      context.strokeStyle = palette.second;
      context.setLineDash([4, 3]);
      context.strokeRect(box[0], box[1], box[2] - box[0], box[3] - box[1]);
      context.setLineDash([]);
    }
  }

  // Points lie on top of the bodies: each can be seen and marked. While turning, some are left out.
  function drawPoints(context, project, palette) {
    const {points} = scene;
    shown = [];
    if (!points) return;
    const n = points.x.length, step = turning ? Math.ceil(n / WHILE_TURNING) : 1, few = n <= MANY;
    for (let i = 0; i < n; i += step) shown.push([...project([points.x[i], points.y[i], points.z[i]]).slice(0, 2), i]);
    const on = shown.filter(([, , i]) => marked.has(points.row[i]));
    const off = on.length ? shown.filter(([, , i]) => !marked.has(points.row[i])) : shown;
    if (few) {
      for (const [x, y, i] of off) dot(context, x, y, css(points.colour[i]), palette.wash, 3.6);
      for (const [x, y] of on) dot(context, x, y, palette.second, palette.ink, 5.5);
    } else {
      const at = {x: item => item[0], y: item => item[1]}, second = rgb(palette.second);
      stamp(context, off, {...at, ink: item => points.colour[item[2]], size: 2.2});
      if (on.length) stamp(context, on, {...at, ink: () => second, size: 3.4});
    }
  }

  // The nearest point within 12 pixels, or null.
  function nearest(x, y) {
    let best = null, distance = 144;
    for (const [px, py, i] of shown) {
      const d = (px - x) ** 2 + (py - y) ** 2;
      if (d < distance) { distance = d; best = i; }
    }
    return best;
  }

  let from = null;
  canvas.addEventListener("pointerdown", event => {
    from = [event.offsetX, event.offsetY, {...eye}, event.shiftKey];
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", event => {
    const {offsetX: x, offsetY: y} = event;
    if (!from) {
      const i = nearest(x, y);
      tip(i === null ? "" : scene.points.text(i), event);
    } else if (from[3]) {
      box = [from[0], from[1], x, y];
      ask();
    } else {
      turning = true;
      eye = {...eye, turn: from[2].turn - 0.008 * (x - from[0]),
        lift: Math.max(-1.5, Math.min(1.5, from[2].lift + 0.008 * (y - from[1])))};
      ask();
    }
  });
  const end = event => {
    if (!from) return;
    const still = Math.hypot(event.offsetX - from[0], event.offsetY - from[1]) < 4;
    if (box) {
      const [x0, x1] = [box[0], box[2]].sort((a, b) => a - b);
      const [y0, y1] = [box[1], box[3]].sort((a, b) => a - b);
      onbox(shown.filter(([x, y]) => x >= x0 && x <= x1 && y >= y0 && y <= y1)
        .map(([, , i]) => scene.points.row[i]));
    } else if (still) {
      const i = nearest(event.offsetX, event.offsetY);
      if (i !== null) onpick(scene.points.row[i]);
    }
    from = box = null;
    turning = false;
    ask();
  };
  canvas.addEventListener("pointerup", end);
  canvas.addEventListener("pointercancel", end);
  canvas.addEventListener("pointerleave", event => tip("", event));
  canvas.addEventListener("wheel", event => {
    if (document.activeElement !== canvas && !event.ctrlKey) return;  // the page scrolls
    event.preventDefault();
    eye.zoom = Math.max(0.3, Math.min(8, eye.zoom * Math.exp(-0.001 * event.deltaY)));
    ask();
  }, {passive: false});
  canvas.addEventListener("keydown", event => {
    const moves = {ArrowLeft: ["turn", 0.12], ArrowRight: ["turn", -0.12], ArrowUp: ["lift", 0.12],
      ArrowDown: ["lift", -0.12]};
    const move = moves[event.key];
    if (move) eye[move[0]] += move[1];
    else if (event.key === "+" || event.key === "=") eye.zoom *= 1.15;
    else if (event.key === "-") eye.zoom /= 1.15;
    else if (event.key === "Home") eye = {...START};
    else return;
    event.preventDefault();
    ask();
  });
  return {node, set, redraw: ask};
}

// Brightness of a triangle from its normal, for a lamp above the left shoulder.
function light({points}, i, j, k) {
  const [a, b, c] = [points[i], points[j], points[k]];
  const u = b.map((v, m) => v - a[m]), w = c.map((v, m) => v - a[m]);
  const n = [u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]];
  const size = Math.hypot(...n) || 1;
  return 0.62 + 0.38 * Math.abs(0.45 * n[0] + 0.8 * n[1] - 0.4 * n[2]) / size;
}

function triangle(context, [, body, a, b, c, bright]) {
  context.beginPath();
  context.moveTo(a[0], a[1]);
  context.lineTo(b[0], b[1]);
  context.lineTo(c[0], c[1]);
  context.closePath();
  context.fillStyle = css(body.colour.map(v => v * bright), body.alpha);
  context.fill();
  if (body.alpha === 1) {
    context.strokeStyle = context.fillStyle;
    context.lineWidth = 0.7;
    context.stroke();
  }
}

function segment(context, a, b, colour, width) {
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.beginPath();
  context.moveTo(a[0], a[1]);
  context.lineTo(b[0], b[1]);
  context.stroke();
}

function drawFrame(context, project, {origin, axes, name, size}, palette) {
  const from = project(origin);
  axes.forEach((axis, i) => {
    const to = project(origin.map((v, m) => v + size * axis[m]));
    segment(context, from, to, AXES[i], name ? 3 : 1.6);
    if (!name) return;
    context.fillStyle = palette.ink;
    context.font = "13px system-ui, sans-serif";
    const text = `${"xyz"[i]}${i === 0 ? ` ${name}` : ""}`;
    context.strokeStyle = palette.wash;
    context.lineWidth = 3;
    context.strokeText(text, to[0] + 5, to[1] + 4);
    context.fillText(text, to[0] + 5, to[1] + 4);
  });
}

function dot(context, x, y, fill, edge, r) {
  context.beginPath();
  context.arc(x, y, r, 0, 7);
  context.fillStyle = fill;
  context.fill();
  context.lineWidth = 1;
  context.strokeStyle = edge;
  context.stroke();
}

export const bodyColour = () => rgb(colours().body);
