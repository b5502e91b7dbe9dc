// Values that the reader may change, each by a slider and a number; reset restores the run's own.
// low and high bound the number; a slider of temperatures covers those of the run and half of their
// range on either side.

const SLIDERS = {
  lowest_K: {
    text: "Coldest background", unit: "K", low: 50, high: 3000, step: 1, needs: "background",
    own: (scene) => Math.min(...scene.backgrounds_K),
  },
  highest_K: {
    text: "Hottest background", unit: "K", low: 50, high: 3000, step: 1, needs: "background",
    own: (scene) => Math.max(...scene.backgrounds_K),
  },
  wall_K: {
    text: "Walls", unit: "K", low: 50, high: 3000, step: 1, needs: "wall",
    own: (scene) => scene.wall_K,
  },
  emissivity: {
    text: "Emissivity of the background", unit: "", low: 0.3, high: 1, step: 0.01,
    own: (scene) => scene.emissivity,
  },
  read_noise_electrons: {
    text: "Read noise of the sensor", unit: "electrons", low: 0, high: 2000, step: 10,
    own: (scene) => scene.read_noise_electrons,
  },
  shots: {
    text: "Shots in front of each background", unit: "", low: 1, high: 200, step: 1,
    own: (scene) => scene.shots,
  },
  signal_K: {
    text: "Background of the camera signal", unit: "K", low: 50, high: 3000, step: 1,
    own: (scene) => middleOf(scene.backgrounds_K),
  },
};
const LEAST_APART_K = 5; // of coldest and hottest background

class Sliders {
  constructor(host, changed) {
    this.asked = {};
    this.changed = changed;
    this.rows = {};
    for (const [name, one] of Object.entries(SLIDERS)) {
      const row = document.createElement("div");
      row.className = "slider";
      const unit = one.unit ? ` / ${one.unit}` : "";
      row.innerHTML = `<label for="range-${name}"></label>
        <input type="range" id="range-${name}" min="${one.low}" max="${one.high}" step="${one.step}">
        <input type="number" id="number-${name}" min="${one.low}" max="${one.high}" step="any">
        <p class="why" id="why-${name}"></p>`;
      row.querySelector("label").textContent = one.text + unit;
      const [range, number] = row.querySelectorAll("input");
      number.setAttribute("aria-label", `${one.text}${unit}, as a number`);
      for (const input of [range, number]) input.setAttribute("aria-describedby", `why-all why-${name}`);
      range.addEventListener("input", () => this.set(name, this.snapped(name, range.valueAsNumber)));
      number.addEventListener("change", () => this.set(name, number.valueAsNumber));
      host.append(row);
      this.rows[name] = { row, range, number, why: row.querySelector(".why") };
    }
  }

  // Requests another value, clamped to its range.
  set(name, value) {
    const row = this.rows[name];
    if (!Number.isFinite(value) || row.range.disabled) return this.show(this.heads);
    const { low, high } = SLIDERS[name];
    let held = Math.min(Math.max(value, low), high);
    if (name === "lowest_K") held = Math.min(held, this.value("highest_K") - LEAST_APART_K);
    if (name === "highest_K") held = Math.max(held, this.value("lowest_K") + LEAST_APART_K);
    if (name === "shots") held = Math.round(held);
    const own = SLIDERS[name].own(this.scene);
    if (held === Number(own.toPrecision(7))) held = own; // as `show` writes it
    this.asked[name] = held;
    this.show(this.heads);
    this.changed();
  }

  // The run's own value, for a slider within half a step of it: its steps may miss it.
  snapped(name, value) {
    const own = this.scene ? SLIDERS[name].own(this.scene) : value;
    return Math.abs(value - own) <= SLIDERS[name].step / 2 ? own : value;
  }

  value(name) {
    return this.asked[name] ?? SLIDERS[name].own(this.scene);
  }

  reset() {
    this.asked = {};
    this.show(this.heads);
    this.changed();
  }

