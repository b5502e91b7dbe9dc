"""The cone against the computed spray of the same injector, by their images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.comparison.regions import Spray2D
from cldit.gpu.device import open_device
from cldit.prepare.spray_factory import make_spray
from cldit.run import Run, simulate
from cldit.scene import load_scene
from cldit.scene.spray import LagrangianSpray, Plume
from cldit.spray.result import Cells, Spray, Vapour
from tests.bench.spray_history import Bench, table

_TIMES_MS = (0.4, 0.95)
_SEEN: dict[str, Any] = {
    "transport.accuracy_K": 0.5,
    "transport.audit": False,
    "domain.leaf_edge_m": 0.5e-3,
    "camera.field_m": [0.1, 0.1],
    "camera.pixels": [250, 250],
    "camera.target_m": [0.0, 0.0, -0.035],
}
_SLICE_M = 1e-3  # of a plume, along it
_TURNS = 8  # of each cell of vapour
_WIEN_K = 4232.0  # h c / (k lambda) at 3.4 um


def spray_cone(bench: Bench) -> list[str]:
    """Table of differences of T_app by region, and what plumes of round section could reach."""
    device = open_device()
    rows = []
    for time_ms in _TIMES_MS:
        found: dict[str, Run] = {}
        sprays: dict[str, Spray] = {}
        for name, scene in (
            ("cone", load_scene("gdi-cone").with_(**{"spray.spacing_m": 0.4e-3})),
            *((f"seed {n}", load_scene("gdi-flow").with_(**{"spray.seed": n})) for n in (1, 2)),
        ):
            box = {} if name == "cone" else {"spray.box.spacing_m": 0.7 * bench.spacing_m}
            one = scene.with_(**{**_SEEN, **box, "spray.time_s": time_ms * 1e-3})
            sprays[name] = make_spray(one.spray, device, cache=bench.cache)
            found[name] = simulate(one, device=device, cache=bench.cache, spray=sprays[name])
            bench.say(f"{name}, {time_ms:g} ms")
        assert isinstance(one.spray, LagrangianSpray)
        made_round = rounded(sprays["seed 1"], one.spray.plumes)
        found["round"] = simulate(one, device=device, cache=bench.cache, spray=made_round)
        for label, name in (("cone", "cone"), ("computed, plumes made round", "round"),
                            ("computed, another seed", "seed 2")):  # fmt: skip
            rms = by_region(found[name], found["seed 1"])
            mg = 1e6 * sprays.get(name, made_round).notes["liquid_mass_kg"]
            texts = [f"{value:.1f}" for value in rms.values()]
            rows.append([f"{time_ms:g} ms: {label}", *texts, f"{mg:.2f}"])
    return [
        "## The cone",
        "",
        "T_app of the same injection by `spray.model: cone`, minus that of the computed spray (RMS",
        f"by region, K; pixels of 0.4 mm, gas of {0.7e3 * bench.spacing_m:g} mm, lattice of 0.4",
        "mm). Made round: each slice of a plume of the computed spray, 1 mm thick, is turned about",
        "its own centre. No plumes of round section can be much nearer to it.",
        "",
        *table(["0.6 MPa, 570 K", *rms, "liquid, mg"], rows),
        "",
    ]


def by_region(run: Run, reference: Run) -> dict[str, float]:
    """RMS of the difference of T_app over the regions of the reference."""
    x, _, z = reference.scene.target_m
    parts, own = (
        Spray2D.of(one.maps, pixel_m=one.pixel_m, centre_m=(x, z)) for one in (reference, run)
    )
    change = (run.maps.apparent_temperature_K - reference.maps.apparent_temperature_K).astype(float)

    def rms(where: Mask) -> float:
        both = where & own.visible
        return float(np.sqrt(np.mean(change[both] ** 2))) if both.any() else float("nan")

    return {name: rms(where) for name, where in parts.regions.items()}


def rounded(spray: Spray, plumes: Sequence[Plume]) -> Spray:
    """The spray with each slice of a plume turned about its own centre by random angles."""
    assert spray.vapour is not None and spray.parcels is not None
    cells, parcels, rng = spray.vapour.cells, spray.parcels, np.random.default_rng(1)
    middle = 0.5 * (cells.lower_m + cells.upper_m)
    amount = spray.vapour.number_density_m3 * cells.volume_m3
    turn = _Turn(plumes, np.concatenate([middle, parcels.position_m]),
                 np.concatenate([spray.vapour.masses_kg, parcels.masses_kg]))  # fmt: skip
    edge_m = float(np.min(cells.upper_m - cells.lower_m))
    places = np.concatenate([
        turn(middle, rng) + rng.uniform(-0.5, 0.5, middle.shape) * edge_m for _ in range(_TURNS)
    ])  # fmt: skip
    index, at = np.unique(np.floor(places / edge_m).astype(int), axis=0, return_inverse=True)
    number = np.bincount(at.ravel(), np.tile(amount / _TURNS, _TURNS))
    light = np.tile(amount / _TURNS * np.exp(-_WIEN_K / spray.vapour.temperature_K), _TURNS)
    vapour = Vapour(
        cells=Cells(lower_m=index * edge_m, upper_m=(index + 1) * edge_m),
        number_density_m3=number / edge_m**3,
        temperature_K=-_WIEN_K / np.log(np.bincount(at.ravel(), light) / number),
        molar_mass_kg_mol=spray.vapour.molar_mass_kg_mol,
    )
    moved = replace(parcels, position_m=turn(parcels.position_m, rng), velocity_m_s=None)
    return replace(spray, parcels=moved, vapour=vapour)


class _Turn:
    """Rotations about the centres of a spray's slices, all plumes being alike."""

    def __init__(self, plumes: Sequence[Plume], place: Floats, mass: Floats) -> None:
        self.azimuth = np.radians([one.azimuth_deg for one in plumes])
        self.inclination = float(np.radians(plumes[0].inclination_deg))
        along, outward, _, _ = self._frame(place)
        edges = np.arange(-0.01, 0.1, _SLICE_M)
        whole = np.histogram(along, edges, weights=mass)[0]
        first = np.histogram(along, edges, weights=mass * outward)[0]
        some = whole > 0
        self.along, self.centre = (edges[:-1] + _SLICE_M / 2)[some], first[some] / whole[some]

    def _frame(self, place: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Distance along the nearest plume, outwards and beside it, and its azimuth."""
        away = np.arctan2(place[:, 1], place[:, 0])[:, None] - self.azimuth
        azimuth = self.azimuth[np.argmax(np.cos(away), axis=1)]
        radius = place[:, 0] * np.cos(azimuth) + place[:, 1] * np.sin(azimuth)
        beside = place[:, 1] * np.cos(azimuth) - place[:, 0] * np.sin(azimuth)
        sine, cosine = np.sin(self.inclination), np.cos(self.inclination)
        along = radius * sine - place[:, 2] * cosine
        return along, radius * cosine + place[:, 2] * sine, beside, azimuth

    def __call__(self, place: Floats, rng: np.random.Generator) -> Floats:
        along, outward, beside, azimuth = self._frame(place)
        centre = np.interp(along, self.along, self.centre)
        angle = rng.uniform(0, 2 * np.pi, len(place))
        first, second = outward - centre, beside
        outward = centre + first * np.cos(angle) - second * np.sin(angle)
        beside = first * np.sin(angle) + second * np.cos(angle)
        sine, cosine = np.sin(self.inclination), np.cos(self.inclination)
        radius, height = along * sine + outward * cosine, outward * sine - along * cosine
        x = radius * np.cos(azimuth) - beside * np.sin(azimuth)
        y = radius * np.sin(azimuth) + beside * np.cos(azimuth)
        return np.stack([x, y, height], axis=1)
