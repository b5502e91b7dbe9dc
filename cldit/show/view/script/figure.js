// One map: pixels on a canvas; axes in mm, colour bar, cursor and line as SVG above it.

const WIDE = 600, LEFT = 62, TOP = 30, BAR = 16, PLOT = 430, BOTTOM = 46, NOTE = 15;

class Figure {
  constructor(host, name) {
    this.host = document.createElement("div");
    this.host.className = "map";
    this.host.tabIndex = 0;
    this.host.setAttribute("role", "application");
    this.host.setAttribute("aria-label", `${name}: arrows move the cursor, space begins a line, escape ends it, plus and minus zoom`);
    this.canvas = document.createElement("canvas");
    this.svg = node("svg", { role: "img" });
    this.host.append(this.canvas, this.svg);
    host.append(this.host);
    this.grid = null;
  }

  // drawn: of the worker; title, label and notes: texts; bar: {url, ends} of the colours; view:
  // left, right, bottom, top in mm, null for all.
  show(drawn, title, label, bar, notes, view) {
    this.shown = [drawn, title, label, bar, notes];
    const { grid, pixels, limits, below, above } = drawn;
    this.grid = grid;
    this.host.classList.remove("empty");
    const [w, h] = grid.pixel_mm, [i0, i1, j0, j1] = partOf(grid, view);
    const [wide, high] = [(i1 - i0) * w, (j1 - j0) * h];
    const left = grid.centre_mm[0] + (i0 - grid.columns / 2) * w;
    const top = grid.centre_mm[1] + (grid.rows / 2 - j0) * h;
    const scale = Math.min(PLOT / wide, 620 / high);
    const box = { left: LEFT, top: TOP, width: wide * scale, height: high * scale };
    const tall = TOP + box.height + BOTTOM + notes.length * NOTE;
    this.box = box;
    this.x = { low: left, high: left + wide, label: "x / mm" };
    this.z = { low: top - high, high: top, label: "z / mm" };
    if (this.canvas.width !== i1 - i0 || this.canvas.height !== j1 - j0) {
      this.canvas.width = i1 - i0;
      this.canvas.height = j1 - j0;
    }
    const image = new ImageData(new Uint8ClampedArray(pixels), grid.columns, grid.rows);
    this.canvas.getContext("2d").putImageData(image, -i0, -j0);
    const share = (part, of) => `${100 * part / of}%`;
    Object.assign(this.canvas.style, {
      left: share(box.left, WIDE), top: share(box.top, tall),
      width: share(box.width, WIDE), height: share(box.height, tall),
    });
    this.svg.replaceChildren();
    this.svg.setAttribute("viewBox", `0 0 ${WIDE} ${tall}`);
    this.svg.setAttribute("aria-label", title);
    this.svg.append(node("text", { x: box.left, y: 18, class: "title" }, title));
    this.at = frame(this.svg, box, this.x, this.z);
    this.colourBar(limits, label, bar, below, above);
    notes.forEach((text, n) => {
      const y = TOP + box.height + BOTTOM + n * NOTE + 6;
      this.svg.append(node("text", { x: box.left, y, class: "note" }, text));
    });
    const [x, y] = [box.left, box.top]; // an svg inside cuts what lies beyond the view
    this.marks = node("svg", { x, y, width: box.width, height: box.height, viewBox: `${x} ${y} ${box.width} ${box.height}` });
    this.svg.append(this.marks);
  }

  // Ends of the whole image along x and z, mm.
  whole() {
    const { columns, rows, pixel_mm, centre_mm } = this.grid;
    return [columns, rows].map((count, axis) => {
      const half = count * pixel_mm[axis] / 2;
      return { low: centre_mm[axis] - half, high: centre_mm[axis] + half };
    });
  }

  again(view) {
    if (this.grid) this.show(...this.shown, view);
  }

  nothing(text) {
    this.grid = null;
    this.host.classList.add("empty");
    this.svg.setAttribute("viewBox", `0 0 ${WIDE} 120`);
    this.svg.replaceChildren(node("text", { x: WIDE / 2, y: 60, "text-anchor": "middle" }, text));
    this.canvas.width = this.canvas.height = 0;
  }

