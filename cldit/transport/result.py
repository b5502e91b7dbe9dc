"""Settings and result of a trace, whatever the method."""

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

Floats = NDArray[np.float64]
Method = Literal["source", "path", "branching"]


@dataclass(frozen=True)
class Settings:
    """How a trace is carried out; `settings_for` derives it from the wanted accuracy.

    directions: ordinates of the defect correction; GMRES has fewer (`Tuning.solver_share`).
    final_directions: ordinates of both halves of the final sweeps.
    tolerance: RMS error allowed in the source (weights are 0..1).
    order: most scatterings, beyond which the wall is seen; None: all.
    cutoff: transmission at which rays end.
    accuracy_K: wanted RMS error of T_app; `path` and the final gather stop there.
    max_samples: of a pixel, at most, by `path` and the final gather.
    phase: phase function; None is isotropic.
    gather: sources have spatial gradients, and the final gather refines thick cells. Without it
        sources are constant in cells, as in the paper.
    audit: a few pixels of `source` are traced by `path`, where `source` simplifies anything.
    linear_coefficients: the extinction is linear in cells for all rays but the sweeps'.
    thick_depth: optical depth of a cell's edge from which the final gather refines it.
    path_depth: optical depth from which its paths go on in a cell.
    subpixels: more rays go through some pixels, to tell what those of the picture miss.
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
    linear_coefficients: bool = False
    thick_depth: float = Tuning.thick_depth
    path_depth: float = Tuning.path_depth
    subpixels: bool = False
    tuning: Tuning = field(default_factory=Tuning)

    @property
    def real(self) -> type[np.floating]:
        """The device's precision."""
        return np.float64 if self.precision == "float64" else np.float32

    def defines(self, cells: OpticalCells, view: View) -> dict[str, Define]:
        """Compile-time defines of all kernels of a trace of `cells` from `view`."""
        own: dict[str, Define] = {"USE_FLOAT64": 1} if self.precision == "float64" else {}
        if self.linear_coefficients:
            own["LINEAR_COEFFICIENTS"] = 1
        return {**cells.needs.defines, **view.defines, **own}

    @property
    def within_cells(self) -> bool:
        """Whether sources vary within cells; at order 0 no radiance in cells is known."""
        return self.gather and self.order != 0

    @property
    def linear_sources(self) -> bool:
        """Whether sources of the final sweeps are linear in cells.

        Orders 1 and 2 gain nothing by it: most of their light comes from the boundary.
        """
        return self.within_cells and (self.order is None or self.order > 2)


@dataclass(frozen=True)
class Audit:
    """What `path` finds of the error of an image, in a sample of its pixels.

    sample: the pixels.
    errors: weights (1, N) of the image minus those of `path`, twice, with independent noise.
    """

    sample: PixelSample
    errors: tuple[Weights, Weights]


@dataclass(frozen=True)
class Subpixels:
    """Some pixels of an image by many more rays each than the image has.

    sample: the pixels.
    across: across^2 rays went through each.
    weights: (1, N) means of these rays; difference: as `Trace.weights_difference`.
    references: what the image's rays and these see of the boundary without the medium, each (1, N);
        None: the background alone, in all pixels.
    """

    sample: PixelSample
    across: int
    weights: Weights
    difference: Weights | None
    references: tuple[Weights, Weights] | None = None


@dataclass(frozen=True)
class Trace:
    """Result of a trace.

    weights_difference: half the difference of two images, of either half of the final ordinates or
        of the samples; its RMS estimates the standard error of the weights. None where nothing
        scatters, and for `branching`, which does not know its error.
    standard_error: of every pixel, from the scatter of its samples (`path` only).
    solution: of source iteration; None for other methods.
    seconds: wall time of each part.
    precision: of the device, float32 or float64.
    counts: sizes for the record: cells, sweeps, samples.
    middle: weights of one ray through the middle of each pixel, where `weights` are of several.
    audit: error of `source` by a few pixels of `path`; None where nothing scatters, where the
        method is another, or where `unaudited` gives a reason.
    scatters: whether anything in the medium does.
    short: why the final gather stopped before the wanted accuracy, if it did.
    pixel_sample: the pixels of which the images are one row, where `path` traced only some.
    closure: energy balance; None where no pixel was traced.
    subpixels: what more rays see of some pixels, where `Settings.subpixels` asks for it and a pixel
        has a T_app.
    """

    weights: Weights
    weights_difference: Weights | None
    programs: tuple[Program, ...]
    solution: Solution | None
    seconds: dict[str, float]
    precision: str
    counts: dict[str, int] = field(default_factory=dict)
    standard_error: Weights | None = None
    middle: Weights | None = None
    audit: Audit | None = None
    unaudited: str = ""
    scatters: bool = True
    short: str = ""
    pixel_sample: PixelSample | None = None
    closure: EnergyBalance | None = None
    subpixels: Subpixels | None = None


def weights_of(image: NDArray[np.floating], cells: OpticalCells) -> Weights:
    """Weights of an image's planes (C or more, H, W), in the order of `cells.needs.components`."""
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
