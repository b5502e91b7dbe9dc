"""Slabs against PythonicDISORT, as a table: `python tests/bench/slabs.py [--plain] [--phase g]`.

A slab of 16 cells, or --layers (0.2 m cube, 128 cells an edge), before a background that fills the
half space; the error is that of the weights of background and wall, in units of the boundary's
radiance. The last two columns are what the sweeps' three Legendre moments cost by PythonicDISORT.
--phase mie: droplets of 9 um.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import cldit
from tests.phase_tables import henyey_greenstein

sys.path.insert(0, str(Path(__file__).parents[1] / "verify"))
slab = importlib.import_module("slab")

EDGE, CELLS = 0.2, 128


def main() -> None:
    """Prints a row for each slab."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plain", action="store_true", help="thick cells too have one source")
    parser.add_argument("--phase", default="isotropic", help="g of Henyey-Greenstein, or mie")
    parser.add_argument("--depths", type=float, nargs="+", default=[0.01, 0.1, 1.0, 10.0, 100.0])
    parser.add_argument("--albedos", type=float, nargs="+", default=[0.0, 0.5, 0.9, 0.999])
    parser.add_argument("--accuracy", type=float, default=0.1)
    parser.add_argument("--layers", type=int, default=16)
    chosen = parser.parse_args()
    thickness = chosen.layers * EDGE / CELLS
    print("depth  a cell  albedo  background  wall  emission  T_app stated K  by three moments")
    with tempfile.TemporaryDirectory() as folder, slab.droplets_of_9_um() as droplets:
        phase: Any = chosen.phase
        if phase == "isotropic":
            moments = np.ones(1)
        elif phase == "mie":
            moments = droplets.moments(48)
        else:
            phase = {"henyey_greenstein": float(phase)}
            moments = henyey_greenstein(float(chosen.phase)).moments(48)
        for depth in chosen.depths:
            for albedo in chosen.albedos:
                file = Path(folder) / f"{depth}-{albedo}.npz"
                size = np.array([EDGE, thickness, EDGE])
                one = np.ones((1, 1, 1))
                np.savez(
                    file,
                    origin_m=-size / 2,
                    spacing_m=size,
                    droplet_absorption_per_m=(1 - albedo) * depth / thickness * one,
                    droplet_scattering_per_m=albedo * depth / thickness * one,
                    droplet_temperature_K=400.0 * one,
                )
                scene = {
                    "name": "slab",
                    "spray": {"model": "grid", "file": str(file)},
                    "domain": {"edge_m": EDGE, "leaf_edge_m": 1.01 * EDGE / CELLS},
                    "camera": {
                        "model": "orthographic",
                        "pixels": [9, 9],
                        "field_m": [0.01, 0.01],
                    },
                    "background": {"radius_m": 99.0, "temperatures_K": [400.0, 500.0]},
                    "transport": {
                        "phase": phase,
                        "gather": not chosen.plain,
                        "accuracy_K": chosen.accuracy,
                    },
                }
                run = cldit.simulate(cldit.parse_scene(scene), cache=Path(folder) / "cache")
                behind, front = slab.disort(depth, albedo, moments, streams=48)
                known_K = run.info.accuracy_K
                stated = "unknown" if known_K is None else f"{known_K:.3g}"
                three = slab.disort(depth, albedo, moments, streams=48, swept=3)
                middle = run.weights.background.mean(), run.weights.wall.mean()
                print(
                    f"{depth:5g} {depth / chosen.layers:7.3g} {albedo:7g} "
                    f"{middle[0] - behind:+11.4f} {middle[1] - front:+7.4f} "
                    f"{1.0 - behind - front:9.4f} {stated} "
                    f"{three[0] - behind:+.4f} {three[1] - front:+.4f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
