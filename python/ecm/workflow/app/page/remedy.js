// The way out of a refusal: a button where a step of the page does it, else the command to copy.

import {busy} from "./api.js";
import {effectName, readable} from "./columns.js";
import {button, el} from "./dom.js";

export function wayOut(remedy, state, app) {
  if (!remedy) return [];
  const words = readable(remedy.words), ways = [remedy.request, remedy.again].filter(Boolean), typed = !ways.length && remedy.command;
  return [el("p", {}, `${words.charAt(0).toUpperCase()}${words.slice(1)}${typed || ways.length ? ":" : "."}`),
    typed ? el("p", {}, el("code", {}, typed)) : null,
    ...ways.map(({verb, ...request}, place) =>
      button(label(verb, request), () => app.step(verb, request),
        {class: place ? null : "first", "data-remedy": verb, disabled: busy(state)}))].filter(Boolean);
}

function label(verb, request) {
  const names = list => (list ?? []).map(effectName).join(" and ");
  if (request.skip_bad_rows || request.leave_out) return "Leave these rows out";
  if (request.at) return `Export at ${readable(request.at)}`;
  if (request.force) return verb === "export" ? "Export it all the same" : "Save it all the same";
  if (request.remove) return `Leave out ${names(request.remove)} and fit again`;
  if (verb === "fit" && request.add) return `Fit ${effectName(request.model ?? "")} with ${names(request.add)}`;
  if (request.add) return `Add ${names(request.add)} and fit again`;
  return {fit: `Fit ${effectName(request.model ?? "")}`, import: "Import it", check: "Check again",
    export: `Export as ${request.to}`}[verb] ?? "Do this";
}
