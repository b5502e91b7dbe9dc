"""A case of `cldit bench stability`, its outcome, and the block of a medium that it traces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cldit.gpu.device import Device
from cldit.io.data_streams import DataStream
from cldit.io.files import whole
from cldit.run import Run, simulate
from cldit.scene import parse_scene
from cldit.spray.result import Spray

EDGE_M = 0.2
CELLS = 16
T_K = 450.0


@dataclass(frozen=True)
class Bench:
    """Where the cases run; folder: for their files."""

    device: Device
    folder: Path

    def run(
        self,
        arrays: dict[str, Any],
        *,
        size_m: tuple[float, float, float] = (EDGE_M,) * 3,
        cells: int = CELLS,
        **scene: Any,
    ) -> Run:
        """Traces a block of these coefficients, centred in a cube of `cells`^3 leaves.

        Args:
            arrays: of the grid file, of any shape (X, Y, Z).
            size_m: of the block.
            cells: leaves along an edge of the cube.
            scene: other sections of the scene.
        """
        full = {name: np.array(value, float, ndmin=3) for name, value in arrays.items()}
        file = self.folder / f"{sum(1 for _ in self.folder.iterdir())}.npz"
        shape = next(iter(full.values())).shape
        origin_m, spacing_m = -np.asarray(size_m) / 2, np.asarray(size_m) / shape
        with whole(file, sync=False) as part, DataStream(part) as stream:
            np.savez(stream, origin_m=origin_m, spacing_m=spacing_m, **full)  # type: ignore[arg-type]
        data = {
            "spray": {"model": "grid", "file": str(file)},
            "domain": {"edge_m": EDGE_M, "leaf_edge_m": 1.01 * EDGE_M / cells},
            "camera": {"pixels": [21, 17], "field_m": [0.19, 0.19]},
            "walls": {"temperature_K": T_K},
            "background": {"temperatures_K": [T_K, T_K + 20]},
            **scene,
        }
        return self._simulated(data, None)

    def sprayed(self, spray: Spray, **scene: Any) -> Run:
        """Traces a spray as if it had been imported.

        Args:
            spray: made by the case.
            scene: other sections of the scene.
        """
        return self._simulated(
            {"spray": {"model": "cfd", "file": "made-by-the-case"}, **scene}, spray
        )

    def _simulated(self, data: dict[str, Any], spray: Spray | None) -> Run:
        scene = parse_scene({"name": "stability", **data})
        return simulate(scene, device=self.device, cache=self.folder / "cache", spray=spray)


@dataclass(frozen=True)
class Case:
    """measure: gives the error reached. unit: of it and of the bound."""

    group: str
    name: str
    bound: float
    measure: Callable[[Bench], float]
    unit: str = "1"


@dataclass(frozen=True)
class Outcome:
    """error: NaN where the case ended with the message instead."""

    case: Case
    error: float
    message: str = ""

    @property
    def holds(self) -> bool:
        """Whether the error is within the bound."""
        return self.error <= self.case.bound
