// Where a mechanism with actuators comes to rest: a slider for each input moves the body.

import {axesOf, bent, profileOf} from "./bend.js";
import {colours, faded, rgb} from "./colours.js";
import {column, label} from "./columns.js";
import {el, number} from "./dom.js";
import {mm} from "./scene.js";
import {bodyColour, space} from "./space.js";

const REACHED = 0.6;  // of the grey of a place that the tip can reach
const kept = new Map();  // inputs that a person has set stay when the page is drawn again

const fixed = value => (Math.round(100 * value) / 100 || 0).toFixed(2);

// found: {actuators, levels: [[...]], poses: [[...], or null where there is none], length_m, outline_m}
export function moved(found) {
  const {actuators, levels, poses} = found, profile = profileOf(found);
  const inputs = levels.map((values, i) => Math.min(values.at(-1), Math.max(values[0], kept.get(actuators[i]) ?? 0)));
  const drawn = space("The body at the inputs of its actuators"), said = el("p", {class: "hint", id: "at-inputs", "aria-live": "polite"});
  const {soft, wash} = colours(), faint = faded(rgb(soft), rgb(wash), REACHED);
  const tips = poses.filter(Boolean).map(mm), [x, y, z] = [0, 1, 2].map(k => tips.map(pose => pose[k]));
  const points = {x, y, z, row: x.map((_, i) => -1 - i), colour: x.map(() => faint),
    text: i => `the top can be at ${number(x[i])}, ${number(y[i])}, ${number(z[i])} mm`};
  const body = (pose, alpha) => {
    const {points: nodes, triangles} = bent(profile, pose);
    return {points: nodes.map(mm), triangles, colour: bodyColour(), alpha};
  };
  function show() {
    const pose = between(levels, poses, inputs), rest = [profile.length, 0, 0, 0, 0, 0];
    const bodies = [body(rest, 0.2)], frames = [];
    if (pose) {
      bodies.push(body(pose, 1));
      frames.push({name: "", origin: mm(pose.slice(0, 3)), axes: axesOf(pose.slice(3)), size: 180 * profile.length});
    }
    drawn.set({bodies, frames, points});
    said.textContent = pose ? `Without a load the top comes to rest at ${mm(pose.slice(0, 3)).map(fixed).join(", ")} mm, turned by `
      + `${pose.slice(3).map(v => fixed(v * 180 / Math.PI)).join(", ")} deg.` : "The model finds no place of rest at these inputs.";
  }
  const sliders = actuators.map((name, i) => {
    const {unit, scale} = column(name), [low, high] = [levels[i][0], levels[i].at(-1)];
    const value = el("output", {for: name});
    const slider = el("input", {type: "range", id: name, min: low, max: high, step: (high - low) / 200, value: inputs[i],
      oninput: () => { inputs[i] = Number(slider.value); kept.set(name, inputs[i]); write(); show(); }});
    const write = () => {
      value.textContent = `${number(inputs[i] * scale)} ${unit}`;
      slider.setAttribute("aria-valuetext", value.textContent);
    };
    write();
    return el("div", {class: "row slider"}, el("label", {for: name}, label(name)), slider, value);
  });
  show();
  return el("section", {"aria-label": "The body at the inputs of its actuators"}, el("h3", {}, "The body moved by its actuators"),
    ...sliders, said, drawn.node, el("p", {class: "hint"}, "Grey points: where the top comes to rest at inputs of the measured range. Between "
      + "them, and between its two end frames, the body is sketched."));
}

// The pose between those of a grid, whose last input runs fastest; null beside one that is null.
function between(levels, poses, inputs) {
  let corners = [[0, 1]];
  for (const [i, values] of levels.entries()) {
    const next = values.findIndex(v => v >= inputs[i]), k = Math.min(values.length - 2, Math.max(0, next - 1));
    const share = (inputs[i] - values[k]) / (values[k + 1] - values[k]);
    corners = corners.flatMap(([at, weight]) => [[at * values.length + k, weight * (1 - share)], [at * values.length + k + 1, weight * share]]);
  }
  const used = corners.filter(([, weight]) => weight > 0);
  if (used.some(([at]) => !poses[at])) return null;
  return [0, 1, 2, 3, 4, 5].map(k => used.reduce((sum, [at, weight]) => sum + weight * poses[at][k], 0));
}
