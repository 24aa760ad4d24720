// Requests to the server of this page. An answer that is an error becomes an Error in its words.

import * as recorded from "./recorded.js";
import {isCopy} from "./recorded.js";

async function answer(response) {
  const document = await response.json().catch(() => ({error: response.statusText}));
  if (!response.ok) throw Object.assign(new Error(document.error), {status: response.status, remedy: document.remedy});
  return document;
}

export const get = path => isCopy ? recorded.get(path) : fetch(path, {cache: "no-store"}).then(answer);

// The text of a file of the session.
export const text = path => isCopy ? recorded.text(path) : fetch(path, {cache: "no-store"}).then(response => response.text());

export const post = (path, body = {}) => isCopy ? recorded.post(path, body) : fetch(path, {
  method: "POST",
  headers: {"content-type": "application/json"},
  body: JSON.stringify(body),
}).then(answer);

// `told` hears how much of the file is here; only this kind of request says so.
export const upload = (file, more, told) => new Promise((done, failed) => {
  const request = new XMLHttpRequest();
  request.open("POST", `/api/upload?name=${encodeURIComponent(file.name)}${more ? "&more=1" : ""}`);
  request.upload.onprogress = event => told(event.loaded / (event.total || 1));
  request.onload = () => answer(new Response(request.responseText, {status: request.status})).then(done, failed);
  request.onerror = () => failed(new Error("the file did not come to its end"));
  request.send(file);
});

// Resolves when nothing is computed: a table is checked as soon as it is here.
export async function idle() {
  while ((await get("/api/state")).running) await new Promise(resolve => setTimeout(resolve, 200));
}

// Whether a step is computed that a person has begun. A click waits for the end of any other one.
export const busy = state => Boolean(state.running) && !state.running.automatic;

// A view depends on the tables and the model only: it is fetched once for each of them.
const views = new Map();

export function view(name, state, model = state.model) {
  const of = [...state.data.map(item => item.file), ...(name === "poses" ? [] : [model])].join(), key = JSON.stringify([name, of]);
  if (!views.has(key)) {
    if (views.size > 12) views.delete(views.keys().next().value);
    // The server refuses where another tab has changed tables or model in the meantime.
    const promise = get(`/api/view/${name}?of=${encodeURIComponent(of)}`);
    promise.catch(() => views.delete(key));
    views.set(key, promise);
  }
  return views.get(key);
}
