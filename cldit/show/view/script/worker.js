// Computes everything with a number for each pixel, beside the page, which never waits.

const items = [];
const images = new Map(); // that the panels show now, by panel
let colourTables = {};

const answers = {
  async load({ index, head, arrays }) {
    const names = Object.keys(arrays);
    const read = await Promise.all(names.map((name) => unpacked(arrays[name].head, arrays[name].text)));
    const found = Object.fromEntries(names.map((name, n) => [name, read[n]]));
    items[index] = head.kind === "run" ? new TracedRun(head, found) : new Measurement(head, found);
    const has = Object.keys(QUANTITIES).filter((name) => name === "depth" || items[index].has(name));
    return { has };
  },

  colours({ tables }) {
    colourTables = tables;
  },

  // Panels: {items: [one] or [one, other], quantity, limits or null}. Each is computed and painted.
  draw({ panels, asked }) {
    images.clear();
    const transfer = [];
    const drawn = panels.map((panel, number) => {
      const shown = panel.items.map((index) => items[index]);
      for (const item of shown) item.compute(asked);
      const made = shown.length === 1 ? single(shown[0], panel.quantity)
        : compared(shown[0], shown[1], panel.quantity);
      if (made === null) return { nothing: true };
      images.set(number, made);
      const diverging = shown.length === 2;
      const limits = panel.limits ?? limitsOf(made.value, diverging);
      let share = null;
      if (panel.colours === "hue" && panel.quantity === "temperature") {
        const emissivity = shown[0].image("emissivity"), full = fullEmissivity(emissivity);
        share = emissivity.map((one) => one / full);
      }
      const { pixels, ...counts } = painted(made.value, made.reason, limits, colourTables[panel.colours], share);
      transfer.push(pixels);
      const { columns, rows, pixel_mm, centre_mm } = made.grid;
      const summary = diverging ? { ...summaryOf(made), states: made.states } : null;
      return { grid: { columns, rows, pixel_mm, centre_mm }, limits, pixels, summary, ...counts };
    });
    const scenes = items.map((item) => (item && item.scene) ?? null);
    return { drawn, scenes, transfer };
  },

  // All values at (x, z) in the items that are shown, and in the panels.
  probe({ x_mm, z_mm, shown }) {
    const values = shown.map((index) => {
      const item = items[index], p = pixelAt(item.head, x_mm, z_mm);
      if (p === null) return null;
      const found = { reason: item.pixel("reason", p), depth: valueAt(item, "depth", p) };
      for (const name of Object.keys(QUANTITIES)) {
        if (name !== "depth" && item.has(name)) found[name] = item.pixel(name, p);
      }
      for (const name of ["temperature_total_error", "emissivity_total_error", "signal_error"]) {
        if (item.has(name)) found[name] = item.pixel(name, p);
      }
      found.depth_error = errorAt(item, "depth", p);
      return found;
    });
    const panels = [...images.values()].map((image) => {
      const p = pixelAt(image.grid, x_mm, z_mm);
      return p === null ? null : { value: image.value[p], error: image.errorAt(p) };
    });
    return { values, panels };
  },

  // Values and errors of every panel along a line, at half of a pixel's steps.
  profile({ from, to }) {
    const length = Math.hypot(to[0] - from[0], to[1] - from[1]);
    const lines = [...images.values()].map((image) => {
      const step = Math.min(...image.grid.pixel_mm) / 2;
      const count = Math.max(2, Math.min(4000, Math.ceil(length / step) + 1));
      const rows = { distance_mm: [], x_mm: [], z_mm: [], value: [], error: [] };
      for (let n = 0; n < count; n++) {
        const t = n / (count - 1);
        const [x, z] = [0, 1].map((axis) => from[axis] + t * (to[axis] - from[axis]));
        const p = pixelAt(image.grid, x, z);
        rows.distance_mm.push(t * length);
        rows.x_mm.push(x);
        rows.z_mm.push(z);
        rows.value.push(p === null ? NaN : image.value[p]);
        rows.error.push(p === null ? NaN : image.errorAt(p));
      }
      return rows;
    });
    return { lines };
  },

  // The numbers of one panel, or of one item: (H, W) float32.
  numbers({ panel, item, name }) {
    const values = panel === undefined ? imageOf(items[item], name) : images.get(panel).value;
    const grid = panel === undefined ? items[item].head : images.get(panel).grid;
    const error = panel === undefined ? null : images.get(panel).errors();
    return { values: values.slice(), error: error && error.slice(), columns: grid.columns, rows: grid.rows };
  },

  // CSV of one panel: a line for each pixel with a value.
  csv({ panel, heading }) {
    const { grid, value, errorAt: errorOfPixel } = images.get(panel);
    const lines = [heading];
    for (let p = 0; p < value.length; p++) {
      if (Number.isNaN(value[p])) continue;
      const [x, z] = placeOf(grid, p).map((one) => Number(one.toFixed(5)));
      const error = errorOfPixel(p);
      lines.push(`${x},${z},${value[p].toPrecision(8)},${Number.isNaN(error) ? "" : error.toPrecision(4)}`);
    }
    return { text: `${lines.join("\n")}\n` };
  },
};

// Image of one item, with the errors of the sensor.
function single(item, name) {
  const value = imageOf(item, name);
  if (value === null) return null;
  const plain = name.endsWith("error") || name === "signal";
  return {
    grid: item.head,
    value,
    errorAt: (p) => errorAt(item, name, p),
    errors: () => errorOf(item, name),
    reason: plain ? null : (p) => item.pixel("reason", p),
  };
}

// Difference of two items.
function compared(one, other, name) {
  const found = differenceOf(one, other, name);
  if (found === null) return null;
  const { error } = found;
  return { ...found, errorAt: (p) => (error ? error[p] : NaN), errors: () => error };
}

function pixelAt(grid, x_mm, z_mm) {
  const i = Math.floor((x_mm - grid.centre_mm[0]) / grid.pixel_mm[0] + grid.columns / 2);
  const j = Math.floor((grid.centre_mm[1] - z_mm) / grid.pixel_mm[1] + grid.rows / 2);
  const inside = i >= 0 && j >= 0 && i < grid.columns && j < grid.rows;
  return inside ? j * grid.columns + i : null;
}

function placeOf(grid, p) {
  const i = p % grid.columns, j = Math.floor(p / grid.columns);
  return [
    grid.centre_mm[0] + (i + 0.5 - grid.columns / 2) * grid.pixel_mm[0],
    grid.centre_mm[1] - (j + 0.5 - grid.rows / 2) * grid.pixel_mm[1],
  ];
}

onmessage = async ({ data }) => {
  const start = performance.now();
  try {
    const { transfer = [], ...answer } = (await answers[data.what](data)) ?? {};
    postMessage({ job: data.job, answer, ms: performance.now() - start }, transfer);
  } catch (error) {
    postMessage({ job: data.job, problem: `${error.message}\n${error.stack}` });
  }
};