  // Requests these values alone; twice, since each background keeps apart from the place of the other.
  restore(asked) {
    this.asked = {};
    this.show(this.heads);
    for (const [name, value] of [...Object.entries(asked), ...Object.entries(asked)]) this.set(name, value);
  }

  // heads: of the items that are shown; sliders apply to runs whose values are not locked.
  show(heads) {
    this.heads = heads;
    const runs = heads.filter((one) => one.kind === "run");
    this.scene = runs.length ? runs[0].scene : null;
    let all = "";
    if (!runs.length) all = "Locked: a measurement has no weights; only a trace can be evaluated again.";
    else if (runs.length < heads.length) all = `Changes only ${runs[0].name}; a measurement has no weights.`;
    document.getElementById("why-all").textContent = all;
    for (const [name, one] of Object.entries(SLIDERS)) {
      const { row, range, number, why } = this.rows[name];
      const free = runs.filter((head) => !(one.needs in head.locked));
      let held = "";
      if (runs.length && !free.length) held = runs[0].locked[one.needs];
      else if (one.needs === "background" && this.scene && new Set(this.scene.backgrounds_K).size < 2) {
        held = "the run has one background, and DIT needs two";
      }
      const reason = held ? `Locked: ${held}.`
        : free.length < runs.length ? `Changes only ${free.map((head) => head.name).join(", ")}.` : "";
      range.disabled = number.disabled = !free.length || held !== "";
      why.textContent = reason;
      if (!this.scene) continue;
      const own = one.own(this.scene), value = this.value(name);
      const [low, high] = one.unit === "K" ? nearOf(this.scene) : [one.low, one.high];
      range.min = Math.min(low, own, value);
      range.max = Math.max(high, own, value);
      range.value = value;
      number.value = Number(value.toPrecision(7));
      range.setAttribute("aria-valuetext", `${number.value} ${one.unit}`);
      row.classList.toggle("changed", value !== own);
    }
  }

  // True if another value than the run's own is requested; not once it is put back.
  differs(name, head) {
    const own = SLIDERS[name].own(head.scene);
    return (this.asked[name] ?? own) !== own && !(SLIDERS[name].needs in head.locked);
  }

  // What is changed in a run, as texts with the run's own values.
  changes(head) {
    if (head.kind !== "run") return [];
    return Object.entries(SLIDERS).flatMap(([name, one]) => {
      if (!this.differs(name, head)) return [];
      const [now, before] = [this.asked[name], one.own(head.scene)].map((number) => `${Number(number.toPrecision(6))}${one.unit && ` ${one.unit}`}`);
      return [`${one.text.toLowerCase()} ${now} (run: ${before})`];
    });
  }

  // The command that traces the requested values; null if nothing is changed.
  command(head, scene) {
    if (head.kind !== "run" || !scene) return null;
    const keys = {
      wall_K: ["walls.temperature_K", () => scene.wall_K],
      emissivity: ["background.emissivity", () => scene.emissivity],
      read_noise_electrons: ["camera.sensor.read_noise_electrons", () => scene.read_noise_electrons],
      shots: ["plan.shots", () => scene.shots],
    };
    const parts = [];
    if (this.differs("lowest_K", head) || this.differs("highest_K", head)) {
      const rounded = scene.backgrounds_K.map((one) => Number(one.toPrecision(7)));
      parts.push(`background.temperatures_K=[${rounded.join(",")}]`);
    }
    for (const [name, [key, value]] of Object.entries(keys)) {
      if (this.differs(name, head)) parts.push(`${key}=${value()}`);
    }
    if (!parts.length) return null;
    const quoted = (text) => (/^[\w.\/=-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`);
    return `cldit run ${quoted(head.source)} ${parts.map((one) => `--set ${quoted(one)}`).join(" ")}`;
  }
}

function nearOf(scene) {
  const own = [...scene.backgrounds_K, scene.wall_K], low = Math.min(...own), high = Math.max(...own);
  const room = Math.max((high - low) / 2, 50), round = (number, way) => 10 * way(number / 10);
  return [Math.max(round(low - room, Math.floor), 50), round(high + room, Math.ceil)];
}
