// Tables over even steps, between which cubic Hermite polynomials run.

class Table {
  // numbers: values, then slopes, `count` each from `begin`; ends: first and last abscissa.
  constructor(numbers, ends, begin = 0, count = numbers.length / 2, slopes = begin + count) {
    this.value = numbers.subarray(begin, begin + count);
    this.slope = numbers.subarray(slopes, slopes + count);
    this.first = ends[0];
    this.last = ends[1];
    this.step = (ends[1] - ends[0]) / (count - 1);
    this.count = count;
  }

  at(x) {
    // Beyond its ends the table goes on straight.
    if (x <= this.first) return this.value[0] + (x - this.first) * this.slope[0];
    const end = this.count - 1;
    if (x >= this.last) return this.value[end] + (x - this.last) * this.slope[end];
    const place = (x - this.first) / this.step;
    const i = Math.min(Math.floor(place), end - 1);
    const t = place - i, u = 1 - t;
    return u * u * (1 + 2 * t) * this.value[i] + t * t * (3 - 2 * t) * this.value[i + 1]
      + this.step * t * u * (u * this.slope[i] - t * this.slope[i + 1]);
  }

  // First derivative; for the tables here a straight line between their slopes is not exact, so
  // it is that of the same cubic.
  rise(x) {
    if (x <= this.first) return this.slope[0];
    const end = this.count - 1;
    if (x >= this.last) return this.slope[end];
    const place = (x - this.first) / this.step;
    const i = Math.min(Math.floor(place), end - 1);
    const t = place - i, u = 1 - t;
    return 6 * t * u * (this.value[i + 1] - this.value[i]) / this.step
      + u * (1 - 3 * t) * this.slope[i] + t * (3 * t - 2) * this.slope[i + 1];
  }
}

// Black-body photon radiance in the camera's filter, and its inverse.
class Planck {
  constructor(head, arrays) {
    this.table = new Table(arrays.planck, head.ends.planck);
    this.inverse = new Table(arrays.inverse, head.ends.inverse);
  }

  radiance(kelvin) {
    return kelvin > 0 ? Math.exp(this.table.at(Math.log(kelvin))) : 0;
  }

  temperature(radiance) {
    return radiance > 0 ? Math.exp(this.inverse.at(Math.log(radiance))) : radiance === 0 ? 0 : NaN;
  }

  // d T / d radiance, where the temperature is known already.
  rise(radiance, kelvin) {
    return radiance > 0 ? kelvin * this.inverse.rise(Math.log(radiance)) / radiance : Infinity;
  }
}
