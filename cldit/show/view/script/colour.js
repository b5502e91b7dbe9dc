// Numbers to colours.

// Percentiles 1 and 99 of known values, of at most some 200,000 pixels; round numbers.
function limitsOf(values, diverging) {
  const known = [], step = Math.max(1, Math.floor(values.length / 200000));
  for (let p = 0; p < values.length; p += step) if (Number.isFinite(values[p])) known.push(values[p]);
  if (!known.length) return [0, 1];
  known.sort((one, other) => one - other);
  let low = known[Math.floor(0.01 * (known.length - 1))];
  let high = known[Math.ceil(0.99 * (known.length - 1))];
  if (diverging) {
    high = Math.max(Math.abs(low), Math.abs(high)) || 1;
    low = -high;
  }
  if (!(high > low)) high = low + Math.max(1e-6 * Math.abs(low), 1e-9);
  const unit = 10 ** Math.floor(Math.log10(high - low) - 2);
  const shown = (number) => Number(number.toPrecision(12));
  return [shown(Math.floor(low / unit) * unit), shown(Math.ceil(high / unit) * unit)];
}

// Full emissivity of the paper's colours: percentile 99, rounded up to 1, 2, 3, 5 times 10^n, <= 1.
function fullEmissivity(emissivity) {
  const most = Math.max(limitsOf(emissivity, false)[1], 1e-3), power = 10 ** Math.floor(Math.log10(most));
  return Math.min([1, 2, 3, 5, 10].map((one) => one * power).find((one) => one >= most * (1 - 1e-6)), 1);
}

// RGBA of an image, the number of pixels without a value by reason, and of those below and above
// the scale; `colours`: 256 RGB triples; `share`: of the colour in each pixel, the rest is white.
// Pixels without a value are clear where the spray is too thin, else grey.
function painted(values, reason, [low, high], colours, share = null) {
  const word = new Uint32Array(256), out = new Uint32Array(values.length);
  for (let c = 0; c < 256; c++) {
    word[c] = colours[3 * c] | (colours[3 * c + 1] << 8) | (colours[3 * c + 2] << 16) | 0xff000000;
  }
  const scale = 256 / (high - low), grey = 0x50808080; // a veil over the paper, light or dark
  const count = new Uint32Array(256);
  let below = 0, above = 0;
  for (let p = 0; p < values.length; p++) {
    const value = values[p];
    if (value === value) {
      const c = Math.max(0, Math.min(255, ((value - low) * scale) | 0));
      if (value < low) below += 1;
      else if (value > high) above += 1;
      out[p] = share ? mixed(colours, c, share[p]) : word[c];
    } else if (reason) {
      const why = reason(p);
      count[why] += 1;
      if (why !== REASON.thin) out[p] = grey;
    }
  }
  const empty = {};
  count.forEach((number, why) => {
    if (number) empty[why] = number;
  });
  return { pixels: out.buffer, empty, below, above };
}

function mixed(colours, c, share) {
  const part = Math.max(0, Math.min(1, share));
  const [r, g, b] = [0, 1, 2].map((n) => Math.round(255 + part * (colours[3 * c + n] - 255)));
  return r | (g << 8) | (b << 16) | 0xff000000;
}
