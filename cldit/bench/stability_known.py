"""Stiff cases whose answer is known without another solver.

A cavity at one temperature is flat (second law), an absorbing medium follows Beer-Lambert, an
isothermal spray that does not scatter has an apparent temperature, its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from cldit.bench.stability_case import CELLS, EDGE_M, T_K, Bench, Case
from cldit.bench.stability_stated import apparent_K
from cldit.optics.planck import band_radiance
from cldit.optics.response import scene_filter
from cldit.run import Run
from cldit.transport.tuning import Tuning

_POISON_BYTES = 64 << 20
# Of a few hundred roundings to 6e-8 of either sign: the sources of sixteen cells along a line, each
# a sum over some thirty ordinates.
_ROUNDED = 3e-5
# Background, walls, vapour and liquid, each to the error that the solver is asked for.
_SOLVED = 4 * Tuning.tolerance_most
_SCATTERINGS = 1000.0  # from which on the source hardly changes from order to order


def _coefficients(depth: float, albedo: float, *, cells: int = CELLS) -> dict[str, Any]:
    per_m = depth * cells / EDGE_M
    return {
        "vapour_absorption_per_m": 0.3 * (1 - albedo) * per_m,
        "droplet_absorption_per_m": 0.7 * (1 - albedo) * per_m,
        "droplet_scattering_per_m": albedo * per_m,
        "vapour_temperature_K": T_K,
        "droplet_temperature_K": T_K,
    }


def _traced(bench: Bench, arrays: dict[str, Any], **scene: Any) -> Run:
    """A run that does not measure its error, which is known here."""
    transport = {"audit": False, **scene.pop("transport", {})}
    return bench.run(arrays, transport=transport, **scene)


def _left(run: Run) -> NDArray[np.float64]:
    """Sum of weights, less 1, in a cavity at one temperature."""
    own = float(band_radiance(T_K, filter_um=scene_filter(run.scene)))
    images = run.weights.images
    emitted = (images.pop("vapour").astype(float) + images.pop("liquid")) / own
    return np.asarray(emitted + sum(image.astype(float) for image in images.values()) - 1.0)


def _flat(**changes: Any) -> Callable[[Bench], float]:
    """Largest departure from a flat picture."""
    depth, albedo = changes.pop("depth"), changes.pop("albedo")
    cells = changes.get("cells", CELLS)

    def measure(bench: Bench) -> float:
        run = _traced(bench, _coefficients(depth, albedo, cells=cells), **changes)
        return float(np.max(np.abs(_left(run))))

    return measure


def _flat_in_the_mean(**changes: Any) -> Callable[[Bench], float]:
    """The mean departure from a flat picture, for methods with noise."""
    depth, albedo = changes.pop("depth"), changes.pop("albedo")

    def measure(bench: Bench) -> float:
        return float(abs(np.mean(_left(_traced(bench, _coefficients(depth, albedo), **changes)))))

    return measure


def _depths(*, few: bool) -> Iterator[Case]:
    depths = (0.0, 1e-6, 1e-3, 0.1, 1.0, 10.0, 100.0, 1e4, 1e6)
    albedos = (0.0, 0.5, 0.999, 0.999999, 1.0)
    for depth in (0.0, 1.0, 100.0, 1e6) if few else depths:
        for albedo in (0.5, 0.999999, 1.0) if few else albedos:
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
    """Largest error of the temperature that a spray of optical depth 2 at one temperature, which
    does not scatter, has by what it adds and what it keeps of the background."""

    def measure(bench: Bench) -> float:
        run = _traced(
            bench,
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


def _inside(method: str, place_m: tuple[float, float, float]) -> Callable[[Bench], float]:
    """A camera in a cavity's medium: flat; and what does not scatter, as Beer-Lambert has it."""

    def measure(bench: Bench) -> float:
        camera = {"pixels": 9, "field_m": [0.05, 0.05], "distance_m": 0.05}
        target = np.add(place_m, (0.0, 0.05, 0.0)).tolist()
        scene: dict[str, Any] = {
            "camera": {**camera, "target_m": target},
            "transport": _METHODS[method],
        }
        scattering = _traced(bench, _coefficients(0.1, 0.5), **scene)
        left = _left(scattering)
        noisy = method in ("path", "branching")
        clear = _traced(
            bench,
            _coefficients(0.1, 0.0),
            **scene,
            background={"temperatures_K": [T_K, 500.0], "radius_m": 99.0},
        )
        at = (np.arange(9) + 0.5) / 9 - 0.5
        slope = np.hypot(np.hypot(at[:, None], at[None, :]), 1.0)
        expected = np.exp(-0.1 * CELLS / EDGE_M * (EDGE_M / 2 - place_m[1]) * slope)
        direct = float(np.max(np.abs(clear.weights.background - expected)))
        return max(direct, float(abs(left.mean()) if noisy else np.abs(left).max()))

    return measure


def _grazing(model: str) -> Callable[[Bench], float]:
    """Lines in faces and through edges and corners of cells, in a medium of optical depth 2."""

    def measure(bench: Bench) -> float:
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
            bench,
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


def _poisoned(bench: Bench) -> float:
    """Difference between a run, and the same where the device's memory held NaN before."""
    first = _traced(bench, _coefficients(0.5, 0.7))
    queue = bench.device.queue
    size = min(_POISON_BYTES, bench.device.info.largest_buffer_bytes)
    for _ in range(4):
        buffer = cl.Buffer(bench.device.context, cl.mem_flags.READ_WRITE, size)
        cl.enqueue_fill_buffer(queue, buffer, np.full(1, np.nan, np.float32), 0, size).wait()
        buffer.release()
    second = _traced(bench, _coefficients(0.5, 0.7))
    parts = second.weights.images
    return float(
        max(np.max(np.abs(image - parts[name])) for name, image in first.weights.images.items())
    )


def _nothing(bench: Bench) -> float:
    run = _traced(bench, {"vapour_absorption_per_m": 0.0})
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
    yield Case("memory", "a device whose memory held NaN before", 0.0, _poisoned)
    for method in () if few else ("source and gather", "path", "branching"):
        for depth in (1e-6, 100.0, 1e6):
            yield Case(
                f"method {method}",
                f"optical depth {depth:g} a cell, albedo 0.5, mean",
                5e-3,
                _flat_in_the_mean(depth=depth, albedo=0.5, transport=_METHODS[method]),
            )


def cases(*, few: bool = False) -> list[Case]:
    """All cases; few: one of each kind, in seconds."""
    return [*_depths(few=few), *_others(few=few)]
