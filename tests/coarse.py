"""Scenes that cost little: the spray of `gdi` on coarse cells, and the same injection as a cone."""

from __future__ import annotations

from typing import Any

from cldit.scene import Scene, load_scene
from cldit.scene.spray import Ambient, ConeSpray

# Values of a computed spray, in place of cells that a run chooses and 375 droplets per parcel. The
# gas is unstable with 1e4 droplets in cells of 2 mm.
COARSE_GAS: dict[str, Any] = {
    "spray.box.spacing_m": 2e-3,
    "spray.droplets_per_parcel": 3e3,
}
CONE = ConeSpray(injection_duration_s=0.78e-3)
COLD_CONE = ConeSpray(
    injection_duration_s=0.78e-3,
    time_s=0.3e-3,
    ambient=Ambient(pressure_Pa=0.15e6, temperature_K=300.0),
)


def coarse_gdi(**values: Any) -> Scene:
    """Scene `gdi` with few cells of gas and few parcels, and more `values` (dotted keys)."""
    return load_scene("gdi").with_(**{**COARSE_GAS, "transport.accuracy_K": 1.0, **values})


def cone_scene(**values: Any) -> Scene:
    """Scene `gdi` with a cone of the same injection, and more `values` (dotted keys)."""
    spray = {"model": "cone", "injection_duration_s": CONE.injection_duration_s}
    scene = load_scene("gdi").with_(spray=spray)
    return scene.with_(**{"transport.accuracy_K": 1.0, **values})
