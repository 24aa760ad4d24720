// What a table does not say of itself: length, body, gravity and instruments, typed in the units that people use.

import {busy, post} from "./api.js";
import {button, el} from "./dom.js";

const LENGTH = {unit: "mm", scale: 1e-3}, ANGLE = {unit: "deg", scale: Math.PI / 180};
const SHAPES = [["", "not described"], ["cylinder", "cylinder"], ["tube", "tube"], ["hourglass", "hourglass"], ["stacked_discs", "stacked discs"]];
const BODY = [
  ["radius_m", "Outer radius", LENGTH, ["cylinder", "tube", "hourglass", "stacked_discs"]],
  ["inner_radius_m", "Inner radius", LENGTH, ["tube"]],
  ["waist_radius_m", "Smallest radius", LENGTH, ["hourglass", "stacked_discs"]],
  ["disc_count", "Number of discs", {unit: "", scale: 1}, ["stacked_discs"]],
  ["young_modulus_Pa", "Young's modulus", {unit: "MPa", scale: 1e6}, ["cylinder", "tube", "hourglass", "stacked_discs"]],
  ["poisson_ratio", "Poisson's ratio", {unit: "", scale: 1}, ["cylinder", "tube", "hourglass", "stacked_discs"]],
  ["density_kg_m3", "Density", {unit: "kg/m³", scale: 1}, ["cylinder", "tube", "hourglass", "stacked_discs"]],
];
const NOISE = [
  ["pose_position_sd_m", "of a position", LENGTH], ["pose_rotation_sd_rad", "of an angle", ANGLE],
  ["force_sd_N", "of a force", {unit: "N", scale: 1}], ["torque_sd_Nm", "of a moment", {unit: "N m", scale: 1}],
];
// Values of a list that are typed together: all of them or none.
const ALONG = ["x", "y", "z"], AXES = [...ALONG.map(axis => ["Force", axis, "N"]), ...ALONG.map(axis => ["Moment", axis, "N m"])];
const GRAVITY = ALONG.map(axis => [`along ${axis}`, "m/s²"]), OF_SENSOR = AXES.map(([what, axis, unit]) => [`${what} along its ${axis}`, unit]);

export function describe(state, app) {
  const {mechanism = {}, instrument = {}, scene = {}} = state.described, inputs = [];
  const box = (id, value, least) => el("input", {type: "number", id, value, step: "any", min: least});
  const named = (words, input, unit) => el("label", {}, el("span", {}, words), input, el("small", {class: "soft"}, unit));
  // An empty field takes back what was said.
  const numberIn = (input, scale = 1) => input.value === "" ? null : Number((input.value * scale).toPrecision(12));
  const field = (section, key, words, {unit, scale}, known, least = 0) => {
    const input = box(`say-${key}`, known[key] === undefined ? "" : Number((known[key] / scale).toPrecision(6)), least);
    inputs.push({section, key, fields: [input], get: () => key === "disc_count" && input.value !== "" ? Math.round(input.value) : numberIn(input, scale)});
    return named(words, input, unit);
  };
  const list = (section, key, entries, known, least = null) => {
    const fields = entries.map((_, k) => box(`say-${key}-${k}`, known[key]?.[k] ?? "", least));
    const some = () => fields.some(input => input.value !== ""), ask = () => { for (const input of fields) input.required = some(); };
    for (const input of fields) input.addEventListener("input", ask);
    ask();
    inputs.push({section, key, fields, get: () => some() ? fields.map(input => numberIn(input)) : null});
    return el("div", {class: "fields"}, entries.map(([words, unit], k) => named(words, fields[k], unit)));
  };
  const shape = el("select", {id: "say-shape", onchange: () => show()},
    SHAPES.map(([value, text]) => el("option", {value, selected: value === (mechanism.builtin ?? "")}, text)));
  const body = BODY.map(([key, words, unit, shapes]) => [field("mechanism", key, words, unit, mechanism), shapes]);
  const show = () => { for (const [label, shapes] of body) label.hidden = !shapes.includes(shape.value); };
  const other = Boolean(mechanism.mesh || mechanism.builtin && !SHAPES.some(([value]) => value === mechanism.builtin));
  const save = () => {
    const wrong = inputs.flatMap(({fields}) => fields).find(input => !input.checkValidity());
    if (wrong) { wrong.reportValidity(); return; }
    const sections = {};
    for (const {section, key, fields, get} of inputs) {
      const known = state.described[section]?.[key] ?? null;
      const value = fields[0].parentElement.hidden ? null : get();
      if (JSON.stringify(value) !== JSON.stringify(known)) (sections[section] ??= {})[key] = value;
    }
    if (!other && shape.value !== (mechanism.builtin ?? "")) (sections.mechanism ??= {}).builtin = shape.value || null;
    app.act(() => post("/api/describe", {sections}));
  };
  show();
  return el("details", {id: "describe"}, el("summary", {}, "Length, body, gravity and instruments",
    Object.keys(state.described).length ? null : el("span", {class: "soft"}, " (nothing is said of them yet)")),
  el("p", {class: "hint"}, "Typed here it counts for all tables of the session; an empty field says nothing."),
  el("h3", {}, "The mechanism"), el("div", {class: "fields"},
    field("mechanism", "length_m", "Length from the base frame to the top frame", LENGTH, mechanism),
    field("mechanism", "free_length_m", "Length when it is detached", LENGTH, mechanism),
    other ? el("p", {class: "soft"}, "Its body is described in its own file.") : el("label", {}, el("span", {}, "Shape"), shape), other ? null : body.map(([label]) => label),
    field("scene", "payload_mass_kg", "Mass on the platform", {unit: "kg", scale: 1}, scene)),
  el("h3", {}, "Gravity, in axes of the base frame"), list("scene", "gravity_m_s2", GRAVITY, scene),
  el("p", {class: "hint"}, "Where nothing is said, −9.81 along x: the mechanism stands on its base. It is 0, 0, 0 where weights were balanced or taken out."),
  el("h3", {}, "The noise of one row: its standard deviation"), el("div", {class: "fields"},
    NOISE.map(([key, words, unit]) => field("instrument", key, words, unit, instrument))),
  el("h3", {}, "The largest reading of the sensor, in its own axes"), list("instrument", "fts_range", OF_SENSOR, instrument, 0),
  el("h3", {}, "The smallest step of its readings"), list("instrument", "fts_resolution", OF_SENSOR, instrument, 0),
  button("Say this of the tables", save, {id: "say", class: "first", disabled: busy(state)}));
}
