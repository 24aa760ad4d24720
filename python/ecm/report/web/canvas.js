// A canvas at the resolution of the screen, and a tooltip at the pointer.

// Calls draw(context, width, height) in CSS pixels when the size of its parent changes.
export function sized(canvas, draw) {
  const fit = () => {
    const {clientWidth: width, clientHeight: height} = canvas.parentElement;
    const ratio = Math.min(2, devicePixelRatio || 1);
    if (!width || !height) return;
    const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
    // A new size takes new memory: only where it has changed.
    if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    draw(context, width, height);
  };
  new ResizeObserver(fit).observe(canvas.parentElement);
  return fit;
}

// Calls draw(share) with a share from 0 to 1; at once with 1 where a person wants no motion. Returns what ends it.
export function glide(draw, ms = 450) {
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches, begun = performance.now();
  let ended = false;
  const step = now => {
    if (ended) return;
    const at = still ? 1 : Math.min(1, Math.max(0, (now - begun) / ms));
    draw(1 - (1 - at) ** 3);
    if (at < 1) requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
  return () => { ended = true; };
}

// A layer to write pixels into, kept for each size: a new one for every picture takes tens of ms.
const layers = new Map();
function layerOf(width, height) {
  const key = `${width} ${height}`, kept = layers.get(key);
  if (kept) {
    kept.pixels.fill(0);
    return kept;
  }
  if (layers.size > 3) layers.delete(layers.keys().next().value);
  const canvas = new OffscreenCanvas(width, height), on = canvas.getContext("2d", {willReadFrequently: true});
  const picture = on.createImageData(width, height);
  const layer = {canvas, pixels: new Uint32Array(picture.data.buffer), show: () => on.putImageData(picture, 0, 0)};
  layers.set(key, layer);
  return layer;
}

// Squares of `size` CSS pixels written into a layer directly: a few ms for 20,000 of them, where
// one call for each would take half a second. x(i), y(i): CSS pixels; ink(i): [r, g, b].
export function stamp(context, indices, {x, y, ink, size}) {
  const {canvas} = context, ratio = context.getTransform().a, {width, height} = canvas;
  const layer = layerOf(width, height), {pixels} = layer;
  const side = Math.max(2, Math.round(size * ratio));
  for (const i of indices) {
    const left = Math.round(x(i) * ratio) - (side >> 1), top = Math.round(y(i) * ratio) - (side >> 1);
    if (!(left > -side && top > -side)) continue;
    const [r, g, b] = ink(i), value = (255 << 24 | b << 16 | g << 8 | r) >>> 0;
    for (let v = Math.max(0, top); v < Math.min(height, top + side); v += 1)
      for (let u = Math.max(0, left); u < Math.min(width, left + side); u += 1) pixels[v * width + u] = value;
  }
  layer.show();
  context.drawImage(layer.canvas, 0, 0, width / ratio, height / ratio);
}

export function tip(text, event) {
  const node = document.getElementById("tip");
  node.hidden = !text;
  if (!text) return;
  node.textContent = text;
  const x = event.clientX + 14, y = event.clientY + 14;
  node.style.left = `${Math.max(8, Math.min(x, innerWidth - node.offsetWidth - 8))}px`;
  node.style.top = `${Math.min(y, innerHeight - node.offsetHeight - 8)}px`;
}

// About `count` round numbers from low to high.
export function ticks(low, high, count) {
  const rough = (high - low) / Math.max(1, count) || 1;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map(k => k * power).find(k => k >= rough) ?? 10 * power;
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1)
    found.push(Number((k * step).toPrecision(12)));
  return found;
}

// A ring around the point at hand, [x, y] or none, and the box that is being drawn, [x0, y0, x1, y1] or none.
export function pointer(context, palette, at, radius, box) {
  if (at) {
    context.strokeStyle = palette.ink;
    context.lineWidth = 2;
    context.beginPath();
    context.arc(at[0], at[1], radius, 0, 7);
    context.stroke();
  }
  if (box) {
    context.strokeStyle = palette.second;
    context.setLineDash([4, 3]);
    context.strokeRect(box[0], box[1], box[2] - box[0], box[3] - box[1]);
    context.setLineDash([]);
  }
}
