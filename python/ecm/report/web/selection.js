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

// A new stage draws new figures: those of the last one are told nothing any more. What a figure hears of the whole document
// ends with this signal, too: else the document would hold the figure, and all around it, for ever.
let ends = new AbortController();
export const untilForgotten = () => ({signal: ends.signal});
export function forget() {
  listeners.clear();
  ends.abort();
  ends = new AbortController();
}
