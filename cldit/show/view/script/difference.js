// Difference of two items, on the coarser pixels of both.

// An item's quantity on other pixels. A larger pixel sees the mean of radiances, so its T_app
// belongs to the mean of emissivity times radiance over the mean of emissivity.
function onGrid(item, name, grid) {
  const value = imageOf(item, name), error = statedOf(item, name);
  if (value === null) return null;
  if (sameGrid(item.head, grid)) return { value, error };
  const size = value.length, known = new Uint8Array(size);
  for (let p = 0; p < size; p++) known[p] = value[p] === value[p] && !(error && Number.isNaN(error[p])) ? 1 : 0;
  const weight = new Float32Array(size).fill(1), light = new Float64Array(size);
  const emissivity = name === "temperature" ? item.image("emissivity") : null;
  for (let p = 0; p < size; p++) {
    if (!known[p]) continue;
    if (emissivity) weight[p] = Math.max(emissivity[p], 0);
    light[p] = weight[p] * (emissivity ? item.planck.radiance(value[p]) : value[p]);
  }
  // Errors of neighbouring pixels are assumed to be correlated: they do not average out.
  const weighted = error ? weight.map((one, p) => one * error[p]) : weight;
  const [mean, of, by] = averaged([light, weighted, weight], known, item.head, grid);
  for (let p = 0; p < mean.length; p++) {
    mean[p] = emissivity ? item.planck.temperature(mean[p] / by[p]) : mean[p];
    of[p] /= by[p];
  }
  return { value: mean, error: error ? of : null };
}

// One minus other, with the stated errors of both, assumed independent.
function differenceOf(one, other, name) {
  const coarser = (axis) => (one.head.pixel_mm[axis] >= other.head.pixel_mm[axis] ? one : other);
  const grid = coarser(0).head;
  const a = onGrid(one, name, grid), b = onGrid(other, name, grid);
  if (a === null || b === null) return null;
  const value = a.value.map((number, p) => number - b.value[p]);
  let error = null;
  if (a.error || b.error) {
    error = value.map((d, p) => (Number.isNaN(d) ? NaN
      : Math.hypot(a.error ? a.error[p] : 0, b.error ? b.error[p] : 0)));
  }
  return { grid, value, error, states: [a.error !== null, b.error !== null] };
}

// Mean and RMS of a difference, RMS of its stated error, share of pixels within twice that error.
function summaryOf(difference) {
  const { value, error } = difference;
  let count = 0, sum = 0, square = 0, errors = 0, within = 0;
  for (let p = 0; p < value.length; p++) {
    const d = value[p];
    if (Number.isNaN(d) || (error && Number.isNaN(error[p]))) continue;
    count += 1;
    sum += d;
    square += d * d;
    if (error) {
      errors += error[p] * error[p];
      within += Math.abs(d) <= 2 * error[p] ? 1 : 0;
    }
  }
  if (!count) return { count };
  const found = { count, mean: sum / count, rms: Math.sqrt(square / count) };
  if (error) Object.assign(found, { stated: Math.sqrt(errors / count), within: within / count });
  return found;
}
