"""Stiff cases whose answer is known without another solver.

A cavity at one temperature is flat (second law), an absorbing medium follows Beer-Lambert, and an
isothermal spray that does not scatter has its own temperature.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from cldit.run import Run
from cldit.transport.tuning import Tuning
from tests.verify.blocks import Blocks
from tests.verify.cavity import ALBEDOS, CELLS, DEPTHS, EDGE_M, T_K, cavity, departure
from tests.verify.stated import apparent_K

# Of a few hundred roundings to 6e-8 of either sign: the sources of sixteen cells along a line, each
# a sum over some thirty ordinates.
_ROUNDED = 3e-5
# Background, walls, vapour and liquid, each to the error that the solver is asked for.
_SOLVED = 4 * Tuning.tolerance_most
_SCATTERINGS = 1000.0  # from which on the source hardly changes from order to order


@dataclass(frozen=True)
class Case:
    """measure: returns the error. unit: of it and of the bound."""

    group: str
    name: str
    bound: float
    measure: Callable[[Blocks], float]
    unit: str = "1"


def _traced(blocks: Blocks, arrays: dict[str, Any], **scene: Any) -> Run:
    """Block in the whole cube, without an estimate of the error, which is known here."""
    scene = {
        "size_m": (EDGE_M,) * 3,
        "domain": {"edge_m": EDGE_M, "leaf_edge_m": 1.01 * EDGE_M / CELLS},
        "camera": {"pixels": [21, 17], "field_m": [0.19, 0.19]},
        "walls": {"temperature_K": T_K},
        "background": {"temperatures_K": [T_K, T_K + 20]},
        **scene,
    }
    transport = {"audit": False, **scene.pop("transport", {})}
    return blocks.run(arrays, transport=transport, **scene)


def _cavity(blocks: Blocks, *, depth: float, albedo: float, **changes: Any) -> Run:
    """Cavity whose vapour and droplets absorb 0.3 and 0.7 of what is absorbed."""
    transport = {"audit": False, **changes.pop("transport", {})}
    vapour, droplets = 0.3 * (1 - albedo), 0.7 * (1 - albedo)
    return cavity(
        blocks.run, depth=depth, albedo=albedo, vapour=vapour, droplets=droplets,
        transport=transport, **changes,
    )  # fmt: skip


def _flat(**changes: Any) -> Callable[[Blocks], float]:
    """Largest departure from a flat image."""
    return lambda blocks: float(np.max(np.abs(departure(_cavity(blocks, **changes)))))


def _flat_in_the_mean(**changes: Any) -> Callable[[Blocks], float]:
    """Mean departure from a flat image, for methods with noise."""
    return lambda blocks: float(abs(np.mean(departure(_cavity(blocks, **changes)))))


def _depths(*, few: bool) -> Iterator[Case]:
    for depth in (0.0, 1.0, 100.0, 1e6) if few else DEPTHS:
        for albedo in (0.5, 0.999999, 1.0) if few else ALBEDOS:
            # Light is absorbed after 1 / (1 - albedo) scatterings, or has left the block after
            # about the square of its depth. Where these are few, the solver's last iteration is
            # far better than it is asked for.
            scatterings = min(1 / max(1 - albedo, 1e-30), (depth * CELLS) ** 2)
            hard = scatterings > 0.99 * _SCATTERINGS
            yield Case(
                "optical depth of a cell and albedo",
                f"{depth:g}, {albedo:g}",
                _SOLVED if hard else _ROUNDED,
                _flat(depth=depth, albedo=albedo),
            )


def _temperature_error_K(spray_K: float, wall_K: float, background_K: list[float]) -> Any:
    """Largest error of the apparent temperature of a spray of optical depth 2 at one temperature
    that does not scatter."""

    def measure(blocks: Blocks) -> float:
        run = _traced(
            blocks,
            {"droplet_absorption_per_m": 2 / EDGE_M, "droplet_temperature_K": spray_K},
            walls={"temperature_K": wall_K},
            background={"temperatures_K": background_K, "radius_m": 99.0},
            transport={"cutoff": 0.0},
        )
        return float(np.max(np.abs(apparent_K(run.weights, run.scene) - spray_K)))

    return measure


_TEMPERATURES = (  # spray, walls, backgrounds
    ("wall at 0 K", 400.0, 0.0, [450.0, 500.0]),
    ("everything cold but the background", 250.0, 0.0, [500.0, 560.0]),
    ("cold background, hot spray", 1500.0, 300.0, [250.0, 300.0]),
    ("hot background, cold spray", 300.0, 300.0, [1400.0, 1500.0]),
    ("spray as hot as the background", 480.0, 300.0, [470.0, 490.0]),
)

_METHODS: dict[str, dict[str, Any]] = {
    "source": {"gather": False},
    "source, g = 0.8": {"phase": {"henyey_greenstein": 0.8}, "gather": False},
    "source and gather": {"accuracy_K": 1.0},
    "path": {"method": "path", "accuracy_K": 1.0},
    "branching": {"method": "branching", "order": 1},
}
_HALF_CELL_M = EDGE_M / CELLS / 2
_PLACES = {
    "anywhere": (0.0031, -0.0437, 0.0023),
    "on a corner of eight cells": (0.0, 0.0, 0.0),
    "in the middle of a cell": (_HALF_CELL_M,) * 3,
}


def _inside(method: str, place_m: tuple[float, float, float]) -> Callable[[Blocks], float]:
    """Camera in the medium of a cavity: flat, and Beer-Lambert without scattering."""

    def measure(blocks: Blocks) -> float:
        camera = {"pixels": 9, "field_m": [0.05, 0.05], "distance_m": 0.05}
        target = np.add(place_m, (0.0, 0.05, 0.0)).tolist()
        scene: dict[str, Any] = {
            "camera": {**camera, "target_m": target},
            "transport": _METHODS[method],
        }
        left = departure(_cavity(blocks, depth=0.1, albedo=0.5, **scene))
        noisy = method in ("path", "branching")
        background = {"temperatures_K": [T_K, 500.0], "radius_m": 99.0}
        clear = _cavity(blocks, depth=0.1, albedo=0.0, background=background, **scene)
        at = (np.arange(9) + 0.5) / 9 - 0.5
        slope = np.hypot(np.hypot(at[:, None], at[None, :]), 1.0)
        expected = np.exp(-0.1 * CELLS / EDGE_M * (EDGE_M / 2 - place_m[1]) * slope)
        direct = float(np.max(np.abs(clear.weights.background - expected)))
        return max(direct, float(abs(left.mean()) if noisy else np.abs(left).max()))

    return measure


def _grazing(model: str) -> Callable[[Blocks], float]:
    """Lines in faces and through edges and corners of cells, in a medium of optical depth 2."""

    def measure(blocks: Blocks) -> float:
        # Odd numbers of pixels, a cell apart: the middle of every pixel lies in a face or an edge;
        # the pinhole's outermost line runs through corners, one cell along y for one along x and z.
        field = EDGE_M / CELLS * 15
        camera = {
            "model": model,
            "pixels": 15,
            "field_m": [field, field],
            "distance_m": 7 * EDGE_M / CELLS,
        }
        run = _traced(
            blocks,
            {"droplet_absorption_per_m": 2 / EDGE_M, "droplet_temperature_K": T_K},
            camera={**camera, "target_m": [0.0, -EDGE_M / 2, 0.0]},
            background={"temperatures_K": [T_K, 500.0], "radius_m": 99.0},
            transport={"cutoff": 0.0},
        )
        at = (np.arange(15) - 7) * EDGE_M / CELLS
        if model == "orthographic":
            length = np.full((15, 15), EDGE_M)
        else:
            run_out = 7 * EDGE_M / CELLS
            x, z = np.abs(at)[None, :] / run_out, np.abs(at)[:, None] / run_out
            with np.errstate(divide="ignore"):
                # Where the line leaves the cube, along y from its front face.
                far = np.minimum(
                    EDGE_M,
                    np.minimum(
                        (EDGE_M / 2) / np.maximum(x, 1e-30) - run_out,
                        (EDGE_M / 2) / np.maximum(z, 1e-30) - run_out,
                    ),
                )
            length = np.maximum(far, 0.0) * np.sqrt(1 + x**2 + z**2)
        expected = np.exp(-2 / EDGE_M * length)
        return float(np.max(np.abs(run.weights.background + run.weights.wall - expected)))

    return measure


def _nothing(blocks: Blocks) -> float:
    run = _traced(blocks, {"vapour_absorption_per_m": 0.0})
    return float(np.max(np.abs(run.weights.background + run.weights.wall - 1.0)))


def _others(*, few: bool) -> Iterator[Case]:
    for name, spray_K, wall_K, background_K in _TEMPERATURES:
        yield Case(
            "temperatures",
            f"{name}: spray {spray_K:g} K, walls {wall_K:g} K, background "
            f"{background_K[0]:g} K and more",
            0.01,
            _temperature_error_K(spray_K, wall_K, background_K),
            unit="K",
        )
    for cells in (1,) if few else (1, 2, 4, 8):
        name = f"{cells**3} cell{'s' if cells > 1 else ''}"
        yield Case("few and many cells", name, _ROUNDED, _flat(depth=2.0, albedo=0.9, cells=cells))
    yield Case("few and many cells", "no cell that holds anything", 0.0, _nothing)
    large = _flat(
        depth=0.01,
        albedo=0.7,
        cells=256,
        size_m=(EDGE_M, EDGE_M, 152 / 256 * EDGE_M),
        transport={"accuracy_K": 1.0},
    )
    if not few:
        yield Case("few and many cells", "256 x 256 x 152 = 1.0e7 cells", 1e-4, large)
    for place, place_m in _PLACES.items():
        for method in (name for name in _METHODS if "gather" not in name):  # no cell is thick
            if few and place == "anywhere":
                continue
            bound = 2e-2 if method in ("path", "branching") else 1e-5
            yield Case("camera in the medium", f"{place}; {method}", bound,
                       _inside(method, place_m))  # fmt: skip
    for model in ("orthographic", "pinhole"):
        name = f"lines in faces, edges and corners of cells, {model}"
        yield Case("lines of sight", name, 1e-5, _grazing(model))
    for method in () if few else ("source and gather", "path", "branching"):
        for depth in (1e-6, 100.0, 1e6):
            yield Case(
                f"method {method}",
                f"optical depth {depth:g} a cell, albedo 0.5, mean",
                5e-3,
                _flat_in_the_mean(depth=depth, albedo=0.5, transport=_METHODS[method]),
            )


def cases(*, few: bool = False) -> list[Case]:
    """All cases, or one of each kind, in seconds."""
    return [*_depths(few=few), *_others(few=few)]
