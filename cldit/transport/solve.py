"""The scattered source: a fixed number of orders, or GMRES to a residual."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.errors import NotConvergedError, TransportError
from cldit.transport.rays import Rays
from cldit.transport.sweep import Sweeper

Array = NDArray[Any]
Report = Callable[[str], None]

# Vectors kept before a restart: light that diffuses far needs many, others some eight.
_KRYLOV = 80
_KRYLOV_BYTES = 1e9  # that they may take, but for the first twelve
_MAX_PASSES = 600


@dataclass(frozen=True)
class Solution:
    """source (C, N) of the scattering cells; passes: full sets of sweeps that it took.

    residual: RMS of the preconditioned residual, of the worst component. error: what that stands
    for in the source, through the smallest singular value that GMRES met. Both are 0 for a fixed
    order, which is no approximation of the converged answer but an answer of its own. lack (C, N):
    the residual itself, about what the source is short of. towards (C, N): what the cells send to
    the camera, once that is known.
    """

    source: Array
    passes: int
    residual: float
    error: float
    lack: Array | None = None
    towards: Array | None = None


def first_guess(sweeper: Sweeper, albedo: NDArray[np.float64]) -> Array:
    """Order 0: whatever is scattered is taken to come from the wall (paper, "Ray Tracing")."""
    guess = sweeper.thermal.copy()
    guess[1] += albedo.astype(guess.dtype)
    return guess


def another_order(sweeper: Sweeper, source: Array, rays: Rays) -> Array:
    """The source after one more scattering."""
    sweeper.set_source(source, shining=True)
    sweeper.sweep(rays, shining=True)
    return sweeper.next_order()


def _rms(values: Array) -> NDArray[np.float64]:
    """RMS over cells of each component (C, N)."""
    wide = values.astype(np.float64)
    return np.asarray(np.sqrt(np.mean(wide * wide, axis=1)))


def solve(
    sweeper: Sweeper, guess: Array, rays: Rays, *, tolerance: float, report: Report | None = None
) -> Solution:
    """GMRES with restarts on the preconditioned equation of transfer.

    The operator is the same for every component, so one set of sweeps serves them together, each
    with its own Krylov space.

    Args:
        guess: (C, N) to start from.
        tolerance: RMS error allowed in the source of any component.

    Raises:
        NotConvergedError: the tolerance cannot be met (rounding, or too many passes).
        TransportError: the source is not finite.
    """
    source = guess.astype(sweeper.real)
    passes, gain, before = 0, 1.0, np.inf
    while True:
        sweeper.set_source(source, shining=True)
        sweeper.sweep(rays, shining=True)
        passes += 1
        lack = sweeper.residual(shining=True)
        now = float(_rms(lack).max())
        if not np.isfinite(now):
            raise TransportError("the scattered source is not finite")
        if report is not None:
            report(f"pass {passes}: residual {now:.1e}, error {now * gain:.1e}")
        if now == 0.0 or (passes > 1 and now * gain <= tolerance):
            return Solution(source, passes, now, now * gain, lack)
        if passes >= _MAX_PASSES or now > 0.5 * before:
            raise NotConvergedError(
                f"scattering does not converge below an error of {now * gain:.1e} "
                f"({passes} passes), asked for is {tolerance:.1e}; allow a larger "
                "transport.accuracy_K, or set transport.precision: float64"
            )
        before = now
        step, taken, gain = _krylov(sweeper, lack, rays, tolerance)
        passes += taken
        source = source + step


def _krylov(
    sweeper: Sweeper, lack: Array, rays: Rays, tolerance: float
) -> tuple[Array, int, float]:
    """One cycle of GMRES: the step to take, passes used, and error per residual."""
    parts, count = lack.shape
    start = np.sqrt(np.sum(lack.astype(np.float64) ** 2, axis=1))
    alive = start > 0
    basis = [lack / np.where(alive, start, 1.0)[:, None].astype(lack.dtype)]
    most = int(np.clip(_KRYLOV_BYTES / max(lack.nbytes, 1), 12, _KRYLOV))
    hessenberg = np.zeros((parts, most + 1, most))
    best: list[NDArray[np.float64]] = [np.zeros(0)] * parts
    gain = 1.0
    taken = 0
    for j in range(most):
        sweeper.set_source(basis[j], shining=False)
        sweeper.sweep(rays, shining=False)
        taken += 1
        image = -sweeper.residual(shining=False)
        for i, vector in enumerate(basis):  # modified Gram-Schmidt
            overlap = np.einsum("cn,cn->c", vector, image, dtype=np.float64)
            hessenberg[:, i, j] = overlap
            image = image - overlap.astype(image.dtype)[:, None] * vector
        length = np.sqrt(np.sum(image.astype(np.float64) ** 2, axis=1))
        hessenberg[:, j + 1, j] = length
        error = 0.0
        for c in range(parts):
            if not alive[c]:
                continue
            h = hessenberg[c, : j + 2, : j + 1]
            target = np.zeros(j + 2)
            target[0] = start[c]
            best[c] = np.linalg.lstsq(h, target, rcond=None)[0].astype(float)
            smallest = float(np.linalg.svd(h, compute_uv=False)[-1])
            gain = max(gain, 1.0 / max(smallest, 1e-12))
            error = max(error, float(np.linalg.norm(target - h @ best[c])) / count**0.5)
        # Half the tolerance: the rest is for what the true residual will differ by.
        if error * gain <= 0.5 * tolerance:
            break
        if np.all(length <= 1e-6 * np.abs(hessenberg[:, 0, 0]).max()):
            break  # the space is exhausted: the solution lies in it
        basis.append(image / np.where(length > 0, length, 1.0)[:, None].astype(image.dtype))
    step = np.zeros_like(lack)
    for c in range(parts):
        for factor, vector in zip(best[c], basis, strict=False):
            step[c] += vector[c] * lack.dtype.type(factor)
    return step, taken, gain
