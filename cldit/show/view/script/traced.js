// A run: maps from its weights, for any temperatures, as cldit.run.reevaluated computes them.
//
// Pixels that the spray changes are "covered" and have numbers of their own. All others show one of
// the few different pixels without spray, the palette.

class TracedRun {
  constructor(head, arrays) {
    this.head = head;
    this.arrays = arrays;
    this.planck = new Planck(head, arrays);
    const size = head.rows * head.columns;
    this.place = new Int32Array(size); // index of a covered pixel, or -1 - palette index
    const kinds = [];
    for (let p = 0; p < size; p++) {
      const kind = arrays.palette_index[p];
      if (arrays.covered[p]) this.place[p] = kinds.push(kind) - 1;
      else this.place[p] = -1 - kind;
    }
    this.kind = Int32Array.from(kinds); // palette index of each covered pixel
    this.sources = ["background", "wall", ...head.scene.patches.map((one) => one.name)];
    this.width = this.sources.length + 1; // of a row of the palette; the last is emission
    this.colours = arrays.palette.length / this.width;
    const n = this.kind.length + this.colours; // covered pixels first, then the palette
    this.maps = { reason: new Uint8Array(n) };
    for (const name of ["temperature", "temperature_error", "emissivity", "emissivity_error"]) {
      this.maps[name] = new Float32Array(n);
    }
    this.one = Object.fromEntries(Object.keys(this.maps).map((name) => [name, [0]]));
    this.known = "";
  }

  get changeable() {
    return true;
  }

  // The scene with the values of the sliders; locked temperatures stay.
  settings(asked) {
    const scene = this.head.scene, locked = this.head.locked;
    const own = scene.backgrounds_K;
    const low = Math.min(...own), high = Math.max(...own);
    const free = (name, key) => (name in locked || asked[key] === undefined ? null : asked[key]);
    const lowest = free("background", "lowest_K") ?? low;
    const highest = free("background", "highest_K") ?? high;
    const stretch = high > low ? (highest - lowest) / (high - low) : 1;
    const moved = lowest !== low || highest !== high;
    const backgrounds = moved ? own.map((one) => lowest + (one - low) * stretch) : own;
    let signal = asked.signal_K ?? middleOf(backgrounds);
    if ("background" in locked) {
      signal = own.reduce((best, one) => (Math.abs(one - signal) < Math.abs(best - signal) ? one : best));
    }
    return {
      ...scene,
      backgrounds_K: backgrounds,
      wall_K: free("wall", "wall_K") ?? scene.wall_K,
      emissivity: asked.emissivity ?? scene.emissivity,
      read_noise_electrons: asked.read_noise_electrons ?? scene.read_noise_electrons,
      shots: asked.shots ?? scene.shots,
      signal_K: signal,
    };
  }

  // Mean shares of the windows in all of the filter, for light of this temperature.
  panes(reference_K) {
    const panes = {}, [first, last] = this.head.panes.ends;
    for (const side of Object.keys(this.head.scene.windows_K)) {
      const table = this.arrays[`pane_${side}`], count = table.length / 2;
      const place = (Math.log(reference_K) - first) / (last - first) * (count - 1);
      const i = Math.max(0, Math.min(Math.floor(place), count - 2)), t = place - i;
      panes[side] = [0, count].map((begin) => (1 - t) * table[begin + i] + t * table[begin + i + 1]);
    }
    return panes;
  }

  // Equation of each node; the share of a node is a cubic in ln T, constant beyond its ends.
  bands(scene) {
    const count = this.head.nodes, ends = this.head.share_ends;
    return Array.from({ length: count }, (_, node) => {
      let radiance = (kelvin) => this.planck.radiance(kelvin);
      if (count > 1) {
        const shares = this.arrays.shares, knots = shares.length / (2 * count);
        const table = new Table(shares, ends, node * knots, knots, (count + node) * knots);
        radiance = (kelvin) => {
          const at = Math.min(Math.max(Math.log(Math.max(kelvin, 1e-9)), ends[0]), ends[1]);
          return this.planck.radiance(kelvin) * table.at(at);
        };
      }
      return boundaryOf(scene, radiance, this.head.panes.nodes[node]);
    });
  }

  // Light of every source inside the chamber in each of the `bands`, in front of one background.
  // `passes`: transmission of the front window in the band, over the filter's.
  lights(bands, passes, leaving) {
    const total = {}, nodes = {};
    bands.forEach((band, n) => {
      const light = { background: leaving(band), wall: band.wall, ...band.patches };
      for (const name of this.sources) {
        (nodes[name] ??= []).push(passes[n] * light[name]);
        total[name] = (total[name] ?? 0) + passes[n] * light[name];
      }
    });
    const parts = this.head.components.map((one) => {
      const sum = one.mix.reduce((all, share, n) => all + share * nodes[one.source][n], 0);
      return { source: one.source, sum, image: this.arrays[one.array] };
    });
    return { total, parts };
  }

