"""Source of the scattering cells on the device, and its update between sweeps.

The sweeps give D = sum w (I - S); the kernels of kernels/source_update.cl make a source, a
residual of GMRES or a correction of it (stages 1 to 3 of `trace_source`).
"""

from typing import Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from cldit.arrays import Reals
from cldit.gpu.buffers import download, unset, upload, zeros
from cldit.gpu.device import Device
from cldit.gpu.program import Program
from cldit.transport.angular_moments import MOMENTS
from cldit.transport.cells import OpticalCells, mean_transmission
from cldit.transport.discrete_ordinates.cell_packets import Real
from cldit.transport.discrete_ordinates.krylov import KrylovSpace
from cldit.transport.discrete_ordinates.scattering_cells import ScatteringCells


class ScatteredSource:
    """Source of the scattering cells, as lists on the device.

    count, components: number N of scattering cells, number C of components.
    albedo, opacity: (N,) of the scattering cells; absorbed share along an edge.
    thermal: (C, N) their thermal source.
    one_minus_lambda: (N,) 1 - Lambda*, the preconditioner (Kunasz and Auer, JQSRT 39, 1988).
    linear_cells: (K,) numbers of the scattering cells that have a gradient.
    real: the device's precision.
    """

    def __init__(
        self,
        device: Device,
        cells: OpticalCells,
        update: Program,
        *,
        moments: int,
        real: Real,
        linear_cells: NDArray[np.intp],
    ) -> None:
        """Uploads the lists of `cells`, whose source has so many angular moments.

        `update` is source_update.cl.
        """
        self.device, self.real = device, real
        self.count = len(cells.address)
        self.components = len(cells.needs.components)
        self.boundaries = cells.needs.boundaries
        self.linear_cells = linear_cells
        depth = cells.depth[cells.address]
        self.albedo = cells.albedo
        self.opacity: NDArray[Any] = (1.0 - np.exp(-depth)).astype(real)
        self.thermal: NDArray[Any] = cells.thermal_source().astype(real)
        # The mean path through a cell is 4 V / S, 2/3 of its edge.
        escapes = mean_transmission(2 / 3 * depth)
        self.one_minus_lambda: NDArray[Any] = (cells.coalbedo + cells.albedo * escapes).astype(real)
        self._emission = upload(device, "emission", self.thermal)
        self._albedo = upload(device, "albedo", cells.albedo.astype(real))
        self._coalbedo = upload(device, "coalbedo", cells.coalbedo.astype(real))
        self._linear = upload(device, "linear cells", linear_cells.astype(np.int32))
        self._one_minus_lambda = upload(device, "1 - Lambda*", self.one_minus_lambda)
        self._cells = ScatteringCells.of(
            device,
            update,
            components=self.components,
            planes=moments * self.components,
            count=self.count,
            real=real,
        )
        self._listed = self._cells.unset(self.components)  # D of the last sweep
        self._out = zeros(device, "answer", self.components * self.count, real)

    @property
    def source(self) -> Any:
        """List of the present source, with MOMENT_SOURCE of all moments."""
        return self._cells.source

    def listed(self, values: Any) -> Any:
        """Uploads an array in the device's precision, unless it is on the device."""
        on_device = isinstance(values, cl.MemoryObject)
        return values if on_device else upload(self.device, "list", values.astype(self.real))

    def unset_light(self, moments: int) -> Any:
        """List for so many angular moments of all components."""
        return self._cells.unset(moments * self.components)

    def read(self, listed: Any, moments: int = 1) -> NDArray[Any]:
        """Downloads the first moments (M C, N) of a list."""
        return self._cells.read(listed, moments * self.components)

    def read_gradient(self, gradient: Any) -> NDArray[Any]:
        """Downloads a gradient (3, C, K) in `linear_cells`."""
        out = np.empty((3, self.components, len(self.linear_cells)), self.real)
        return download(self.device, gradient, out)

    def _radiance(self, out: Any, listed: Any, offsets: Reals | None, *, weight: float) -> None:
        """Moments of the radiance from those of I - S; `offsets` (8,) of radiance 1, or None."""
        self._cells.run(
            "radiance_moments",
            {"count": self.count},
            high=self.components,
            out=out,
            i_minus_s=listed,
            listed=self.source,
            offsets=self.listed(np.zeros(1) if offsets is None else offsets),
            weight=weight,
            moments=1 if offsets is None else MOMENTS,
        )

    def _scatter(self, out: Any, light: Any, ratios: Reals | None) -> None:
        """Source of radiance that scatters, see `scatter`."""
        table = np.zeros((1, 1)) if ratios is None else ratios
        self._cells.run(
            "scattered_source",
            {"count": self.count},
            high=self.components,
            listed=out,
            light=light,
            emission=self._emission,
            albedo=self._albedo,
            ratios=self.listed(table),
            alike=int(table.shape[1] == 1),
            moments=1 if ratios is None else MOMENTS,
        )

    def limited_gradient(self, light: Any, source: Any) -> Any:
        """Gradient (3, C, K) of the source in the linear cells, limited to positive sources.

        `light` (3, C, K) is the gradient of the radiance there, and `source` (C or more, N) the
        source of all scattering cells, the mean first; both on the device or arrays.
        """
        count = len(self.linear_cells)
        out = unset(self.device, "spatial gradient", 3 * self.components * count, self.real)
        self._cells.run(
            "limited_gradients",
            {"count": count},
            gradient=out,
            light_gradient=self.listed(light),
            listed=self.listed(source),
            albedo=self._albedo,
            linear=self._linear,
            cells=self.count,
        )
        return out

    def krylov(self) -> KrylovSpace:
        """Empty Krylov space of the scattering cells, which sets the source."""
        return KrylovSpace(self._cells, self.opacity)

    def residual(
        self, space: KrylovSpace, out: Any, *, shining: bool, listed: Any = None, number: int = 0
    ) -> None:
        """Writes the preconditioned residual after a sweep of the present source to `out`.

        With `shining` the emission counts. `out` is a vector of `space`, with the first `number`
        vectors of which it is multiplied; `listed` is the list of `room` with D; None: the
        sweeper's own.
        """
        space.residual(
            out,
            number=number,
            i_minus_s=self._listed if listed is None else listed,
            emission=self._emission,
            albedo=self._albedo,
            coalbedo=self._coalbedo,
            one_minus_lambda=self._one_minus_lambda,
            shine=float(shining),
        )

    def corrected(
        self, space: KrylovSpace, solution: Any, light: Any = None, residual: Any = None
    ) -> Any:
        """List (C, N) of a solution with the corrections of `space`.

        The mean radiance of the list `light` gets what these add; `residual` is the vector before.
        """
        out = self.unset_light(1)
        self._cells.run(
            "correct",
            {"count": self.count},
            high=self.components,
            out=out,
            light=out if light is None else light,
            solution=solution,
            onto=space.onto,
            first=space.onto if light is None else residual,
            albedo=self._albedo,
            one_minus_lambda=self._one_minus_lambda,
            lit=int(light is not None),
            stride=space.stride,
        )
        return out

    def next_order(self) -> Any:
        """List of the source a (S + D) + E, (C, N), after one more scattering."""
        out = self.unset_light(1)
        self._radiance(out, self._listed, None, weight=1.0)
        self._scatter(out, out, None)
        return out
