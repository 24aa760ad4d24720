// Bodies, frames and points in space on a canvas: turned by a drag, a finger or the arrow keys.

import {colours, css, faded, rgb} from "./colours.js";
import {pointer, sized, stamp, tip} from "./canvas.js";
import {lit, normalsOf, picture} from "./depth.js";
import {button, el} from "./dom.js";
import {painter} from "./gl.js";
import {marked, onMark} from "./selection.js";

const AXES = ["#d0460f", "#00996e", "#2a66c8"];
const WHILE_TURNING = 4000, MANY = 1500;
const START = {turn: -0.75, lift: 0.32, zoom: 1};
const VIEWS = [START, {turn: 0, lift: 0, zoom: 1}, {turn: -Math.PI / 2, lift: 0, zoom: 1}, {turn: 0, lift: 1.5, zoom: 1}];
const FAINT = 0.3, ROOM = 0.006;  // of what lies behind a body; room of a point on its surface, of the whole
const IN_MOTION = 130_000;  // pixels
const REST_MS = 150, SHARP = 2, STILL = 4, TOUCH = 24, MOUSE = 12;

// scene: {points: {x, y, z, row, colour, text}, bodies: [{points, triangles, colour, alpha}],
// frames: [{origin, axes, name, size}], lines: [{from, to, colour}]}, all lengths in mm.
export function space(name, {onpick = () => {}, onbox = null} = {}) {
  const canvas = el("canvas", {tabindex: "0", role: "application", "aria-roledescription": "figure", "aria-label": `${name}. Arrow keys turn, plus and minus `
    + "zoom, Home looks from the start. N and P go from row to row, space marks, escape clears."});
  const live = el("p", {class: "hidden", "aria-live": "polite"});
  const boxes = button("Mark a box", () => marking(!place.classList.contains("marking")), {"aria-pressed": "false"});
  const below = el("canvas", {"aria-hidden": "true"}), place = el("div", {class: "space"}, canvas, below);
  const node = el("div", {}, place, live, el("div", {class: "row views"}, onbox ? boxes : null,
    button("Next view", () => look(VIEWS[view = (view + 1) % VIEWS.length])),
    button("+", () => look({...eye, zoom: Math.min(8, 1.25 * eye.zoom)}), {"aria-label": "Larger"}),
    button("−", () => look({...eye, zoom: Math.max(0.3, eye.zoom / 1.25)}), {"aria-label": "Smaller"})));
  let scene = {points: null, bodies: [], frames: [], lines: []}, eye = {...START}, edges = [];
  let centre = [0, 0, 0], extent = [], reach = 1, shown = null, turning = false, box = null, asked = false;
  let view = 0, cursor = -1, rest = 0, coarse = false;

  const card = painter(below), redraw = sized(canvas, draw);
  const ask = () => {
    if (!asked) { asked = true; requestAnimationFrame(() => { asked = false; redraw(); }); }
  };
  // A picture at once, and a sharp one when nothing has changed for a while.
  const soon = () => {
    coarse = true;
    clearTimeout(rest);
    rest = setTimeout(() => { coarse = false; ask(); }, REST_MS);
    ask();
  };
  const look = next => { eye = {...next}; ask(); };
  const marking = on => {
    place.classList.toggle("marking", on);
    boxes.setAttribute("aria-pressed", String(on));
  };

  // `keep`: seen from where it is seen now, while something moves.
  function set(next, keep = false) {
    // Marked bodies are drawn a moment later: who goes from row to row by keys stays at the row.
    if (next.points?.x !== scene.points?.x) cursor = -1;
    scene = {bodies: [], frames: [], lines: [], ...next};
    edges = [...scene.lines.map(line => ({...line, width: 2})), ...scene.frames.flatMap(({origin, axes, name, size}) =>
      axes.map((axis, i) => ({from: origin, to: tipOf(origin, axis, size), colour: rgb(AXES[i]), width: name ? 3 : 1.6})))];
    card?.set({bodies: scene.bodies, lines: edges});
    sendPoints();
    soon();
    if (keep) return;
    const all = [...scene.bodies.flatMap(body => body.points),
      ...scene.frames.flatMap(({origin, axes, size}) => axes.map(axis => origin.map((v, m) => v + size * axis[m])))];
    if (scene.points) all.push(...outermost(scene.points));
    const low = [0, 1, 2].map(i => all.reduce((m, p) => Math.min(m, p[i]), Infinity));
    const high = [0, 1, 2].map(i => all.reduce((m, p) => Math.max(m, p[i]), -Infinity));
    centre = low.map((v, i) => (v + high[i]) / 2);
    reach = Math.hypot(...low.map((v, i) => high[i] - v)) || 1;
    extent = all;
    // What is seen from the start lies in the middle of the picture.
    const at = extent.map(projection(0, 0, START, 1)), middle = k =>
      (Math.min(...at.map(point => point[k])) + Math.max(...at.map(point => point[k]))) / 2;
    const [right, up] = [middle(0), -middle(1)], c = Math.cos(START.turn), s = Math.sin(START.turn);
    const u = Math.cos(START.lift), v = Math.sin(START.lift);
    centre = [centre[0] + u * up, centre[1] + c * right - v * s * up, centre[2] + s * right + v * c * up];
    ask();
  }

  // Those that are marked come last.
  function sendPoints() {
    if (!card) return;
    const {points} = scene, n = points?.x.length ?? 0, few = n <= MANY, ratio = Math.min(2, devicePixelRatio || 1);
    const second = rgb(colours().second), is = i => marked.has(points.row[i]), numbers = new Float32Array(7 * n);
    let at = 0;
    for (const on of [false, true]) for (let i = 0; i < n; i += 1) if (is(i) === on) {
      const [r, g, b] = on ? second : points.colour[i];
      numbers.set([points.x[i], points.y[i], points.z[i], r / 255, g / 255, b / 255, ratio * (few ? on ? 12 : 8.2 : on ? 4.4 : 3)], at);
      at += 7;
    }
    card.points(numbers);
  }
  onMark(() => { sendPoints(); ask(); });

  // The x axis of the base points up: the mechanism stands on its clamped face.
  function projection(width, height, from = eye, size = from.zoom * fit(width, height)) {
    const [[, c, s], [u, ua, ub], [v, va, vb]] = viewOf(from).view;
    return ([x, y, z]) => {
      const up = x - centre[0], a = y - centre[1], b = z - centre[2];
      return [width / 2 + size * (c * a + s * b), height / 2 - size * (u * up + ua * a + ub * b), v * up + va * a + vb * b];
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
    shown = null;
    const count = scene.points ? scene.points.row.reduce((sum, row) => sum + marked.has(row), 0) : 0, few = (scene.points?.x.length ?? 0) <= MANY;
    const done = card?.paint(context.getTransform().a, width, height, {...viewOf(eye), centre, size: eye.zoom * fit(width, height), reach}, {faint: FAINT, room: ROOM, on: count,
      alpha: scene.bodies.find(body => body.alpha < 1)?.alpha ?? 1, rim: few ? 1.2 : 0,
      edges: [palette.wash, palette.ink].map(colour => rgb(colour).map(v => v / 255))});
    if (!done) paintFlat(context, width, height, project, palette);
    for (const frame of scene.frames) if (frame.name) nameFrame(context, project, frame, palette);
    const {points} = scene, here = cursor >= 0 && points && project([points.x[cursor], points.y[cursor], points.z[cursor]]);
    pointer(context, palette, here, 8, box);
  }

  // Where each point is seen: [x, y, its place in the list].
  function places() {
    if (shown) return shown;
    const project = projection(canvas.parentElement.clientWidth, canvas.parentElement.clientHeight), {points} = scene;
    return shown = points ? Array.from(points.x, (x, i) => [...project([x, points.y[i], points.z[i]]).slice(0, 2), i]) : [];
  }

  // --- by the processor, where the browser gives no graphics card ---
  function paintFlat(context, width, height, project, palette) {
    // In motion a large picture has fewer pixels than the screen, so that each frame is there in time.
    const moving = Math.min(1, Math.sqrt(IN_MOTION / (width * height)));
    const solid = picture(width, height, coarse || turning ? moving : Math.max(SHARP, devicePixelRatio || 1));
    for (const body of scene.bodies) if (body.alpha === 1) drawBody(solid, body, project);
    solid.show(context);
    const clear = scene.bodies.filter(body => body.alpha < 1);
    if (clear.length) {
      const ghost = solid.over();
      for (const body of clear) drawBody(ghost, body, project);
      context.globalAlpha = clear[0].alpha;
      ghost.show(context);
      context.globalAlpha = 1;
    }
    const hidden = at => solid.hides(at, ROOM * reach);
    for (const {from, to, colour, width} of edges) drawLine(context, project(from), project(to), {colour: css(colour), width, hidden});
    drawPoints(context, project, palette, hidden);
  }

  function drawBody(on, body, project) {
    const at = body.points.map(project), {view} = viewOf(eye);
    const bright = normal => lit(view.map(row => row[0] * normal[0] + row[1] * normal[1] + row[2] * normal[2]));
    body.normals ??= normalsOf(body);
    body.triangles.forEach((corners, t) =>
      on.triangle(corners.map(i => at[i]), body.normals[t].map(bright), body.colour));
  }

  // Each point can be seen and marked: one behind a body is faint. While turning, some are left out.
  function drawPoints(context, project, palette, hidden) {
    const {points} = scene, shown = [];
    if (!points) return;
    const n = points.x.length, step = turning ? Math.ceil(n / WHILE_TURNING) : 1, few = n <= MANY;
    for (let i = 0; i < n; i += step) {
      const at = project([points.x[i], points.y[i], points.z[i]]);
      shown.push([at[0], at[1], i, hidden(at)]);
    }
    const on = shown.filter(([, , i]) => marked.has(points.row[i]));
    const off = on.length ? shown.filter(([, , i]) => !marked.has(points.row[i])) : shown;
    if (few) {
      for (const [x, y, i, behind] of off) {
        context.globalAlpha = behind ? FAINT : 1;
        disc(context, x, y, css(points.colour[i]), palette.wash, 3.6);
      }
      context.globalAlpha = 1;
      for (const [x, y] of on) disc(context, x, y, palette.second, palette.ink, 5.5);
    } else {
      const at = {x: item => item[0], y: item => item[1]}, second = rgb(palette.second), wash = rgb(palette.wash);
      const ink = ([, , i, behind]) => behind ? faded(points.colour[i], wash, FAINT) : points.colour[i];
      stamp(context, off, {...at, ink, size: 2.2});
      if (on.length) stamp(context, on, {...at, ink: () => second, size: 3.4});
    }
  }

  // The nearest point within so many pixels, or null.
  function nearest(x, y, within = MOUSE) {
    let best = null, distance = within ** 2;
    for (const [px, py, i] of places()) {
      const d = (px - x) ** 2 + (py - y) ** 2;
      if (d < distance) { distance = d; best = i; }
    }
    return best;
  }

  let from = null;
  canvas.addEventListener("pointerdown", event => {
    if (event.button !== 0 || !event.isPrimary) return; // a menu or a second finger is no drag
    from = {x: event.offsetX, y: event.offsetY, eye: {...eye}, marks: onbox && (event.shiftKey || place.classList.contains("marking"))};
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", event => {
    const {offsetX: x, offsetY: y} = event;
    if (!from) {
      const i = nearest(x, y);
      tip(i === null ? "" : scene.points.text(i), event);
    } else if (from.marks) {
      box = [from.x, from.y, x, y];
      ask();
    } else {
      turning = true;
      eye = {...eye, turn: from.eye.turn - 0.008 * (x - from.x),
        lift: Math.max(-1.5, Math.min(1.5, from.eye.lift + 0.008 * (y - from.y)))};
      ask();
    }
  });
  const end = event => {
    if (!from) return;
    const still = Math.hypot(event.offsetX - from.x, event.offsetY - from.y) < STILL;
    if (event.type === "pointercancel") {
      // The page scrolls: nothing is marked.
    } else if (box && !still) {
      const [x0, x1] = [box[0], box[2]].sort((a, b) => a - b);
      const [y0, y1] = [box[1], box[3]].sort((a, b) => a - b);
      onbox(places().filter(([x, y]) => x >= x0 && x <= x1 && y >= y0 && y <= y1)
        .map(([, , i]) => scene.points.row[i]));
    } else if (still) {
      const i = nearest(event.offsetX, event.offsetY, event.pointerType === "touch" ? TOUCH : MOUSE);
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
  const rows = step => {
    const n = scene.points?.x.length ?? 0;
    if (!n) return;
    cursor = (cursor + step + n) % n;
    live.textContent = scene.points.text(cursor);
  };
  const toggle = () => {
    if (cursor < 0 || !onbox) return;
    const row = scene.points.row[cursor];
    onbox(marked.has(row) ? [...marked].filter(other => other !== row) : [...marked, row]);
  };
  const keys = {
    ArrowLeft: () => { eye.turn += 0.12; }, ArrowRight: () => { eye.turn -= 0.12; },
    ArrowUp: () => { eye.lift = Math.min(1.5, eye.lift + 0.12); }, ArrowDown: () => { eye.lift = Math.max(-1.5, eye.lift - 0.12); },
    "+": () => { eye.zoom *= 1.15; }, "=": () => { eye.zoom *= 1.15; }, "-": () => { eye.zoom /= 1.15; },
    Home: () => { eye = {...START}; }, n: () => rows(1), p: () => rows(-1), " ": toggle, Escape: () => onbox?.([]),
  };
  canvas.addEventListener("keydown", event => {
    if (event.ctrlKey || event.metaKey || event.altKey || !keys[event.key]) return;
    keys[event.key]();
    event.preventDefault();
    soon();
  });
  canvas.addEventListener("blur", () => { cursor = -1; ask(); });
  return {node, set};
}

// Right, up and away as rows over x, y, z.
function viewOf({turn, lift}) {
  const c = Math.cos(turn), s = Math.sin(turn), u = Math.cos(lift), v = Math.sin(lift);
  return {view: [[0, c, s], [u, -v * s, v * c], [-v, -u * s, u * c]]};
}

// Those of many points that bound all: the outermost in directions over the whole sphere.
const DIRECTIONS = Array.from({length: 100}, (_, k) => {
  const up = 1 - (2 * k + 1) / 100, side = Math.sqrt(1 - up * up), turn = 2.39996 * k;  // a golden spiral
  return [up, side * Math.cos(turn), side * Math.sin(turn)];
});
const bounds = new WeakMap();  // by the column of x: it stays the same while rows are marked
function outermost({x, y, z}) {
  if (!bounds.has(x)) {
    const corners = DIRECTIONS.map(([a, b, c]) => {
      let best = 0, most = -Infinity;
      for (let i = 0; i < x.length; i += 1) {
        const at = a * x[i] + b * y[i] + c * z[i];
        if (at > most) [best, most] = [i, at];
      }
      return best;
    });
    bounds.set(x, x.length ? [...new Set(corners)].map(i => [x[i], y[i], z[i]]) : []);
  }
  return bounds.get(x);
}

// A line that is faint where a body lies before it.
function drawLine(context, a, b, {colour, width, hidden}) {
  const pieces = Math.max(1, Math.ceil(Math.hypot(b[0] - a[0], b[1] - a[1]) / 4));
  const at = k => a.map((v, m) => v + k / pieces * (b[m] - v));
  context.strokeStyle = colour;
  context.lineWidth = width;
  for (let k = 0; k < pieces; k += 1) {
    const from = at(k), to = at(k + 1);
    context.globalAlpha = hidden(at(k + 0.5)) ? FAINT : 1;
    context.beginPath();
    context.moveTo(from[0], from[1]);
    context.lineTo(to[0], to[1]);
    context.stroke();
  }
  context.globalAlpha = 1;
}

const tipOf = (origin, axis, size) => origin.map((v, m) => v + size * axis[m]);

function nameFrame(context, project, {origin, axes, name, size}, palette) {
  axes.forEach((axis, i) => {
    const to = project(tipOf(origin, axis, size)), text = `${"xyz"[i]}${i === 0 ? ` ${name}` : ""}`;
    context.fillStyle = palette.ink;
    context.font = "13px system-ui, sans-serif";
    context.strokeStyle = palette.wash;
    context.lineWidth = 3;
    context.strokeText(text, to[0] + 5, to[1] + 4);
    context.fillText(text, to[0] + 5, to[1] + 4);
  });
}

function disc(context, x, y, fill, edge, r) {
  context.beginPath();
  context.arc(x, y, r, 0, 7);
  context.fillStyle = fill;
  context.fill();
  context.lineWidth = 1;
  context.strokeStyle = edge;
  context.stroke();
}

export const bodyColour = () => rgb(colours().body);
