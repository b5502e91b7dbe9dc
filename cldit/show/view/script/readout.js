// Numbers as text: at the cursor, of a difference, and of pixels without a value.

function number(value, digits) {
  return Number.isFinite(value) ? value.toFixed(digits).replace("-", "−") : "–";
}

function withError(value, error, digits) {
  if (!Number.isFinite(value)) return "–";
  return Number.isFinite(error) ? `${number(value, digits)} ± ${error.toPrecision(2)}` : number(value, digits);
}

function showReadout(x, z, shown, { values, panels }) {
  $("where").textContent = `x ${number(x, 2)} mm, z ${number(z, 2)} mm`;
  const head = ["", "T_app / K", "emissivity", "optical depth", "by the simulation / K, 1", "camera signal / K", ""];
  const rows = values.map((one, n) => {
    const name = HEADS[shown[n]].name;
    if (!one) return [name, "outside its image", "", "", "", "", ""];
    return [
      name,
      withError(one.temperature, one.temperature_total_error ?? one.temperature_error, 2),
      withError(one.emissivity, one.emissivity_total_error ?? one.emissivity_error, 5),
      withError(one.depth, one.depth_error, 5),
      `${number(one.simulation_error, 2)}, ${number(one.emissivity_simulation_error, 4)}`,
      withError(one.signal, one.signal_error, 2),
      one.reason ? DATA.reasons[one.reason] : "",
    ];
  });
  if (values.length > 1 && panels[2]) {
    const { short, unit, digits } = QUANTITIES[state.quantity];
    rows.push([`difference of ${short}${unit ? ` / ${unit}` : ""}`, withError(panels[2].value, panels[2].error, digits)]);
  }
  const table = $("readout");
  table.replaceChildren();
  for (const [n, row] of [head, ...rows].entries()) {
    const line = table.insertRow();
    for (const text of row) line.appendChild(document.createElement(n ? "td" : "th")).textContent = text;
  }
}

function showSummary(drawn, panels) {
  const place = $("summary");
  place.textContent = "";
  if (panels.length < 3 || !drawn.summary) return;
  const { count, mean, rms, stated, within, states } = drawn.summary;
  const { unit, short } = QUANTITIES[state.quantity];
  if (!count) {
    place.textContent = `No pixel has ${short} in both.`;
    return;
  }
  const of = (value) => `${value.toPrecision(3).replace("-", "−")}${unit ? ` ${unit}` : ""}`;
  let text = `${names[2]}, ${short}: mean ${of(mean)}, RMS ${of(rms)} over ${count} pixels`;
  if (stated !== undefined) {
    text += `; stated errors together ${of(stated)} RMS, ${Math.round(100 * within)} % of the pixels within twice theirs`;
  }
  const silent = shownItems().filter((_, n) => !states[n]).map((index) => HEADS[index].name);
  if (silent.length) text += `; no error of it is stated by ${silent.join(" and ")}`;
  place.textContent = `${text}.`;
}

// Pixels of a map beyond its scale, and the meaning of clear and grey ones.
function notesOf({ empty, below, above, limits }) {
  const ends = [[below, "below", limits[0]], [above, "above", limits[1]]].filter(([count]) => count);
  const beyond = ends.map(([count, where, end]) => `${count} ${where} ${tickText(end)}`).join(", ");
  const why = Object.entries(empty).map(([reason, count]) => {
    const how = Number(reason) === DATA.thin ? "clear" : "grey";
    return `${how}: ${DATA.reasons[reason]} (${count} pixels)`;
  });
  return beyond ? [`pixels beyond the scale: ${beyond}`, ...why] : why;
}
