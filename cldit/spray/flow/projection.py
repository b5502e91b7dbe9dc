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

_BLOCK = 256  # entries of a row, so that rows of one block stay in the cache


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

    Those of a library for linear algebra have threads that wait for each other by spinning.
    """
    kinds, count, length = values.shape
    for k in range(kinds):
        for first in range(0, length, _BLOCK):
            last = min(first + _BLOCK, length)
            for n in range(count):
                out, factors = result[k, n], matrices[k, n]
                for i in range(first, last):
                    out[i] = 0.0
                m = 0
                while m + 4 <= count:  # reads and writes the result a quarter as often
                    a, b, c, d = factors[m], factors[m + 1], factors[m + 2], factors[m + 3]
                    p, q = values[k, m], values[k, m + 1]
                    r, s = values[k, m + 2], values[k, m + 3]
                    for i in range(first, last):
                        out[i] += a * p[i] + b * q[i] + c * r[i] + d * s[i]
                    m += 4
                for rest in range(m, count):
                    factor, row = factors[rest], values[k, rest]
                    for i in range(first, last):
                        out[i] += factor * row[i]


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
