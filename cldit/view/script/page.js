// The page: what is shown, and what happens when something is moved.

const DATA = JSON.parse(document.getElementById("data").textContent);
const HEADS = DATA.items;
const $ = (id) => document.getElementById(id);

// The worker answers jobs in turn.
const worker = new Worker(URL.createObjectURL(
  new Blob([$("worker").textContent], { type: "text/javascript" })));
const waiting = new Map();
let jobs = 0;
worker.onmessage = ({ data }) => {
  const { done, failed } = waiting.get(data.job);
  waiting.delete(data.job);
  if (data.problem) failed(new Error(data.problem));
  else done({ ...data.answer, ms: data.ms });
};
function ask(what, given = {}) {
  return new Promise((done, failed) => {
    waiting.set(++jobs, { done, failed });
    worker.postMessage({ what, job: jobs, ...given });
  });
}

const state = { one: 0, other: null, quantity: "temperature", colours: "cividis", diverging: "RdBu_r", limits: {}, cursor: null, line: null };
const knows = []; // names of what each item can show
let figures = [], names = [], scenes = [];
const profile = new Profile($("profile"));
const sliders = new Sliders($("sliders"), () => redraw());

function shownItems() {
  return state.other === null ? [state.one] : [state.one, state.other];
}

function panelsOf() {
  const { one, other, quantity, colours, diverging } = state;
  const plain = { quantity, colours, limits: state.limits[quantity] ?? null };
  if (other === null) return [{ ...plain, items: [one] }];
  const apart = { quantity, colours: diverging, limits: state.limits[`${quantity} apart`] ?? null };
  return [{ ...plain, items: [one] }, { ...plain, items: [other] }, { ...apart, items: [one, other] }];
}

// Draws the newest state; while the worker is busy, only the last wish is kept.
let busy = null, again = false;
function redraw() {
  if (busy) {
    again = true;
    return busy;
  }
  busy = drawOnce().catch(problem).then(() => {
    busy = null;
    if (!again) return null;
    again = false;
    return redraw();
  });
  return busy;
}

async function drawOnce() {
  const start = performance.now();
  const panels = panelsOf();
  let found = await ask("draw", { panels, asked: sliders.asked });
  if (panels.length > 1 && !panels[0].limits) {
    // Both maps have one scale: that of the first, or of the other where the first has none.
    state.limits[state.quantity] = (found.drawn.find((one) => !one.nothing) ?? { limits: [0, 1] }).limits;
    found = await ask("draw", { panels: panelsOf(), asked: sliders.asked });
  }
  scenes = found.scenes;
  const { text, unit } = QUANTITIES[state.quantity];
  names = panels.map(({ items }) => items.map((index) => HEADS[index].name).join(" − "));
  makeFigures(panels.length);
  found.drawn.forEach((drawn, number) => {
    if (drawn.nothing) {
      figures[number].nothing(`${QUANTITIES[state.quantity].text}: not known of ${names[number]}`);
      return;
    }
    const apart = panels[number].items.length > 1;
    state.limits[apart ? `${state.quantity} apart` : state.quantity] ??= drawn.limits;
    const label = `${apart ? "difference" : QUANTITIES[state.quantity].short}${unit ? ` / ${unit}` : ""}`;
    figures[number].show(drawn, `${names[number]}: ${apart ? "difference" : text}`, label,
      barOf(panels[number].colours), notesOf(drawn.empty));
    figures[number].mark(state.cursor, state.line);
  });
  showSummary(found.drawn.at(-1), panels);
  showLimits();
  showCommand();
  await Promise.all([probe(), along()]);
  document.body.dataset.drawn = String(Number(document.body.dataset.drawn ?? 0) + 1);
  state.ms = { worker: found.ms, all: performance.now() - start };
}

// What clear and grey pixels of a map are.
function notesOf(empty) {
  return Object.entries(empty).map(([reason, count]) => {
    const how = Number(reason) === DATA.thin ? "clear" : "grey";
    return `${how}: ${DATA.reasons[reason]} (${count} pixels)`;
  });
}

function makeFigures(count) {
  while (figures.length > count) figures.pop().host.remove();
  while (figures.length < count) {
    const figure = new Figure($("maps"), `Map ${figures.length + 1}`);
    figures.push(figure);
    follow(figure);
  }
  $("maps").classList.toggle("several", count > 1);
}

const bars = {};
function barOf(name) {
  if (!bars[name]) {
    const canvas = document.createElement("canvas");
    canvas.width = 1;
    canvas.height = 256;
    const context = canvas.getContext("2d"), colours = DATA.colours[name];
    for (let c = 0; c < 256; c++) {
      context.fillStyle = `rgb(${colours.slice(3 * c, 3 * c + 3).join(",")})`;
      context.fillRect(0, 255 - c, 1, 1);
    }
    bars[name] = canvas.toDataURL();
  }
  return bars[name];
}

