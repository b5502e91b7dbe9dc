"""Solver for the potential of the mass fluxes on the grid of rays.

The operator is a sum of products of one factor for each axis. Eigenvectors of azimuth and polar
angle separate it into one tridiagonal system along the radius for each pair of them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import eigh

from cldit.arrays import Floats
from cldit.gpu.program import Launch
from cldit.spray.flow.ray_fields import RayFields
from cldit.spray.flow.rays import RayGrid


class Projection:
    """Solver of div(grad(potential)) = amiss, in flux form, for a grid."""

    def __init__(self, fields: RayFields) -> None:
        self._fields, self._program = fields, fields.program("spray/gas_projection.cl")
        factors = factored(fields.grid)
        matrices = {
            "into azimuth": factors.azimuthal.T,
            "from azimuth": factors.azimuthal,
            "into polar": factors.down.transpose(0, 2, 1),
            "from polar": factors.down,
        }
        self._matrices = {name: fields.table(name, matrix) for name, matrix in matrices.items()}
        self._lower = fields.row("lower", factors.lower)
        self._upper, self._pivot = fields.plane("upper"), fields.plane("pivot")
        fields.write(self._upper, factors.upper)
        fields.write(self._pivot, factors.pivot)
        self._modes = fields.plane("modes")

    def launches(self, amiss: Any) -> list[Launch]:
        """Kernels that replace a plane of minus the outflow that is amiss by the potential."""
        modes = self._modes
        azimuths, polars, radii = self._fields.grid.shape
        along = {
            "modes": amiss,
            "lower": self._lower,
            "upper": self._upper,
            "pivot": self._pivot,
            "radii": radii,
            "stride": self._fields.stride,
            "rays": azimuths * polars,
        }
        return [
            self._product("into azimuth", amiss, modes),
            self._product("into polar", modes, amiss),
            self._fields.grouped(self._program, "solve_along", azimuths * polars, along),
            self._product("from polar", amiss, modes),
            self._product("from azimuth", modes, amiss),
        ]

    def _product(self, name: str, values: Any, products: Any) -> Launch:
        """Product of the matrices of this name and a plane."""
        f = self._fields
        azimuths, polars, _ = f.grid.shape
        layer = polars * f.stride
        azimuth = name.endswith("azimuth")
        count, columns = (azimuths, layer) if azimuth else (polars, f.stride)
        arguments = {
            "matrices": self._matrices[name],
            "values": values,
            "products": products,
            "count": count,
            "jump": columns,
            "batch_jump": layer,
            "matrix_jump": count * count,
            "columns": columns,
            "batches": 1 if azimuth else azimuths,
        }
        # A work-item makes four rows of a product, see kernels/spray/gas_projection.cl.
        items = columns // f.simd_width * -(-count // 4) * arguments["batches"]
        return f.grouped(self._program, "transform", items, arguments)


class Factors:
    """Eigenvectors, and factored systems along the radius.

    around: (A, A); down: (A, P, P); lower: (R,); upper, pivot: (A, P, R).
    """

    def __init__(
        self, azimuthal: Floats, down: Floats, lower: Floats, shape: tuple[int, ...]
    ) -> None:
        self.azimuthal, self.down, self.lower = azimuthal, down, lower
        self.upper, self.pivot = np.empty(shape), np.empty(shape)


def factored(grid: RayGrid) -> Factors:
    """Factors of the operator of a grid."""
    na, nt, nr = grid.shape
    azimuth, polar, radius = grid.middle
    wide, high = np.diff(grid.azimuth), -np.diff(np.cos(grid.polar))
    azimuthal = np.zeros(na + 1)
    azimuthal[1:-1] = 1 / np.diff(azimuth)
    matrix = _second_difference(azimuthal)
    if grid.ring:
        closing = 1 / (azimuth[0] - (azimuth[-1] - 2 * np.pi))
        matrix[0, 0] += closing
        matrix[-1, -1] += closing
        matrix[0, -1] -= closing
        matrix[-1, 0] -= closing
    down = np.zeros(nt + 1)
    down[1:-1] = np.sin(grid.polar[1:-1]) / np.diff(polar)
    outward = np.zeros(nr + 1)
    outward[1:-1] = grid.radius_m[1:-1] ** 2 / np.diff(radius)
    side = np.diff(grid.polar) / np.sin(polar)
    turn, vectors = eigh(matrix, np.diag(wide))
    factors = Factors(vectors, np.empty((na, nt, nt)), -outward[:-1], grid.shape)
    length = grid.strip_m2 / radius
    lean = np.empty((na, nt))
    for k in range(na):
        operator = _second_difference(down) + turn[k] * np.diag(side)
        lean[k], factors.down[k] = eigh(operator, np.diag(high))
    lean[0, 0] = 0.0
    diagonal = outward[:-1] + outward[1:] + lean[:, :, None] * length
    diagonal[0, 0, 0] *= 2.0  # fixes the constant, which has no gradient
    previous = np.zeros((na, nt))
    for i in range(nr):
        factors.pivot[:, :, i] = 1.0 / (diagonal[:, :, i] + outward[i] * previous)
        previous = -outward[i + 1] * factors.pivot[:, :, i]
        factors.upper[:, :, i] = previous
    return factors


def _second_difference(faces: Floats) -> Floats:
    """Matrix of minus the second difference with the coefficients of the faces."""
    matrix = np.diag(faces[:-1] + faces[1:])
    if len(faces) > 2:
        matrix -= np.diag(faces[1:-1], 1) + np.diag(faces[1:-1], -1)
    return np.asarray(matrix)
