// Columns as people write them: theta_x_rad is the angle θx in degrees, x_m a length in mm.

import {number} from "./dom.js";

const SHOWN = {m: ["mm", 1e3], rad: ["deg", 180 / Math.PI], N: ["N", 1], Nm: ["N m", 1],
  s: ["s", 1], degC: ["°C", 1], Pa: ["Pa", 1]};
const WORDS = {theta: "θ", tau: "τ"};
const OWN = {bend: "bending angle", azimuth: "direction of bending", force: "size of the force",
  torque: "size of the moment", row: "row of the table", dwell: "time at rest",
  approach_side: "side of the approach", time: "time", repeat: "visit to this pose"};

export function column(name) {
  const at = name.lastIndexOf("_"), known = at > 0 ? SHOWN[name.slice(at + 1)] : null;
  const bare = known ? name.slice(0, at) : name;
  const [unit, scale] = known ?? ["", 1];
  const words = OWN[bare] ?? bare.replace(/\b(theta|tau)_(?=[xyz]$)|(?<=^sd_)(theta|tau)_(?=[xyz]$)/,
    name => WORDS[name.slice(0, -1)]).replace(/^sd_/, "spread of ").replaceAll("_", " ");
  return {words, unit, scale};
}

export function label(name) {
  const {words, unit} = column(name);
  return unit ? `${words} [${unit}]` : words;
}

const POLYNOMIAL = {1: "linear", 2: "quadratic", 3: "cubic"};

// Files of the session by the names under which a person dropped them.
let dropped = new Map();
export function nameFiles(steps) {
  dropped = new Map(steps.filter(step => step.name).map(step => [String(step.number), step.name]));
}
export const ownFiles = text => String(text ?? "").replace(/\b(?:upload|data)-(\d+)\.\w+/g, (file, number) => dropped.get(number) ?? file);

// Where the page has what a sentence of the server names by a section of a description or by an option.
const FIELDS = {length_m: "the length under Data", free_length_m: "the length when detached, under Data", gravity_m_s2: "gravity, under Data",
  fts_range: "the largest reading of the sensor, under Data", fts_resolution: "the smallest step of the sensor, under Data"};
const SECTIONS = {mechanism: "the body under Data", instrument: "the noise under Data"};
export const inPage = text => text.replace(/\[(mechanism|instrument|scene|columns|frames|file|leave_out)\](?::? (figures\b|[a-z]+_\w+))?/g, (_, section, key) => FIELDS[key]
  ?? (!key || key === "figures" ? SECTIONS[section] ?? "the description" : `${key} in the description`))
  .replace(/\bTOML\b/g, "description").replace(": --mass KG --inertia KGM2", ", above").replace(/: fit --model \S+$/, ".")
  .replace(/ with --[a-z-]+ \(which records \w+\)/, "");

// Names of files, columns and effects in a sentence of the server, as words.
export const readable = text => inPage(ownFiles(text).replace(/ by \[leave_out\]: marked /, ", as you marked them: ")).replaceAll("->", "→").replaceAll("+-", "±").replace("kept as covariates", "kept as possible causes").replace(
  /\b[a-z][a-z0-9_]*_(?:Nm|N|m|rad|s|degC|Pa)\b/g, name => column(name).words)
  .replace(/\bpoly:\d\b/g, effectName)
  .replace(/\d+(?:\.\d+)?e[+-]\d+/g, text => number(Number(text)))
  .replace(/\b[a-z][a-z0-9-]*(?:[_+][a-z0-9_+-]+)+\b/g,
    name => /^(tau|theta)_[xyz]$/.test(name) ? column(name).words : effectName(name))
  .replace(/\bkg m2\b/g, "kg\u00a0m²").replaceAll("N m", "N\u00a0m").replace(/(\d) (?=(?:N|mm|deg|rad|kg|s)\b|%)/g, "$1\u00a0");

// Whether a checked table has columns of the pose and of the wrench.
export const measured = check => ["pose", "wrench"].every(role => check.columns.some(item => item.role === role));

// Of models as well: a base, and "+ fts_drift" of a rung.
export const effectName = id => id.replace(/\bfts_/, "sensor ").replace(/\bpoly:(\d)\b/g, (_, degree) => POLYNOMIAL[degree] ?? `polynomial of degree ${degree}`)
  .replaceAll("_", " ").replace(/\+(?=\S)/g, " + ").trim();

// Letters of formulas in words; modulus_at_strain_0p1 is "modulus at strain 0.1".
const LETTERS = {g: "share that relaxes", c: "lag of the pose", eta: "share of the stiffness that is lost",
  beta: "change of the stiffness per kelvin", alpha: "change of the stiffness per second"};
export const parameterName = name => LETTERS[name] ?? name.replaceAll("_", " ").replace(/(\d)p(?=\d)/g, "$1.")
  .replace(/\btau ([xyz])\b/g, "τ$1");

// A chance that is 0 is one below the smallest number of a computer.
export const chance = p => Number(p) > 0 ? number(Number(p), 2) : "below 10⁻³⁰⁰";

// A value of the server in the unit of the page, as [number, unit]; a share has no unit.
const LENGTH_AND_ANGLE = {m: SHOWN.m, rad: SHOWN.rad, "1": ["(no unit)", 1]};
export function quantity(value, unit) {
  const [words, scale] = LENGTH_AND_ANGLE[unit] ?? [unit.replaceAll("^2", "²"), 1];
  return [value === null || value === undefined ? value : value * scale, words];
}
