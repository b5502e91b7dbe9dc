// SVG: axes, ticks and labels, the same on the page and in what is saved.

const SVG = "http://www.w3.org/2000/svg";

function node(tag, attributes = {}, text = null) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  if (text !== null) made.textContent = text;
  return made;
}

// Round numbers from low to high, at most about `most` of them.
function ticks(low, high, most) {
  const raw = (high - low) / most, unit = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 2.5, 5, 10].map((one) => one * unit).find((one) => one >= raw * (1 - 1e-9));
  const found = [];
  for (let n = Math.ceil(low / step - 1e-9); n * step <= high + 1e-9 * step; n++) {
    found.push(Number((n * step).toPrecision(12)));
  }
  return found;
}

function tickText(value) {
  const size = Math.abs(value);
  if (value !== 0 && (size < 1e-3 || size >= 1e6)) return value.toExponential();
  return String(value).replace("-", "−");
}

// A frame with ticks and labels in `box` {left, top, width, height}; x and y are {low, high, label}.
function frame(group, box, x, y) {
  const at = {
    x: (value) => box.left + (value - x.low) / (x.high - x.low) * box.width,
    y: (value) => box.top + (y.high - value) / (y.high - y.low) * box.height,
  };
  group.append(node("rect", { x: box.left, y: box.top, width: box.width, height: box.height, class: "frame" }));
  const bottom = box.top + box.height;
  for (const value of ticks(x.low, x.high, Math.max(2, box.width / 70))) {
    group.append(node("line", { x1: at.x(value), x2: at.x(value), y1: bottom, y2: bottom + 5, class: "tick" }));
    group.append(node("text", { x: at.x(value), y: bottom + 18, "text-anchor": "middle" }, tickText(value)));
  }
  for (const value of ticks(y.low, y.high, Math.max(2, box.height / 45))) {
    group.append(node("line", { x1: box.left - 5, x2: box.left, y1: at.y(value), y2: at.y(value), class: "tick" }));
    group.append(node("text", { x: box.left - 8, y: at.y(value) + 4, "text-anchor": "end" }, tickText(value)));
  }
  group.append(node("text", { x: box.left + box.width / 2, y: bottom + 36, "text-anchor": "middle" }, x.label));
  const middle = box.top + box.height / 2, side = 14;
  group.append(node("text", {
    x: side, y: middle, "text-anchor": "middle", transform: `rotate(-90 ${side} ${middle})`,
  }, y.label));
  return at;
}

// Style of a saved SVG; on the page, page.css has the same rules with its own colours.
const PRINT = `text{font:12px sans-serif;fill:#111}.frame{fill:none;stroke:#111}.tick{stroke:#111}
.note{font-size:11px}.title{font-size:13px;font-weight:bold}.cursor{stroke:#111;fill:none}.line{stroke:#111;stroke-width:1.5}
.halo{stroke:#fff;stroke-width:4}.curve{fill:none;stroke-width:1.6}.band{opacity:.25;stroke:none}
.one{stroke:#00429d;fill:#00429d}.other{stroke:#c0560d;fill:#c0560d;stroke-dasharray:6 3}`;