// Pointer and keys on a map: cursor, and the line of a profile.
function follow(figure) {
  let from = null;
  figure.host.addEventListener("pointerdown", (event) => {
    if (!figure.grid || event.button !== 0) return;
    const { inside, x, z } = figure.place(event);
    if (!inside) return;
    from = [x, z];
    figure.host.setPointerCapture(event.pointerId);
    event.preventDefault();
    figure.host.focus({ preventScroll: true });
  });
  figure.host.addEventListener("pointermove", (event) => {
    if (!figure.grid) return;
    const { inside, x, z } = figure.place(event);
    if (from) state.line = [from, [x, z]];
    state.cursor = inside || from ? [x, z] : null;
    moved();
  });
  figure.host.addEventListener("pointerup", () => {
    from = null;
  });
  figure.host.addEventListener("keydown", (event) => {
    if (!figure.grid) return;
    const step = event.shiftKey ? 10 : 1, [w, h] = figure.grid.pixel_mm;
    const ways = { ArrowLeft: [-w, 0], ArrowRight: [w, 0], ArrowUp: [0, h], ArrowDown: [0, -h] };
    if (event.key in ways) {
      const now = state.cursor ?? figure.grid.centre_mm, ahead = ways[event.key];
      const ends = [figure.x, figure.z];
      state.cursor = now.map((one, axis) => Math.min(Math.max(one + step * ahead[axis], ends[axis].low), ends[axis].high));
      if (state.line && state.lineOpen) state.line = [state.line[0], state.cursor];
    } else if (event.key === " ") {
      state.cursor ??= [...figure.grid.centre_mm];
      state.lineOpen = !state.lineOpen;
      if (state.lineOpen) state.line = [state.cursor, state.cursor];
    } else if (event.key === "Escape") {
      state.line = null;
      state.lineOpen = false;
      profile.clear();
    } else return;
    event.preventDefault();
    moved();
  });
}

function moved() {
  for (const figure of figures) figure.mark(state.cursor, state.line);
  probe().catch(problem);
  along().catch(problem);
}

let probing = false, probeAgain = false;
async function probe() {
  if (probing) {
    probeAgain = true;
    return;
  }
  probing = true;
  try {
    do {
      probeAgain = false;
      if (!state.cursor) continue;
      const [x_mm, z_mm] = state.cursor, shown = shownItems();
      const found = await ask("probe", { x_mm, z_mm, shown });
      showReadout(x_mm, z_mm, shown, found);
    } while (probeAgain);
  } finally {
    probing = false;
  }
}

let lining = false, lineAgain = false;
async function along() {
  if (lining) {
    lineAgain = true;
    return;
  }
  lining = true;
  try {
    do {
      lineAgain = false;
      if (!state.line || state.line[0].every((one, axis) => one === state.line[1][axis])) continue;
      const [from, to] = state.line;
      const { lines } = await ask("profile", { from, to });
      const { short, unit } = QUANTITIES[state.quantity];
      if (lines.length) profile.show(lines, names, state.other === null ? 1 : 2, `${short}${unit ? ` / ${unit}` : ""}`);
    } while (lineAgain);
  } finally {
    lining = false;
  }
}

function number(value, digits) {
  return Number.isFinite(value) ? value.toFixed(digits).replace("-", "−") : "–";
}

function withError(value, error, digits) {
  if (!Number.isFinite(value)) return "–";
  return Number.isFinite(error) ? `${number(value, digits)} ± ${error.toPrecision(2)}` : number(value, digits);
}

