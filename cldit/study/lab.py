"""Scenes of the paper's studies, and runs that all studies share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from cldit.gpu.device import Device
from cldit.prepare.spray_factory import make_spray
from cldit.run import Run, RunCache, Say
from cldit.run.trusted import open_device
from cldit.scene import Scene, load_scene
from cldit.scene.camera import square_pixels
from cldit.scene.keys import coarsened
from cldit.scene.spray import LagrangianSpray
from cldit.scene.vessel import PAPER_LEAF_M
from cldit.spray.result import Spray

# Injector of `gdi`, in the conditions of the paper's Figs. 9 to 13, open for
# 1.5 ms: the paper's spray still hangs on it at 0.95 ms. The field is the part of the paper's 16 cm
# with spray, at its 0.16 mm per pixel.
OPEN_s = 1.5e-3
_CAMERA = {
    "camera.field_m": [0.1, 0.1],
    "camera.pixels": [625, 625],
    "camera.target_m": [0.0, 0.0, -0.035],
}
CAPTION_WALLS_K = 450.0  # Figs. 11, 12, 13 and 15

# K of gas and walls at MPa. At 0.4 MPa the paper gives the walls (Fig. 6), at 0.6 MPa that they are
# "115 K lower than the gas temperature" (Fig. 9), which is assumed wherever the gas is hot.
GASES_K = {
    0.15: (300.0, 300.0),
    0.3: (500.0, 385.0),
    0.4: (530.0, 415.0),
    0.6: (570.0, 455.0),
    0.9: (620.0, 505.0),
}

# Scenes are compared, and share the error of their cells; what is left in a change is found by
# making the change again on coarser ones (`paper.variation`), not by auditing each trace.
_COMPARED: dict[str, Any] = {
    "domain.leaf_edge_m": PAPER_LEAF_M,
    "transport.accuracy_K": 0.1,
    "transport.audit": False,
}

# Fewer droplets per parcel than the paper's 1e4, so that single parcels are invisible.
_PARCELS = 2.5e3
# Quick: pixels of 0.4 mm, and the octree, the gas and the parcels' masses 2 to 4 times as coarse.
_QUICK_SPRAY: dict[str, Any] = {
    "spray.box.spacing_m": 2e-3,
    "spray.droplets_per_parcel": 1e4,
}


def reduced(scene: Scene) -> Scene:
    """The scene with reduced accuracy, and 250 square pixels along the longer side."""
    return scene.with_(
        **{
            "camera.pixels": square_pixels(scene.camera.field_m, 250),
            "transport.accuracy_K": 0.5,
            "domain.leaf_edge_m": 1e-3,
        }
    )


def in_gas(pressure_MPa: float) -> tuple[str, dict[str, Any]]:
    """Name of the gas at one of the paper's pressures, and the values of a scene in it."""
    gas_K, walls_K = GASES_K[pressure_MPa]
    values = {"spray.ambient": ambient(pressure_MPa, gas_K), "walls.temperature_K": walls_K}
    return f"{pressure_MPa:g} MPa, {gas_K:g} K", values


def ambient(pressure_MPa: float, gas_K: float) -> dict[str, float]:
    """Gas of a scene."""
    return {"pressure_Pa": pressure_MPa * 1e6, "temperature_K": gas_K}


def gdi_in(pressure_MPa: float) -> str:
    """Name of the paper's spray in the gas at one of its pressures."""
    gas_K, _ = GASES_K[pressure_MPa]
    return "gdi" if pressure_MPa == 0.6 else f"gdi-{pressure_MPa:g}MPa-{gas_K:g}K"


def open_for(duration_s: float) -> dict[str, float]:
    """Values of `gdi` with an injection of another duration at the same rate."""
    spray = load_scene("gdi").spray
    assert isinstance(spray, LagrangianSpray)
    return {
        "spray.injection_duration_s": duration_s,
        "spray.injected_mass_kg": spray.injected_mass_kg / spray.injection_duration_s * duration_s,
    }


@dataclass(frozen=True)
class Lab:
    """Runs and sprays of scenes, from the cache if they are there.

    quick: reduced pixels and accuracy. always: values of all scenes that override those of a study.
    seed: of computed sprays. coarser: factor on the edges of all cells. used: scenes that were run,
    for the page.
    """

    runs: RunCache = field(default_factory=RunCache)
    quick: bool = False
    device: Device | None = None
    say: Say | None = None
    always: Mapping[str, Any] = field(default_factory=dict)
    seed: int = 1
    coarser: float = 1.0
    used: dict[str, Scene] = field(default_factory=dict)

    def gdi(self, name: str, values: Mapping[str, Any] | None = None) -> Scene:
        """Gasoline spray of the paper, called `name`, with some `values` changed (dotted keys)."""
        fixed = {
            "name": name,
            "description": "",
            "spray.droplets_per_parcel": _PARCELS,
            "spray.seed": self.seed,
            "walls.temperature_K": GASES_K[0.6][1],
            **open_for(OPEN_s),
            **_CAMERA,
        }
        return self._changed(load_scene("gdi").with_(**fixed), _QUICK_SPRAY, values)

    def shipped(self, name: str, values: Mapping[str, Any] | None = None) -> Scene:
        """Shipped scene `name` with some `values` changed, reduced if the study is quick."""
        return self._changed(load_scene(name), {}, values)

    def _changed(
        self, scene: Scene, quick: Mapping[str, Any], values: Mapping[str, Any] | None
    ) -> Scene:
        """The scene as one to compare, reduced and with the values `quick` if the study is quick,
        and with `values`."""
        scene = scene.with_(**_COMPARED)
        if self.quick:
            scene = reduced(scene).with_(**quick)
        return coarsened(scene.with_(**(values or {})).with_(**self.always), self.coarser)

    def run(self, scene: Scene, *, spray: Callable[[], Spray] | None = None) -> Run:
        """Run of a scene, from the cache if it is there; `spray` makes its spray."""
        self._note(scene)
        return self.runs.run(scene, device=self.device, spray=spray, progress=self.say)

    def spray(self, scene: Scene) -> Spray:
        """Spray of a scene, from the cache if it is there."""
        self._note(scene)
        return make_spray(scene.spray, self.device or open_device(), cache=self.runs.cache)

    def _note(self, scene: Scene) -> None:
        self.used.setdefault(scene.name, scene)
        if self.say is not None:
            self.say(f"scene {scene.name}")
