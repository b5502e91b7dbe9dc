// Values along a line: curves with bands of one standard error.

const PROFILE_HIGH = 260;

class Profile {
  constructor(svg) {
    this.svg = svg;
    this.lines = null;
    this.clear();
  }

  clear() {
    this.lines = null;
    this.svg.setAttribute("viewBox", `0 0 ${WIDE} 60`);
    this.svg.replaceChildren(node("text", { x: WIDE / 2, y: 34, "text-anchor": "middle" },
      "Drag across a map, or press space and move the cursor, for a profile"));
  }

  // lines: rows of the worker, one a panel; names: of the panels; curves: how many share the axes.
  show(lines, names, curves, label) {
    this.lines = lines;
    this.names = names;
    const drawn = lines.slice(0, curves).filter((one) => one);
    const known = drawn.flatMap((one) => one.value.filter(Number.isFinite));
    this.svg.setAttribute("viewBox", `0 0 ${WIDE} ${PROFILE_HIGH}`);
    this.svg.replaceChildren();
    const box = { left: LEFT, top: 28, width: WIDE - LEFT - 20, height: PROFILE_HIGH - 28 - BOTTOM };
    let low = known.reduce((least, one) => Math.min(least, one), Infinity);
    let high = known.reduce((most, one) => Math.max(most, one), -Infinity);
    if (!known.length) [low, high] = [0, 1];
    const room = 0.06 * (high - low) || Math.max(Math.abs(high) * 1e-3, 1e-9);
    const length = drawn[0].distance_mm.at(-1) || 1;
    const at = frame(this.svg, box, { low: 0, high: length, label: "along the line / mm" },
      { low: low - room, high: high + room, label });
    const inside = (y) => Math.min(Math.max(at.y(y), box.top), box.top + box.height).toFixed(1);
    drawn.forEach((rows, number) => {
      const kind = number === 0 ? "one" : "other";
      for (const run of runsOf(rows.value)) {
        const x = (n) => at.x(rows.distance_mm[n]).toFixed(1);
        const edge = (sign) => run.map((n) => `${x(n)} ${inside(rows.value[n] + sign * (rows.error[n] || 0))}`);
        if (run.some((n) => rows.error[n] > 0)) {
          this.svg.append(node("path", { d: `M${[...edge(1), ...edge(-1).reverse()].join("L")}Z`, class: `band ${kind}` }));
        }
        const path = run.map((n) => `${x(n)} ${inside(rows.value[n])}`).join("L");
        this.svg.append(node("path", { d: `M${path}`, class: `curve ${kind}`, style: "fill:none" }));
      }
      const left = box.left + 8 + number * 260;
      this.svg.append(node("line", { x1: left, x2: left + 26, y1: 14, y2: 14, class: `curve ${kind}` }));
      this.svg.append(node("text", { x: left + 32, y: 18 }, names[number]));
    });
  }

  csv() {
    const head = ["panel", "distance_mm", "x_mm", "z_mm", "value", "standard_error"].join(",");
    const rows = this.lines.flatMap((one, number) => one.value.map((value, n) => [
      `"${this.names[number].replaceAll('"', '""')}"`, one.distance_mm[n].toFixed(4),
      one.x_mm[n].toFixed(4), one.z_mm[n].toFixed(4), plainNumber(value), plainNumber(one.error[n]),
    ].join(",")));
    return `${[head, ...rows].join("\n")}\n`;
  }
}

function plainNumber(value) {
  return Number.isFinite(value) ? value.toPrecision(8) : "";
}

// Indices of neighbouring numbers without a gap.
function runsOf(values) {
  const runs = [];
  let open = false;
  values.forEach((value, n) => {
    if (!Number.isFinite(value)) open = false;
    else if (open) runs.at(-1).push(n);
    else open = runs.push([n]) > 0;
  });
  return runs;
}
