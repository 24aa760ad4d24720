// The loop: polls the state of the session folder, and shows one of the seven stages.

import {busy, get, post} from "./api.js";
import {effectName, inPage, nameFiles, ownFiles} from "./columns.js";
import {button, el, waiting} from "./dom.js";
import {wayOut} from "./remedy.js";
import {isCopy} from "./recorded.js";
import {forget, mark} from "./selection.js";
import {stages} from "./stages.js";

const main = document.getElementById("main");
const WORK = {example: "Preparing the example", campaign: "Measuring on the simulated rig", import: "Importing", check: "Checking the table",
  fit: "Fitting the model", refit: "Fitting with the change", compare: "Comparing model and data",
  diagnose: "Testing every effect", export: "Writing the controller", reveal: "Opening the sealed truth"};
let state = null, shown = "", lost = false, acting = false, marksOf = "", wasRunning = null;

export const app = {
  go: id => { location.hash = id; },
  // One click at a time: the second of a double click does nothing.
  async act(work) {
    if (acting) return;
    acting = true;
    say("");
    try {
      await work();
    } catch (error) {
      say(inPage(error.message), true, error.remedy);
    } finally {
      acting = false;
    }
    await refresh();
  },
  // The marked rows are left out of the tables, and the model of now is fitted to the others.
  leaveOut: rows => app.act(() => {
    const base = state.rungs[0]?.asked, add = (state.fit?.effects ?? []).map(effect => effect.id);
    const then = base ? {verb: "fit", model: base, ...add.length ? {then: {verb: "refit", add}} : {}} : null;
    return post("/api/leave_out", {rows, then});
  }),
  step: (verb, request = {}) => app.act(() => post("/api/step", {verb, ...request})),
};

function say(text, error = false, remedy = null) {
  document.getElementById("status").replaceChildren(
    text ? el("div", {class: error ? "error" : "lead", role: error ? "alert" : null}, text, " ", ...state ? wayOut(remedy, state, app) : [],
      button("Close", () => say(""))) : "");
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
      role: open ? null : "link",
    }, el("span", {class: "place", "aria-hidden": "true"}, String(i + 1)), el("span", {}, item.title),
    el("small", {}, open ? item.brief(state) : item.needs)));
  }));
  seeStage();
}

// On a phone the stages are a row that scrolls; the page itself stays where it is.
function seeStage() {
  const nav = document.querySelector("nav"), item = nav.querySelector("[aria-current]");
  if (item) nav.scrollLeft = item.offsetLeft - (nav.clientWidth - item.offsetWidth) / 2;
}

function drawRunning() {
  const node = document.getElementById("running"), {running} = state;
  if (!running) {
    if (wasRunning && !lost) announce(`${wasRunning}: ended`);
    wasRunning = null;
    node.hidden = true;
    node.replaceChildren();
    return;
  }
  const step = state.steps.find(item => item.number === running.step);
  if (node.hidden) {
    node.replaceChildren(el("div", {class: "what"}, el("strong", {}), el("div", {class: "soft"})),
      el("progress", {"aria-label": "progress"}),
      button("Cancel", cancel, {id: "cancel"}));
    node.hidden = false;
  }
  const what = WORK[step?.verb] ?? step?.verb ?? "";
  if (what !== wasRunning) announce(`${what} …`);
  wasRunning = what;
  node.querySelector("strong").textContent = what;
  const few = running.total > 1 && running.total <= 100;
  const count = !running.total ? "" : few ? `${Math.floor(running.done)} of ${running.total}`
    : `${Math.round(100 * running.done / running.total)} %`;
  const seconds = running.left_s, soon = seconds < 90;
  const left = seconds ? `about ${Math.ceil(soon ? seconds : seconds / 60)} ${soon ? "s" : "min"} left` : "";
  node.querySelector(".soft").textContent = [running.what, count, `${Math.round(running.seconds)} s so far`,
    left, running.waiting ? "your click comes next" : ""].filter(Boolean).join(", ");
  const bar = node.querySelector("progress");
  if (running.total) { bar.max = running.total; bar.value = running.done; }
  else bar.removeAttribute("value");
}

// Also while a click waits.
const cancel = () => post("/api/cancel").then(refresh, error => say(error.message, true));

function announce(text) {
  document.getElementById("announced").textContent = text;
}

function drawTools() {
  document.getElementById("folder").replaceChildren(el("span", {}, isCopy ? "A copy to read of " : "Session folder: "), state.folder);
  const off = busy(state);
  document.getElementById("tools").replaceChildren(
    button("Undo", () => app.act(() => post("/api/undo")),
      {id: "undo", disabled: !state.undo || off, title: "Take the last change of data or model back"}),
    button("Redo", () => app.act(() => post("/api/redo")),
      {id: "redo", disabled: !state.redo || off, title: "Bring back what was undone"}));
}