  // An end beyond which values lie is pointed.
  colourBar([low, high], label, { url, ends }, below, above) {
    const left = this.box.left + this.box.width + 14, { top, height } = this.box;
    this.svg.append(node("image", {
      href: url, x: left, y: top, width: BAR, height, preserveAspectRatio: "none",
    }));
    this.svg.append(node("rect", { x: left, y: top, width: BAR, height, class: "frame" }));
    const arrows = [[below, ends[0], top + height, 11], [above, ends[1], top, -11]];
    for (const [count, fill, y, away] of arrows.filter(([number]) => number)) {
      const d = `M${left} ${y}h${BAR}l${-BAR / 2} ${away}Z`;
      this.svg.append(node("path", { d, class: "frame beyond", style: `fill:${fill}` }));
    }
    for (const value of ticks(low, high, Math.max(2, height / 45))) {
      const y = top + (high - value) / (high - low) * height;
      this.svg.append(node("line", { x1: left + BAR, x2: left + BAR + 4, y1: y, y2: y, class: "tick" }));
      this.svg.append(node("text", { x: left + BAR + 7, y: y + 4 }, tickText(value)));
    }
    const x = left + BAR + 62, y = top + height / 2;
    this.svg.append(node("text", { x, y, "text-anchor": "middle", transform: `rotate(-90 ${x} ${y})` }, label));
  }

  // Cursor [x, z] and line [[x, z], [x, z]] in mm; null is none.
  mark(cursor, line) {
    if (!this.grid) return;
    this.marks.replaceChildren();
    if (line) {
      const [[x1, y1], [x2, y2]] = line.map(([x, z]) => [this.at.x(x), this.at.y(z)]);
      for (const name of ["halo", "line"]) this.marks.append(node("line", { x1, y1, x2, y2, class: name }));
      this.marks.append(node("circle", { cx: x1, cy: y1, r: 4, class: "cursor" }));
    }
    if (cursor) {
      const [x, y] = [this.at.x(cursor[0]), this.at.y(cursor[1])];
      for (const name of ["halo", "cursor"]) {
        this.marks.append(node("path", { d: `M${x - 9} ${y}H${x + 9}M${x} ${y - 9}V${y + 9}`, class: name }));
      }
    }
  }

  // Position of the pointer in mm, clamped to the image.
  place(event) {
    const shown = this.svg.getBoundingClientRect(), scale = WIDE / shown.width;
    const u = ((event.clientX - shown.left) * scale - this.box.left) / this.box.width;
    const v = ((event.clientY - shown.top) * scale - this.box.top) / this.box.height;
    const inside = u >= 0 && u <= 1 && v >= 0 && v <= 1;
    const held = (share) => Math.min(Math.max(share, 0), 1);
    return {
      inside,
      x: this.x.low + held(u) * (this.x.high - this.x.low),
      z: this.z.high - held(v) * (this.z.high - this.z.low),
    };
  }

  // A copy for a file, with its pixels.
  copy() {
    const copy = this.svg.cloneNode(true);
    if (!this.grid) return copy;
    const { left, top, width, height } = this.box;
    const image = node("image", {
      href: this.canvas.toDataURL("image/png"), x: left, y: top, width, height,
      preserveAspectRatio: "none", style: "image-rendering:pixelated",
    });
    copy.prepend(image);
    return copy;
  }
}

// Columns and rows of a grid in a view, whole pixels: first and end of each.
function partOf({ columns, rows, pixel_mm, centre_mm }, view) {
  if (!view) return [0, columns, 0, rows];
  const left = centre_mm[0] - columns * pixel_mm[0] / 2, top = centre_mm[1] + rows * pixel_mm[1] / 2;
  const held = (first, end, count) => {
    const begin = Math.min(Math.max(Math.floor(first + 1e-6), 0), count - 1);
    return [begin, Math.max(begin + 1, Math.min(Math.ceil(end - 1e-6), count))];
  };
  return [
    ...held((view[0] - left) / pixel_mm[0], (view[1] - left) / pixel_mm[0], columns),
    ...held((top - view[3]) / pixel_mm[1], (top - view[2]) / pixel_mm[1], rows),
  ];
}
