"""Cost of runs that choose their resolution: cases that once took far more than asked for.

The page is written after each case; cases that are not measured keep their rows.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cldit.bench.case import changed, clocked
from cldit.bench.report import Part, Table, number
from cldit.gpu.device import open_device
from cldit.io.caches import default_cache
from cldit.run import simulate
from cldit.scene import Scene, load_scene, parse_scene
from tests.bench.page import UNLISTED, Given, write_measured

_EDGE_m = 0.1
Fields = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """A scene with what its run may take. make: the scene, from a folder for its files."""

    make: Callable[[Path], Scene]
    core_s: float
    gigabytes: float | None = None


def voxels(depth: np.ndarray, albedo: Any, kelvin: Any) -> Fields:
    """Arrays of a grid of 10 cm, by the optical depth of each voxel."""
    cell_m = _EDGE_m / len(depth)
    per_m = depth / cell_m
    return {
        "origin_m": np.full(3, -_EDGE_m / 2),
        "spacing_m": np.full(3, cell_m),
        "droplet_absorption_per_m": per_m * (1.0 - albedo),
        "droplet_scattering_per_m": per_m * albedo,
        "droplet_temperature_K": np.full(depth.shape, kelvin),
    }


def random_voxels(deepest: float, *, albedo: float, kelvin: float | None = None) -> Fields:
    """24^3 voxels, of which 40 % are filled, with depths of all magnitudes from 1e-8."""
    rng = np.random.default_rng(3)
    shape = (24,) * 3
    depth = np.exp(rng.uniform(np.log(1e-8), np.log(deepest), shape))
    depth *= rng.random(shape) < 0.4
    warm = rng.uniform(320.0, 520.0, shape) if kelvin is None else kelvin
    return voxels(depth, rng.uniform(0.0, albedo, shape).round(3), warm)


def clumps() -> Fields:
    """40^3 voxels of smooth noise, whose exponential is the depth, in a ball."""
    rng, count = np.random.default_rng(5), 40
    waves = np.fft.fftfreq(count)
    size2 = sum(one**2 for one in np.meshgrid(waves, waves, waves))
    smooth = np.fft.ifftn(np.fft.fftn(rng.normal(size=(count,) * 3)) * np.exp(-44.0 * size2)).real
    axis = (np.arange(count) + 0.5) / count - 0.5
    radius = np.sqrt(sum(one**2 for one in np.meshgrid(axis, axis, axis)))
    return voxels(0.0125 * np.exp(1.8 * smooth / smooth.std()) * (radius < 0.45), 0.74, 370.0)


def dense() -> Fields:
    """24^3 voxels of depth 3 in a ball, which scatter 0.9 of the light."""
    axis = (np.arange(24) + 0.5) / 24 - 0.5
    radius = np.sqrt(sum(one**2 for one in np.meshgrid(axis, axis, axis)))
    return voxels(3.0 * np.exp(-((radius / 0.25) ** 2)), 0.9, 380.0)


def plume() -> Fields:
    """128^3 voxels of a smooth plume."""
    axis = (np.arange(128) + 0.5) / 128 - 0.5
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    width = 0.03 + 0.15 * (0.5 - z)
    depth = 0.02 * np.exp(-(x**2 + y**2) / width**2) * np.clip(4.0 * (0.5 - z), 0.0, 1.0)
    return voxels(np.where(depth > 1e-5, depth, 0.0), 0.7, 380.0 + 80.0 * (0.5 - z))


def of_voxels(
    make: Callable[[], Fields], pixels: int = 64, **sections: Fields
) -> Callable[[Path], Scene]:
    """Maker of the scene of a grid."""

    def scene(folder: Path) -> Scene:
        path = folder / "voxels.npz"
        np.savez(path, **make())
        data: Fields = {
            "name": "voxels",
            "spray": {"model": "grid", "file": str(path)},
            "camera": {"pixels": [pixels] * 2, "field_m": [0.13] * 2, "target_m": [0.0] * 3},
            "background": {"radius_m": 0.09, "temperatures_K": [413.0, 533.0]},
            "walls": {"temperature_K": 450.0},
        }
        return parse_scene({**data, **sections})

    return scene


def narrow_plumes(_: Path) -> Scene:
    """The plumes of gdi with an angle of 6 degrees."""
    scene = load_scene("gdi-cone").model_dump(mode="json")
    for one in scene["spray"]["plumes"]:
        one["cone_angle_deg"] = 6.0
    scene["camera"]["pixels"] = [48, 48]
    return parse_scene(scene)


def gdi(pixels: int, accuracy_K: float) -> Callable[[Path], Scene]:
    """Maker of `gdi` with so many pixels along an edge."""
    sections: dict[str, Fields] = {
        "camera": {"pixels": [pixels] * 2},
        "transport": {"accuracy_K": accuracy_K},
    }
    return lambda _: changed(load_scene("gdi-cone"), **sections)


def droplets(seed: int) -> Callable[[Path], Scene]:
    """Maker of `droplets-only` with a seed."""
    return lambda _: changed(load_scene("droplets-only"), transport={"seed": seed})


def _cavity() -> Fields:
    return random_voxels(20.0, albedo=0.999, kelvin=450.0)


_LEAF = {"domain": {"leaf_edge_m": _EDGE_m / 128}}
_FINE = {"transport": {"accuracy_K": 0.3}}
CASES = {
    "voxels to depth 20": Case(of_voxels(lambda: random_voxels(20.0, albedo=0.999)), 20.0, 2.0),
    "voxels to depth 2e7": Case(of_voxels(lambda: random_voxels(2e7, albedo=1.0)), 20.0, 2.0),
    "voxels in a cavity": Case(of_voxels(_cavity), 20.0, 2.0),
    "clumps": Case(of_voxels(clumps, transport={"phase": {"henyey_greenstein": 0.85}}), 15.0, 2.0),
    "dense": Case(of_voxels(dense), 10.0),
    "plume at 0.3 K": Case(of_voxels(plume, 1000, **_FINE), np.inf),
    "plume, its voxels": Case(of_voxels(plume, 1000, **_FINE, **_LEAF), np.inf),
    "narrow plumes": Case(narrow_plumes, 20.0),
    "gdi, 100 x 100": Case(gdi(100, 1.0), 13.0),
    "gdi, 100 x 100, 0.5 K": Case(gdi(100, 0.5), np.inf),
    "gdi, 1000 x 1000": Case(gdi(1000, 1.0), np.inf),
    **{f"droplets-only, seed {seed}": Case(droplets(seed), 40.0) for seed in range(1, 6)},
}
RATIOS = (  # numerator, denominator, bar
    ("plume at 0.3 K", "plume, its voxels", 1.5),
    ("gdi, 100 x 100, 0.5 K", "gdi, 100 x 100", 4.0),
)


def run_case(name: str) -> None:
    """Runs a case in this process and prints what it took."""
    import resource

    device = open_device()
    with tempfile.TemporaryDirectory() as folder:
        scene = CASES[name].make(Path(folder))
        small = changed(load_scene("gdi-cone"), camera={"pixels": [8, 8]})
        simulate(small, device=device, cache=default_cache())  # loads modules and kernels
        run, cost = clocked(device, lambda: simulate(scene, device=device, cache=default_cache()))
    assert run.errors is not None
    seen = run.maps.apparent_temperature_K[run.maps.has_temperature].astype(float)
    print(
        json.dumps(
            {
                "name": name,
                "core_s": cost.core_s,
                "gigabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6,
                "asked_K": scene.transport.accuracy_K,
                "stated": run.errors.text,
                "spread_K": float(np.ptp(seen)) if seen.size else 0.0,
                "remarks": list(run.info.remarks),
            }
        )
    )


def measured(given: Given) -> Part:
    """Cases, each in a process of its own."""
    path = given.options.out / "cost.json"
    rows = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else []
    by_name = {row["name"]: row for row in rows}
    for name in given.options.case or CASES:
        command = [sys.executable, "-m", "tests.bench", "cost_cases", "--run", name]
        found = subprocess.run(command, capture_output=True, text=True, check=False)
        if found.returncode:
            sys.exit(f"{name}: {found.stderr[-2000:]}")
        row = by_name[name] = json.loads(found.stdout.splitlines()[-1])
        given.say(f"{name}: {row['core_s']:.3g} core-s, {row['stated']}")
        given.save(_part([by_name[name] for name in CASES if name in by_name]))
    return _part([by_name[name] for name in CASES if name in by_name])


def _part(rows: list[Fields]) -> Part:
    return Part(
        name="cost",
        title="Cost of runs that choose their resolution",
        tables=(
            Table.of(
                ("case", "asked, K", "stated", "core-s", "bar", "GB", "bar"),
                [_line(row) for row in rows],
            ),
        ),
        data=rows,
        text=_text(rows),
    )


def _line(row: Fields) -> tuple[str, ...]:
    case = CASES[row["name"]]
    bar = "-" if np.isinf(case.core_s) else f"{case.core_s:g}"
    most = "-" if case.gigabytes is None else f"{case.gigabytes:g}"
    took = number(row["core_s"]), number(row["gigabytes"], 2)
    return row["name"], f"{row['asked_K']:g}", row["stated"], took[0], bar, took[1], most


def _text(rows: list[Fields]) -> tuple[str, ...]:
    by_name = {row["name"]: row for row in rows}
    out = []
    flat = by_name.get("voxels in a cavity")
    if flat is not None:
        out.append(
            f"In a cavity at the medium's temperature T_app varies by {flat['spread_K']:.2g} K."
        )
    for one, other, bar in RATIOS:
        if {one, other} <= by_name.keys():
            ratio = by_name[one]["core_s"] / by_name[other]["core_s"]
            out.append(f"{one}: {ratio:.2g} times the core-seconds of {other} (bar: {bar:g}).")
    return tuple(out)


def main() -> None:
    """Measures the cases, or runs one."""
    if "--run" in sys.argv:
        run_case(sys.argv[sys.argv.index("--run") + 1])
        return
    write_measured(measured, _options, folder=UNLISTED)


def _options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--case", action="append", choices=CASES, help="default: all")
