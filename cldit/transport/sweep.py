"""Sweeps on the device: the mean radiance of every scattering cell from the present source."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from cldit.errors import DeviceError
from cldit.gpu.buffers import clear, download, upload, zeros
from cldit.gpu.device import Device
from cldit.gpu.program import Program
from cldit.transport.cells import Box, OpticalCells
from cldit.transport.directions import Directions
from cldit.transport.groups import GROUP, Groups, turned_too
from cldit.transport.layout import Layout, layouts
from cldit.transport.patches import NONE, shifted
from cldit.transport.towards import ToCamera
from cldit.transport.way import Way

_MEAN_PATH = 2 / 3  # through a cell, in units of its edge: 4 V / S

Real = type[np.float32] | type[np.float64]


def sweep_defines(device: Device, box: Box, *, ray_bytes: int = 8) -> dict[str, int]:
    """What the sweep kernel must know of the device and of the box when it is built.

    ray_bytes: what the components of one ray take.

    Raises:
        DeviceError: a row of rays does not fit into what a work-group shares.
    """
    nx, ny, nz = (-(-edge // GROUP) * GROUP for edge in box.shape)
    slots = max(nx + nz, nx + ny, ny + nx) + 4
    if slots * ray_bytes > device.info.local_bytes:
        raise DeviceError(
            f"{device.info.name}: a row of rays takes {slots * ray_bytes} bytes of local memory, "
            f"and a work-group has {device.info.local_bytes}; set domain.leaf_edge_m coarser, or "
            "name fewer patches"
        )
    return {"VECTOR": GROUP if device.is_cpu else 1, "SLOTS": slots}


def _apart(rows: int) -> list[tuple[int, int]]:
    """First and number of sets of rows, every other one, with no neighbours in a set."""
    even, odd = rows // 2, rows % 2
    return [(0, even), (1, even)] * (even > 0) + [(rows - 1, 1)] * odd


@dataclass(frozen=True)
class _Order:
    """The box's groups of cells in one order, and the device's arrays of them.

    place: of the scattering cells among the cells of all groups. source, excess, thermal: planes of
    all components, side by side in each group; thermal is the source of what emits.
    """

    groups: Groups
    first: Any
    begins: Any
    place: Any
    depth: Any
    source: Any
    excess: Any
    thermal: Any
    bytes: int  # of `source`

    @classmethod
    def of(
        cls,
        device: Device,
        cells: OpticalCells,
        box: Box,
        groups: Groups,
        real: Real,
        *,
        turned: bool,
    ) -> _Order:
        def packed(values: NDArray[np.float64]) -> NDArray[Any]:
            return groups.packed(turned_too(cells.dense(box, values.astype(real)))[turned])

        components, boundaries = len(cells.needs.components), cells.needs.boundaries
        thermal = np.zeros((len(groups), components, GROUP), real)
        for number, name in enumerate(cells.needs.emitters, boundaries):
            thermal[:, number] = packed(cells.emitted[name])
        x, y, z = (cells.positions(cells.address) - np.asarray(box.low)).T
        _, ny, nz = box.shape
        place = groups.places(x * nz + z, y) if turned else groups.places(z * ny + y, x)
        return cls(
            groups=groups,
            first=upload(device, "groups of rows", groups.first),
            begins=upload(device, "groups", groups.along),
            place=upload(device, "places", place),
            depth=upload(device, "optical depth", packed(cells.depth)),
            source=zeros(device, "source", thermal.size, real),
            excess=zeros(device, "excess", thermal.size, real),
            thermal=upload(device, "thermal source", thermal),
            bytes=thermal.nbytes,
        )


@dataclass(frozen=True)
class _Beam:
    """One direction of a set: its number there, where its light comes from, and where rays start."""

    number: int
    back: NDArray[np.float64]
    weight: float
    start: NDArray[np.float64]


class Sweeper:
    """The swept box on the device.

    Holds optical depths, source and excess in groups of cells along x, and once more in groups
    along y (turned), so that rays along x go through rows of memory as those along y and z do.
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
    ) -> None:
        """disc, patches: as in `View`, in cells from the cube's lower corner."""
        self.device = device
        self.box: Box = cells.box()
        self.count = len(cells.address)
        self.components = len(cells.needs.components)
        self._boundaries = cells.needs.boundaries
        self._sweep = sweep["sweep"]
        self._vector = int(sweep.defines["VECTOR"])
        self._kernels = iterate
        self._real: Real = np.float64 if "USE_FLOAT64" in sweep.defines else np.float32
        self._disc = disc.copy()
        self._disc[:3] -= self.box.low
        self._patches = []
        real = self._real
        if len(patches):
            moved = shifted(patches, -np.asarray(self.box.low, float))
            self._patches = [upload(device, "patches", moved.astype(real))]
        self.groups = Groups.both(cells, self.box)
        self._order = {
            turned: _Order.of(device, cells, self.box, groups, real, turned=turned)
            for turned, groups in self.groups.items()
        }
        self._shining: bool | None = False  # what the cells that do not scatter hold
        self._lanes = device.info.largest_group
        self.thermal = np.zeros((self.components, self.count), real)
        self.thermal[self._boundaries :] = cells.thermal_planes(real)[:, cells.address]
        self._emission = upload(device, "emission", self.thermal)
        self._albedo = upload(device, "albedo", cells.albedo.astype(real))
        self._coalbedo = upload(device, "coalbedo", cells.coalbedo.astype(real))
        self._depth = upload(device, "optical depth", cells.depth[cells.address].astype(real))
        self._list = zeros(device, "list", self.components * self.count, real)
        self._out = zeros(device, "answer", self.components * self.count, real)
        self.sweeps = 0

    @property
    def real(self) -> Real:
        return self._real

    def set_source(self, listed: NDArray[Any], *, shining: bool) -> None:
        """Puts the source (C, N) of the scattering cells into the box.

        shining: with the thermal source of all other cells; else these are black.
        """
        if self._shining is not shining:
            for order in self._order.values():
                if shining:
                    cl.enqueue_copy(self.device.queue, order.source, order.thermal)
                else:
                    clear(self.device, order.source, order.bytes)
            self._shining = shining
        self._put(listed)

    def _put(self, listed: NDArray[Any]) -> None:
        cl.enqueue_copy(self.device.queue, self._list, np.ascontiguousarray(listed, self._real))
        sources = [order.source for order in self._order.values()]
        self._of_list("set_source", *sources, self._list, *self._places())

    def _places(self) -> list[Any]:
        return [order.place for order in self._order.values()]

    def _of_list(self, kernel: str, *arguments: Any) -> None:
        """Runs a kernel over the scattering cells."""
        self._kernels[kernel](
            self.device.queue, (self.count,), None, *arguments, np.int32(self.count)
        )

    def _answer(self, kernel: str | None = None, *arguments: Any) -> NDArray[Any]:
        """(C, N) excess of the listed cells, or what a kernel makes of it."""
        excess = [order.excess for order in self._order.values()]
        self._of_list("listed_excess", self._out, *excess, *self._places())
        if kernel is not None:
            self._of_list(kernel, self._out, self._list, *arguments)
        return download(self.device, self._out, np.empty((self.components, self.count), self._real))

    def sweep(
        self,
        directions: Directions,
        starts: NDArray[np.float64],
        *,
        shining: bool,
        camera: ToCamera | None = None,
    ) -> None:
        """Sweeps every direction; the excess D of the present source is then on the device.

        starts: (len(directions), 2) in 0..1, where rays cross the cells of the first layer.
        camera: what directions count for towards it; None counts all alike.
        """
        for turned, order in self._order.items():
            clear(self.device, order.excess, order.bytes)
            if camera is not None:
                clear(self.device, camera.shares[turned], order.bytes // self.components)
        main = np.argmax(np.abs(directions.unit), axis=1)
        for axis, layout in layouts(self.box.shape).items():
            for i in np.flatnonzero(main == axis):
                beam = _Beam(
                    int(i), directions.unit[i], float(directions.weight[i]), np.asarray(starts[i])
                )
                self._one(layout, beam, shining, camera)
        self.sweeps += len(directions)

    def _one(self, layout: Layout, beam: _Beam, shining: bool, camera: ToCamera | None) -> None:
        real = self._real
        order = self._order[layout.turned]
        # Light runs away from where it comes from.
        u, v, run = (-beam.back[axis] for axis in layout.axes)
        nu, nv, nl = layout.size
        way = Way.of(u / abs(run), v / abs(run), beam.start, layers=nl, backwards=run < 0)
        lanes = 1 if self._vector > 1 else min(order.groups.widest, self._lanes)
        extra = []
        if camera is not None:
            place = np.zeros(4)
            place[:3] = camera.place - self.box.low
            extra = [
                camera.shares[layout.turned],
                camera.seen[layout.turned],
                upload(self.device, "heights", way.within[layout.axes.index(1)].astype(real)),
                camera.phase,
                place.astype(real),
                *([] if camera.light is None else camera.light.arguments(layout, beam.number)),
            ]
        kernel = self._sweep if camera is None else camera.kernel
        before = [
            order.first,
            order.begins,
            order.depth,
            order.source,
            order.excess,
            upload(self.device, "shifts", way.shifts(nv)),
            upload(self.device, "layers", way.layer),
            upload(self.device, "parts", way.part.astype(real)),
            np.int32(len(way.part)),
        ]
        after = [
            np.int32(nl + 1 if u > 0 else 1),
            np.int32(layout.number),
            np.int32(nu),
            np.int32(nv),
            np.int32(nl),
            np.int32(layout.stride_v),
            np.int32(layout.stride_l),
            real(1 / abs(run)),
            real(beam.weight),
            real(shining),
            np.array([*beam.back, 0], real),
            self._disc.astype(real),
            *self._patches,
            *extra,
        ]
        # Rows that are neighbours, the first and the last among them, share cells.
        for first, rows in _apart(nv):
            kernel(
                self.device.queue,
                (lanes, rows),
                (lanes, 1),
                *before,
                np.int32(first),
                *after,
            )

    def defect(
        self, listed: NDArray[Any], directions: Directions, starts: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Mean radiance (N,) of the scattering cells, less 1, in a cavity of radiance 1.

        listed: (C, N) source; what the boundaries' part of it lacks to 1, the cells emit, as all
        other cells emit 1. The sweep carries the parts one by one, as it always does.
        """
        b, real = self._boundaries, self._real
        parts = np.zeros((self.components, self.count), real)
        parts[:b] = listed[:b]
        for order in self._order.values():
            source = np.zeros((len(order.groups), self.components, GROUP), real)
            source[:, b : b + 1] = 1.0
            cl.enqueue_copy(self.device.queue, order.source, source)
        self._shining = None
        if self.components > b:
            parts[b] = 1.0 - listed[:b].sum(axis=0)
        self._put(parts)
        self.sweep(directions, starts, shining=True)
        total = self._answer().sum(axis=0, dtype=np.float64)
        missing = parts.sum(axis=0, dtype=np.float64) - 1.0
        return np.asarray(total / directions.weight.sum() + missing)

    def to_camera(
        self,
        program: Program,
        seen: OpticalCells,
        phase: NDArray[np.float64],
        place: NDArray[np.float64],
    ) -> ToCamera:
        """See `ToCamera.of`."""
        return ToCamera.of(
            self.device, self.box, self._real, program, seen, self.groups, phase=phase, place=place
        )

    def weighted_mean(self, camera: ToCamera) -> NDArray[Any]:
        """Mean radiance (C, N) of the scattering cells after a sweep towards the camera."""
        return self._answer("weighted_mean", *camera.shares.values(), *self._places())

    def residual(self, *, shining: bool) -> NDArray[Any]:
        """Preconditioned residual (C, N) of the present source and its excess."""
        return self._answer(
            "residual",
            self._emission,
            self._albedo,
            self._coalbedo,
            self._depth,
            self._real(_MEAN_PATH),
            self._real(shining),
        )

    def next_order(self) -> NDArray[Any]:
        """The source a (S + D) + E, (C, N), of one scattering more."""
        return self._answer("next_order", self._emission, self._albedo)
