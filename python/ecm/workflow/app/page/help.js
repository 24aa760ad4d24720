// Words that the page explains, one hover or one focus away.

import {el} from "./dom.js";
import {TERMS} from "./words.js";

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
