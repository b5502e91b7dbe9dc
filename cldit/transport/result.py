"""Input, settings and result of a trace, for all methods."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Ints, Reals
from cldit.gpu.device import Device
from cldit.gpu.program import Define, Program
from cldit.medium.octree import Octree
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.radiance.apparent_temperature import TraceTemperature
from cldit.radiance.weights import Weights
from cldit.scene.schema import Scene
from cldit.transport.cells import OpticalCells
from cldit.transport.energy_balance import EnergyBalance
from cldit.transport.monte_carlo.pixel_sampling import PixelSample
from cldit.transport.phase import ScatteringTable
from cldit.transport.tuning import Tuning
from cldit.transport.view import View, check_boundary

Method = Literal["source", "path", "branching"]


@dataclass(frozen=True)
class TraceSettings:
    """Numerical settings of a trace; `settings_for` derives them from the wanted accuracy.

    directions: ordinates of the defect correction; GMRES has fewer (`Tuning.solver_share`).
    final_directions: ordinates of both halves of the final sweeps.
    tolerance: largest RMS error of the source (weights are 0..1).
    order: largest number of scatterings, beyond which the wall is seen; None: all.
    cutoff: transmission at which rays end; None: see `ending`.
    accuracy_K: wanted RMS error of T_app, at which `path` and the final gather stop.
    max_samples: largest number of samples of a pixel, by `path` and the final gather.
    phase: phase function; None: isotropic.
    gather: sources have spatial gradients, and the final gather refines thick cells. Without it
        sources are constant in cells, as in the paper.
    audit: a few pixels of `source` are also traced by `path`.
    linear_coefficients: the extinction is linear in cells for all rays but those of the sweeps.
    thick_depth: optical depth of a cell's edge from which the final gather refines it.
    path_depth: optical depth from which its paths continue in a cell.
    whole_pixels: paths of `path` begin anywhere in their pixel, not in its middle.
    subpixels: some pixels are traced by more rays, to measure the error within pixels.
    rays_K: RMS error of T_app by the sampling of pixels, for which the trace chooses rays, and
        which it measures; None: the rays are given.
    visible: emissivity above which a pixel has a T_app at this wavelength.
    """

    directions: int
    final_directions: int
    tolerance: float
    order: int | None
    cutoff: float | None
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
    whole_pixels: bool = False
    subpixels: bool = False
    rays_K: float | None = None
    visible: float = VISIBLE_EMISSIVITY
    tuning: Tuning = field(default_factory=Tuning)

    @property
    def real(self) -> type[np.floating]:
        """The device's precision."""
        return np.float64 if self.precision == "float64" else np.float32

    def ending(self, cells: OpticalCells, scene: Scene) -> float:
        """Transmission at which rays end.

        Without a `cutoff`, the light beyond changes T_app by at most the share `neglected` of
        accuracy_K, and the emissivity by `neglected_emissivity`. It is 0 where single precision has
        none.
        """
        if self.cutoff is not None:
            return self.cutoff
        allowed_K = self.tuning.neglected * self.accuracy_K
        cutoff = min(cells.cutoff(scene, tolerance_K=allowed_K), self.tuning.neglected_emissivity)
        # Single precision has no normal numbers below 1.2e-38.
        return 0.0 if cutoff < 1e-37 else cutoff

    def defines(self, cells: OpticalCells) -> dict[str, Define]:
        """Compile-time defines of all kernels of a trace of `cells`."""
        defines: dict[str, Define] = {"USE_FLOAT64": 1} if self.precision == "float64" else {}
        if self.linear_coefficients:
            defines["LINEAR_COEFFICIENTS"] = 1
        return {**cells.needs.defines, **defines}

    @property
    def within_cells(self) -> bool:
        """True if sources vary within cells; at order 0 no radiance in cells is known."""
        return self.gather and self.order != 0

    @property
    def linear_sources(self) -> bool:
        """True if sources of the final sweeps are linear in cells.

        Orders 1 and 2 do not gain by it: most of their light comes from the boundary.
        """
        return self.within_cells and (self.order is None or self.order > 2)


