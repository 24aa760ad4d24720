// Base and effects fitted linearly in the browser, on the whitened columns that the server sent: what a
// fit with other effects would find, at once. The base's part of each column is taken out already.

const RIDGE = 1e-10;  // of the largest diagonal: as the server's

export function linearFit({effects, gram, slope, squares, mean, at, row, columns, step, values}) {
  const place = new Map(), signs = [];
  for (const [id, {parameters}] of Object.entries(effects))
    place.set(id, parameters.map(({sign}) => signs.push(sign) - 1));
  const total = signs.length, wide = columns.length * total;
  const table = new Int16Array(Uint8Array.from(atob(values), c => c.charCodeAt(0)).buffer);
  const ridge = RIDGE * gram.reduce((most, line, i) => Math.max(most, line[i]), 0);

  // Coefficients, their covariance over the noise, and the error (times the noise) that is left. A
  // coefficient that may have one sign only is left out where it has the other.
  function fit(ids) {
    let taken = [...ids].flatMap(id => place.get(id) ?? []);
    for (;;) {
      const inverse = inverted(taken.map(i => taken.map(j => gram[i][j] + (i === j ? ridge : 0))));
      const theta = inverse.map(line => line.reduce((sum, v, k) => sum + v * slope[taken[k]], 0));
      const right = taken.filter((i, k) => theta[k] * signs[i] >= 0);
      if (right.length === taken.length) {
        const gain = theta.reduce((sum, v, k) => sum + v * slope[taken[k]], 0);
        return {taken, theta, sd: inverse.map((line, k) => Math.sqrt(Math.max(0, line[k]))),
          squares: Math.max(0, squares - gain), error: Math.sqrt(mean * Math.max(0, squares - gain))};
      }
      taken = right;
    }
  }

  // What a fit explains of a component at the k-th of the rows that were sent; null of one that is no column.
  function explained({taken, theta}, name, k) {
    const j = columns.indexOf(name), begin = k * wide + j * total;
    if (j < 0) return null;
    let sum = 0;
    for (let c = 0; c < taken.length; c += 1) sum += theta[c] * step[taken[c]] * table[begin + taken[c]];
    return sum;
  }

  // The parameters of an effect in a fit, in their units.
  function parameters(found, id) {
    return effects[id].parameters.map(({name, unit, length}, k) => {
      const at = found.taken.indexOf(place.get(id)[k]);
      return {name, unit, value: at < 0 ? 0 : found.theta[at] / length, sd: at < 0 ? null : found.sd[at] / length};
    });
  }

  return {fit, explained, parameters, has: id => place.has(id), rows: at.map(i => row[i])};
}

// The inverse of a small positive matrix, by Gauss and Jordan; a direction that is not there gets zeros.
function inverted(matrix) {
  const n = matrix.length, work = matrix.map((line, i) => [...line, ...line.map((_, j) => Number(i === j))]);
  for (let i = 0; i < n; i += 1) {
    const pivot = work[i][i];
    if (!(pivot > 1e-12 * matrix[i][i])) {
      for (const line of work) line[i] = line[n + i] = 0;
      work[i].fill(0);
      continue;
    }
    work[i] = work[i].map(v => v / pivot);
    for (let k = 0; k < n; k += 1) {
      const factor = work[k][i];
      if (k !== i && factor) work[k] = work[k].map((v, j) => v - factor * work[i][j]);
    }
  }
  return work.map(line => line.slice(n));
}
