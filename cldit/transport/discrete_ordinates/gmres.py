"""The scattered source: a fixed number of orders, or GMRES to a residual.

GMRES makes do with few directions. How far its solution is from that of more shows in one sweep
along these; and as the few tell well how light goes on from one cell to others, GMRES then solves
for what is lacking (defect correction: Stetter, Numer. Math. 29, 1978). What is left is of second
order in what the two sets differ by.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.errors import NotConvergedError, TransportError
from cldit.transport.discrete_ordinates.device_ordinates import DeviceOrdinates
from cldit.transport.discrete_ordinates.sweep import Sweeper

Array = NDArray[Any]
Report = Callable[[str], None]

# RMS of what rounding takes from numbers, in machine epsilons of theirs: up to a half of the last
# digit, evenly, of mantissas from 1 to 2.
_ROUNDED = 0.2


@dataclass(frozen=True)
class Solution:
    """source (C, N) of the scattering cells; iterations: full sets of sweeps that it took.

    residual: RMS of the preconditioned residual, of the worst component. error: what that stands
    for in the source, through the smallest singular value that GMRES met. Both are 0 for a fixed
    order, which is no approximation of the converged answer but an answer of its own. lack (C, N):
    the residual itself, about what the source is short of. towards (C, N): what the cells send to
    the camera, once that is known.
    """

    source: Array
    iterations: int
    residual_rms: float
    error: float
    residual: Array | None = None
    towards: Array | None = None


def order_0(sweeper: Sweeper, albedo: NDArray[np.float64]) -> Array:
    """Order 0: whatever is scattered is taken to come from the wall (paper, "Ray Tracing")."""
    guess = sweeper.thermal.copy()
    guess[1] += albedo.astype(guess.dtype)
    return guess


def next_order(sweeper: Sweeper, source: Array, rays: DeviceOrdinates) -> Array:
    """The source after one more scattering."""
    sweeper.set_source(source, shining=True)
    sweeper.sweep(rays, shining=True)
    return sweeper.next_order()


def _rms(values: Array) -> NDArray[np.float64]:
    """RMS over cells of each component (C, N)."""
    wide = values.astype(np.float64)
    return np.asarray(np.sqrt(np.mean(wide * wide, axis=1)))


def _worst(residual: Array) -> float:
    """RMS of a residual (C, N), of its worst component; TransportError where it is not finite."""
    worst = float(_rms(residual).max())
    if not np.isfinite(worst):
        raise TransportError("the scattered source is not finite")
    return worst


def gmres(
    sweeper: Sweeper,
    guess: Array,
    rays: DeviceOrdinates,
    *,
    tolerance: float,
    report: Report | None = None,
    confirmed: bool = True,
) -> Solution:
    """GMRES with restarts on the preconditioned equation of transfer.

    The operator is the same for every component, so one set of sweeps serves them together, each
    with its own Krylov space.

    Args:
        guess: (C, N) to start from.
        tolerance: RMS error allowed in the source of any component.
        confirmed: by one pass more, which sees rounding too; else by what GMRES makes of its own.

    Raises:
        NotConvergedError: the tolerance cannot be met (rounding, or too many iterations).
        TransportError: the source is not finite.
    """
    source = guess.astype(sweeper.real)
    iterations, gain, before = 0, 1.0, np.inf
    while True:
        sweeper.set_source(source, shining=True)
        sweeper.sweep(rays, shining=True)
        iterations += 1
        residual = sweeper.residual(shining=True)
        now = _worst(residual)
        if report is not None:
            report(f"iteration {iterations}: residual {now:.1e}, error {now * gain:.1e}")
        if now == 0.0 or (iterations > 1 and now * gain <= tolerance):
            return Solution(source, iterations, now, now * gain, residual)
        if iterations >= sweeper.tuning.iterations or now > 0.5 * before:
            raise _stuck(now * gain, iterations, tolerance)
        before = now
        cycle = _krylov(sweeper, residual, rays, tolerance)
        iterations, gain = iterations + cycle.iterations, cycle.gain
        source = source + cycle.step
        if not confirmed and (left := _worst(cycle.left)) * gain <= tolerance:
            return Solution(source, iterations, left, left * gain, cycle.left)


def _stuck(error: float, iterations: int, tolerance: float) -> NotConvergedError:
    return NotConvergedError(
        f"scattering does not converge below an error of {error:.1e} ({iterations} iterations), "
        f"asked for is {tolerance:.1e}; allow a larger transport.accuracy_K, or set "
        "transport.precision: float64"
    )


def defect_correction(
    sweeper: Sweeper,
    solution: Solution,
    rays: DeviceOrdinates,
    *,
    tolerance: float,
    report: Report | None = None,
    listed: Any = None,
) -> tuple[Solution, Array]:
    """The solution as more directions have it, and how much more light (C, N) that brings to cells
    than these found.

    The sweeper has swept the solution along them, into `listed` (see `Sweeper.residual_rms`); rays:
    those that it was solved with.

    Raises:
        NotConvergedError, TransportError: as `gmres`.
    """
    residual = sweeper.residual(shining=True, listed=listed)
    left, step, iterations = residual, np.zeros_like(residual), solution.iterations
    # What is left goes from cycle to cycle, and cannot show what `residual` itself is off by.
    rounding = _ROUNDED * float(np.finfo(residual.dtype).eps) * _worst(solution.source)
    error = now = _worst(residual)
    while now > 0.0 and (error > tolerance or left is residual):
        before, cycle = now, _krylov(sweeper, left, rays, tolerance)
        step, left, iterations = step + cycle.step, cycle.left, iterations + cycle.iterations
        now = _worst(left)
        error = (now + rounding) * cycle.gain
        if report is not None:
            report(f"iteration {iterations}, corrected: residual {now:.1e}, error {error:.1e}")
        if error > tolerance and (now > 0.5 * before or now < rounding):
            raise _stuck(error, iterations, tolerance)
    # What the step scatters, less what it is of its own: the residual not preconditioned.
    least = np.finfo(residual.dtype).tiny
    albedo = np.maximum(sweeper.albedo, least).astype(residual.dtype)
    more = (step - residual * sweeper.one_minus_lambda) / albedo
    source = solution.source + step
    return Solution(source, iterations, now, error, left), more


@dataclass(frozen=True)
class _Cycle:
    """step: (C, N) to take; left (C, N): residual after it; gain: error per residual."""

    step: Array
    left: Array
    iterations: int
    gain: float


def _krylov(sweeper: Sweeper, residual: Array, rays: DeviceOrdinates, tolerance: float) -> _Cycle:
    """One cycle of GMRES."""
    parts, count = residual.shape
    start = np.sqrt(np.sum(residual.astype(np.float64) ** 2, axis=1))
    alive = start > 0
    basis = [residual / np.where(alive, start, 1.0)[:, None].astype(residual.dtype)]
    tuning = sweeper.tuning
    most = int(np.clip(tuning.krylov_bytes / max(residual.nbytes, 1), 12, tuning.krylov))
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
        basis.append(image / np.where(length > 0, length, 1.0)[:, None].astype(image.dtype))
        # Half the tolerance: the rest is for what the true residual will differ by.
        if error * gain <= 0.5 * tolerance:
            break
        if np.all(length <= 1e-6 * np.abs(hessenberg[:, 0, 0]).max()):
            break  # the space is exhausted: the solution lies in it
    step, left = np.zeros_like(residual), residual.copy()
    for c in range(parts):
        met = hessenberg[c, :, : len(best[c])] @ best[c]
        for number, vector in enumerate(basis):
            left[c] -= vector[c] * residual.dtype.type(met[number])
            if number < len(best[c]):
                step[c] += vector[c] * residual.dtype.type(best[c][number])
    return _Cycle(step, left, taken, gain)