  // Radiance inside without the background: covered pixels, then the palette.
  fixed(light, added) {
    const n = this.kind.length, out = new Float64Array(n + this.colours);
    const palette = this.arrays.palette, w = this.width;
    for (let c = 0; c < this.colours; c++) {
      let sum = palette[c * w + w - 1] + added;
      for (let j = 1; j < this.sources.length; j++) sum += palette[c * w + j] * light.total[this.sources[j]];
      out[n + c] = sum;
    }
    const emitted = this.arrays.emitted, kind = this.kind;
    for (let i = 0; i < n; i++) out[i] = out[n + kind[i]] + emitted[i];
    for (const part of light.parts) {
      if (part.source === "background") continue;
      const image = part.image, sum = part.sum;
      for (let i = 0; i < n; i++) out[i] += sum * image[i];
    }
    return out;
  }

  // Radiance of the background of `light` in these pixels.
  shown(light) {
    const n = this.kind.length, out = new Float64Array(n + this.colours);
    const palette = this.arrays.palette, kind = this.kind;
    for (let c = 0; c < this.colours; c++) out[n + c] = palette[c * this.width] * light.total.background;
    for (let i = 0; i < n; i++) out[i] = out[n + kind[i]];
    for (const part of light.parts) {
      if (part.source !== "background") continue;
      const image = part.image, sum = part.sum;
      for (let i = 0; i < n; i++) out[i] += sum * image[i];
    }
    return out;
  }

  compute(asked) {
    const key = JSON.stringify(asked);
    if (key === this.known) return;
    this.all = null; // that adds the errors to the maps
    const scene = this.settings(asked), head = this.head;
    const reference_K = "background" in head.locked
      ? head.panes.reference_K : middleOf(scene.backgrounds_K);
    const whole = boundaryOf(scene, (kelvin) => this.planck.radiance(kelvin), this.panes(reference_K));
    const nodes = this.bands(scene), single = nodes.length === 1;
    const bands = single ? [whole] : nodes;
    const passes = bands.map((one) => one.front.transmission / whole.front.transmission);
    const added = single ? 0
      : (bands.reduce((all, one) => all + one.front.added, 0) - whole.front.added)
        / whole.front.transmission;
    const at = (kelvin) => this.lights(bands, passes, (band) => band.leaving(kelvin));
    const rest = this.fixed(at(scene.backgrounds_K[0]), added);
    const sensor = this.exposed(scene, nodes, whole, rest);
    const noise = noiseOf(sensor, scene, whole.front);
    if (new Set(scene.backgrounds_K).size < 2) this.unevaluated();
    else {
      const x = scene.backgrounds_K.map(whole.leaving);
      const before = new Line(x, noise, scene.references), after = new Line(x, noise, scene.shots);
      if (single) this.solveExact(before, after, rest, false);
      else this.solveFitted(before, after, rest, scene.backgrounds_K.map((one) => this.shown(at(one))));
    }
    this.signal = this.signalOf(rest, at(scene.signal_K), whole, noise);
    this.scene = { ...scene, integration_time_s: sensor.integration_time_s };
    this.known = key;
  }

  // One band: every pixel's signals lie on a line by themselves, and its slope is its weight.
  // With errors only if asked: they cost more than the maps, and few of them are read.
  solveExact(before, after, rest, errors) {
    const n = this.kind.length, palette = this.arrays.palette, w = this.width;
    const own = this.head.components.filter((one) => one.source === "background");
    const change = this.arrays[own[0].array], mix = own[0].mix[0];
    const known = this.references((c) => before.exact(palette[c * w], rest[n + c]), before);
    for (let c = 0; c < this.colours; c++) {
      after.exact(known[c].slope, known[c].start);
      solvePixel(this.maps, n + c, known[c], after, this.planck);
    }
    const whole = (maps, at, i) => {
      const bare = known[this.kind[i]];
      after.exact(bare.slope + mix * change[i], rest[i]);
      solvePixel(maps, at, bare, after, this.planck);
    };
    const { maps, kind, planck } = this;
    for (let i = 0; i < n; i++) {
      const bare = known[kind[i]], slope = bare.slope + mix * change[i];
      if (errors || !solveClear(maps, i, bare, slope, rest[i], after, planck)) whole(maps, i, i);
    }
    this.all = errors ? null : () => this.solveExact(before, after, rest, true);
    this.solveOne = (i) => whole(this.one, 0, i);
  }

