// Two weighted straight lines for each pixel, and the maps that follow: cldit/dit/solve.py without
// errors that references and injections share.

const REASON = { ok: 0, few: 1, hidden: 4, thin: 5, negative: 6 };
const VISIBLE = 0.5; // share of the disc's radiance that a pixel must see without spray
const DETECTION = 3; // an emissivity of fewer standard errors is not significant ...
const LEAST = 1e-4; // ... nor is one below the accuracy of a trace

// The line through K means at the radiances x. `noise` gives the variance of one exposure as
// `photons` times what the camera sees, plus `constant`.
class Line {
  constructor(x, noise, exposures) {
    this.x = Float64Array.from(x);
    this.unit = Math.max(...x.map(Math.abs));
    this.scaled = Float64Array.from(x, (one) => one / this.unit);
    this.noise = noise;
    this.per = this.unit * this.unit * exposures;
    this.signal = new Float64Array(x.length);
    // Of the slope, per variance of one exposure: its variance if all signals had this variance.
    const [sum, square] = this.scaled.reduce(([a, b], one) => [a + one, b + one * one], [0, 0]);
    this.spread = 1 / (this.per * (square - sum * sum / x.length));
    this.slope = this.start = this.slopes = this.both = this.starts = 0;
  }

  variance(mean) {
    const n = this.noise;
    const seen = n.transmission * mean + n.added;
    return (seen > 0 ? n.photons * seen : 0) + n.constant;
  }

  // Fits means that lie on a line exactly: (co)variances of slope and start.
  exact(slope, start) {
    const { x, scaled, per, unit } = this;
    const { transmission, photons, added, constant } = this.noise;
    let s = 0, sx = 0, sxx = 0;
    for (let k = 0; k < x.length; k++) {
      const seen = transmission * (slope * x[k] + start) + added;
      const p = per / ((seen > 0 ? photons * seen : 0) + constant);
      const px = p * scaled[k];
      s += p;
      sx += px;
      sxx += px * scaled[k];
    }
    const inverse = 1 / (s * sxx - sx * sx);
    this.slope = slope;
    this.start = start;
    this.slopes = s * inverse;
    this.both = -sx * inverse * unit;
    this.starts = sxx * inverse * unit * unit;
  }

  // Fits any means twice, the second time with the noise at the fitted signals.
  fitted(mean) {
    this.weighted(mean, mean);
    const { slope, start, signal, x } = this;
    for (let k = 0; k < x.length; k++) signal[k] = slope * x[k] + start;
    this.weighted(mean, signal);
  }

  weighted(mean, signal) {
    const scaled = this.scaled, unit = this.unit;
    let s = 0, sx = 0, sxx = 0, sy = 0, sxy = 0;
    for (let k = 0; k < scaled.length; k++) {
      const p = this.per / this.variance(signal[k]), y = mean[k] / unit;
      s += p;
      sx += p * scaled[k];
      sxx += p * scaled[k] * scaled[k];
      sy += p * y;
      sxy += p * scaled[k] * y;
    }
    const determinant = s * sxx - sx * sx;
    this.slope = (s * sxy - sx * sy) / determinant;
    this.start = (sxx * sy - sx * sxy) / determinant * unit;
    this.slopes = s / determinant;
    this.both = -sx / determinant * unit;
    this.starts = sxx / determinant * unit * unit;
  }
}

// Writes emissivity and temperature of pixel i without their errors, of a spray in which they are
// surely significant: the slope's variance is at most that of the brightest signal at every
// background. False where this does not hold.
function solveClear(maps, i, before, slope, start, after, planck) {
  const g = before.slope, depth = g - slope, emissivity = 1 - slope / g, x = after.x;
  const end = x[x.length - 1], bright = start + slope * (slope > 0 ? Math.max(end, x[0]) : Math.min(end, x[0]));
  const per = 1 / (g * g);
  const most = per * (slope * slope * per * before.slopes + after.variance(bright) * after.spread);
  if (!(g >= VISIBLE && emissivity > LEAST && emissivity * emissivity > DETECTION * DETECTION * most)) return false;
  const radiance = (start - before.start) / depth;
  if (!(radiance > 0)) return false;
  planck.inverse.look(Math.log(radiance));
  maps.reason[i] = REASON.ok;
  maps.emissivity[i] = emissivity;
  maps.temperature[i] = planck.inverse.value;
  return true;
}

// Writes pixel i of the maps from the lines `before`, without spray, and `after`. Without objects
// and powers: either would cost more than the rest.
function solvePixel(maps, i, before, after, planck) {
  const g = before.slope, s = after.slope, depth = g - s;
  const emissivity = 1 - s / g, per = 1 / (g * g);
  const error = Math.sqrt(per * (s * s * per * before.slopes + after.slopes));
  const radiance = (after.start - before.start) / depth;
  const clear = DETECTION * error;
  let reason = REASON.ok;
  if (!(radiance >= 0)) reason = REASON.negative;
  if (!(emissivity > (clear > LEAST ? clear : LEAST))) reason = REASON.thin;
  if (!(g >= VISIBLE)) reason = REASON.hidden;
  maps.reason[i] = reason;
  maps.emissivity[i] = reason !== REASON.hidden ? emissivity : NaN;
  maps.emissivity_error[i] = reason !== REASON.hidden ? error : NaN;
  if (reason !== REASON.ok) {
    maps.temperature[i] = NaN;
    maps.temperature_error[i] = NaN;
    return;
  }
  const variance = (radiance * (radiance * (before.slopes + after.slopes)
    + 2 * (before.both + after.both)) + before.starts + after.starts) / (depth * depth);
  if (radiance === 0) {
    maps.temperature[i] = 0;
    maps.temperature_error[i] = variance > 0 ? Infinity : NaN;
    return;
  }
  const inverse = planck.inverse;
  inverse.look(Math.log(radiance));
  maps.temperature[i] = inverse.value;
  maps.temperature_error[i] = Math.sqrt(variance) * inverse.slope / radiance;
}
