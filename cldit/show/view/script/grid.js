// Images on other pixels. A grid is {columns, rows, pixel_mm, centre_mm}, row 0 at the top.

function edges(grid, axis) {
  const count = axis === 0 ? grid.columns : grid.rows, step = grid.pixel_mm[axis];
  return { count, step, begin: (axis === 0 ? 1 : -1) * grid.centre_mm[axis] - count * step / 2 };
}

// For each pixel of `to` along one axis: the first pixel of `from` in it, and shares of the length.
function overlaps(from, to, axis) {
  const a = edges(from, axis), b = edges(to, axis);
  return Array.from({ length: b.count }, (_, j) => {
    const low = (b.begin + j * b.step - a.begin) / a.step, high = low + b.step / a.step;
    const first = Math.max(Math.floor(low + 1e-9), 0), end = Math.min(Math.ceil(high - 1e-9), a.count);
    const shares = [];
    for (let i = first; i < end; i++) {
      shares.push((Math.min(i + 1, high) - Math.max(i, low)) / (high - low));
    }
    return { first, shares };
  });
}

// Means by area of several images (H, W) in the pixels of `to`, over the parts that are `known`; NaN
// if less than half of a pixel is known.
function averaged(values, known, from, to) {
  const across = overlaps(from, to, 0), down = overlaps(from, to, 1);
  const out = values.map(() => new Float32Array(to.columns * to.rows).fill(NaN));
  const sums = new Float64Array(values.length);
  for (let j = 0; j < to.rows; j++) {
    for (let i = 0; i < to.columns; i++) {
      let covered = 0;
      sums.fill(0);
      for (let v = 0; v < down[j].shares.length; v++) {
        const row = (down[j].first + v) * from.columns + across[i].first;
        for (let u = 0; u < across[i].shares.length; u++) {
          if (!known[row + u]) continue;
          const share = down[j].shares[v] * across[i].shares[u];
          covered += share;
          for (let n = 0; n < sums.length; n++) sums[n] += share * values[n][row + u];
        }
      }
      if (covered < 0.5) continue;
      for (let n = 0; n < sums.length; n++) out[n][j * to.columns + i] = sums[n] / covered;
    }
  }
  return out;
}

function sameGrid(one, other) {
  const close = (a, b) => Math.abs(a - b) < 1e-6;
  return one.columns === other.columns && one.rows === other.rows
    && [0, 1].every((axis) => close(one.pixel_mm[axis], other.pixel_mm[axis])
      && close(one.centre_mm[axis], other.centre_mm[axis]));
}
