// Tables over even steps with cubic Hermite interpolation, and linear extrapolation.

class Table {
  // numbers: `count` values from `begin`, and slopes from `slopes`; ends: first and last abscissa.
  constructor(numbers, ends, begin = 0, count = numbers.length / 2, slopes = begin + count) {
    const last = count - 1;
    this.first = ends[0];
    this.last = ends[1];
    this.perStep = last / (ends[1] - ends[0]);
    this.top = last - 1;
    // Four polynomial coefficients of each step.
    this.powers = new Float64Array(4 * last);
    for (let i = 0; i < last; i++) {
      const [v, w] = [numbers[begin + i], numbers[begin + i + 1]];
      const [p, q] = [numbers[slopes + i] / this.perStep, numbers[slopes + i + 1] / this.perStep];
      this.powers.set([v, p, 3 * (w - v) - 2 * p - q, 2 * (v - w) + p + q], 4 * i);
    }
    this.low = [numbers[begin], numbers[slopes]];
    this.high = [numbers[begin + last], numbers[slopes + last]];
    this.value = this.slope = 0;
  }

  // Stores value and slope at x in the object: both are needed for a million pixels.
  look(x) {
    if (!(x > this.first && x < this.last)) {
      const [at, end] = x >= this.last ? [this.last, this.high] : [this.first, this.low];
      this.value = end[0] + (x - at) * end[1];
      this.slope = end[1];
      return;
    }
    const place = (x - this.first) * this.perStep;
    const i = Math.min(place | 0, this.top), t = place - i;
    const powers = this.powers, n = 4 * i;
    const b = powers[n + 1], c = powers[n + 2], d = powers[n + 3];
    this.value = powers[n] + t * (b + t * (c + t * d));
    this.slope = (b + t * (2 * c + t * 3 * d)) * this.perStep;
  }

  at(x) {
    this.look(x);
    return this.value;
  }
}

// Black-body photon radiance in the camera's filter, and its inverse.
class Planck {
  constructor(head, arrays) {
    this.table = new Table(arrays.planck, head.ends.planck); // ln B over ln T
    this.inverse = new Table(arrays.inverse, head.ends.inverse); // T over ln B
  }

  radiance(kelvin) {
    return kelvin > 0 ? Math.exp(this.table.at(Math.log(kelvin))) : 0;
  }

  temperature(radiance) {
    return radiance > 0 ? this.inverse.at(Math.log(radiance)) : radiance === 0 ? 0 : NaN;
  }

  // d T / d radiance.
  rise(radiance) {
    if (!(radiance > 0)) return Infinity;
    this.inverse.look(Math.log(radiance));
    return this.inverse.slope / radiance;
  }
}
