// Words that the page explains, one hover or one focus away.

import {el} from "./dom.js";

const TERMS = {
  "pose": "Position and rotation of the top frame, seen from the base: six numbers.",
  "wrench": "Force and moment together: three forces in N and three moments in N m.",
  "residual": "Measured wrench minus the wrench of the model, row by row.",
  "noise floor": "How far two readings of the same pose differ by chance. No model can err less "
    + "than this on new rows.",
  "over noise": "The residual divided by its noise: 1 is as large as chance, 3 is rarely chance.",
  "noise not known": "No pose is repeated and no noise is stated, so nothing says how much of this error is noise. "
    + "Record repeats, or say under Data how exact the instruments are.",
  "as pose error": "How far the top would have to move to feel the residual: the inverse stiffness "
    + "times the residual, in mm and degrees.",
  "held out": "Poses that the fit never saw. An error that falls only on fitted rows means that the "
    + "model learns the noise.",
  "signature": "Shapes that a residual may have: constant, proportional to the wrench, even (the same for a pose "
    + "and its mirror image), odd (opposite), or a curve over a column. The percentage is its share.",
  "gain": "Share of the squared residual over noise that this effect alone would take away.",
  "verdict": "What the test of all effects says: one is named, several look alike, an unknown one, "
    + "or nothing is missing.",
  "not testable": "The table lacks what would show this effect. Recording it makes it testable.",
  "plus minus": "Standard deviation of the fitted value: the true one lies within twice this in "
    + "about 95 of 100 repetitions.",
  "is the change real?": "p is the chance of such a fall by accident: below 0.01 the change is real. χ² is the sum "
    + "of squared residuals over noise; BIC weighs the fall against the number of new parameters.",
  "frozen": "Its parameters keep their values when the model is fitted again.",
  "sealed": "The simulated rig hid an effect. Its name lies in a sealed file, so that you can test "
    + "the diagnosis first.",
  "learning curve": "The error on held-out poses for growing numbers of poses: where it is flat, "
    + "more poses do not help.",
  "readings": "The force as the sensor reads it, its zero included. The table corrects for that at the end.",
  "chance": "Probability that the verdict is right after this experiment.",
  "controller": "The model as source code for a real-time computer.",
  "correlation": "How far an error of one value is made up by another, from -1 to 1: near either end only a "
    + "combination of the two is known.",
  "energy": "The wrench is the slope of an energy: a sum of products of the pose's coordinates, so "
    + "that pushing round a loop gives no work for free.",
  "physics": "Finite elements of the described body; modulus and Poisson's ratio are fitted.",
  "frames": "Red is x, green is y, blue is z. The base frame sits on the clamped face, its x axis "
    + "goes along the mechanism.",
};

const tip = () => document.getElementById("tip");

export function help(term) {
  const show = event => {
    const node = tip(), box = event.currentTarget.getBoundingClientRect();
    node.textContent = TERMS[term];
    node.hidden = false;
    const left = Math.min(box.left, innerWidth - node.offsetWidth - 12);
    const below = box.bottom + 8 + node.offsetHeight < innerHeight;
    node.style.left = `${Math.max(12, left)}px`;
    node.style.top = `${below ? box.bottom + 8 : box.top - node.offsetHeight - 8}px`;
  };
  const hide = () => { tip().hidden = true; };
  return el("button", {type: "button", class: "help", "aria-label": `Help on ${term}`, "aria-description": TERMS[term],
    onmouseenter: show, onfocus: show, onclick: show, onmouseleave: hide, onblur: hide,
    onkeydown: event => { if (event.key === "Escape") hide(); }}, "?");
}

// The term itself with its help.
export const term = (name, text = name) => el("span", {}, text, help(name));
