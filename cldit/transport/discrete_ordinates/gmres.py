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
from cldit.transport.discrete_ordinates.krylov import KrylovSpace
from cldit.transport.discrete_ordinates.sweep import Sweeper

Array = NDArray[Any]
Report = Callable[[str], None]

# RMS rounding error of a number in machine epsilons: uniform up to half of the last digit, with
# mantissas from 1 to 2.
_ROUNDED = 0.2


@dataclass(frozen=True)
class Solution:
    """Source of the scattering cells, on the device.

    source: list (C, N), in the unit of `OpticalCells.emitted`.
    iterations: sets of sweeps along all ordinates.
    error: RMS error of the source, from the smallest singular value in GMRES; 0 at a fixed order.
    residual: vector (C, N) of the preconditioned residual after a defect correction, about the
        error of the source.
    """

    source: Any
    iterations: int
    error: float
    residual: Any = None


def order_0(sweeper: Sweeper, albedo: NDArray[np.float64]) -> Array:
    """Source (C, N) of order 0: all scattered light comes from the wall (paper, "Ray Tracing")."""
    guess = sweeper.thermal.copy()
    guess[1] += albedo.astype(guess.dtype)
    return guess


def next_order(sweeper: Sweeper, source: Any, rays: DeviceOrdinates) -> Any:
    """List (C, N) with one more order of scattering than `source` (C, N): Lambda iteration."""
    sweeper.set_source(source, shining=True)
    sweeper.sweep(rays, shining=True)
    return sweeper.next_order()


def _worst(rms: NDArray[np.float64]) -> float:
    """Largest RMS of a component, of (C,); TransportError if one is not finite."""
    worst = float(rms.max())
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
    space, source = sweeper.krylov(), sweeper.listed(guess)
    start_source = source
    iterations, inverse_norm, previous = 0, 1.0, np.inf
    while True:
        sweeper.set_source(source, shining=True)
        sweeper.sweep(rays, shining=True)
        iterations += 1
        sweeper.residual(space, space.left, shining=True)
        rms, *_ = space.measured()
        residual_rms = _worst(rms)
        if report is not None:
            report(
                f"iteration {iterations}: residual {residual_rms:.1e}, "
                f"error {residual_rms * inverse_norm:.1e}"
            )
        if residual_rms == 0.0 or (iterations > 1 and residual_rms * inverse_norm <= tolerance):
            break
        if iterations >= sweeper.tuning.iterations or residual_rms > 0.5 * previous:
            raise _stuck(residual_rms * inverse_norm, iterations, tolerance)
        previous = residual_rms
        rms, _, taken, inverse_norm = _krylov(sweeper, space, rms, rays, tolerance)
        iterations += taken
        residual_rms, source = _worst(rms), sweeper.corrected(space, start_source)
        if not confirmed and residual_rms * inverse_norm <= tolerance:
            break
    return Solution(source, iterations, residual_rms * inverse_norm)


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
    light: Any = None,
) -> Solution:
    """Corrects a solution along few ordinates for its defect along more; raises as `gmres`.

    The sweeper must have swept the solution along the larger set.

    Args:
        solution: of `gmres` along `rays`, the few ordinates.
        tolerance, report: as in `gmres`.
        listed: buffer of that sweep's I - S, see `Sweeper.residual`; None: the sweeper's own.
        light: list of that sweep's mean radiance (C, N), which gets what the correction adds.
    """
    space, iterations = sweeper.krylov(), solution.iterations
    sweeper.residual(space, space.left, shining=True, listed=listed)
    residual = None if light is None else space.copied(space.left)
    rms, peak, source = space.measured()
    # The residual is updated from cycle to cycle, so it does not show the rounding of the first.
    rounding = _ROUNDED * float(np.finfo(sweeper.real).eps) * _worst(source)
    error = residual_rms = _worst(rms)
    peak_limit, previous = sweeper.tuning.solver_peak, np.inf
    while residual_rms > 0.0 and (previous == np.inf or error > tolerance or peak > peak_limit):
        # A few opaque cells may be far above the mean: they are solved as well.
        previous = residual_rms
        cycle_tolerance = tolerance * min(1.0, peak_limit / peak)
        rms, peak, taken, inverse_norm = _krylov(sweeper, space, rms, rays, cycle_tolerance)
        iterations += taken
        residual_rms = _worst(rms)
        error = (residual_rms + rounding) * inverse_norm
        if report is not None:
            report(
                f"iteration {iterations}, corrected: residual {residual_rms:.1e}, error {error:.1e}"
            )
        spent = iterations >= sweeper.tuning.iterations
        if spent or residual_rms > 0.5 * previous or residual_rms < rounding:
            if error > tolerance:
                raise _stuck(error, iterations, tolerance)
            break
    corrected = sweeper.corrected(space, solution.source, light, residual)
    return Solution(corrected, iterations, error, space.left)


def _krylov(
    sweeper: Sweeper,
    space: KrylovSpace,
    start: NDArray[np.float64],
    rays: DeviceOrdinates,
    tolerance: float,
) -> tuple[NDArray[np.float64], float, int, float]:
    """One cycle of GMRES for the residual `space.left`, whose RMS is `start` (C,).

    Returns:
        RMS (C,) and peak of the residual that is left, as `KrylovSpace.add` returns them, number of
        iterations, and 1 / the smallest singular value.
    """
    parts, tuning = len(start), sweeper.tuning
    bytes_ = parts * sweeper.count * np.dtype(sweeper.real).itemsize
    capacity = int(np.clip(tuning.krylov_bytes / max(bytes_, 1), 12, tuning.krylov))
    hessenberg = np.zeros((parts, capacity + 1, capacity))
    best = np.zeros((parts, capacity))
    inverse_norm, taken = 1.0, 0
    space.begin()
    while taken < capacity:
        sweeper.set_source(None, shining=False)
        sweeper.sweep(rays, shining=False)
        j, taken = taken, taken + 1
        sweeper.residual(space, space.image, shining=False, number=taken)
        # The residual is the right-hand side less the operator's image.
        overlap, length = space.extend(taken)
        hessenberg[:, :taken, j], hessenberg[:, taken, j] = -overlap.T, -length
        error = 0.0
        for c in np.flatnonzero(start > 0):
            h = hessenberg[c, : taken + 1, :taken]
            target = np.zeros(taken + 1)
            target[0] = start[c]
            best[c, :taken] = np.linalg.lstsq(h, target, rcond=None)[0]
            smallest = float(np.linalg.svd(h, compute_uv=False)[-1])
            inverse_norm = max(inverse_norm, 1.0 / max(smallest, 1e-12))
            error = max(error, float(np.linalg.norm(target - h @ best[c, :taken])))
        # Half the tolerance: the true residual will differ a little.
        if error * inverse_norm <= 0.5 * tolerance:
            break
        if np.all(length <= 1e-6 * np.abs(hessenberg[:, 0, 0]).max()):
            break  # the space contains the solution
    used = taken + 1
    reached = np.einsum("cij,cj->ic", hessenberg[:, :used], best)
    rms, peak = space.add(np.stack([np.eye(used, capacity) @ best.T, -reached]))
    return rms, peak, taken, inverse_norm
