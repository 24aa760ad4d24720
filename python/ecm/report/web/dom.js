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

export function table(caption, header, rows, options = {}) {
  const numeric = header.map((_, j) => rows.length > 0 && rows.every(r => typeof r[j] === "number" || r[j] === null || r[j] === undefined)
    && rows.some(r => typeof r[j] === "number"));
  const cell = (tag, value, j) => el(tag, {
    class: numeric[j] ? "number" : "", scope: tag === "th" ? "col" : null,
  }, typeof value === "number" ? number(value) : value ?? "–");
  return el("div", {class: `scroll ${rows.length > 20 ? "long" : ""}`, tabindex: "0", role: "region", "aria-label": caption},
    el("table", {}, el("caption", {}, caption),
      el("thead", {}, el("tr", {}, header.map((h, j) => cell("th", h, j)))),
      el("tbody", {}, rows.map((row, i) => el("tr", options.row?.(i) ?? {},
        row.map((c, j) => cell("td", c, j)))))));
}

// One of a few, as radio buttons: arrow keys move between them.
export function choices(legend, id, entries, onchange, chosen = entries[0][0]) {
  const node = el("span", {class: "choices", role: "radiogroup", "aria-label": legend, id},
    entries.map(([value, text]) => el("label", {}, el("input", {type: "radio", name: id, value,
      checked: value === chosen, onchange: () => onchange(value)}), text)));
  return node;
}

export const waiting = text => el("div", {class: "waiting", role: "status"}, text);

export function number(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-4 || size >= 1e5)) {
    const [mantissa, power] = value.toExponential(digits - 1).split("e");
    return `${Number(mantissa)}·10${[...String(Number(power))].map(c => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]).join("")}`;
  }
  return String(Number(value.toPrecision(digits)));
}

// Copies a text, and says how that went: a browser may refuse it.
export const copy = (text, say) => navigator.clipboard.writeText(text).then(() => say("Copied"),
  () => say("The browser refuses: select the text and copy it by hand"));
