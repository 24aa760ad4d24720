// The rows that are marked, in all figures and tables at once.

const listeners = new Set();
export const marked = new Set();

export function mark(rows) {
  marked.clear();
  for (const row of rows) marked.add(row);
  for (const listener of listeners) listener();
}

export function onMark(listener) {
  listeners.add(listener);
}

// A new stage draws new figures: those of the last one are told nothing any more.
export function forget() {
  listeners.clear();
}
