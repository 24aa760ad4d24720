// A copy of a session in one file, without a server: its recorded states, and what the figures show of them.

const {states = [], views = {}, script = ""} = globalThis.recorded ?? {};
let at = states.length - 1, version = 0;
export const isCopy = states.length > 0;

const words = ({verb, request}) => [{example: "open the example", refit: "fit again"}[verb] ?? verb,
  ...["model", "add", "remove", "to"].flatMap(name => request[name] ?? [])].join(" ");

export async function get(path) {
  if (path === "/api/state") return {...states[at].state, version, undo: at > 0, redo: at < states.length - 1, running: null};
  if (!(path in views)) throw new Error("This copy of a session does not hold this.");
  return views[path];
}

export const text = async () => script;

// A step of the recorded session is taken; no other.
export async function post(path, {verb, then, ...request}) {
  const same = item => item.verb === verb && Object.entries(request).every(([name, value]) => JSON.stringify(item.request[name] ?? "") === JSON.stringify(value || ""));
  const next = {"/api/undo": at - 1, "/api/redo": at + 1, "/api/step": states.findIndex(same)}[path] ?? -1;
  if (!states[next]) {
    const kept = states.slice(1).map(words).join(", ");
    throw new Error(`This is a copy of a session to read${kept ? `; it holds these steps: ${kept}` : ""}. Ticks and figures work; ecm app goes on with a session.`);
  }
  [at, version] = [next, version + 1];
  return {};
}
