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

// (H, W) of a quantity; null where the item does not know it.
function imageOf(item, name) {
  if (name !== "depth") return item.has(name) ? item.image(name) : null;
  const depth = item.image("emissivity").slice();
  for (let p = 0; p < depth.length; p++) depth[p] = depth[p] < 1 ? -Math.log1p(-depth[p]) : NaN;
  return depth;
}

// (H, W) standard error that the sensor, or the measurement, gives a quantity; null: none known.
function errorOf(item, name) {
  if (name === "signal") return item.has("signal_error") ? item.image("signal_error") : null;
  if (name === "temperature" || name === "emissivity") {
    const total = `${name}_total_error`;
    return item.image(item.has(total) ? total : `${name}_error`);
  }
  if (name !== "depth") return null;
  const error = item.image("emissivity").slice(), of = errorOf(item, "emissivity");
  for (let p = 0; p < error.length; p++) error[p] = error[p] < 1 ? of[p] / (1 - error[p]) : NaN;
  return error;
}

// (H, W) error that an item states of its own values: a trace has no noise, so the simulation's; a
// measurement the noise and what is only stated of the set-up. null: nothing is stated.
function statedOf(item, name) {
  if (!item.changeable) return errorOf(item, name);
  return name === "temperature" && item.has("simulation_error") ? item.image("simulation_error") : null;
}
