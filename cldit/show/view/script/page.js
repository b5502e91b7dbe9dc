// The page: its state, and reactions to the controls.

// one, other: items by their number. limits: of the scales, by quantity. cursor [x, z] and line
// [from, to] in mm; lineOpen: the keys move its end. view: left, right, bottom, top in mm; null: all.
// moving: dragging moves the view, and draws no line.
const PLAIN = {
  one: 0, other: null, quantity: "temperature", colours: "cividis", diverging: "RdBu_r", line: null, view: HEADS[0].window_mm ?? null,
};
const state = { ...PLAIN, limits: {}, cursor: null, lineOpen: false, moving: false };
const knows = []; // quantities that each item can show
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

// Draws the newest state.
const redraw = latest(async () => {
  const start = performance.now();
  // The state may change while the worker works: all below belongs to this moment.
  const panels = panelsOf(), { quantity } = state;
  let found = await ask("draw", { panels, asked: sliders.asked });
  if (panels.length > 1 && !panels[0].limits) {
    // Both maps have one scale: that of the first, or of the other if the first has none.
    state.limits[quantity] = (found.drawn.find((one) => !one.nothing) ?? { limits: [0, 1] }).limits;
    const { limits } = state;
    panels.forEach((panel) => {
      if (panel.items.length === 1) panel.limits = limits[quantity];
    });
    found = await ask("draw", { panels, asked: sliders.asked });
  }
  scenes = found.scenes;
  const { text, unit } = QUANTITIES[quantity];
  names = panels.map(({ items }) => items.map((index) => HEADS[index].name + (changesOf(index).length ? " (changed)" : ""))
    .join(" − "));
  makeFigures(panels.length);
  found.drawn.forEach((drawn, number) => {
    if (drawn.nothing) {
      figures[number].nothing(`${QUANTITIES[quantity].text}: unknown for ${names[number]}`);
      return;
    }
    const apart = panels[number].items.length > 1;
    state.limits[apart ? `${quantity} apart` : quantity] ??= drawn.limits;
    const label = `${apart ? "difference" : QUANTITIES[quantity].short}${unit ? ` / ${unit}` : ""}`;
    figures[number].show(drawn, `${names[number]}: ${apart ? "difference" : text}`, label,
      barOf(panels[number].colours), [...changedLines(panels[number].items), ...notesOf(drawn)], state.view);
    figures[number].mark(state.cursor, state.line);
  });
  showSummary(found.drawn.at(-1), panels);
  showLimits();
  showCommand();
  keepLink();
  await Promise.all([probe(), along()]);
  document.body.dataset.drawn = String(Number(document.body.dataset.drawn ?? 0) + 1);
  state.ms = { worker: found.ms, all: performance.now() - start };
});

// The address keeps the settings, once they rest: browsers limit how often it may change.
let linking = null;
function keepLink() {
  clearTimeout(linking);
  linking = setTimeout(() => {
    const shown = shownItems().map((index) => HEADS[index]).filter(({ kind }) => kind === "run");
    const asked = Object.entries(sliders.asked).filter(([name]) => shown.some((head) => sliders.differs(name, head)));
    const link = linkOf(state, asked, PLAIN);
    history.replaceState(null, "", link ? `#${link}` : location.href.split("#")[0]);
  }, 300);
}

// Applies the settings of the address.
async function followLink() {
  const choices = Object.fromEntries(["quantity", "colours", "diverging"].map((name) => (
    [name, [...$(name).options].map((option) => option.value)])));
  const { state: linked, asked, refused } = settingsOf(location.hash, choices, HEADS.length, Object.keys(SLIDERS));
  Object.assign(state, PLAIN, linked);
  for (const name of ["quantity", "colours", "diverging"]) $(name).value = state[name];
  $("frame").value = state.one;
  $("other").value = state.other ?? "";
  for (const index of shownItems()) await loaded(index);
  showControls();
  sliders.restore(asked);
  if (refused.length) problem(new Error(`the link sets ${refused.join(", ")} to what this page does not have`));
  await redraw();
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
    const ends = [colours.slice(0, 3), colours.slice(-3)].map((one) => `rgb(${one.join(",")})`);
    bars[name] = { url: canvas.toDataURL(), ends };
  }
  return bars[name];
}

function changesOf(index) {
  return scenes[index] ? sliders.changes(HEADS[index]) : [];
}

