// The measurement equation in one band, as cldit/radiance/boundary.py has it.
//
// around: wall_K, emissivity, around_K (null: the walls), camera_K, patches, windows_K.
// radiance: of a black body in the band. panes: {front: [transmission, reflection], rear: ...}.

function boundaryOf(around, radiance, panes) {
  const wall = radiance(around.wall_K);
  const outside = radiance(around.around_K === null ? around.wall_K : around.around_K);
  const window = (side, opposite_K) => {
    if (!(side in panes)) return { transmission: 1, added: 0 };
    const [transmission, reflection] = panes[side];
    const own = Math.max(1 - transmission - reflection, 0) * radiance(around.windows_K[side]);
    return { transmission, added: own + reflection * radiance(opposite_K) };
  };
  const rear = window("rear", around.wall_K);
  const front = window("front", around.camera_K);
  const patches = {};
  for (const one of around.patches) {
    patches[one.name] = one.emissivity * radiance(one.K) + (1 - one.emissivity) * wall;
  }
  return {
    wall,
    patches,
    front,
    leaving: (kelvin) => rear.added + rear.transmission
      * (around.emissivity * radiance(kelvin) + (1 - around.emissivity) * outside),
    seen: (inside) => front.transmission * inside + front.added,
  };
}
