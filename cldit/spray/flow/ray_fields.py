"""Fields on the grid of rays in device memory, and launches that work on them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyopencl as cl

from cldit.arrays import Floats
from cldit.gpu.buffers import download, upload, zeros
from cldit.gpu.device import Device
from cldit.gpu.program import Launch, Program, build
from cldit.spray.flow.rays import RayGrid

_GUARD = 16  # cells around a plane, and multiple of a row: kernels/spray/gas_cell.h
GROUP = 32  # work-items; one size, since a compiler may compile a kernel anew for another


class RayFields:
    """Fields on a grid of rays in device memory, with the launches that work on them.

    real: type of the numbers. cells: numbers of a plane.
    """

    def __init__(self, grid: RayGrid, device: Device, real: type[np.floating]) -> None:
        self.grid, self.device = grid, device
        self.real: Any = real
        azimuths, polars, radii = grid.shape
        self.stride = -(-(radii + 2) // _GUARD) * _GUARD
        self.cells = azimuths * polars * self.stride + 2 * _GUARD
        self.simd_width = 8 if device.is_cpu else 1
        self.packets = azimuths * polars * self.stride // self.simd_width
        self._programs: dict[str, Program] = {}

    def places(self) -> dict[str, Any]:
        """Arguments of kernels that find the cells around a position, see ray_place.h."""
        grid = self.grid
        turns = 2 * np.pi / max(grid.symmetry, 1) * np.arange(max(grid.symmetry, 1))
        turned = np.stack([np.cos(turns), np.sin(turns)], axis=1)
        faces = np.concatenate([grid.azimuth, grid.polar, grid.radius_m])
        frame = np.concatenate([grid.frame.reshape(-1), turned.reshape(-1)])
        sizes = dict(zip(("azimuths", "polars", "radii"), grid.shape, strict=True))
        return {
            "faces": self.table("faces", faces, np.float32),
            "frame": self.table("frame", frame, np.float32),
            "symmetry": grid.symmetry,
            "ring": int(grid.ring),
            "stride": self.stride,
            **sizes,
        }

    def program(self, name: str) -> Program:
        """Program of a file of kernels for these fields."""
        if name not in self._programs:
            defines: dict[str, int | float | str] = {"SIMD_WIDTH": self.simd_width}
            if self.real is np.float64:
                defines["USE_FLOAT64"] = 1
            self._programs[name] = build(self.device, name, defines)
        return self._programs[name]

    def table(self, name: str, values: Floats, dtype: Any = None) -> Any:
        """Buffer of numbers of a table."""
        return upload(self.device, name, np.asarray(values, dtype or self.real).reshape(-1))

    def row(self, name: str, values: Any, *, padded: float = 0.0) -> Any:
        """Buffer of numbers along a row (R,) or of its faces (R + 1,)."""
        out = np.full(self.stride + 1, padded)
        out[: len(values)] = values
        return self.table(name, out)

    def plane(self, name: str, planes: int = 1, *, value: float = 0.0) -> Any:
        """Buffer of planes with one value everywhere, padded cells included."""
        if value == 0.0:
            return zeros(self.device, name, planes * self.cells, self.real)
        return self.table(name, np.full(planes * self.cells, value))

    def read(self, buffer: Any, plane: int = 0) -> Floats:
        """A plane of a buffer as an array (A, P, R)."""
        return np.asarray(self.read_planes(buffer, 1, begin=plane)[0])

    def read_planes(self, buffer: Any, planes: int, *, begin: int = 0) -> Floats:
        """Planes of a buffer from `begin` on, as an array (planes, A, P, R)."""
        out = np.empty((planes, self.cells), self.real)
        download(self.device, buffer, out, start=begin * self.cells)
        rows = out[:, _GUARD:-_GUARD].reshape(planes, *self.grid.shape[:2], self.stride)
        return np.array(rows[..., : self.grid.shape[2]], dtype=np.float64)

    def write(self, buffer: Any, values: Floats, plane: int = 0) -> None:
        """Sets a plane to an array (A, P, R)."""
        old = np.empty(self.cells, self.real)
        download(self.device, buffer, old, start=plane * self.cells)
        rows = old[_GUARD:-_GUARD].reshape(*self.grid.shape[:2], self.stride)
        rows[:, :, : self.grid.shape[2]] = values
        offset = plane * self.cells * old.itemsize
        cl.enqueue_copy(self.device.queue, buffer, old, dst_offset=offset)

    def bind(self, name: str, kernel: str, shared: Mapping[str, Any], **specific: Any) -> Launch:
        """Launch of a kernel of the file `name`, whose arguments are taken by name.

        `shared` and `specific` may have more names than the kernel takes; `specific` ones override
        `shared` ones. One work-item is a packet of cells of one field; the number of fields is
        `kinds`, or 1.
        """
        program = self.program(name)
        available = {"kinds": 1, **shared, **specific}
        arguments = {argument: available[argument] for argument in program.takes(kernel)}
        return self.grouped(program, kernel, self.packets * int(available["kinds"]), arguments)

    def grouped(
        self, program: Program, kernel: str, items: int, arguments: Mapping[str, Any]
    ) -> Launch:
        """Launch of work-items in groups of one size."""
        return program.bind(kernel, (items,), (GROUP,), arguments)


class Mixing:
    """Implicit exchange of fields per mass between neighbours across the rays."""

    def __init__(self, fields: RayFields) -> None:
        grid = fields.grid
        self.fields, self.program = fields, fields.program("spray/gas_mixing.cl")
        azimuthal, down, _ = grid.conductance
        self._azimuthal, self._down = fields.table("around", azimuthal), fields.table("down", down)
        self._length = fields.row("length", grid.strip_m2 / grid.middle[2])
        self.ratio = fields.plane("elimination", 2)

    def launches(
        self,
        values: Any,
        kinds: int,
        *,
        mass: Any,
        flux: Any,
        exchange: tuple[Any, Any],
        factor: float,
    ) -> list[Launch]:
        """One launch for the polar angle, and one for the azimuth if it has cells.

        Args:
            values: planes of `kinds` fields per mass, changed in place.
            mass: plane of the cells' mass, changed by the fluxes.
            flux: planes of mass flux through the lower faces for azimuth and polar angle.
            exchange, factor: planes for polar angle and azimuth; their product is diffusivity times
                density.
        """
        f, (azimuths, polars, _) = self.fields, self.fields.grid.shape
        layer, packets = polars * f.stride, f.stride // f.simd_width
        common = {
            "fields": values,
            "kinds": kinds,
            "mass": mass,
            "flux": flux,
            "length": self._length,
            "ratio": self.ratio,
            "factor": factor,
            "step": 1.0,
            "cells": f.cells,
            "packets": packets,
        }
        polar = {
            "flux_plane": 1,
            "exchange": exchange[0],
            "conductance": self._down,
            "count": polars,
            "jump": f.stride,
            "other": layer,
            "table_jump": 1,
            "table_other": polars,
            "ring": 0,
        }
        azimuth = {
            "flux_plane": 0,
            "exchange": exchange[1],
            "conductance": self._azimuthal,
            "count": azimuths,
            "jump": layer,
            "other": f.stride,
            "table_jump": polars,
            "table_other": 1,
            "ring": int(f.grid.ring),
        }
        lines = [(azimuths, polar)] + [(polars, azimuth)] * (azimuths > 1)
        return [
            f.grouped(self.program, "mix_across", packets * count, common | axis | {"lines": count})
            for count, axis in lines
        ]

    def along(self, values: Any, kinds: int, *, mass: Any, flux: Any, diffusions: Any) -> Launch:
        """Launch for the radius; `flux` and `diffusions` have its planes last."""
        azimuths, polars, radii = self.fields.grid.shape
        arguments = {
            "fields": values,
            "kinds": kinds,
            "mass": mass,
            "flux": flux,
            "diffusions": diffusions,
            "ratio": self.ratio,
            "step": 1.0,
            "radii": radii,
            "stride": self.fields.stride,
            "rays": azimuths * polars,
            "cells": self.fields.cells,
        }
        return self.fields.grouped(self.program, "mix_along", azimuths * polars, arguments)
