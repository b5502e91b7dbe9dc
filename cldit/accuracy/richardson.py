"""Richardson extrapolation: the error that is left on the finest of three grids.

If the error is C h^p, the difference d(h) between the images at 2 h and h falls by 2^p when h is
halved. So the order is p = log2(d(2 h) / d(h)), and the error at h is d(h) / (2^p - 1) (Roache, J.
Fluids Eng. 116, 405, 1994); other ratios of size likewise. Orders are limited to the range from 1,
that of constant cells, to 2, that of linear ones. If the difference falls faster than second
order, the middle of both limits is assumed. Beyond an order of 2.5, which chance in the differences
rarely makes, the coarsest grid is outside the asymptotic range, and first order is assumed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import scipy

from cldit.accuracy.errors import Estimate
from cldit.accuracy.image_pair import ImageDifference, ImagePair
from cldit.accuracy.variant_tracer import VariantTracer
from cldit.errors import SprayError, TransportError

_ORDERS = (1.0, 2.0)
SAFE = 0.92  # of an error asked for: what cells aim at by an estimate on others
_OUTSIDE = 2.5  # observed order from which the coarsest grid is outside the asymptotic range


@dataclass(frozen=True)
class RichardsonEstimate:
    """Error of one of three images, the finest if nothing else is said.

    order: of convergence. difference: the error, with its map. sizes: of the three images' cells
    over those of the one. bound_K: outside the asymptotic range, the larger error by first order
    from either difference; else None. shown: true if the order is observed between the limits.
    """

    order: float
    difference: ImageDifference
    sizes: tuple[float, float, float] = (1.0, 2.0, 4.0)
    bound_K: float | None = None
    shown: bool = False

    @classmethod
    def of(
        cls,
        coarse_step: ImageDifference,
        fine_step: ImageDifference,
        *,
        once: float = 2.0,
        twice: float = 4.0,
    ) -> RichardsonEstimate:
        """Takes two differences of images on cells of h, `once` h and `twice` h.

        With an error of C h^p, `coarse_step` (`twice` h against `once` h) is C h^p (twice^p -
        once^p), and `fine_step` (`once` h against h) is C h^p (once^p - 1).
        """
        order, bound_K, shown = _ORDERS[0], None, False
        if coarse_step.error_K and fine_step.error_K:
            ratio = coarse_step.error_K / fine_step.error_K

            def above(p: float) -> float:
                return float((twice**p - once**p) / (once**p - 1.0)) - ratio

            low, high = _ORDERS
            if above(high) < 0.0:
                order = (low + high) / 2
            if above(_OUTSIDE) < 0.0:
                order = low
                steps = (fine_step.error_K, once - 1.0), (coarse_step.error_K, twice - once)
                bound_K = max(error_K / size for error_K, size in steps)
            elif -1e-6 * ratio <= above(high) <= 0.0:
                order, shown = high, True
            elif above(low) < 0.0 < above(high):
                order, shown = float(scipy.optimize.brentq(above, low, high, xtol=1e-6)), True
        error = fine_step.times(1.0 / (once**order - 1.0))
        return cls(order, error, (1.0, once, twice), bound_K, shown)

    def at(self, size: float) -> RichardsonEstimate:
        """The error on another of the three grids, `size` times as coarse as the finest."""
        factor = size**self.order
        bound_K = None if self.bound_K is None else factor * self.bound_K
        return replace(self, difference=self.difference.times(factor), bound_K=bound_K)

    @property
    def error_K(self) -> float:
        """The error; 0 where no pixel shows it."""
        return self.difference.error_K or 0.0

    @property
    def most_K(self) -> float:
        """The larger one of error and bound."""
        return max(self.error_K, self.bound_K or 0.0)


def extrapolated(
    name: str, method: str, estimates: Sequence[RichardsonEstimate], **options: Any
) -> Estimate:
    """Error of a source, of the order of the result with the larger one."""
    method += f", extrapolated by order {estimates[0].order:.2g}"
    differences = [estimate.difference for estimate in estimates]
    order = max(estimates, key=lambda estimate: estimate.error_K).order
    return Estimate.of(name, differences, method, order=order, **options)


def richardson(
    tracer: VariantTracer, images: Sequence[ImagePair], *, once: float = 2.0, twice: float = 4.0
) -> list[RichardsonEstimate]:
    """Estimates of both results from images on cells of h, `once` h and `twice` h."""
    fine_step, coarse_step = (tracer.difference(*pair) for pair in pairwise(images))
    steps = zip(coarse_step, fine_step, strict=True)
    return [RichardsonEstimate.of(*pair, once=once, twice=twice) for pair in steps]


def error_at(tracer: VariantTracer, cell_m: float) -> list[RichardsonEstimate] | None:
    """Errors of both results by cells of this edge; None: they cannot be estimated."""
    if 4 * cell_m > tracer.prepared.cube.edge_m * (1 + 1e-9):
        return None
    tracer.level(cell_m)
    try:
        sizes, images = zip(*tracer.grids(cell_m), strict=True)
    except (SprayError, TransportError):  # no cone has the lattice, or cells reach behind a patch
        return None
    finest, once, twice = sizes
    estimates = richardson(tracer, images, once=once / finest, twice=twice / finest)
    if estimates[0].difference.error_K is None:
        return None
    return [replace(estimate.at(1.0 / finest), sizes=sizes) for estimate in estimates]
