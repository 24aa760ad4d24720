// The picture in space by WebGL 2: bodies, lines and points with the depth of the graphics card. All pictures of a page share
// one context, of which a browser gives few, and each hands its frame to a canvas of its own. Without a card there is no
// painter: a browser that imitates one takes three times as long as the processor by depth.js.

import {LAMP, normalsOf} from "./depth.js";

const HEAD = `#version 300 es
precision highp float;
uniform mat3 view; uniform vec3 centre; uniform vec2 zoom, pixels; uniform float deep, room, alpha;
vec4 place(vec3 p) { vec3 q = view * (p - centre); return vec4(q.xy * zoom, q.z * deep - room, 1.0); }
`;
const LIT = `float lit(vec3 n) {
  return 0.58 + 0.36 * max(0.0, dot(n, vec3(${LAMP}))) + 0.06 * max(0.0, -n.z);
}`;
const OUT = `${HEAD}in vec3 colour; in float size; out vec4 seen;`;
// Of each: what its corners hold, its vertex shader, and its fragment shader. A line is a thin rectangle on the screen.
const KINDS = {
  bodies: [{at: 3, normal: 3, ink: 3}, `${LIT} out vec3 colour; out float size;
    void main() { gl_Position = place(at); colour = min(ink * lit(view * normal), 1.0); size = 0.0; }`,
  "void main() { seen = vec4(colour * alpha, alpha); }"],
  lines: [{from: 3, to: 3, end: 2, ink: 3, thick: 1}, `out vec3 colour; out float size;
    void main() {
      vec4 p = place(from), q = place(to);
      vec2 way = normalize((q.xy - p.xy) * pixels + vec2(1e-9, 0.0));
      gl_Position = mix(p, q, end.x) + vec4(vec2(-way.y, way.x) * end.y * thick / pixels, 0.0, 0.0);
      colour = ink; size = 0.0;
    }`, "void main() { seen = vec4(colour * alpha, alpha); }"],
  points: [{at: 3, ink: 3, wide: 1}, `out vec3 colour; out float size;
    void main() { gl_Position = place(at); gl_PointSize = wide; size = wide; colour = ink; }`, `uniform vec3 edge; uniform float rim;
    void main() {
      float r = 0.5 * size, d = length(gl_PointCoord - 0.5) * size, inside = clamp(r - d, 0.0, 1.0) * alpha;
      seen = vec4(mix(colour, edge, rim > 0.0 ? clamp(d - r + rim, 0.0, 1.0) : 0.0) * inside, inside);
    }`],
};

const IMITATED = /swiftshader|llvmpipe|softpipe|software|basic render/i;  // Chromium gives these in spite of the caveat
let shared;  // undefined before the first picture, null where there is none

