"""Sweeps on the device: the mean radiance of every scattering cell from the present source."""

from __future__ import annotations

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
from cldit.transport.layout import Layout, layouts
from cldit.transport.patches import NONE, shifted
from cldit.transport.towards import ToCamera
from cldit.transport.way import Way

_TILE = 16  # as in iterate.cl, unless the device's work-groups are smaller
_GROUP, _SCATTERS = 8, 2  # as in sweep.cl: cells of a group, and its content where one scatters
_MEAN_PATH = 2 / 3  # through a cell, in units of its edge: 4 V / S


def sweep_defines(device: Device, box: Box, *, ray_bytes: int = 8) -> dict[str, int]:
    """What the sweep kernel must know of the device and of the box when it is built.

    ray_bytes: what the components of one ray take.

    Raises:
        DeviceError: a row of rays does not fit into what a work-group shares.
    """
    nx, ny, nz = box.shape
    vector = 8 if device.is_cpu and nx % 8 == 0 and ny % 8 == 0 else 1
    slots = max(nx + nz, nx + ny, ny + nx) + 4
    if slots * ray_bytes > device.info.local_bytes:
        raise DeviceError(
            f"{device.info.name}: a row of rays takes {slots * ray_bytes} bytes of local memory, "
            f"and a work-group has {device.info.local_bytes}; set domain.leaf_edge_m coarser, or "
            "name fewer patches"
        )
    return {"VECTOR": vector, "SLOTS": slots}


def _contents(device: Device, cells: OpticalCells, box: Box) -> dict[int, Any]:
    """What groups of cells hold, [l][v][group], for each layout's number (see kernels/sweep.cl)."""
    content = (cells.depth > 0).astype(np.int8)
    content[cells.address] = _SCATTERS
    dense = cells.dense(box, content)
    out = {}
    for layout in layouts(box.shape).values():
        rows = dense.transpose([2 - axis for axis in reversed(layout.axes)])
        rows = np.pad(rows, ((0, 0), (0, 0), (0, -rows.shape[2] % _GROUP)))
        groups = rows.reshape(*rows.shape[:2], -1, _GROUP).max(axis=3)
        out[layout.number] = upload(device, "contents", groups)
    return out


def _apart(rows: int) -> list[tuple[int, int]]:
    """First and number of sets of rows, every other one, with no neighbours in a set."""
    even, odd = rows // 2, rows % 2
    return [(0, even), (1, even)] * (even > 0) + [(rows - 1, 1)] * odd


