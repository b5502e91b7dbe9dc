// Files out of the page.

function saveFile(name, content, type) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([content], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

// All figures, two side by side at most, and the profile where there is one, in one SVG.
function wholeSvg(figures, profile) {
  const parts = figures.map((figure) => figure.copy());
  if (profile.lines) parts.push(profile.svg.cloneNode(true));
  const columns = Math.min(2, figures.length);
  const whole = node("svg", { xmlns: SVG });
  whole.append(node("style", {}, PRINT));
  const backdrop = whole.appendChild(node("rect", { fill: "#fff" }));
  let row = 0, bottom = 0;
  parts.forEach((part, number) => {
    const column = number % columns;
    if (column === 0) row = bottom;
    const [, , wide, high] = part.getAttribute("viewBox").split(" ").map(Number);
    for (const [name, value] of Object.entries({ x: column * WIDE, y: row, width: wide, height: high })) {
      part.setAttribute(name, value);
    }
    whole.append(part);
    bottom = Math.max(bottom, row + high);
  });
  const size = { width: columns * WIDE, height: bottom };
  for (const [name, value] of Object.entries(size)) {
    whole.setAttribute(name, value);
    backdrop.setAttribute(name, value);
  }
  return { text: new XMLSerializer().serializeToString(whole), ...size };
}

async function pngOf({ text, width, height }) {
  const image = new Image();
  image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(text)}`;
  await image.decode();
  const canvas = document.createElement("canvas");
  canvas.width = 2 * width;
  canvas.height = 2 * height;
  canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
  return new Promise((done) => canvas.toBlob(done, "image/png"));
}
