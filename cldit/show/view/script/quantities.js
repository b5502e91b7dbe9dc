// What can be shown of an item, and how far it is known.

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
  signal: { text: "What the camera sees, as temperature", short: "signal", unit: "K", digits: 2 },
};

// What pixel p shows of a quantity, and (H, W) of it; NaN and null where the item does not know it.
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

// Standard error of one pixel that the sensor, or the measurement, gives a quantity; NaN: none.
function errorAt(item, name, p) {
  if (name === "signal") return item.has("signal_error") ? item.pixel("signal_error", p) : NaN;
  if (name === "temperature" || name === "emissivity") {
    const total = `${name}_total_error`;
    return item.pixel(item.has(total) ? total : `${name}_error`, p);
  }
  return name === "depth" ? errorAt(item, "emissivity", p) / (1 - item.pixel("emissivity", p)) : NaN;
}

// (H, W) of these; null where none is known.
function errorOf(item, name) {
  if (!["signal", "temperature", "emissivity", "depth"].includes(name)) return null;
  if (name === "signal" && !item.has("signal_error")) return null;
  const error = new Float32Array(item.head.rows * item.head.columns);
  for (let p = 0; p < error.length; p++) error[p] = errorAt(item, name, p);
  return error;
}

// (H, W) error that an item states of its own values: a trace has no noise, so the simulation's; a
// measurement the noise and what is only stated of the set-up. null: nothing is stated.
function statedOf(item, name) {
  if (!item.changeable) return errorOf(item, name);
  return name === "temperature" && item.has("simulation_error") ? item.image("simulation_error") : null;
}
