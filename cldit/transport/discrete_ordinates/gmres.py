"""GMRES for the scattered source (stage 1 of `trace_source`), or a fixed number of orders.

GMRES (Saad, Iterative Methods for Sparse Linear Systems, 2003, ch. 6) solves S = a Lambda S + E
along few ordinates. One sweep along more ordinates gives the residual of that solution. GMRES then
solves for the correction along the few, which describe the exchange between cells well (defect
correction: Stetter, Numer. Math. 29, 1978). The remaining error is of second order in the
difference of the two sets.
"""

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

# RMS rounding error of a number in machine epsilons: uniform up to half of the last digit, with
# mantissas from 1 to 2.
_ROUNDED = 0.2


@dataclass(frozen=True)
class Solution:
    """Source of the scattering cells.

    source: (C, N), in the unit of `OpticalCells.emitted`.
    iterations: sets of sweeps along all ordinates.
    error: RMS error of the source, from the smallest singular value in GMRES; 0 at a fixed order.
    residual: (C, N) preconditioned residual, about the error of the source.
    """

    source: Array
    iterations: int
    error: float
    residual: Array | None = None


def order_0(sweeper: Sweeper, albedo: NDArray[np.float64]) -> Array:
    """Source (C, N) of order 0: all scattered light comes from the wall (paper, "Ray Tracing")."""
    guess = sweeper.thermal.copy()
    guess[1] += albedo.astype(guess.dtype)
    return guess


def next_order(sweeper: Sweeper, source: Array, rays: DeviceOrdinates) -> Array:
    """Source (C, N) with one more order of scattering than `source` (C, N): Lambda iteration."""
    sweeper.set_source(source, shining=True)
    sweeper.sweep(rays, shining=True)
    return sweeper.next_order()


def _rms(values: Array) -> NDArray[np.float64]:
    """RMS over the cells of each component of `values` (C, N)."""
    wide = values.astype(np.float64)
    return np.asarray(np.sqrt(np.mean(wide * wide, axis=1)))


def _worst(residual: Array) -> float:
    """RMS of the worst component of a residual (C, N); TransportError if it is not finite."""
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
    """Solves the equation of transfer by GMRES with restarts, preconditioned by 1 - Lambda*.

    The operator is the same for all components, so that they share one set of sweeps; each has its
    own Krylov space.

    Args:
        guess: (C, N) initial source.
        tolerance: largest RMS error of the source of any component.
        confirmed: convergence is confirmed by one more iteration, which includes rounding; else by
            GMRES's own residual.
    """
    source = guess.astype(sweeper.real)
    iterations, inverse_norm, before = 0, 1.0, np.inf
    while True:
        sweeper.set_source(source, shining=True)
        sweeper.sweep(rays, shining=True)
        iterations += 1
        residual = sweeper.residual(shining=True)
        now = _worst(residual)
        if report is not None:
            report(f"iteration {iterations}: residual {now:.1e}, error {now * inverse_norm:.1e}")
        if now == 0.0 or (iterations > 1 and now * inverse_norm <= tolerance):
            return Solution(source, iterations, now * inverse_norm, residual)
        if iterations >= sweeper.tuning.iterations or now > 0.5 * before:
            raise _stuck(now * inverse_norm, iterations, tolerance)
        before = now
        cycle = _krylov(sweeper, residual, rays, tolerance)
        iterations, inverse_norm = iterations + cycle.iterations, cycle.inverse_norm
        source = source + cycle.correction
        if not confirmed and (left := _worst(cycle.left)) * inverse_norm <= tolerance:
            return Solution(source, iterations, left * inverse_norm, cycle.left)


def _stuck(error: float, iterations: int, tolerance: float) -> NotConvergedError:
    return NotConvergedError(
        f"scattering does not converge: error {error:.1e} after {iterations} iterations, wanted "
        f"{tolerance:.1e}; increase transport.accuracy_K, or set transport.precision: float64"
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
    """Corrects a solution along few ordinates for its defect along more; raises as `gmres`.

    The sweeper must have swept the solution along the larger set.

    Args:
        solution: of `gmres` along `rays`, the few ordinates.
        tolerance, report: as in `gmres`.
        listed: buffer of that sweep's I - S, see `Sweeper.residual`; None: the sweeper's own.

    Returns:
        The corrected solution, and the mean radiance (C, N) that the correction adds.
    """
    residual = sweeper.residual(shining=True, listed=listed)
    left, correction, iterations = residual, np.zeros_like(residual), solution.iterations
    # The residual is updated from cycle to cycle, so it does not show the rounding of the first.
    rounding = _ROUNDED * float(np.finfo(residual.dtype).eps) * _worst(solution.source)
    error, most = _worst(residual), sweeper.tuning.solver_peak
    now, peak = error, most
    while now > 0.0 and (left is residual or error > tolerance or peak > most):
        # A few opaque cells may be far above the mean: they are solved as well.
        before, cycle = now, _krylov(sweeper, left, rays, tolerance * min(1.0, most / peak))
        correction, left = correction + cycle.correction, cycle.left
        iterations += cycle.iterations
        now, peak = _worst(left), float(np.max(np.abs(left) * sweeper.opacity))
        error = (now + rounding) * cycle.inverse_norm
        if report is not None:
            report(f"iteration {iterations}, corrected: residual {now:.1e}, error {error:.1e}")
        spent = iterations >= sweeper.tuning.iterations
        if spent or now > 0.5 * before or now < rounding:
            if error > tolerance:
                raise _stuck(error, iterations, tolerance)
            break
    # The correction less the unpreconditioned residual, over the albedo.
    least = np.finfo(residual.dtype).tiny
    albedo = np.maximum(sweeper.albedo, least).astype(residual.dtype)
    more = (correction - residual * sweeper.one_minus_lambda) / albedo
    source = solution.source + correction
    return Solution(source, iterations, error, left), more


@dataclass(frozen=True)
class _Cycle:
    """Correction and residual (C, N) of a GMRES cycle, and 1 / the smallest singular value."""

    correction: Array
    left: Array
    iterations: int
    inverse_norm: float


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
    inverse_norm = 1.0
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
            inverse_norm = max(inverse_norm, 1.0 / max(smallest, 1e-12))
            error = max(error, float(np.linalg.norm(target - h @ best[c])) / count**0.5)
        basis.append(image / np.where(length > 0, length, 1.0)[:, None].astype(image.dtype))
        # Half the tolerance: the true residual will differ a little.
        if error * inverse_norm <= 0.5 * tolerance:
            break
        if np.all(length <= 1e-6 * np.abs(hessenberg[:, 0, 0]).max()):
            break  # the space contains the solution
    correction, left = np.zeros_like(residual), residual.copy()
    for c in range(parts):
        reached = hessenberg[c, :, : len(best[c])] @ best[c]
        for number, vector in enumerate(basis):
            left[c] -= vector[c] * residual.dtype.type(reached[number])
            if number < len(best[c]):
                correction[c] += vector[c] * residual.dtype.type(best[c][number])
    return _Cycle(correction, left, taken, inverse_norm)
