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
from cldit.transport.cells import OpticalCells, SweptBox
from cldit.transport.discrete_ordinates.axis_order import axis_orders
from cldit.transport.discrete_ordinates.camera_sweep import CameraSweep
from cldit.transport.discrete_ordinates.cell_packets import Real
from cldit.transport.discrete_ordinates.device_ordinates import DeviceOrdinates
from cldit.transport.discrete_ordinates.gradients import Gradients
from cldit.transport.discrete_ordinates.interface_radiance import InterfaceRadiance
from cldit.transport.discrete_ordinates.quadrature import Ordinates
from cldit.transport.discrete_ordinates.scattering_cells import BOTH, Boxes
from cldit.transport.discrete_ordinates.source_update import ScatteredSource
from cldit.transport.discrete_ordinates.sweep_schedule import SweepSchedule
from cldit.transport.discrete_ordinates.swept_boxes import SweptBoxes
from cldit.transport.tuning import Tuning

_PER_MOMENT = 12  # gradient over the first moment of a linear field in a cell: 1 / mean of x^2


class Sweeper(ScatteredSource):
    """Source of the scattering cells, and the sweeps of it.

    For each order of packets a sweep puts the source into the box, and collects D = sum w (I - S) q
    from it.

    box, boxes: the swept box, and its cells on the device.
    gradients: finite differences of neighbours; None: `set_source` receives the gradient.
    ray_planes: values of a ray. sweeps: ordinates swept so far.
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
        real: Real = np.float64 if "USE_FLOAT64" in sweep.defines else np.float32
        linear = "LINEAR_SOURCE" in sweep.defines
        moments = MOMENTS if "MOMENT_SOURCE" in sweep.defines else 1
        mask = np.full(len(cells.address), linear) if linear_cells is None else linear_cells
        numbers = np.flatnonzero(mask)
        super().__init__(device, cells, iterate, moments=moments, real=real, linear_cells=numbers)
        self.tuning = tuning or Tuning()
        self.box: SweptBox = cells.box()
        self._sweep = sweep
        self._by_ray = sweep.defines["SIMD_WIDTH"] == 1
        self.boxes = SweptBoxes(
            device,
            cells,
            self.box,
            planes=moments * self.components,
            real=real,
            sum_type=np.int64 if self._by_ray else real,
            linear_cells=self.linear_cells,
            by_ray=self._by_ray,
        )
        self._i_minus_s = self.boxes.unset("I - S", self.components, self.boxes.sum_type)
        self._disc = disc.copy()
        self._disc[:3] -= self.box.low
        inside = shifted(patches, -np.asarray(self.box.low, float)).astype(self.real)
        self._patches = {"patches": upload(device, "patches", inside)} if len(patches) else {}
        self._shining = False
        self.sweeps = 0
        # RAY_PLANES of blurred_boundary.h: values of a ray.
        excesses = self.boundaries - 1 if "BLURRED_BOUNDARY" in sweep.defines else 0
        self.ray_planes = self.components + excesses
        self._take_rays()
        self.gradients = (
            Gradients.of(cells, self.box, self.tuning) if linear and linear_cells is None else None
        )
        self._neighbours = {} if self.gradients is None else self.gradients.upload(device, real)

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
        # More than 32 ordinates of a schedule would need more memory for rays.
        self._together = max(1, min(32, fit))
        self._rays = {"rays": zeros(self.device, "rays", self._together * ray_values, self.real)}
        # Equal for all partitions of a device, so that sums are bit-identical. Cells and rays of 16
        # rows and layers are in the cache of a CPU core; n x n tiles need 2 n launches, from four
        # corners, and a launch needs four tiles for each core on average.
        cores = sum(device.info.compute_units for device in (self.device, *self.device.others))
        self._edge = max(1, min(16, 2 * max(self.box.shape) // (4 * cores)))

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
            boxes = {turned: packets.gradient for turned, packets in self.boxes.packets.items()}
            sizes = {"planes": 3 * self.components, "count": len(self.linear_cells)}
            self._cells.put(self.listed(gradient), boxes, self.boxes.linear_places, BOTH, **sizes)
        if self._neighbours:
            straight, turned = self.boxes.packets[False], self.boxes.packets[True]
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

    def room(self, moments: int) -> tuple[Any, ...]:
        """Buffers for so many angular moments of I - S, in the boxes and in the list.

        Sweeps clear and write them. All sweepers of this box can share them.
        """
        planes = moments * self.components
        return self.boxes.unset("I - S", planes, self.boxes.sum_type), self._cells.unset(planes)

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
        linear, sum_type = "LINEAR_SOURCE" in program.defines, self.boxes.sum_type
        for orders in (BOTH,) if self.boxes.apart else ((False,), (True,)):
            self.boxes.fill(
                self._cells,
                orders,
                emits=self.components > self.boundaries,
                shining=self._shining,
                cavity=cavity,
            )
            for packets in (self.boxes.packets[turned] for turned in orders):
                box, turned = i_minus_s[packets.turned], packets.turned
                clear(self.device, box, planes * packets.cells, sum_type)
                box_arguments = {
                    "i_minus_s": box,
                    **({"gradient": packets.gradient} if linear else {}),
                }
                if spatial is not None:
                    box_arguments["spatial_moments"] = spatial[0][turned]
                    clear(self.device, spatial[0][turned], 3 * packets.linear_size, sum_type)
                if camera is not None:
                    clear(self.device, camera.shares[turned], packets.cells, sum_type)
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
            self._cells.collect(listed, i_minus_s, self.boxes.places, orders, **parts)
            if spatial is not None:
                self._cells.collect(
                    spatial[1], spatial[0], self.boxes.linear_places, orders, **sizes
                )
        self.sweeps += len(rays.directions)
        return None if spatial is None else spatial[1]

    def _spatial_room(self) -> tuple[Boxes, Any]:
        """Buffers as of `room`, for the spatial moments of I - S in `linear_cells`."""
        sizes = {turned: 3 * packets.linear_size for turned, packets in self.boxes.packets.items()}
        listed = 3 * self.components * len(self.linear_cells)
        boxes = {
            t: unset(self.device, "I - S", size, self.boxes.sum_type) for t, size in sizes.items()
        }
        return boxes, unset(self.device, "list", listed, self.real)

    def _launch(
        self, program: Program, schedule: SweepSchedule, shining: bool, arguments: dict[str, Any]
    ) -> None:
        """Launches the kernel for all rays at once, or tile by tile.

        `arguments` are added to those of box and boundary.
        """
        layout = schedule.layout
        packets = self.boxes.packets[layout.turned]
        nu, nv, nl = (int(count) for count in layout.size)
        shared = {
            "slots": int(layout.slots),
            "packets": packets.rows,
            "begins": packets.begins,
            "depth": packets.depth,
            "source": self.boxes.source[layout.turned],
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
            group = min(32, program.largest_group("sweep"))  # neighbouring rays of a row
            shared["places"] = packets.number.shape[1]
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
        blurred: Mapping[str, Any] | None = None,
    ) -> tuple[NDArray[Any], NDArray[Any] | None]:
        """Sweeps all ordinates for the mean radiance (C, N) with the camera's weights.

        `interfaces` receives the stored radiance, with INTERFACE_RADIANCE; `blurred`, of
        `upload_blurred`, is the boundary along these ordinates, with BLURRED_BOUNDARY. The second
        result is the gradient as in `moments`.
        """
        room = (self._i_minus_s, self._listed, self.components)
        gradient = self._sweep_all(
            camera.program, rays, True, *room, camera, interfaces=interfaces, extra=blurred
        )
        self._cells.run(
            "weighted_mean",
            {"count": self.count},
            out=self._out,
            i_minus_s=self._listed,
            listed=self.source,
            shares=camera.shares[False],
            shares_turned=camera.shares[True],
            place=self.boxes.packets[False].place,
            turned=self.boxes.packets[True].place,
        )
        mean = self._cells.read(self._out)
        if gradient is None:
            return mean, None
        sizes_of_share = {"planes": 1, "count": self.count}
        self._cells.collect(self._out, camera.shares, self.boxes.places, BOTH, **sizes_of_share)
        shares = download(self.device, self._out, np.empty(self.count, self.real))[
            self.linear_cells
        ]
        share = np.divide(1, shares, out=np.zeros_like(shares), where=shares > 0)
        return mean, self.real(_PER_MOMENT) * share * self.read_gradient(gradient)
