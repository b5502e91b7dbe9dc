// Cursor and line on the maps, by pointer and keys, and the values there.

// Pointer and keys on a map: cursor, and the line of a profile.
function follow(figure) {
  let from = null, held = null; // where a line, or a move of the view, began
  figure.host.classList.toggle("moving", state.moving);
  figure.host.addEventListener("pointerdown", (event) => {
    if (!figure.grid || event.button > 1) return;
    const { inside, x, z } = figure.place(event);
    if (!inside) return;
    if (state.moving || event.shiftKey || event.button === 1) held = [x, z];
    else from = [x, z];
    figure.host.setPointerCapture(event.pointerId);
    event.preventDefault();
    figure.host.focus({ preventScroll: true });
  });
  figure.host.addEventListener("pointermove", (event) => {
    if (!figure.grid) return;
    const { inside, x, z } = figure.place(event);
    if (held) {
      move([held[0] - x, held[1] - z]);
      return;
    }
    if (from) state.line = [from, [x, z]];
    state.cursor = inside || from ? [x, z] : null;
    moved();
  });
  for (const end of ["pointerup", "pointercancel"]) {
    figure.host.addEventListener(end, () => {
      from = held = null;
    });
  }
  // The wheel scrolls the page, unless the map has the focus; pinching sets ctrlKey.
  figure.host.addEventListener("wheel", (event) => {
    if (!figure.grid || !(event.ctrlKey || document.activeElement === figure.host)) return;
    event.preventDefault();
    const { x, z } = figure.place(event);
    zoom(event.deltaY > 0 ? 1.2 : 1 / 1.2, [x, z]);
  }, { passive: false });
  figure.host.addEventListener("keydown", (event) => {
    if (!figure.grid) return;
    const step = event.shiftKey ? 10 : 1, [w, h] = figure.grid.pixel_mm;
    const ways = { ArrowLeft: [-w, 0], ArrowRight: [w, 0], ArrowUp: [0, h], ArrowDown: [0, -h] };
    if (event.key in ways) {
      const now = state.cursor ?? figure.grid.centre_mm, ahead = ways[event.key];
      const ends = figure.whole(), seen = [figure.x, figure.z];
      state.cursor = now.map((one, axis) => Math.min(Math.max(one + step * ahead[axis], ends[axis].low), ends[axis].high));
      if (state.line && state.lineOpen) state.line = [state.line[0], state.cursor];
      const beyond = state.cursor.map((one, axis) => Math.min(one - seen[axis].low, 0) + Math.max(one - seen[axis].high, 0));
      if (beyond.some((one) => one !== 0)) move(beyond);
    } else if ("+-0".includes(event.key)) {
      if (event.key === "0") look(null);
      else zoom(event.key === "+" ? 1 / 1.5 : 1.5, state.cursor);
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
  probe();
  along();
}

const probe = latest(async () => {
  if (!state.cursor) return;
  const [x_mm, z_mm] = state.cursor, shown = shownItems();
  showReadout(x_mm, z_mm, shown, await ask("probe", { x_mm, z_mm, shown }));
});

const along = latest(async () => {
  if (!state.line || state.line[0].every((one, axis) => one === state.line[1][axis])) return;
  const [from, to] = state.line;
  const { lines } = await ask("profile", { from, to });
  const { short, unit } = QUANTITIES[state.quantity];
  if (lines.length) profile.show(lines, names, state.other === null ? 1 : 2, `${short}${unit ? ` / ${unit}` : ""}`);
});