// The server's words name options of the command line and keys of files; the page has a list of the columns.
const OF_FILES = /(?: (?:If it is in that unit, call|Divide by 1000, give|Multiply by pi\/180, give|Rename the columns, or map|Where there is no header, set) [^\n]*)?$/;
function advice({verb, message, remedy}) {
  if (!state.dropped.length) return message;
  if (verb === "check" && !state.check) message = message.replace(OF_FILES, remedy?.request ? "" : "\nSay below what the columns are, and import it.");
  return verb === "import" ? message.replace(/\s*\b(Say it once|Say which|Name what is one|Say --)[^]*$/, "\nSay so in the list below.") : message;
}

// What a controller cannot hold may be an effect of the model: each can be left out.
const without = ({verb, status, remedy}) => verb !== "export" || status !== "failed" || remedy?.request?.remove ? [] : (state.fit?.effects ?? []).map(({id}) =>
  button(`Leave out ${effectName(id)} and fit again`, () => app.step("refit", {remove: [id]}), {"data-remove": id}));

// What to do after a step that did not end well.
function trouble() {
  const last = state.steps.at(-1);
  if (!last || state.running) return null;
  const words = {
    failed: `${WORK[last.verb] ?? last.verb}: this did not work.\n${inPage(ownFiles(advice(last)))}\n`,
    cancelled: `${WORK[last.verb] ?? last.verb}: cancelled. Nothing was changed.\n`,
    interrupted: `${WORK[last.verb] ?? last.verb}: cut off (${last.message}). All else is kept.\n`,
  }[last.status];
  const way = wayOut(last.remedy, state, app);
  return words ? el("div", {class: "error", role: "alert", id: "trouble"}, words, ...way, ...without(last), button("Run again",
    () => app.act(() => post("/api/again", {step: last.number})), {class: way.length ? "" : "first"})) : null;
}

function draw() {
  const stage = current();
  // The page stays where it is: the next stage is opened by a click only.
  if (!location.hash) history.replaceState(null, "", `#${stage.id}`);
  drawRunning();
  const running = state.running ? state.running.step : "";
  document.documentElement.dataset.running = running;
  document.documentElement.dataset.version = state.version;
  const key = `${stage.id} ${state.version} ${running}`;
  if (key === shown) return;
  const focused = document.activeElement?.id, same = shown.split(" ")[0] === stage.id;
  shown = key;
  drawTools();
  drawStages(stage);
  document.documentElement.dataset.stage = stage.id;
  document.title = `${stage.title} – ECM`;
  if (marksOf !== JSON.stringify(state.data)) {
    marksOf = JSON.stringify(state.data);
    mark([]);
  }
  forget();
  document.getElementById("tip").hidden = true;
  const body = el("div");
  main.replaceChildren(el("h2", {}, stage.title), el("p", {class: "purpose"}, stage.purpose),
    ...[trouble()].filter(Boolean), body);
  if (stage.compares && !state.compare) {
    body.append(state.running ? waiting("The errors are being computed …")
      : button("Compute the errors", () => app.step("compare"), {class: "first", id: "compare"}));
    return;
  }
  const drawn = Promise.resolve(stage.draw(body, state, app)).catch(error => {
    for (const node of body.querySelectorAll(".waiting")) node.remove();
    body.append(el("div", {class: "error", role: "alert"}, error.message, " ",
      button("Try again", () => { shown = ""; draw(); })));
  });
  if (!same) scrollTo(0, 0);
  else if (focused) {
    // What was focused may be there at once, or when its figures have been computed.
    const back = () => key === shown && document.activeElement === document.body
      && document.getElementById(focused)?.focus({preventScroll: true});
    back();
    drawn.then(back);
  }
}

async function refresh() {
  try {
    const found = await get("/api/state");
    if (state && found.version < state.version) return;  // an older answer that came later
    state = found;
    nameFiles(state.steps);
  } catch (error) {
    lost = true;
    say(error.status ? error.message : "The server does not answer. The session is kept in its folder: start it again with ecm app "
      + "and open the address that it prints.", true);
    if (!state) main.replaceChildren(waiting("No session to show yet."));
    return;
  }
  if (lost) { lost = false; say(""); }
  draw();
}

async function poll() {
  await refresh();
  if (!isCopy) setTimeout(poll, state && state.running ? 400 : 1500);
}

addEventListener("hashchange", () => {
  if (!state) return;
  // The skip link names the content, which is no stage.
  if (location.hash === "#main") history.replaceState(null, "", `#${shown.split(" ")[0]}`);
  draw();
  main.focus({preventScroll: true});
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  shown = "";
  if (state) draw();
});
addEventListener("resize", seeStage);
document.documentElement.classList.toggle("copy", isCopy);
document.body.append(el("div", {id: "announced", class: "hidden", "aria-live": "polite"}));
poll();
