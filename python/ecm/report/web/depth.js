// A picture with a depth buffer: at each pixel the nearest surface is seen, from every side. For a browser without WebGL.

export const LAMP = [-0.42, 0.62, -0.66];  // right, up, away: above the left shoulder of who looks
const CREASE = 0.6;

// The normal of every corner of every triangle: smooth along a side, sharp at an edge.
export function normalsOf({points, triangles}) {
  const flat = triangles.map(([i, j, k]) => {
    const [a, b, c] = [points[i], points[j], points[k]];
    const u = b.map((v, m) => v - a[m]), w = c.map((v, m) => v - a[m]);
    return [u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]];
  });
  const sums = points.map(() => [0, 0, 0]);
  triangles.forEach((corners, t) => corners.forEach(i => flat[t].forEach((v, m) => { sums[i][m] += v; })));
  const unit = n => { const size = Math.hypot(...n) || 1; return n.map(v => v / size); };
  return triangles.map((corners, t) => {
    const own = unit(flat[t]);
    return corners.map(i => {
      const mean = unit(sums[i]);
      return own[0] * mean[0] + own[1] * mean[1] + own[2] * mean[2] > CREASE ? mean : own;
    });
  });
}

// Brightness of a surface whose normal is (right, up, away), of unit length.
export function lit([right, up, away]) {
  const facing = right * LAMP[0] + up * LAMP[1] + away * LAMP[2];
  return 0.58 + 0.36 * Math.max(0, facing) + 0.06 * Math.max(0, -away);
}

// `scale` pixels of the picture for one of the canvas.
export function picture(width, height, scale) {
  const w = Math.max(1, Math.round(width * scale)), h = Math.max(1, Math.round(height * scale));
  const pixels = new Uint32Array(w * h), depth = new Float32Array(w * h).fill(Infinity);

  // Corners [x, y, depth] on the canvas and their brightness; one that is seen from behind is left out.
  function triangle(corners, bright, [red, green, blue], alpha = 255) {
    const [[ax, ay, az], [bx, by, bz], [cx, cy, cz]] = corners.map(([x, y, z]) => [x * scale, y * scale, z]);
    const area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
    if (area >= 0) return;
    const left = Math.max(0, Math.ceil(Math.min(ax, bx, cx) - 0.5));
    const right = Math.min(w - 1, Math.floor(Math.max(ax, bx, cx) - 0.5));
    const top = Math.max(0, Math.ceil(Math.min(ay, by, cy) - 0.5));
    const bottom = Math.min(h - 1, Math.floor(Math.max(ay, by, cy) - 0.5));
    for (let v = top; v <= bottom; v += 1) for (let u = left; u <= right; u += 1) {
      const x = u + 0.5, y = v + 0.5;
      const p = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area;
      const q = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area, r = 1 - p - q;
      if (p < 0 || q < 0 || r < 0) continue;
      const z = p * az + q * bz + r * cz, at = v * w + u;
      if (z >= depth[at]) continue;
      depth[at] = z;
      const light = p * bright[0] + q * bright[1] + r * bright[2];
      const shade = c => Math.min(255, c * light) | 0;
      pixels[at] = (alpha << 24 | shade(blue) << 16 | shade(green) << 8 | shade(red)) >>> 0;
    }
  }

  return {
    triangle,
    // Whether a surface lies before [x, y, depth] by more than `room`.
    hides([x, y, z], room) {
      const u = Math.floor(x * scale), v = Math.floor(y * scale);
      return u >= 0 && v >= 0 && u < w && v < h && depth[v * w + u] < z - room;
    },
    // A picture on top of this one: only what lies before this one is seen of it.
    over() {
      const next = picture(width, height, scale);
      next.begin(depth);
      return next;
    },
    begin(other) { depth.set(other); },
    show(context) {
      const layer = new OffscreenCanvas(w, h);
      layer.getContext("2d").putImageData(new ImageData(new Uint8ClampedArray(pixels.buffer), w, h), 0, 0);
      context.imageSmoothingQuality = "high";
      context.drawImage(layer, 0, 0, width, height);
    },
  };
}