// Lines of what is changed in items, for figures and files; none if nothing is.
function changedLines(items) {
  const lines = [];
  for (const index of items) {
    const texts = changesOf(index), of = items.length > 1 ? `${HEADS[index].name}, ` : "";
    texts.forEach((text, n) => {
      if (n % 2 === 0) lines.push(n ? `  ${text}` : `${of}changed: ${text}`);
      else lines.push(`${lines.pop()}, ${text}`);
    });
  }
  return lines;
}

// Shows another part of the maps; they are not computed again.
function look(view) {
  state.view = view;
  for (const figure of figures) {
    figure.again(view);
    figure.mark(state.cursor, state.line);
  }
  keepLink();
}

// Zooms about a point in mm, or the middle; a factor above 1 shows more.
function zoom(factor, about = null) {
  const figure = figures.find((one) => one.grid);
  if (!figure) return;
  const ends = [figure.x, figure.z], whole = figure.whole(), pixel = figure.grid.pixel_mm;
  const view = ends.flatMap(({ low, high }, axis) => {
    const size = Math.min(Math.max((high - low) * factor, 8 * pixel[axis]), whole[axis].high - whole[axis].low);
    const at = about ? about[axis] : (low + high) / 2;
    return heldIn(at - size * (at - low) / (high - low), size, whole[axis]);
  });
  look(view);
}

function heldIn(low, size, whole) {
  const begin = Math.min(Math.max(low, whole.low), whole.high - size);
  return [begin, begin + size];
}

// Moves the view by so many mm.
function move(by) {
  const figure = figures.find((one) => one.grid);
  if (!figure) return;
  const whole = figure.whole();
  look([figure.x, figure.z].flatMap(({ low, high }, axis) => heldIn(low + by[axis], high - low, whole[axis])));
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
    ? `Error of T_app by the simulation, for the run's own temperatures: ${head.stated_error}` +
      `${head.stated_error_emissivity === null ? "" : `; of emissivity: ${head.stated_error_emissivity.toPrecision(2)}`}.` : "";
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
  const renew = () => {
    showControls();
    redraw();
  };
  for (const name of ["quantity", "colours", "diverging"]) {
    on(name, "change", () => {
      state[name] = $(name).value;
      renew();
    });
  }
  on("frame", "input", () => {
    state.one = $("frame").valueAsNumber;
    $("frame").setAttribute("aria-valuetext", HEADS[state.one].name);
    loaded(state.one).then(renew).catch(problem);
  });
  on("other", "change", () => {
    state.other = $("other").value === "" ? null : Number($("other").value);
    loaded(state.other ?? state.one).then(renew).catch(problem);
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
  on("zoom-in", "click", () => zoom(1 / 1.5, state.cursor));
  on("zoom-out", "click", () => zoom(1.5, state.cursor));
  on("whole", "click", () => look(null));
  on("spray", "click", () => look(HEADS[state.one].window_mm ?? null));
  on("moving", "click", () => {
    state.moving = !state.moving;
    $("moving").setAttribute("aria-pressed", state.moving);
    for (const figure of figures) figure.host.classList.toggle("moving", state.moving);
  });
  const file = () => `${names.at(-1)}-${state.quantity}`.replace(/[^\w.-]+/g, "-");
  const comment = () => changedLines(shownItems()).map((line) => `# ${line}\n`).join("");
  on("save-svg", "click", () => saveFile(`${file()}.svg`, wholeSvg(figures, profile).text, "image/svg+xml"));
  on("save-png", "click", () => pngOf(wholeSvg(figures, profile))
    .then((data) => saveFile(`${file()}.png`, data, "image/png")).catch(problem));
  on("save-csv", "click", () => {
    const { unit } = QUANTITIES[state.quantity], suffix = unit ? `_${unit}` : "";
    const what = state.other === null ? state.quantity : `difference_of_${state.quantity}`;
    const heading = `${comment()}x_mm,z_mm,${what}${suffix},standard_error${suffix}`;
    const last = figures.length - 1;
    ask("csv", { panel: last, heading }).then(({ text }) => saveFile(`${file()}.csv`, text, "text/csv")).catch(problem);
  });
  on("save-profile", "click", () => {
    if (profile.lines) saveFile(`${file()}-profile.csv`, comment() + profile.csv(), "text/csv");
  });
}

async function begin() {
  wire();
  await ask("colours", { tables: DATA.colours });
  await followLink();
  window.addEventListener("hashchange", () => followLink().catch(problem));
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
    while (redraw.busy) await redraw.busy;
  },
  look,
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
