"""Discrete ordinates sweeps on the device: moments of the radiance from the present source.

Stages 1 to 3 of `trace_source` use it (kernels/sweep.cl, kernels/source_update.cl).
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from cldit.arrays import Reals
from cldit.gpu.buffers import clear, download, unset, upload, zeros
from cldit.gpu.device import Device
from cldit.gpu.program import Program
from cldit.transport.angular_moments import MOMENTS, discrete_to_moment
from cldit.transport.boundary import NONE, shifted
from cldit.transport.cells import OpticalCells, SweptBox, mean_transmission
from cldit.transport.discrete_ordinates.axis_order import axis_orders
from cldit.transport.discrete_ordinates.blurred_boundary import BlurredBoundary
from cldit.transport.discrete_ordinates.camera_sweep import CameraSweep
from cldit.transport.discrete_ordinates.cell_packets import CellPackets
from cldit.transport.discrete_ordinates.device_ordinates import DeviceOrdinates
from cldit.transport.discrete_ordinates.gradients import Gradients
from cldit.transport.discrete_ordinates.interface_radiance import InterfaceRadiance
from cldit.transport.discrete_ordinates.krylov import KrylovSpace
from cldit.transport.discrete_ordinates.quadrature import Ordinates
from cldit.transport.discrete_ordinates.scattering_cells import (
    BOTH,
    Boxes,
    Orders,
    ScatteringCells,
)
from cldit.transport.discrete_ordinates.sweep_arrays import Real, SweepArrays
from cldit.transport.discrete_ordinates.sweep_schedule import SweepSchedule
from cldit.transport.tuning import Tuning

_PER_MOMENT = 12  # gradient over the first moment of a linear field in a cell
_MEAN_PATH = 2 / 3  # through a cell, in units of its edge: 4 V / S

_TOGETHER = 32  # ordinates of a schedule; more would need more memory for rays
_EDGE = 16  # largest number of rows and layers of a tile, for the cache of a CPU core
_TILES = 4  # smallest mean number for each core in a launch
_GROUP = 32  # rays of a row that a group of work-items follows
_APART = 1 / 32  # share of the memory up to which either order of packets has a box of its own


class Sweeper:
    """Swept box on the device.

    It has the cells in packets along x, and again along y (turned), so that rays along x traverse
    rows of memory as those along y and z do. For each order of packets a sweep puts the source of
    the scattering cells into the box, and collects D = sum w (I - S) q from it.

    box, count, components: swept box, number N of scattering cells, number C of components.
    albedo, opacity: (N,) of the scattering cells; absorbed share along an edge.
    thermal: (C, N) their thermal source.
    one_minus_lambda: (N,) 1 - Lambda*, the preconditioner (Kunasz and Auer, JQSRT 39, 1988).
    linear_cells: (K,) numbers of the scattering cells that have a gradient.
    gradients: finite differences of neighbours; None: `set_source` receives the gradient.
    sweeps: ordinates swept so far. real: the device's precision.
    """

    def __init__(
        self,
        device: Device,
        cells: OpticalCells,
        sweep: Program,
        iterate: Program,
        *,
        disc: NDArray[np.float64],
        patches: NDArray[np.float64] = NONE,
        linear_cells: NDArray[np.bool_] | None = None,
        tuning: Tuning | None = None,
    ) -> None:
        """Uploads the box of `cells`.

        Args:
            sweep: sweep.cl. With MOMENT_SOURCE sources have angular moments; with LINEAR_SOURCE
                they have spatial gradients, from neighbours.
            iterate: source_update.cl.
            disc, patches: as in `View`, in cells from the cube's lower corner.
            linear_cells: (N,) mask of scattering cells with a gradient in other programs with
                LINEAR_SOURCE; `set_source` then receives it.
        """
        self.device = device
        self.tuning = tuning or Tuning()
        self.box: SweptBox = cells.box()
        self.count = len(cells.address)
        self.components = len(cells.needs.components)
        self.boundaries = cells.needs.boundaries
        self._sweep = sweep
        self._by_ray = sweep.defines["SIMD_WIDTH"] == 1
        self._planes = self.components * (MOMENTS if "MOMENT_SOURCE" in sweep.defines else 1)
        linear = "LINEAR_SOURCE" in sweep.defines
        self.linear_cells = np.flatnonzero(
            np.full(self.count, linear) if linear_cells is None else linear_cells
        )
        self.real: Real = np.float64 if "USE_FLOAT64" in sweep.defines else np.float32
        self.sum_type: type[np.generic] = np.int64 if self._by_ray else self.real
        self._disc = disc.copy()
        self._disc[:3] -= self.box.low
        inside = shifted(patches, -np.asarray(self.box.low, float)).astype(self.real)
        self._patches = {"patches": upload(device, "patches", inside)} if len(patches) else {}
        self._emits: tuple[bool, bool] | None = None
        self._shining = False
        self.sweeps = 0
        self._take_boxes(cells)
        # RAY_PLANES of blurred_boundary.h: values of a ray.
        excesses = self.boundaries - 1 if "BLURRED_BOUNDARY" in sweep.defines else 0
        self.ray_planes = self.components + excesses
        self._take_rays()
        self.gradients = (
            Gradients.of(cells, self.box, self.tuning) if linear and linear_cells is None else None
        )
        self._neighbours: dict[str, Any] = {}
        if self.gradients is not None:
            weights = self.gradients.weights.astype(self.real)
            self._neighbours = {
                "neighbours": upload(device, "neighbours", self.gradients.neighbours),
                "weights": upload(device, "neighbours' weights", weights),
            }
        self._take_cells(cells, iterate)

    def _take_boxes(self, cells: OpticalCells) -> None:
        """Uploads the cells in packets, in both orders, with room for their source."""
        self.packets = CellPackets.both(cells, self.box)
        self._order = {
            turned: SweepArrays.of(
                self.device,
                cells,
                self.box,
                packets,
                self.real,
                turned=turned,
                linear_cells=self.linear_cells,
                by_ray=self._by_ray,
            )
            for turned, packets in self.packets.items()
        }
        self._places = {turned: order.place for turned, order in self._order.items()}
        self._linear_places = {turned: o.gradient_place for turned, o in self._order.items()}
        number_bytes = np.dtype(self.real).itemsize + np.dtype(self.sum_type).itemsize
        packed_bytes = sum(packets.cells for packets in self.packets.values()) * number_bytes
        self._apart = packed_bytes * self._planes < _APART * self.device.info.memory_bytes
        self._source = self._boxes("source", self._planes, self.real)

    def _take_rays(self) -> None:
        """Sets how many ordinates are swept together, with room for their rays."""
        self._together, self._edge = self.device.info.largest_buffer_bytes, max(self.box.shape)
        self._rays: dict[str, Any] = {}
        if self._by_ray:
            return
        ray_values = max(
            layout.ray_rows * self.ray_planes * layout.slots
            for layout in axis_orders(self.box.shape).values()
        )
        fit = self._together // (ray_values * np.dtype(self.real).itemsize)
        self._together, self._edge = max(1, min(_TOGETHER, fit)), self._tile_edge()
        self._rays = {"rays": zeros(self.device, "rays", self._together * ray_values, self.real)}

    def _take_cells(self, cells: OpticalCells, iterate: Program) -> None:
        """Uploads the lists of the scattering cells, with room for the sums of a sweep."""
        device, real = self.device, self.real
        depth = cells.depth[cells.address]
        self.albedo = cells.albedo
        self.opacity: NDArray[Any] = (1.0 - np.exp(-depth)).astype(real)
        self.thermal: NDArray[Any] = cells.thermal_source().astype(real)
        escapes = mean_transmission(_MEAN_PATH * depth)
        self.one_minus_lambda: NDArray[Any] = (cells.coalbedo + cells.albedo * escapes).astype(real)
        self._emission = upload(device, "emission", self.thermal)
        self._albedo = upload(device, "albedo", cells.albedo.astype(real))
        self._coalbedo = upload(device, "coalbedo", cells.coalbedo.astype(real))
        self._linear = upload(device, "linear cells", self.linear_cells.astype(np.int32))
        self._one_minus_lambda = upload(device, "1 - Lambda*", self.one_minus_lambda)
        self._cells = ScatteringCells.of(
            device,
            iterate,
            components=self.components,
            planes=self._planes,
            count=self.count,
            real=real,
        )
        self._i_minus_s, self._listed = self.room(1)
        self._out = zeros(device, "answer", self.components * self.count, real)

    def _tile_edge(self) -> int:
        """Edge of a tile, equal for all partitions of a device: sums are bit-identical."""
        cores = sum(device.info.compute_units for device in (self.device, *self.device.others))
        # n x n tiles need 2 n launches, from four corners.
        return max(1, min(_EDGE, 2 * max(self.box.shape) // (_TILES * cores)))

    def set_source(
        self,
        listed: Any,
        *,
        shining: bool,
        gradient: Any = None,
    ) -> None:
        """Sets the source of the scattering cells for every sweep that follows.

        Args:
            listed: list (C, N), with MOMENT_SOURCE (9 C, N), or an array of it; None: a kernel has
                put it into `source`.
            shining: all other cells have their thermal source; else they are black.
            gradient: (3, C, K) of the isotropic part in `linear_cells`, on the device or an array,
                unless neighbours give it.
        """
        self._shining = shining
        if listed is not None:
            source_list = self.listed(listed)
            cl.enqueue_copy(
                self.device.queue, self.source, source_list, byte_count=source_list.size
            )
        if gradient is not None:
            boxes = {turned: order.gradient for turned, order in self._order.items()}
            sizes = {"planes": 3 * self.components, "count": len(self.linear_cells)}
            self._cells.put(self.listed(gradient), boxes, self._linear_places, BOTH, **sizes)
        if self._neighbours:
            straight, turned = self._order[False], self._order[True]
            self._cells.run(
                "set_gradients",
                {"count": self.count},
                gradient=straight.gradient,
                gradient_turned=turned.gradient,
                listed=self._cells.source,
                place=straight.gradient_place,
                turned=turned.gradient_place,
                **self._neighbours,
            )

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

    def _fill(self, orders: Orders, *, cavity: bool) -> None:
        """Puts the source into the boxes of these orders; `cavity`: all other cells emit 1.

        A box of its own keeps the emission of the other cells from sweep to sweep.
        """
        if not self._apart or self._emits != (self._shining, cavity):
            for order in (self._order[turned] for turned in orders):
                box = self._source[order.turned]
                clear(self.device, box, self._planes * order.packets.cells, self.real)
                if self.components > self.boundaries and self._shining:
                    self._cells.run(
                        "emit",
                        {"packets": len(order.packets)},
                        source=box,
                        thermal=order.thermal,
                        cavity=int(cavity),
                        planes=self._planes,
                    )
            self._emits = (self._shining, cavity)
        sizes = {"planes": self._planes, "count": self.count}
        self._cells.put(self.source, self._source, self._places, orders, **sizes)

    def _boxes(self, label: str, planes: int, dtype: type[np.generic]) -> Boxes:
        """Buffer of either order's box; the orders share one if memory is short."""
        sizes = {turned: planes * packets.cells for turned, packets in self.packets.items()}
        if self._apart:
            return {turned: unset(self.device, label, sizes[turned], dtype) for turned in BOTH}
        return dict.fromkeys(BOTH, unset(self.device, label, max(sizes.values()), dtype))

    def room(self, moments: int) -> tuple[Any, ...]:
        """Buffers for so many angular moments of I - S, in the boxes and in the list.

        Sweeps clear and write them. All sweepers of this box can share them.
        """
        planes = moments * self.components
        return self._boxes("I - S", planes, self.sum_type), self._cells.unset(planes)

    def rays(self, directions: Ordinates, starts: NDArray[np.float64]) -> DeviceOrdinates:
        """Ordinates on the device, for any number of sweeps.

        Rays of each cross the cells of the first layer at `starts` (N, 2), 0 to 1.
        """
        return DeviceOrdinates.of(
            self.device,
            self.box,
            directions,
            starts,
            batch=self._together,
            edge=None if self._by_ray else self._edge,
            real=self.real,
        )

    def sweep(self, rays: DeviceOrdinates, *, shining: bool, cavity: bool = False) -> None:
        """Sweeps all ordinates; D of the present source is then on the device.

        With `shining` the boundary emits, with `cavity` all cells that do not scatter emit 1.
        """
        room = (self._i_minus_s, self._listed, self.components)
        self._sweep_all(self._sweep, rays, shining, *room, cavity=cavity)

    def moments(
        self,
        program: Program,
        rays: DeviceOrdinates,
        *,
        out: Any,
        room: tuple[Any, ...] = (),
        interfaces: InterfaceRadiance | None = None,
        since: Any = None,
    ) -> Any:
        """Sweeps all ordinates for the angular moments of the radiance in the scattering cells.

        Moments beyond the mean are those of the radiance less its mean, which are 0 for isotropic
        radiance with any quadrature.

        Args:
            program: sweep.cl, for 9 moments with ANGULAR_MOMENTS.
            out: list (9 or 1, C, N), which receives the moments.
            room: buffers of `room(MOMENTS)`, with ANGULAR_MOMENTS.
            interfaces: receives the stored radiance, with INTERFACE_RADIANCE.
            since: gradient (3, C, K) of the source on the device, which is added to the result.

        Returns:
            With SPATIAL_MOMENTS the gradient (3, C, K) of I - S in `linear_cells` on the device,
            else None.
        """
        planes = self.components * (MOMENTS if "ANGULAR_MOMENTS" in program.defines else 1)
        i_minus_s, listed = (self._i_minus_s, self._listed) if planes == self.components else room
        gradient = self._sweep_all(
            program, rays, True, i_minus_s, listed, planes, interfaces=interfaces
        )
        weight = rays.directions.weight
        of_isotropic = discrete_to_moment(rays.directions.unit) @ weight / weight.sum()
        offsets = None if planes == self.components else of_isotropic
        self._radiance(out, listed, offsets, weight=float(weight.sum()))
        if gradient is not None:
            self._cells.run(
                "radiance_gradient",
                {"count": 3 * self.components * len(self.linear_cells)},
                gradient=gradient,
                source_gradient=gradient if since is None else since,
                scale=float(_PER_MOMENT / weight.sum()),
                since=int(since is not None),
            )
        return gradient

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

    def scatter(self, light: Any, gradient: Any, ratios: Reals | None) -> Any:
        """Makes the radiance, scattered once more, the source of the sweeps that follow.

        Args:
            light: list (M, C, N) of its angular moments.
            gradient: its spatial gradient (3, C, K) on the device; None: there is none.
            ratios: (8, N) or (8, 1) of the source's moments to the radiance's, over the albedo;
                None: the mean is the only moment.

        Returns:
            Limited gradient (3, C, K) of the source on the device, or None.
        """
        self._scatter(self.source, light, ratios)
        limited = None if gradient is None else self.limited_gradient(gradient, self.source)
        self.set_source(None, shining=True, gradient=limited)
        return limited

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

    def _sweep_all(
        self,
        program: Program,
        rays: DeviceOrdinates,
        shining: bool,
        i_minus_s: Boxes,
        listed: Any,
        planes: int,
        camera: CameraSweep | None = None,
        *,
        interfaces: InterfaceRadiance | None = None,
        extra: Mapping[str, Any] | None = None,
        cavity: bool = False,
    ) -> Any:
        """Sweeps all ordinates, both orders of packets at once if they have boxes of their own.

        `listed` receives the planes of the boxes `i_minus_s` for the scattering cells. Returns,
        with SPATIAL_MOMENTS, the moments (3, C, K) of I - S in `linear_cells` on the device.
        """
        spatial = self._spatial_room() if "SPATIAL_MOMENTS" in program.defines else None
        parts = {"planes": planes, "count": self.count}
        sizes = {"planes": 3 * self.components, "count": len(self.linear_cells)}
        linear = "LINEAR_SOURCE" in program.defines
        for orders in (BOTH,) if self._apart else ((False,), (True,)):
            self._fill(orders, cavity=cavity)
            for order in (self._order[turned] for turned in orders):
                box, turned = i_minus_s[order.turned], order.turned
                clear(self.device, box, planes * order.packets.cells, self.sum_type)
                box_arguments = {
                    "i_minus_s": box,
                    **({"gradient": order.gradient} if linear else {}),
                }
                if spatial is not None:
                    box_arguments["spatial_moments"] = spatial[0][turned]
                    clear(self.device, spatial[0][turned], 3 * order.linear_size, self.sum_type)
                if camera is not None:
                    clear(self.device, camera.shares[turned], order.packets.cells, self.sum_type)
                for schedule, tables, basis in rays.sweep_schedules:
                    if schedule.layout.turned is not turned:
                        continue
                    arguments = {**box_arguments, **tables, **(extra or {})}
                    arguments |= {} if spatial is None else basis
                    if camera is not None:
                        arguments |= camera.arguments(schedule.layout)
                    if interfaces is not None:
                        arguments |= interfaces.arguments(schedule.layout)
                    self._launch(program, schedule, shining, arguments)
            self._cells.collect(listed, i_minus_s, self._places, orders, **parts)
            if spatial is not None:
                self._cells.collect(spatial[1], spatial[0], self._linear_places, orders, **sizes)
        self.sweeps += len(rays.directions)
        return None if spatial is None else spatial[1]

    def _spatial_room(self) -> tuple[Boxes, Any]:
        """Buffers as of `room`, for the spatial moments of I - S in `linear_cells`."""
        sizes = {turned: 3 * order.linear_size for turned, order in self._order.items()}
        listed = 3 * self.components * len(self.linear_cells)
        boxes = {t: unset(self.device, "I - S", size, self.sum_type) for t, size in sizes.items()}
        return boxes, unset(self.device, "list", listed, self.real)

    def _launch(
        self, program: Program, schedule: SweepSchedule, shining: bool, arguments: dict[str, Any]
    ) -> None:
        """Launches the kernel for all rays at once, or tile by tile.

        `arguments` are added to those of box and boundary.
        """
        layout = schedule.layout
        order = self._order[layout.turned]
        nu, nv, nl = (int(count) for count in layout.size)
        shared = {
            "slots": int(layout.slots),
            "packets": order.rows,
            "begins": order.begins,
            "depth": order.depth,
            "source": self._source[layout.turned],
            "layout": int(layout.number),
            "nu": nu,
            "nv": nv,
            "nl": nl,
            "stride_v": int(layout.stride_v),
            "stride_l": int(layout.stride_l),
            "inflow": float(shining),
            "disc": self._disc.astype(self.real),
            **self._patches,
            **arguments,
        }
        if self._by_ray:
            size = (int(layout.slots), int(layout.ray_rows), len(schedule))
            group = min(_GROUP, program.largest_group("sweep"))
            shared["places"] = order.packets.number.shape[1]
            program.launch("sweep", size, (group, 1, 1), shared)
            return
        program.launch_each(
            "sweep",
            [int(end - tile) for tile, end in schedule.launches],
            1,
            "first_tile",
            [int(tile) for tile, _ in schedule.launches],
            {**self._rays, "ray_rows": int(layout.ray_rows), **shared},
        )

    def defect(
        self, solution: Any, rays: DeviceOrdinates, residual: Any = None, *, scattered: bool = False
    ) -> NDArray[np.float64]:
        """Mean radiance (N,) of the scattering cells, less 1, in a cavity of radiance 1.

        The cells emit 1 less the boundary's part of their source `solution` (C, N), a list; all
        other cells emit 1. The boundary's part of the vector `residual`, which with `scattered` is
        scattered once more, is removed from it.
        """
        self._cells.run(
            "cavity_source", {"count": self.count}, listed=self.source, solution=solution
        )
        self.set_source(None, shining=True)
        self.sweep(rays, shining=True, cavity=True)
        self._cells.run(
            "cavity_defect",
            {"count": self.count},
            out=self._out,
            i_minus_s=self._listed,
            listed=self.source,
            residual=self.source if residual is None else residual,
            albedo=self._albedo,
            weight=float(rays.directions.weight.sum()),
            times=-1 if residual is None else int(scattered),
            stride=self._cells.stride,
        )
        return np.asarray(self._cells.read(self._out, 1)[0], np.float64)

    def view_weighted_mean(
        self,
        camera: CameraSweep,
        rays: DeviceOrdinates,
        interfaces: InterfaceRadiance | None = None,
        blurred: BlurredBoundary | None = None,
    ) -> tuple[NDArray[Any], NDArray[Any] | None]:
        """Sweeps all ordinates for the mean radiance (C, N) with the camera's weights.

        `interfaces` receives the stored radiance, with INTERFACE_RADIANCE; `blurred` is the
        boundary along these ordinates, with BLURRED_BOUNDARY. The second result is the gradient as
        in `moments`.
        """
        room = (self._i_minus_s, self._listed, self.components)
        extra = {} if blurred is None else blurred.arguments
        gradient = self._sweep_all(
            camera.program, rays, True, *room, camera, interfaces=interfaces, extra=extra
        )
        self._cells.run(
            "weighted_mean",
            {"count": self.count},
            out=self._out,
            i_minus_s=self._listed,
            listed=self.source,
            shares=camera.shares[False],
            shares_turned=camera.shares[True],
            place=self._order[False].place,
            turned=self._order[True].place,
        )
        mean = self._cells.read(self._out)
        if gradient is None:
            return mean, None
        sizes_of_share = {"planes": 1, "count": self.count}
        self._cells.collect(self._out, camera.shares, self._places, BOTH, **sizes_of_share)
        shares = download(self.device, self._out, np.empty(self.count, self.real))[
            self.linear_cells
        ]
        share = np.divide(1, shares, out=np.zeros_like(shares), where=shares > 0)
        return mean, self.real(_PER_MOMENT) * share * self.read_gradient(gradient)

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