@dataclass(frozen=True)
class TraceInput:
    """Medium to trace as the camera of a scene sees it, on a device, with settings."""

    cells: OpticalCells
    scene: Scene
    view: View
    device: Device
    settings: TraceSettings

    @classmethod
    def of(
        cls, tree: Octree, scene: Scene, device: Device, settings: TraceSettings
    ) -> "TraceInput":
        """Input of the trace of an octree."""
        cells = OpticalCells.of(tree, patches=tuple(patch.name for patch in scene.patches))
        view = View.of(scene, cells, device, visible=settings.visible)
        return cls(cells, scene, view, device, settings)

    @property
    def defines(self) -> dict[str, Define]:
        """Compile-time defines of all kernels."""
        return self.settings.defines(self.cells)

    @property
    def cutoff(self) -> float:
        """Transmission at which rays end."""
        return self.settings.ending(self.cells, self.scene)

    @property
    def temperature(self) -> TraceTemperature:
        """T_app of weights."""
        return self.cells.temperature(self.scene, visible=self.settings.visible)

    def check_boundary(self) -> None:
        """Raises TransportError if the disc or a patch is inside the medium."""
        check_boundary(self.scene, self.cells, self.view)


@dataclass(frozen=True)
class Audit:
    """Error of an image in a sample of its pixels, by path tracing.

    sample: the pixels.
    errors: weights (1, N) of the image less those of `path`, twice, with independent noise.
    """

    sample: PixelSample
    errors: tuple[Weights, Weights]


@dataclass(frozen=True)
class Subpixels:
    """Some pixels of an image, by many more rays each than the image has.

    sample: the pixels.
    across: (N,) across^2 rays go through each.
    weights: (1, N) means of these rays; difference: as `Trace.weights_difference`.
    references: weights (1, N) without the medium, by the image's rays and by these; None: all of
        these rays end on the background.
    """

    sample: PixelSample
    across: Ints
    weights: Weights
    difference: Weights | None
    references: tuple[Weights, Weights] | None = None


@dataclass(frozen=True)
class Trace:
    """Result of a trace.

    weights_difference: half the difference of two images, from the two halves of the final
        ordinates or of the samples; its RMS estimates the standard error of the weights. None if
        nothing scatters, and for `branching`, which does not estimate its error.
    iterations: sets of sweeps of source iteration; None for other methods. source_error: RMS error
        of its source, a weight.
    seconds: wall time of each part.
    precision: of the device, float32 or float64.
    counts: sizes for the record: cells, sweeps, samples.
    middle: weights of one ray through the middle of each pixel, if `weights` may be of several, and
        half the difference of their two images.
    rays: (H, W) rays across each pixel; None: one ray.
    audit: error of `source` in a few pixels, by `path`; None if nothing scatters, for other
        methods, or if `unaudited` gives a reason.
    scatters: true if anything in the medium scatters.
    short: reason why the final gather or paths stopped before the wanted accuracy; empty if they
        did not.
    pixel_sample: the pixels in the image's one row, if `path` traced only some.
    closure: energy balance; None if no pixel was traced.
    subpixels: some pixels by more rays, if the settings ask for them; None if none has a T_app.
    """

    weights: Weights
    weights_difference: Weights | None
    programs: tuple[Program, ...]
    seconds: dict[str, float]
    precision: str
    counts: dict[str, int] = field(default_factory=dict)
    iterations: int | None = None
    source_error: float = 0.0
    middle: Weights | None = None
    middle_difference: Weights | None = None
    rays: Ints | None = None
    audit: Audit | None = None
    unaudited: str = ""
    scatters: bool = True
    short: str = ""
    pixel_sample: PixelSample | None = None
    closure: EnergyBalance | None = None
    subpixels: Subpixels | None = None


def weights_of(image: Reals, cells: OpticalCells) -> Weights:
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