  // Several bands: the signals are nearly straight in the radiance of the whole filter.
  solveFitted(before, after, rest, shown) {
    const n = this.kind.length, means = new Float64Array(shown.length);
    const mean = (i) => {
      for (let k = 0; k < means.length; k++) means[k] = shown[k][i] + rest[i];
      return means;
    };
    const known = this.references((c) => before.fitted(mean(n + c)), before);
    for (let i = 0; i < n + this.colours; i++) {
      after.fitted(mean(i));
      solvePixel(this.maps, i, known[i < n ? this.kind[i] : i - n], after, this.planck);
    }
  }

  references(fit, line) {
    return Array.from({ length: this.colours }, (_, c) => {
      fit(c);
      const { slope, start, slopes, both, starts } = line;
      return { slope, start, slopes, both, starts };
    });
  }

  unevaluated() {
    for (const [name, map] of Object.entries(this.maps)) map.fill(name === "reason" ? REASON.few : NaN);
  }

  // The sensor, with a time so short that the hottest background does not saturate it.
  exposed(scene, nodes, whole, rest) {
    const sensor = this.head.sensor;
    if (sensor.fixed_time) return sensor;
    const hottest = Math.max(...scene.backgrounds_K), single = nodes.length === 1;
    // A single node has its own pane here, at its middle wavelength.
    const band = single ? nodes[0] : whole;
    const passes = single ? [1]
      : nodes.map((one) => one.front.transmission / whole.front.transmission);
    const shown = this.shown(this.lights(nodes, passes, (one) => one.leaving(hottest)));
    let most = -Infinity;
    for (let i = 0; i < shown.length; i++) {
      const inside = shown[i] + rest[i];
      if (inside > most) most = inside;
    }
    const brightest = band.seen(most);
    const range = sensor.saturation_counts - sensor.offset_counts;
    const counts = brightest * sensor.electrons_per_radiance_s * sensor.integration_time_s
      / sensor.electrons_per_count;
    if (counts <= 0.8 * range) return sensor;
    const time = sensor.integration_time_s * 0.8 * range / counts;
    return { ...sensor, integration_time_s: Number(time.toPrecision(3)) };
  }

  // Camera signal in front of one background, as the temperature of a black body, and its error in
  // one exposure: functions of a pixel, since a slider seldom needs them.
  signalOf(rest, light, whole, noise) {
    let shown = null;
    const seen = (i) => {
      shown ??= this.shown(light);
      return whole.seen(rest[i] + shown[i]);
    };
    const signal = (i) => this.planck.temperature(seen(i));
    const signal_error = (i) => {
      const variance = (seen(i) > 0 ? noise.photons * seen(i) : 0) + noise.constant;
      return Math.sqrt(variance) * whole.front.transmission * this.planck.rise(seen(i));
    };
    return { signal, signal_error };
  }

  // One quantity of pixel p.
  pixel(name, p) {
    const at = this.place[p], own = at < 0 ? this.kind.length - 1 - at : at;
    if (this.all && at >= 0 && name.endsWith("error") && name in this.maps) {
      this.solveOne(own);
      return this.one[name][0];
    }
    if (name in this.maps) return this.maps[name][own];
    if (name in this.signal) return this.signal[name](own);
    if (at < 0 || Number.isNaN(this.maps.temperature[at])) return NaN;
    return this.arrays[name] ? this.arrays[name][at] : this.head[STATED[name]];
  }

  // (H, W) of one quantity.
  image(name) {
    const n = this.kind.length, place = this.place, out = new Float32Array(place.length);
    const map = this.maps[name];
    if (this.all && map && name.endsWith("error")) this.all();
    for (let p = 0; p < out.length; p++) {
      const at = place[p];
      out[p] = map ? map[at < 0 ? n - 1 - at : at] : this.pixel(name, p);
    }
    return out;
  }

  has(name) {
    if (name in STATED) return name in this.arrays || this.head[STATED[name]] !== null;
    return name in this.maps || name.startsWith("signal");
  }
}

// Error by the simulation in all pixels of an item without a map of it.
const STATED = {
  simulation_error: "stated_error_K", emissivity_simulation_error: "stated_error_emissivity",
};

// Variance of one exposure in the radiance inside: shot noise, read noise, rounding.
function noiseOf(sensor, scene, front) {
  const gain = sensor.electrons_per_count;
  const counts = sensor.electrons_per_radiance_s * sensor.integration_time_s / gain;
  const scale = counts * front.transmission;
  return {
    transmission: front.transmission,
    added: front.added,
    photons: counts / gain / (scale * scale),
    constant: ((scene.read_noise_electrons / gain) ** 2 + 1 / 12) / (scale * scale),
  };
}
