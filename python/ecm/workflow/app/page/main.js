// The loop: polls the state of the session folder, and shows one of the seven stages.

import {get, post} from "./api.js";
import {button, el} from "./dom.js";
import {stages} from "./stages.js";

const main = document.getElementById("main");
let state = null, shown = "", busy = "";

export const app = {
  go: id => { location.hash = id; },
  async act(work) {
    say("");
    try {
      await work();
    } catch (error) {
      say(error.message, true);
    }
    await refresh();
  },
  step: (verb, request = {}) => app.act(() => post("/api/step", {verb, ...request})),
};

function say(text, error = false) {
  const status = document.getElementById("status");
  status.replaceChildren(text ? el("p", {class: error ? "error" : "lead"}, text) : "");
}

function current() {
  const wanted = stages.find(stage => `#${stage.id}` === location.hash);
  if (wanted && wanted.open(state)) return wanted;
  return [...stages].reverse().find(stage => stage.open(state) && !stage.late) ?? stages[0];
}

function drawStages(stage) {
  document.getElementById("stages").replaceChildren(...stages.map((item, i) => {
    const open = item.open(state);
    return el("li", {}, el("a", {
      href: open ? `#${item.id}` : null,
      "aria-current": item === stage ? "step" : null,
      "aria-disabled": open ? null : "true",
      title: open ? item.title : item.needs,
    }, `${i + 1} ${item.title}`, el("small", {}, open ? item.brief(state) : item.needs)));
  }));
}

function drawRunning() {
  const node = document.getElementById("running"), running = state.running;
  node.hidden = !running;
  if (!running) return;
  const step = state.steps.find(item => item.number === running.step);
  node.replaceChildren(
    el("div", {}, el("strong", {}, step ? step.verb : ""),
      ` ${running.what} `, running.total
        ? el("progress", {value: running.done, max: running.total, "aria-label": "progress"})
        : el("progress", {"aria-label": "progress"}),
      el("div", {class: "soft"},
        `${Math.round(running.seconds)} s${running.left ? `, ${running.left}` : ""}`)),
    button("Cancel", () => app.act(() => post("/api/cancel"))));
}

function drawTools() {
  document.getElementById("folder").textContent = `Session folder: ${state.folder}`;
  document.getElementById("tools").replaceChildren(
    button("Undo", () => app.act(() => post("/api/undo")),
      {disabled: !state.undo || Boolean(state.running)}), " ",
    button("Redo", () => app.act(() => post("/api/redo")),
      {disabled: !state.redo || Boolean(state.running)}));
}

function draw() {
  const stage = current();
  // The page stays where it is: the next stage is opened by a click only.
  if (!location.hash) history.replaceState(null, "", `#${stage.id}`);
  const key = `${stage.id} ${state.version}`;
  drawRunning();
  document.documentElement.dataset.running = state.running ? state.running.step : "";
  document.documentElement.dataset.version = state.version;
  if (key === shown) return;
  shown = key;
  drawTools();
  drawStages(stage);
  document.documentElement.dataset.stage = stage.id;
  const failed = state.steps.at(-1);
  const trouble = failed && ["failed", "cancelled", "interrupted"].includes(failed.status)
    ? el("div", {class: "error", role: "alert"}, `${failed.verb}: ${failed.status}. ${failed.message} `,
      button("Run again", () => app.act(() => post("/api/again", {step: failed.number}))))
    : null;
  main.replaceChildren(el("h2", {}, stage.title), ...(trouble ? [trouble] : []));
  const body = el("div");
  main.append(body);
  if (stage.compares && !state.compare) {
    body.append(state.running ? el("p", {class: "soft"}, "The errors are being computed …")
      : button("Compute the errors", () => app.step("compare"), {class: "first", id: "compare"}));
    return;
  }
  Promise.resolve(stage.draw(body, state, app)).catch(error =>
    body.append(el("p", {class: "error", role: "alert"}, error.message)));
}

async function refresh() {
  try {
    const found = await get("/api/state");
    if (state && found.version < state.version) return;  // an older answer that came later
    state = found;
    if (busy) { busy = ""; say(""); }
  } catch (error) {
    busy = "lost";
    say("The server does not answer. The session is kept: begin it again with ecm app.", true);
    return;
  }
  draw();
}

async function poll() {
  await refresh();
  setTimeout(poll, state && state.running ? 400 : 1500);
}

addEventListener("hashchange", () => state && draw());
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  shown = "";
  if (state) draw();
});
poll();
