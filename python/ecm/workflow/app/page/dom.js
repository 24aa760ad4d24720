// Elements. Text is always set as text: names from files cannot become markup.

export function el(tag, options = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(options)) {
    if (name === "class") node.className = value;
    else if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (value === true) node.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) node.setAttribute(name, value);
  }
  node.append(...children.flat().filter(child => child !== null && child !== undefined));
  return node;
}

export const button = (label, onclick, options = {}) =>
  el("button", {type: "button", onclick, ...options}, label);

export function table(caption, header, rows) {
  const numeric = header.map((_, j) => rows.length > 0 && rows.every(r => typeof r[j] === "number"));
  const cell = (tag, value, j) => el(tag, {
    class: numeric[j] ? "number" : "", scope: tag === "th" ? "col" : null,
  }, typeof value === "number" ? number(value) : value ?? "");
  return el("div", {class: "scroll", tabindex: "0", role: "region", "aria-label": caption},
    el("table", {}, el("caption", {}, caption),
      el("thead", {}, el("tr", {}, header.map((h, j) => cell("th", h, j)))),
      el("tbody", {}, rows.map(row => el("tr", {}, row.map((c, j) => cell("td", c, j)))))));
}

export function number(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-4 || size >= 1e5)) return value.toExponential(digits - 1);
  return String(Number(value.toPrecision(digits)));
}

export const UNITS = {
  m: "m", rad: "rad", N: "N", Nm: "N m", s: "s", degC: "°C",
};

// A column name as people write it: "tau_x_Nm" is "tau_x [N m]".
export function label(name) {
  const at = name.lastIndexOf("_");
  const unit = UNITS[name.slice(at + 1)];
  return at > 0 && unit ? `${name.slice(0, at)} [${unit}]` : name;
}
