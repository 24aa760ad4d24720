// Colours of the page for what is drawn on a canvas, and the scale from small to large.

const read = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export function colours() {
  const names = ["ink", "soft", "line", "paper", "wash", "mark", "second", "band", "body", "point"];
  return Object.fromEntries(names.map(name => [name, read(`--${name}`)]));
}

export const rgb = hex => [1, 3, 5].map(i => parseInt(hex.slice(i, i + 2), 16));
// A colour that lets so much of the ground through that `share` of its own is left.
export const faded = (colour, ground, share) => colour.map((v, k) => share * v + (1 - share) * ground[k]);
export const css = ([r, g, b], alpha = 1) =>
  `rgb(${r | 0} ${g | 0} ${b | 0} / ${alpha})`;

// Small to large: lightness changes all the way, so that it is read without seeing hues.
export function scaleOf(largest) {
  const stops = ["--low", "--middle", "--high"].map(name => rgb(read(name)));
  return value => {
    const at = 2 * Math.min(1, Math.max(0, (value ?? 0) / (largest || 1)));
    const k = Math.min(1, Math.floor(at)), part = at - k;
    return stops[k].map((v, i) => v + part * (stops[k + 1][i] - v));
  };
}