function showReadout(x, z, shown, { values, panels }) {
  $("where").textContent = `x ${number(x, 2)} mm, z ${number(z, 2)} mm`;
  const head = ["", "T_app / K", "emissivity", "optical depth", "by the simulation / K", "camera sees / K", ""];
  const rows = values.map((one, n) => {
    const name = HEADS[shown[n]].name;
    if (!one) return [name, "outside its picture", "", "", "", "", ""];
    return [
      name,
      withError(one.temperature, one.temperature_total_error ?? one.temperature_error, 2),
      withError(one.emissivity, one.emissivity_total_error ?? one.emissivity_error, 5),
      withError(one.depth, one.depth_error, 5),
      number(one.simulation_error, 2),
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

function showLimits() {
  const limits = state.limits[state.quantity] ?? [0, 1];
  $("low").value = limits[0];
  $("high").value = limits[1];
}

function showCommand() {
  const command = sliders.command(HEADS[state.one], scenes[state.one]);
  $("command-box").hidden = command === null;
  $("command").textContent = command ?? "";
  const head = HEADS[state.one];
  $("frame-name").textContent = head.name;
  $("stated").textContent = head.stated_error
    ? `Error of T_app by the simulation, for the run's own temperatures: ${head.stated_error}.` : "";
}

function showControls() {
  const heads = shownItems().map((index) => HEADS[index]);
  sliders.show(heads);
  const known = knows[state.one];
  for (const option of $("quantity").options) option.disabled = known ? !known.includes(option.value) : false;
  if (known && !known.includes(state.quantity)) state.quantity = $("quantity").value = "temperature";
  $("diverging-box").hidden = state.other === null;
  $("save-csv").textContent = `CSV of the ${state.other === null ? "map" : "difference"}`;
}

function problem(error) {
  $("problem").hidden = false;
  $("problem").textContent = `Something went wrong: ${error.message}`;
}

function optionsOf(select, pairs, chosen) {
  for (const [value, text] of pairs) select.add(new Option(text, value, false, value === chosen));
}

function wire() {
  optionsOf($("quantity"), Object.entries(QUANTITIES).map(([name, one]) => [name, one.text]), state.quantity);
  optionsOf($("colours"), DATA.sequential, state.colours);
  optionsOf($("diverging"), DATA.diverging, state.diverging);
  optionsOf($("other"), [["", "nothing"], ...HEADS.map((one, n) => [String(n), one.name])], "");
  $("frames").hidden = $("beside").hidden = HEADS.length < 2;
  $("frame").max = HEADS.length - 1;
  const on = (id, kind, act) => $(id).addEventListener(kind, act);
  for (const name of ["quantity", "colours", "diverging"]) {
    on(name, "change", () => {
      state[name] = $(name).value;
      showControls();
      redraw();
    });
  }
  on("frame", "input", () => {
    state.one = $("frame").valueAsNumber;
    $("frame").setAttribute("aria-valuetext", HEADS[state.one].name);
    loaded(state.one).then(() => {
      showControls();
      redraw();
    }).catch(problem);
  });
  on("other", "change", () => {
    state.other = $("other").value === "" ? null : Number($("other").value);
    loaded(state.other ?? state.one).then(() => {
      showControls();
      redraw();
    }).catch(problem);
  });
  for (const [n, id] of ["low", "high"].entries()) {
    on(id, "change", () => {
      const limits = [...(state.limits[state.quantity] ?? [0, 1])];
      limits[n] = $(id).valueAsNumber;
      if (limits[1] > limits[0]) state.limits[state.quantity] = limits;
      redraw();
    });
  }
  on("fit", "click", () => {
    delete state.limits[state.quantity];
    delete state.limits[`${state.quantity} apart`];
    redraw();
  });
  on("reset", "click", () => sliders.reset());
  const file = () => `${HEADS[state.one].name}-${state.quantity}`.replace(/[^\w.-]+/g, "-");
  on("save-svg", "click", () => saveFile(`${file()}.svg`, wholeSvg(figures, profile).text, "image/svg+xml"));
  on("save-png", "click", () => pngOf(wholeSvg(figures, profile))
    .then((data) => saveFile(`${file()}.png`, data, "image/png")).catch(problem));
  on("save-csv", "click", () => {
    const { unit } = QUANTITIES[state.quantity], suffix = unit ? `_${unit}` : "";
    const what = state.other === null ? state.quantity : `difference_of_${state.quantity}`;
    const heading = `x_mm,z_mm,${what}${suffix},standard_error${suffix}`;
    const last = figures.length - 1;
    ask("csv", { panel: last, heading }).then(({ text }) => saveFile(`${file()}.csv`, text, "text/csv")).catch(problem);
  });
  on("save-profile", "click", () => {
    if (profile.lines) saveFile(`${file()}-profile.csv`, profile.csv(), "text/csv");
  });
}

// The arrays of an item go to the worker once; the page keeps no copy.
const loading = [];
function loaded(index) {
  loading[index] ??= (async () => {
    const arrays = {};
    for (const element of document.querySelectorAll(`script[data-item="${index}"]`)) {
      const { name } = element.dataset;
      arrays[name] = { head: HEADS[index].arrays[name], text: element.textContent };
      element.remove();
    }
    knows[index] = (await ask("load", { index, head: HEADS[index], arrays })).has;
  })();
  return loading[index];
}

async function begin() {
  wire();
  await ask("colours", { tables: DATA.colours });
  await loaded(0);
  showControls();
  await redraw();
  document.body.dataset.ready = "yes";
  for (const index of HEADS.keys()) await loaded(index);
  document.body.dataset.all = "yes";
}

begin().catch(problem);

// For scripts that drive the page: set, draw, read.
window.cldit = {
  state,
  set(name, value) {
    sliders.set(name, value);
    return this.drawn();
  },
  async drawn() {
    while (busy) await busy;
  },
  scene: (index) => scenes[index],
  async numbers(given) {
    const found = await ask("numbers", given);
    const text = (values) => {
      const bytes = new Uint8Array(values.buffer);
      let letters = "";
      for (let i = 0; i < bytes.length; i += 32768) letters += String.fromCharCode(...bytes.subarray(i, i + 32768));
      return btoa(letters);
    };
    return { ...found, values: text(found.values), error: found.error && text(found.error) };
  },
};
