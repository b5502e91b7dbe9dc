"""How a trace is to be carried out, and what comes out of it, whatever the method."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.program import Define, Program
from cldit.radiance.weights import Weights
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.gmres import Solution
from cldit.transport.energy_balance import EnergyBalance
from cldit.transport.monte_carlo.pixel_sampling import PixelSample
from cldit.transport.phase import ScatteringTable
from cldit.transport.tuning import Tuning
from cldit.transport.view import View

Method = Literal["source", "path", "branching"]


@dataclass(frozen=True)
class Settings:
    """How a trace is carried out; `settings_for` derives it from the wanted accuracy.

    directions: of the sweep that corrects the source, which is solved for with fewer (work.py);
    final_directions: of the two halves together of the last sweep; tolerance: RMS error allowed in
    the source (weights are 0..1).
    accuracy_K, max_samples: where `path` stops, RMS error of T_app or samples a pixel. order: most
    scatterings, None for all; beyond it the wall is seen. phase: None is isotropic.
    gather: `source` has light change within cells; what those of an optical depth above
    `thick_depth`
    scatter to the camera is found by flights, until its noise is below half of accuracy_K, or with
    max_samples a pixel. Without it light is even in cells, as the paper has it. path_depth:
    optical depth
    of cells in which the sweeps' sources, linear in them, do not suffice for that.
    audit: `source` has some of its pixels traced by `path`, where it simplifies anything.
    """

    directions: int
    final_directions: int
    tolerance: float
    order: int | None
    cutoff: float
    precision: Literal["auto", "float32", "float64"]
    seed: int
    method: Method = "source"
    accuracy_K: float = 0.1
    max_samples: int = 4096
    phase: ScatteringTable | None = None
    gather: bool = True
    audit: bool = True
    thick_depth: float = Tuning.thick_depth
    path_depth: float = Tuning.path_depth
    tuning: Tuning = field(default_factory=Tuning)

    @property
    def real(self) -> type[np.floating]:
        """The device's precision."""
        return np.float64 if self.precision == "float64" else np.float32

    def defines(self, cells: OpticalCells, view: View) -> dict[str, Define]:
        """What all kernels of a trace are compiled with."""
        double: dict[str, Define] = {"USE_FLOAT64": 1} if self.precision == "float64" else {}
        return {**cells.needs.defines, **view.defines, **double}

    @property
    def within_cells(self) -> bool:
        """Order 0 knows nothing of the light in them."""
        return self.gather and self.order != 0

    @property
    def linear_sources(self) -> bool:
        """Of the last sweeps. Orders 1 and 2 are no better for it: most of their light comes from
        the boundaries."""
        return self.within_cells and (self.order is None or self.order > 2)


@dataclass(frozen=True)
class Trace:
    """What came out of a trace, and how.

    weights_difference: half the difference of two pictures, of either half of the last sweep or of
    the samples; its RMS estimates the standard error of the weights. standard_error: that of every
    pixel, from the scatter of its samples (`path` only). Both are None where nothing scatters, and
    for `branching`, which does not know its error.
    audit_K: RMS error of T_app of `source` as a few pixels traced by `path` show it, one standard
    error added; None where the method simplifies nothing, or was not audited for the reason that
    `unaudited` gives.
    sampled: the pixels that the pictures are a row of, where `path` was asked for some only.
    """

    weights: Weights
    weights_difference: Weights | None
    programs: tuple[Program, ...]
    solution: Solution | None
    seconds: dict[str, float]
    precision: str
    counts: dict[str, int] = field(default_factory=dict)
    standard_error: Weights | None = None
    audit_K: float | None = None
    unaudited: str = ""
    short: str = ""  # of the wanted accuracy: what stopped before, and why
    pixel_sample: PixelSample | None = None
    closure: EnergyBalance | None = None  # None where flights gather a solved source, or none fly


def weights_of(image: NDArray[np.floating], cells: OpticalCells) -> Weights:
    """Weights from planes (C or more, H, W) in the order of `cells.needs.components`."""
    planes = dict(zip(cells.needs.components, image, strict=False))
    nothing = np.zeros(image.shape[1:], np.float32)

    def emitted(name: str) -> NDArray[np.float32]:
        return (planes[name] * cells.scale).astype(np.float32) if name in planes else nothing

    return Weights(
        background=planes["background"].astype(np.float32),
        wall=planes["wall"].astype(np.float32),
        vapour=emitted("vapour"),
        liquid=emitted("liquid"),
        patches={name: planes[name].astype(np.float32) for name in cells.needs.patches},
    )
