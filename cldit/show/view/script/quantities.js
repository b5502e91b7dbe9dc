// Quantities of an item, and their errors.

const QUANTITIES = {
  temperature: { text: "Apparent temperature", short: "T_app", unit: "K", digits: 2 },
  emissivity: { text: "Emissivity", short: "emissivity", unit: "", digits: 5 },
  depth: { text: "Optical depth, −ln(1 − emissivity)", short: "optical depth", unit: "", digits: 5 },
  temperature_error: {
    text: "Standard error of T_app by the sensor", short: "error of T_app", unit: "K", digits: 3,
  },
  emissivity_error: {
    text: "Standard error of emissivity by the sensor", short: "error of emissivity", unit: "",
    digits: 6,
  },
  simulation_error: {
    text: "Error of T_app by the simulation", short: "error by the simulation", unit: "K", digits: 3,
  },
  emissivity_simulation_error: {
    text: "Error of emissivity by the simulation", short: "error of emissivity", unit: "", digits: 4,
  },
  signal: { text: "Camera signal, as temperature", short: "signal", unit: "K", digits: 2 },
};

// A quantity in pixel p, and as (H, W); NaN and null if the item does not have it.
function valueAt(item, name, p) {
  if (name === "depth") return depthOf(item.pixel("emissivity", p));
  return item.has(name) ? item.pixel(name, p) : NaN;
}

function imageOf(item, name) {
  if (name === "depth") return item.image("emissivity").map(depthOf);
  return item.has(name) ? item.image(name) : null;
}

function depthOf(emissivity) {
  return emissivity < 1 ? -Math.log1p(-emissivity) : NaN;
}

// Standard error of a quantity in one pixel by the sensor or the measurement; NaN: none.
function errorAt(item, name, p) {
  if (name === "signal") return item.has("signal_error") ? item.pixel("signal_error", p) : NaN;
  if (name === "temperature" || name === "emissivity") {
    const total = `${name}_total_error`;
    return item.pixel(item.has(total) ? total : `${name}_error`, p);
  }
  return name === "depth" ? errorAt(item, "emissivity", p) / (1 - item.pixel("emissivity", p)) : NaN;
}

// The same as (H, W); null if none is known.
function errorOf(item, name) {
  if (!["signal", "temperature", "emissivity", "depth"].includes(name)) return null;
  if (name === "signal" && !item.has("signal_error")) return null;
  const error = new Float32Array(item.head.rows * item.head.columns);
  for (let p = 0; p < error.length; p++) error[p] = errorAt(item, name, p);
  return error;
}

// (H, W) error that an item states of its own values: for a trace, which has no noise, that of the
// simulation; for a measurement, noise and the stated uncertainties of the set-up. null: none.
function statedOf(item, name) {
  if (!item.changeable) return errorOf(item, name);
  const stated = { temperature: "simulation_error", emissivity: "emissivity_simulation_error" }[name];
  return stated && item.has(stated) ? item.image(stated) : null;
}

// The median, as numpy computes it.
function middleOf(numbers) {
  const sorted = [...numbers].sort((one, other) => one - other), half = sorted.length >> 1;
  return sorted.length % 2 ? sorted[half] : (sorted[half - 1] + sorted[half]) / 2;
}
