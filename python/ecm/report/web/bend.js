// The body bent into a pose: a tube along the smooth curve from the base frame to the top frame.
// The curve leaves and arrives along the x axes of the two frames; the twist grows evenly. It is a
// sketch of the shape: no equation of the material is solved for it.

const AROUND = 24, ALONG = 12;
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const unit = a => { const n = Math.hypot(...a) || 1; return a.map(v => v / n); };

// Columns of the rotation matrix of a rotation vector: the axes of the frame.
export function axesOf(theta) {
  const angle = Math.hypot(...theta), k = angle ? theta.map(v => v / angle) : [1, 0, 0];
  const s = Math.sin(angle), c = Math.cos(angle);
  return [0, 1, 2].map(j => {
    const e = [0, 1, 2].map(i => Number(i === j)), turned = cross(k, e), along = dot(k, e);
    return e.map((v, i) => v * c + turned[i] * s + k[i] * along * (1 - c));
  });
}

// The radius of a body of revolution at places from 0 (base) to 1 (top).
export function profileOf({length_m, outline_m}) {
  const length = length_m || 0.1;
  if (!outline_m) return {length, radius: () => 0.14 * length};
  const last = outline_m.length - 1;
  const radius = s => {
    const at = last * s, k = Math.min(last - 1, Math.floor(at));
    return outline_m[k] + (at - k) * (outline_m[k + 1] - outline_m[k]);
  };
  return {length, radius};
}

// Points and triangles of the body whose top frame is at a pose (m and rotation vector in rad).
export function bent({length, radius}, pose) {
  const end = pose.slice(0, 3), [axis, side] = axesOf(pose.slice(3));
  const start = [length, 0, 0], finish = axis.map(v => v * length);
  const at = s => [0, 1, 2].map(i => (s * s * s - 2 * s * s + s) * start[i]
    + (3 * s * s - 2 * s * s * s) * end[i] + (s * s * s - s * s) * finish[i]);
  const along = s => unit([0, 1, 2].map(i => (3 * s * s - 4 * s + 1) * start[i]
    + (6 * s - 6 * s * s) * end[i] + (3 * s * s - 2 * s) * finish[i]));
  const sections = [];
  let normal = [0, 1, 0];
  for (let k = 0; k <= ALONG; k += 1) {
    const tangent = along(k / ALONG), off = dot(normal, tangent);
    normal = unit(normal.map((v, i) => v - off * tangent[i]));
    sections.push([at(k / ALONG), tangent, normal]);
  }
  const [, tangent, last] = sections[ALONG];
  const twist = Math.atan2(dot(cross(last, side), tangent), dot(last, side));
  const points = [], triangles = [];
  sections.forEach(([centre, t, n], k) => {
    const b = cross(t, n), r = radius(k / ALONG);
    for (let j = 0; j < AROUND; j += 1) {
      const angle = 2 * Math.PI * j / AROUND + twist * k / ALONG, c = Math.cos(angle), s = Math.sin(angle);
      points.push([0, 1, 2].map(i => centre[i] + r * (c * n[i] + s * b[i])));
    }
  });
  const index = (k, j) => k * AROUND + j % AROUND;
  for (let k = 0; k < ALONG; k += 1) for (let j = 0; j < AROUND; j += 1) {
    triangles.push([index(k, j), index(k + 1, j + 1), index(k + 1, j)]);
    triangles.push([index(k, j), index(k, j + 1), index(k + 1, j + 1)]);
  }
  for (const k of [0, ALONG]) {
    points.push(sections[k][0]);
    for (let j = 0; j < AROUND; j += 1)
      triangles.push([points.length - 1, index(k, j + (k ? 0 : 1)), index(k, j + (k ? 1 : 0))]);
  }
  return {points, triangles};
}

// A few poses that lie far from each other, from (x, y, z) columns; the first is given.
export function farApart(columns, count, first) {
  const n = columns[0].length, chosen = [first], distance = new Array(n).fill(Infinity);
  while (chosen.length < Math.min(count, n)) {
    const from = chosen.at(-1);
    let best = 0;
    for (let i = 0; i < n; i += 1) {
      distance[i] = Math.min(distance[i],
        Math.hypot(...columns.map(values => values[i] - values[from])));
      if (distance[i] > distance[best]) best = i;
    }
    chosen.push(best);
  }
  return chosen;
}
