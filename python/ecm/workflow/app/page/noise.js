// Errors in words: over the noise where it is known; where it is only assumed, in percent.

export const knowsNoise = state => state.compare?.noise.source !== "assumed";

// Error of a fit in percent of the readings' spread: the root mean square over the components.
export function share(state, rmse) {
  const of = state.rungs[0]?.report?.components ?? {};
  const shares = Object.entries(rmse ?? {}).flatMap(([name, error]) => {
    const {rmse: own, rmse_over_spread: over} = of[name] ?? {};
    return own > 0 && over > 0 ? [error / (own / over)] : [];
  });
  return shares.length ? 100 * Math.sqrt(shares.reduce((sum, v) => sum + v * v, 0) / shares.length) : null;
}

export function errorWords(state) {
  const {whitened_rms: error, rmse} = state.compare;
  if (knowsNoise(state)) return `${error.toFixed(2)} times the noise`;
  const own = share(state, rmse);
  return own === null ? "noise not known" : `${own.toPrecision(3)} % of the spread`;
}