class Sweeper:
    """The swept box on the device.

    Holds the optical depths, one source and one excess array a component, the first two also in
    turned order so that rays along x read rows of memory as those along y and z do.
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
        self._real = np.float64 if "USE_FLOAT64" in sweep.defines else np.float32
        self._disc = disc.copy()
        self._disc[:3] -= self.box.low
        self._patches = []
        if len(patches):
            moved = shifted(patches, -np.asarray(self.box.low, float))
            self._patches = [upload(device, "patches", moved.astype(self._real))]
        planes = self.components * self.box.cells
        real = self._real
        depth = cells.dense(self.box, cells.depth.astype(real))
        self._depth = {
            False: upload(device, "optical depth", depth),
            True: upload(device, "optical depth", depth.transpose(2, 0, 1)),
        }
        self._contents = _contents(device, cells, self.box)
        self._lanes = device.info.largest_group
        self._tile = int(iterate.defines.get("TILE", _TILE))
        self._source = {t: zeros(device, "source", planes, real) for t in (False, True)}
        self._excess = {t: zeros(device, "excess", planes, real) for t in (False, True)}
        self._bytes = planes * np.dtype(real).itemsize
        self._at = cells.place(self.box, cells.address)
        self._place = upload(device, "places", self._at.astype(np.int32))
        thermal = np.zeros((self.components, self.count), real)
        base = np.zeros((len(cells.needs.emitters), self.box.cells), real)
        for number, name in enumerate(cells.needs.emitters):
            emitted = cells.emitted[name].astype(real)
            base[number] = cells.dense(self.box, emitted).reshape(-1)
            thermal[self._boundaries + number] = emitted[cells.address]
        self._base = upload(device, "thermal source", base)
        self._base_bytes = base.nbytes
        self._emission = upload(device, "emission", thermal)
        self._albedo = upload(device, "albedo", cells.albedo.astype(real))
        self._coalbedo = upload(device, "coalbedo", cells.coalbedo.astype(real))
        self._list = zeros(device, "list", self.components * self.count, real)
        self._out = zeros(device, "residual", self.components * self.count, real)
        self.thermal = thermal
        self.sweeps = 0

    @property
    def real(self) -> type[np.float32] | type[np.float64]:
        return self._real

    def _grid(self) -> tuple[int, int, int]:
        nx, ny, nz = self.box.shape
        return (
            -(-nx // self._tile) * self._tile,
            -(-ny // self._tile) * self._tile,
            nz * self.components,
        )

    def set_source(self, listed: NDArray[Any], *, shining: bool) -> None:
        """Puts the source (C, N) of the scattering cells into the box.

        shining: with the thermal source of all other cells; else these are black.
        """
        queue = self.device.queue
        cl.enqueue_copy(queue, self._list, np.ascontiguousarray(listed, self._real))
        self._fill(shining)

    def _fill(self, shining: bool) -> None:
        queue = self.device.queue
        source, own = self._source[False], self._base_bytes if shining else 0
        clear(self.device, source, self._bytes - own)  # boundaries' light begins in no cell
        if own:
            cl.enqueue_copy(queue, source, self._base, byte_count=own, dst_offset=self._bytes - own)
        self._scatter()

    def _scatter(self) -> None:
        """The list into the box's source, and its turned copy."""
        self._kernels["scatter_list"](
            self.device.queue,
            (self.count,),
            None,
            self._source[False],
            self._list,
            self._place,
            np.int32(self.box.cells),
            np.int32(self.count),
        )
        self._turn(self._source)

    def _turn(self, arrays: dict[bool, Any]) -> None:
        sizes = [np.int32(n) for n in self.box.shape]
        self._kernels["turn"](
            self.device.queue,
            self._grid(),
            (self._tile, self._tile, 1),
            arrays[True],
            arrays[False],
            *sizes,
        )

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
        for turned in (False, True):
            clear(self.device, self._excess[turned], self._bytes)
            if camera is not None:
                clear(self.device, camera.shares[turned], self._bytes // self.components)
        main = np.argmax(np.abs(directions.unit), axis=1)
        for axis, layout in layouts(self.box.shape).items():
            for i in np.flatnonzero(main == axis):
                self._one(
                    layout,
                    directions.unit[i],
                    float(directions.weight[i]),
                    starts[i],
                    shining,
                    camera,
                    int(i),
                )
        if np.any(main == 0):
            sizes = [np.int32(n) for n in self.box.shape]
            self._kernels["add_turned"](
                self.device.queue,
                self._grid(),
                (self._tile, self._tile, 1),
                self._excess[False],
                self._excess[True],
                *sizes,
            )
            if camera is not None:
                grid = (*self._grid()[:2], self.box.shape[2])
                self._kernels["add_turned"](
                    self.device.queue,
                    grid,
                    (self._tile, self._tile, 1),
                    camera.shares[False],
                    camera.shares[True],
                    *sizes,
                )
        self.sweeps += len(directions)

    def _one(
        self,
        layout: Layout,
        unit: NDArray[np.float64],
        weight: float,
        start: NDArray[np.float64],
        shining: bool,
        camera: ToCamera | None,
        number: int,
    ) -> None:
        real = self._real
        u, v, run = (
            -unit[axis] for axis in layout.axes
        )  # light runs away from where it comes from
        nu, nv, nl = layout.size
        way = Way.of(u / abs(run), v / abs(run), start, layers=nl, backwards=run < 0)
        lanes = 1 if self._vector > 1 else min(nu, self._lanes)
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
                *([] if camera.light is None else camera.light.arguments(layout, number)),
            ]
        kernel = self._sweep if camera is None else camera.kernel
        before = [
            self._depth[layout.turned],
            self._source[layout.turned],
            self._excess[layout.turned],
            self._contents[layout.number],
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
            real(weight),
            real(shining),
            np.array([*unit, 0], real),
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
        queue, size = self.device.queue, self._bytes // self.components
        clear(self.device, self._source[False], self._bytes)
        if self.components > b:
            parts[b] = 1.0 - listed[:b].sum(axis=0)
            cl.enqueue_fill_buffer(queue, self._source[False], np.ones(1, real), b * size, size)
        cl.enqueue_copy(queue, self._list, parts)
        self._scatter()
        self.sweep(directions, starts, shining=True)
        excess = np.empty((self.components, self.box.cells), real)
        total = download(self.device, self._excess[False], excess)[:, self._at].sum(axis=0)
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
            self.device, self.box, self._real, program, seen, phase=phase, place=place
        )

    def weighted_mean(self, camera: ToCamera) -> NDArray[Any]:
        """Mean radiance (C, N) of the scattering cells after a sweep towards the camera."""
        self._kernels["weighted_mean"](
            self.device.queue,
            (self.count,),
            None,
            self._out,
            self._source[False],
            self._excess[False],
            camera.shares[False],
            self._place,
            np.int32(self.box.cells),
            np.int32(self.count),
        )
        return download(self.device, self._out, np.empty((self.components, self.count), self._real))

    def residual(self, *, shining: bool) -> NDArray[Any]:
        """Preconditioned residual (C, N) of the present source and its excess."""
        self._kernels["residual"](
            self.device.queue,
            (self.count,),
            None,
            self._out,
            self._excess[False],
            self._list,
            self._emission,
            self._albedo,
            self._coalbedo,
            self._depth[False],
            self._place,
            self._real(_MEAN_PATH),
            self._real(shining),
            np.int32(self.box.cells),
            np.int32(self.count),
        )
        return download(self.device, self._out, np.empty((self.components, self.count), self._real))

    def next_order(self) -> NDArray[Any]:
        """Replaces the source by a (S + D) + E and returns it, (C, N)."""
        self._kernels["next_order"](
            self.device.queue,
            (self.count,),
            None,
            self._list,
            self._excess[False],
            self._emission,
            self._albedo,
            self._place,
            np.int32(self.box.cells),
            np.int32(self.count),
        )
        return download(
            self.device, self._list, np.empty((self.components, self.count), self._real)
        )
