"""Sweeps on the device: the mean radiance of every scattering cell from the present source."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.buffers import clear, download, unset, upload, zeros
from cldit.gpu.device import Device
from cldit.gpu.program import Program
from cldit.transport.angular_moments import MOMENTS, discrete_to_moment
from cldit.transport.attenuation import mean_transmission
from cldit.transport.cells import Box, OpticalCells
from cldit.transport.discrete_ordinates.axis_order import AxisOrder, axis_orders
from cldit.transport.discrete_ordinates.camera_sweep import CameraSweep
from cldit.transport.discrete_ordinates.cell_packets import CellPackets
from cldit.transport.discrete_ordinates.device_ordinates import DeviceOrdinates
from cldit.transport.discrete_ordinates.gradients import Gradients
from cldit.transport.discrete_ordinates.interface_radiance import InterfaceRadiance
from cldit.transport.discrete_ordinates.quadrature import Ordinates
from cldit.transport.discrete_ordinates.scattering_cells import ScatteringCells
from cldit.transport.discrete_ordinates.sweep_arrays import Real, SweepArrays
from cldit.transport.discrete_ordinates.sweep_schedule import SweepSchedule
from cldit.transport.patches import NONE, shifted
from cldit.transport.tuning import Tuning

# Light that changes by 1 across a cell has, times the place in it, 1 over this for its mean.
_FLAT = 12
_MEAN_PATH = 2 / 3  # through a cell, in units of its edge: 4 V / S

_TOGETHER = 32  # directions: more take memory for rays
# Rows and layers of a tile, at most, which a CPU's core has at hand; and so many tiles on average,
# at least, for each of its cores in a launch.
_EDGE = 16
_TILES = 4


class Sweeper:
    """The swept box on the device.

    Holds optical depths in groups of cells along x, and once more in groups along y (turned), so
    that rays along x go through rows of memory as those along y and z do. The source is put into
    the one and then into the other, from the list of scattering cells, and the excess found there
    and listed.
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
        """disc, patches: as in `View`, in cells from the cube's lower corner. sweep: with
        MOMENT_SOURCE,
        sources have moments; with LINEAR_SOURCE, they change across cells as neighbours' sources
        have it.
        changing (N,): in programs with LINEAR_SOURCE they change across these instead, by what is
        given."""
        self.device = device
        self.tuning = tuning or Tuning()
        self.box: Box = cells.box()
        self.count = len(cells.address)
        self.components = len(cells.needs.components)
        self._boundaries = cells.needs.boundaries
        self._sweep = sweep
        self._vector = int(sweep.defines["SIMD_WIDTH"])
        self._planes = self.components * (MOMENTS if "MOMENT_SOURCE" in sweep.defines else 1)
        linear = "LINEAR_SOURCE" in sweep.defines
        self.linear_cells = np.flatnonzero(
            np.full(self.count, linear) if linear_cells is None else linear_cells
        )
        self._real: Real = np.float64 if "USE_FLOAT64" in sweep.defines else np.float32
        self._disc = disc.copy()
        self._disc[:3] -= self.box.low
        self._patches: dict[str, Any] = {}
        real = self._real
        if len(patches):
            moved = shifted(patches, -np.asarray(self.box.low, float))
            self._patches = {"patches": upload(device, "patches", moved.astype(real))}
        self.groups = CellPackets.both(cells, self.box)
        self._order = {
            turned: SweepArrays.of(
                device,
                cells,
                self.box,
                groups,
                real,
                turned=turned,
                linear_cells=self.linear_cells,
            )
            for turned, groups in self.groups.items()
        }
        self._excess, self._listed = self.room(1)
        most = max(groups.cells for groups in self.groups.values())
        self._source = unset(device, "source", self._planes * most, real)
        self._given: NDArray[Any] = np.zeros((self._planes, self.count), real)
        self._shining = False
        each = max(
            layout.ray_rows * self.components * layout.slots
            for layout in axis_orders(self.box.shape).values()
        )
        fit = device.info.largest_buffer_bytes // (each * np.dtype(real).itemsize)
        self._together = max(1, min(_TOGETHER, fit))
        self._edge = 1 if self._vector == 1 else self._tile_edge()
        self._rays = zeros(device, "rays", self._together * each, real)
        self.albedo = cells.albedo
        self.thermal: NDArray[Any] = cells.thermal_source().astype(real)
        self.gradients = (
            Gradients.of(cells, self.box, self.tuning) if linear and linear_cells is None else None
        )
        self._neighbours: dict[str, Any] = {}
        if self.gradients is not None:
            weights = self.gradients.weights.astype(real)
            self._neighbours = {
                "neighbours": upload(device, "neighbours", self.gradients.neighbours),
                "weights": upload(device, "neighbours' weights", weights),
            }
        self._emission = upload(device, "emission", self.thermal)
        self._albedo = upload(device, "albedo", cells.albedo.astype(real))
        self._coalbedo = upload(device, "coalbedo", cells.coalbedo.astype(real))
        escapes = mean_transmission(_MEAN_PATH * cells.depth[cells.address])
        self.one_minus_lambda = (cells.coalbedo + cells.albedo * escapes).astype(real)
        self._lost = upload(device, "lost light", self.one_minus_lambda)
        self._cells = ScatteringCells.of(
            device, iterate, components=self.components, count=self.count, real=real
        )
        self._out = zeros(device, "answer", self.components * self.count, real)
        self.sweeps = 0

    def _tile_edge(self) -> int:
        """The same however a device is divided, as sums are then the same to the last bit."""
        cores = sum(each.info.compute_units for each in (self.device, *self.device.others))
        # n x n tiles go in 2 n launches, from four corners.
        return max(1, min(_EDGE, 2 * max(self.box.shape) // (_TILES * cores)))

    @property
    def real(self) -> Real:
        return self._real

    def set_source(
        self, listed: NDArray[Any], *, shining: bool, changes: NDArray[Any] | None = None
    ) -> None:
        """Puts the source (C, N) of the scattering cells into the box; (9 C, N) if it has moments.

        shining: with the thermal source of all other cells; else these are black. changes
        (3, C, M): of S_0 across the cells `linear_cells`, unless they are as neighbours have it.
        Every
        sweep reads `listed` anew.
        """
        self._given, self._shining = listed, shining
        orders = self._order.values()
        if changes is not None:
            for order in orders:
                self._cells.put(
                    changes.reshape(-1, len(self.linear_cells)), order.across, order.changed
                )
        if self._neighbours:
            self._cells.take(listed[: self.components])
            straight, turned = self._order[False], self._order[True]
            self._cells.run(
                "set_gradients",
                {"count": self.count},
                gradient=straight.across,
                gradient_turned=turned.across,
                listed=self._cells.source,
                place=straight.changed,
                turned=turned.changed,
                **self._neighbours,
            )

    def _fill(self, order: SweepArrays, *, cavity: bool) -> None:
        """Puts the present source into the box, in one order of its cells. cavity: all cells emit
        1 besides."""
        count, emitters = order.groups.cells, self.components - self._boundaries
        thermal = order.thermal
        if cavity and emitters:
            ones = np.zeros((emitters, count), self._real)
            ones[0] = 1.0
            thermal = upload(self.device, "thermal sources", ones)
        clear(self.device, self._source, self._planes * count, self._real)
        if emitters and self._shining:
            groups = {"groups": len(order.groups)}
            self._cells.run(
                "emit", groups, source=self._source, thermal=thermal, planes=self._planes
            )
        self._cells.put(self._given, self._source, order.place)

    def room(self, moments: int) -> tuple[Any, ...]:
        """Room for so many moments of the excess in either order of cells, which sweeps clear, and
        in the list, which they write; as good for any other sweeper of this box."""
        planes = moments * self.components
        most = max(groups.cells for groups in self.groups.values())
        return (
            unset(self.device, "excess", planes * most, self._real),
            unset(self.device, "list", planes * self.count, self._real),
        )

    def _answer(self, kernel: str, *, excess: Any = None, **arguments: Any) -> NDArray[Any]:
        """What a kernel makes of the source and the excess (C, N) of the listed cells."""
        self._cells.run(
            kernel,
            {"count": self.count},
            out=self._out,
            i_minus_s=self._listed if excess is None else excess,
            listed=self._cells.source,
            **arguments,
        )
        return self._cells.read(self._out)

    def rays(self, directions: Ordinates, starts: NDArray[np.float64]) -> DeviceOrdinates:
        """starts: (len(directions), 2) in 0..1, where rays cross the cells of the first layer."""
        return DeviceOrdinates.of(
            self.device,
            self.box,
            directions,
            starts,
            together=self._together,
            edge=self._edge,
            real=self._real,
        )

    def sweep(self, rays: DeviceOrdinates, *, shining: bool, cavity: bool = False) -> None:
        """Sweeps every direction; the excess D of the present source is then on the device."""
        room = (self._excess, self._listed, self.components)
        self._along_all(self._sweep, rays, shining, *room, cavity=cavity)

    def moments(
        self,
        program: Program,
        rays: DeviceOrdinates,
        *,
        out: NDArray[Any],
        room: tuple[Any, ...] = (),
        interfaces: InterfaceRadiance | None = None,
    ) -> NDArray[Any] | None:
        """Finds the mean of the light in the scattering cells, and of what it is more than that
        the other moments (moments.py), which no set of directions then finds in even light.

        program: sweep.cl with ANGULAR_MOMENTS, and room for MOMENTS, or without. out (9 or 1, C,
        N): takes
        them. rim: with INTERFACE_RADIANCE, takes the light that is kept. With SPATIAL_MOMENTS it
        returns how much more the
        light changes across the cells `linear_cells` than their source, (3, C, M).
        """
        many = self.components * (MOMENTS if "ANGULAR_MOMENTS" in program.defines else 1)
        i_minus_s, listed = (self._excess, self._listed) if many == self.components else room
        across = self._along_all(
            program, rays, True, i_minus_s, listed, many, interfaces=interfaces
        )
        download(self.device, listed, out[: many // self.components])
        weight = rays.directions.weight
        if many > self.components:
            leaning = discrete_to_moment(rays.directions.unit) @ weight / weight.sum()
            for moment, lean in zip(out[1:], leaning, strict=True):
                moment -= self._real(lean) * out[0]
        out[0] += self._real(weight.sum()) * self._cells.read(self._cells.source)
        return None if across is None else across * self._real(_FLAT / weight.sum())

    def _along_all(
        self,
        program: Program,
        rays: DeviceOrdinates,
        shining: bool,
        i_minus_s: Any,
        listed: Any,
        planes: int,
        camera: CameraSweep | None = None,
        *,
        interfaces: InterfaceRadiance | None = None,
        cavity: bool = False,
    ) -> NDArray[Any] | None:
        """Sweeps every direction, those through one order of cells after those through the other,
        which share the room for the excess; `listed` then has its planes for the scattering cells.
        Returns what a program with SPATIAL_MOMENTS finds besides.
        """
        across = self._room_across() if "SPATIAL_MOMENTS" in program.defines else ()
        for turned, order in self._order.items():
            self._fill(order, cavity=cavity)
            clear(self.device, i_minus_s, planes * order.groups.cells, self._real)
            if across:
                clear(self.device, across[0], 3 * order.linear_size, self._real)
            if camera is not None:
                clear(self.device, camera.shares[turned], order.groups.cells, self._real)
            linear: dict[str, Any] = {}
            if "LINEAR_SOURCE" in program.defines:
                linear["gradient"] = order.across
            if across:
                linear["spatial_moments"] = across[0]
            for schedule, tables, basis in rays.sweep_schedules:
                if schedule.layout.turned is turned:
                    arguments = {"i_minus_s": i_minus_s, **tables, **linear}
                    arguments |= basis if across else {}
                    if camera is not None:
                        arguments |= self._towards(camera, schedule.layout)
                    if interfaces is not None:
                        arguments |= interfaces.arguments(schedule.layout)
                    self._along(program, schedule, shining, arguments)
            self._cells.find(listed, i_minus_s, order.place, turned=turned, planes=planes)
            if across:
                some, count = (across[1], across[0], order.changed), len(self.linear_cells)
                planes_across = 3 * self.components
                self._cells.find(*some, turned=turned, planes=planes_across, count=count)
        self.sweeps += len(rays.directions)
        if not across:
            return None
        out = np.empty((3, self.components, len(self.linear_cells)), self._real)
        return download(self.device, across[1], out)

    def _room_across(self) -> tuple[Any, Any]:
        """As `room`, for what is found of the excess in cells across which sources change."""
        most = 3 * max(order.linear_size for order in self._order.values())
        listed = 3 * self.components * len(self.linear_cells)
        real = self._real
        return unset(self.device, "excess", most, real), unset(self.device, "list", listed, real)

    def _towards(self, camera: CameraSweep, layout: AxisOrder) -> dict[str, Any]:
        """What the kernel takes with CAMERA_SWEEP."""
        place = np.zeros(4)
        place[:3] = camera.place - self.box.low
        return {
            "shares": camera.shares[layout.turned],
            "phase": camera.phase,
            "camera": place.astype(self._real),
            **camera.seen[layout.turned],
        }

    def _along(
        self, program: Program, schedule: SweepSchedule, shining: bool, arguments: dict[str, Any]
    ) -> None:
        """arguments: of the kernel, beside those of the box and the boundaries."""
        layout = schedule.layout
        order = self._order[layout.turned]
        nu, nv, nl = (int(count) for count in layout.size)
        lanes = 1
        if self._vector == 1:
            lanes = min(order.groups.widest, program.largest_group("sweep"))
        program.launch_each(
            "sweep",
            [lanes * int(end - first) for first, end in schedule.launches],
            lanes,
            "first_tile",
            [int(first) for first, _ in schedule.launches],
            {
                "rays": self._rays,
                "slots": int(layout.slots),
                "ray_rows": int(layout.ray_rows),
                "groups": order.first,
                "begins": order.begins,
                "depth": order.depth,
                "source": self._source,
                "layout": int(layout.number),
                "nu": nu,
                "nv": nv,
                "nl": nl,
                "stride_v": int(layout.stride_v),
                "stride_l": int(layout.stride_l),
                "inflow": float(shining),
                "disc": self._disc.astype(self._real),
                **self._patches,
                **arguments,
            },
        )

    def defect(self, listed: NDArray[Any], rays: DeviceOrdinates) -> NDArray[np.float64]:
        """Mean radiance (N,) of the scattering cells, less 1, in a cavity of radiance 1.

        listed: (C, N) source; what the boundaries' part of it lacks to 1, the cells emit, as all
        other cells emit 1. The sweep carries the parts one by one, as it always does.
        """
        b, real = self._boundaries, self._real
        parts = np.zeros((self.components, self.count), real)
        parts[:b] = listed[:b]
        if self.components > b:
            parts[b] = 1.0 - listed[:b].sum(axis=0)
        self.set_source(parts, shining=True)
        self.sweep(rays, shining=True, cavity=True)
        total = self._cells.read(self._listed).sum(axis=0, dtype=np.float64)
        missing = parts.sum(axis=0, dtype=np.float64) - 1.0
        return np.asarray(total / rays.directions.weight.sum() + missing)

    def to_camera(
        self,
        program: Program,
        seen: OpticalCells,
        phase: NDArray[np.float64],
        place: NDArray[np.float64],
    ) -> CameraSweep:
        """See `CameraSweep.of`."""
        return CameraSweep.of(
            self.device, self.box, self._real, program, seen, self.groups, phase=phase, place=place
        )

    def view_weighted_mean(
        self,
        camera: CameraSweep,
        rays: DeviceOrdinates,
        interfaces: InterfaceRadiance | None = None,
    ) -> tuple[NDArray[Any], NDArray[Any] | None]:
        """Mean radiance (C, N) of the scattering cells, as the camera sees them; rim and what is
        returned besides as in `moments`."""
        i_minus_s, listed, planes = self._excess, self._listed, self.components
        across = self._along_all(
            camera.program, rays, True, i_minus_s, listed, planes, camera, interfaces=interfaces
        )
        mean = self._answer(
            "weighted_mean",
            shares=camera.shares[False],
            shares_turned=camera.shares[True],
            place=self._order[False].place,
            turned=self._order[True].place,
        )
        if across is None:
            return mean, None
        for turned, order in self._order.items():
            counted = camera.shares[turned]
            self._cells.find(self._out, counted, order.place, turned=turned, planes=1)
        shares = download(self.device, self._out, np.empty(self.count, self._real))[
            self.linear_cells
        ]
        share = np.divide(1, shares, out=np.zeros_like(shares), where=shares > 0)
        return mean, self._real(_FLAT) * share * across

    def residual(self, *, shining: bool, listed: Any = None) -> NDArray[Any]:
        """Preconditioned residual (C, N) of the present source and its excess; listed: of `room`,
        where that has taken the excess."""
        return self._answer(
            "residual",
            excess=listed,
            emission=self._emission,
            albedo=self._albedo,
            coalbedo=self._coalbedo,
            lost=self._lost,
            shine=float(shining),
        )

    def next_order(self) -> NDArray[Any]:
        """The source a (S + D) + E, (C, N), of one scattering more."""
        return self._answer("next_order", emission=self._emission, albedo=self._albedo)
