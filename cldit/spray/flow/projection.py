"""Solver for the potential of the mass fluxes on the grid of rays.

The operator is a sum of products of one factor for each axis. Eigenvectors of azimuth and polar
angle separate it into one tridiagonal system along the radius for each pair of them.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from cldit.arrays import Floats
from cldit.spray.flow.rays import RayGrid
from cldit.spray.numba_typing import compiled


class Projection:
    """Solver of div(grad(potential)) = amiss, in flux form, for a grid."""

    def __init__(self, grid: RayGrid) -> None:
        na, nt, nr = grid.shape
        azimuth, polar, radius = grid.middle
        wide, high = np.diff(grid.azimuth), -np.diff(np.cos(grid.polar))
        around = np.zeros(na + 1)
        around[1:-1] = 1 / np.diff(azimuth)
        down = np.zeros(nt + 1)
        down[1:-1] = np.sin(grid.polar[1:-1]) / np.diff(polar)
        outward = np.zeros(nr + 1)
        outward[1:-1] = grid.radius_m[1:-1] ** 2 / np.diff(radius)
        side = np.diff(grid.polar) / np.sin(polar)
        turn, self._around = eigh(_second(around), np.diag(wide))
        self._down = np.empty((na, nt, nt))
        self._upper, self._pivot = np.empty((na, nt, nr)), np.empty((na, nt, nr))
        length = grid.strip_m2 / radius
        for k in range(na):
            lean, self._down[k] = eigh(_second(down) + turn[k] * np.diag(side), np.diag(high))
            if k == 0:
                lean[0] = 0.0
            for j in range(nt):
                self._factor(outward, lean[j] * length, k, j)
        self._lower = -outward[:-1]
        self._shape = grid.shape

    def _factor(self, outward: Floats, diagonal: Floats, k: int, j: int) -> None:
        whole = outward[:-1] + outward[1:] + diagonal
        if k == 0 and j == 0:
            whole[0] *= 2.0  # fixes the constant, which has no gradient
        _thomas(outward, whole, self._upper[k, j], self._pivot[k, j])

    def __call__(self, amiss: Floats) -> Floats:
        one, other = np.negative(amiss), np.empty(self._shape)
        flat = (1, self._shape[0], self._shape[1] * self._shape[2])
        around = self._around[None]
        _turned(around.transpose(0, 2, 1).copy(), one.reshape(flat), other.reshape(flat))
        _turned(self._down.transpose(0, 2, 1).copy(), other, one)
        _back(self._lower, self._upper, self._pivot, one)
        _turned(self._down, one, other)
        _turned(around, other.reshape(flat), one.reshape(flat))
        return one


def _second(faces: Floats) -> Floats:
    """Matrix of minus the second difference with the coefficients of the faces."""
    matrix = np.diag(faces[:-1] + faces[1:])
    if len(faces) > 2:
        matrix -= np.diag(faces[1:-1], 1) + np.diag(faces[1:-1], -1)
    return np.asarray(matrix)


@compiled
def _turned(matrices: Floats, values: Floats, result: Floats) -> None:
    """Products of matrices (K, N, N) and values (K, N, R).

    Those of a library for linear algebra have threads that wait for each other by spinning. Two
    rows of the result are made from four of the values at a time, which takes the fewest reads.
    """
    kinds, count, length = values.shape
    for k in range(kinds):
        for n in range(0, count, 2):
            one, other = result[k, n], result[k, min(n + 1, count - 1)]
            left, right = matrices[k, n], matrices[k, min(n + 1, count - 1)]
            one[:] = 0.0
            other[:] = 0.0
            for m in range(0, count - 3, 4):
                a, b, c, d = left[m], left[m + 1], left[m + 2], left[m + 3]
                e, f, g, h = right[m], right[m + 1], right[m + 2], right[m + 3]
                p, q = values[k, m], values[k, m + 1]
                r, s = values[k, m + 2], values[k, m + 3]
                for i in range(length):
                    w, x, y, z = p[i], q[i], r[i], s[i]
                    # Both before either is written: the last row may be both.
                    u = one[i] + a * w + b * x + c * y + d * z
                    v = other[i] + e * w + f * x + g * y + h * z
                    one[i] = u
                    other[i] = v
            for m in range(count - count % 4, count):
                a, e, p = left[m], right[m], values[k, m]
                for i in range(length):
                    u = one[i] + a * p[i]
                    v = other[i] + e * p[i]
                    one[i] = u
                    other[i] = v


@compiled
def _thomas(faces: Floats, whole: Floats, upper: Floats, pivot: Floats) -> None:
    count = len(whole)
    before = 0.0
    for i in range(count):
        pivot[i] = 1.0 / (whole[i] + faces[i] * before)
        upper[i] = -faces[i + 1] * pivot[i]
        before = upper[i]


@compiled
def _back(lower: Floats, upper: Floats, pivot: Floats, modes: Floats) -> None:
    na, nt, nr = modes.shape
    for k in range(na):
        for j in range(nt):
            row, up, inverse = modes[k, j], upper[k, j], pivot[k, j]
            row[0] *= inverse[0]
            for i in range(1, nr):
                row[i] = (row[i] - lower[i] * row[i - 1]) * inverse[i]
            for i in range(nr - 2, -1, -1):
                row[i] -= up[i] * row[i + 1]