function context() {
  if (shared !== undefined) return shared;
  const canvas = globalThis.OffscreenCanvas ? new OffscreenCanvas(1, 1) : null, gl = canvas?.getContext("webgl2", {failIfMajorPerformanceCaveat: true});
  const named = gl?.getExtension("WEBGL_debug_renderer_info"), card = gl?.getParameter(named ? named.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
  shared = null;
  if (!gl || IMITATED.test(card)) return null;
  const programs = Object.fromEntries(Object.entries(KINDS).map(([kind, [parts, vertex, fragment]]) => {
    const program = gl.createProgram(), given = Object.entries(parts).map(([name, n]) => `in ${n > 1 ? `vec${n}` : "float"} ${name};\n`).join("");
    for (const [type, text] of [[gl.VERTEX_SHADER, HEAD + given + vertex], [gl.FRAGMENT_SHADER, OUT + fragment]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    const uniforms = new Map();
    return [kind, {program, parts, uniform: name => {
      if (!uniforms.has(name)) uniforms.set(name, gl.getUniformLocation(program, name));
      return uniforms.get(name);
    }}];
  }));
  gl.enable(gl.BLEND);
  gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  gl.cullFace(gl.BACK);
  canvas.addEventListener("webglcontextlost", () => { shared = null; });
  return shared = {gl, canvas, programs};
}

// What one picture shows. `set` takes bodies, lines [{from, to, colour, width}] and points [{at, colour, size}] of which the
// last `on` are marked; a changed scene is sent to the card once.
export function painter(onto) {
  const own = context(), seen = onto.getContext("bitmaprenderer");
  if (!own) return null;
  const {gl, canvas, programs} = own, sent = {}, counts = {};
  let solid = 0;
  for (const [kind, {program, parts}] of Object.entries(programs)) {
    const stride = 4 * Object.values(parts).reduce((sum, n) => sum + n, 0);
    sent[kind] = {vao: gl.createVertexArray(), buffer: gl.createBuffer()};
    gl.bindVertexArray(sent[kind].vao);
    gl.bindBuffer(gl.ARRAY_BUFFER, sent[kind].buffer);
    let before = 0;
    for (const [name, n] of Object.entries(parts)) {
      const place = gl.getAttribLocation(program, name);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, n, gl.FLOAT, false, stride, before);
      before += 4 * n;
    }
  }
  function send(kind, numbers, corners) {
    gl.bindBuffer(gl.ARRAY_BUFFER, sent[kind].buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(numbers), gl.STATIC_DRAW);
    counts[kind] = corners;
  }
  function draw(kind, first, count, values = {}) {
    gl.bindVertexArray(sent[kind].vao);
    for (const [name, value] of Object.entries(values)) gl[name === "edge" ? "uniform3fv" : "uniform1f"](programs[kind].uniform(name), value);
    gl.drawArrays(kind === "points" ? gl.POINTS : gl.TRIANGLES, first, count);
  }

  return {
    set({bodies, lines}) {
      const numbers = [], put = of => {
        for (const body of of) {
          const ink = body.colour.map(v => v / 255), normals = normalsOf(body);
          body.triangles.forEach((corners, t) => corners.forEach((i, m) => numbers.push(...body.points[i], ...normals[t][m], ...ink)));
        }
        return numbers.length / 9;
      };
      solid = put(bodies.filter(body => body.alpha === 1));
      send("bodies", numbers, put(bodies.filter(body => body.alpha < 1)));
      const ends = [[0, -1], [1, -1], [1, 1], [0, -1], [1, 1], [0, 1]];
      send("lines", lines.flatMap(({from, to, colour, width}) => ends.flatMap(end =>
        [...from, ...to, ...end, ...colour.map(v => v / 255), width])), 6 * lines.length);
    },
    points(numbers) { send("points", numbers, numbers.length / 7); },
    // ratio: pixels of the screen for one of the page; eye: {view (right, up, away as rows), centre, size in pixels a mm, reach}; false where the context was lost.
    paint(ratio, width, height, {view, centre, size, reach}, {alpha, faint, room, on: marked, edges, rim}) {
      if (!shared || gl.isContextLost()) {
        seen.transferFromImageBitmap(null);
        return false;
      }
      const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
      if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
      gl.viewport(0, 0, w, h);
      gl.clearColor(0, 0, 0, 0);
      gl.depthMask(true);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.enable(gl.DEPTH_TEST);
      const deep = 1 / (4 * reach), use = kind => {
        const {program, uniform} = programs[kind];
        gl.useProgram(program);
        gl.uniformMatrix3fv(uniform("view"), true, view.flat());
        gl.uniform3fv(uniform("centre"), centre);
        gl.uniform2f(uniform("zoom"), 2 * size / width, 2 * size / height);
        gl.uniform2f(uniform("pixels"), w / ratio, h / ratio);
        gl.uniform1f(uniform("deep"), deep);
        gl.uniform1f(uniform("room"), kind === "bodies" ? 0 : room * reach * deep);
      };
      const depthOnly = (first, count) => {
        gl.colorMask(false, false, false, false);
        draw("bodies", first, count);
        gl.colorMask(true, true, true, true);
      };
      use("bodies");
      gl.enable(gl.CULL_FACE);
      gl.depthFunc(gl.LEQUAL);
      draw("bodies", 0, solid, {alpha: 1});
      if (counts.bodies > solid) {  // the nearest surface of those that let light through; points are seen before them
        depthOnly(solid, counts.bodies - solid);
        draw("bodies", solid, counts.bodies - solid, {alpha});
        gl.clear(gl.DEPTH_BUFFER_BIT);
        depthOnly(0, solid);
      }
      gl.disable(gl.CULL_FACE);
      gl.depthMask(false);
      for (const kind of ["lines", "points"]) {
        use(kind);
        // What lies behind a body is faint.
        for (const [test, strength] of [[gl.GREATER, faint], [gl.LEQUAL, 1]]) {
          gl.depthFunc(test);
          if (kind === "lines") draw(kind, 0, counts.lines, {alpha: strength});
          else draw(kind, 0, counts.points - marked, {alpha: strength, edge: edges[0], rim});
        }
      }
      gl.disable(gl.DEPTH_TEST);  // a marked row is seen through all
      draw("points", counts.points - marked, marked, {alpha: 1, edge: edges[1], rim});
      seen.transferFromImageBitmap(canvas.transferToImageBitmap());
      return true;
    },
  };
}
