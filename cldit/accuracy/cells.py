"""Which cells a picture needs: each of a few coarse ones costs an eighth of the next.

From cells of edge h to the next of h / 2 the error falls by 2^p. With d(h) the difference of the
pictures at 2 h and h, the order is p = log2(d(2 h) / d(h)), and the error at h is d(h) / (2^p - 1)
(Roache, J. Fluids Eng. 116, 405, 1994); other ratios of size likewise. Orders are between 1, that
of even cells, and 2, that of linear ones. Steps that fall faster tell no order: the coarsest cells
miss what the others have. First order is taken then, and finer cells tell more.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from scipy.optimize import brentq

from cldit.accuracy.picture import Picture, Step
from cldit.accuracy.pilot import Pilot
from cldit.errors import MediumError, SprayError, TransportError

_ORDERS = (1.0, 2.0)
_FINEST = 12  # 4096 cells along an edge
_SAFE = 0.92  # of the wanted error, which what is foretold is aimed at
_FORETOLD, _LEAST = 1.4, 0.35  # order, and how far cells are foretold
_CLOSE = 1.1  # of the wanted error: a pilot of the picture's own cells costs as much as that
_ACROSS = 32  # cells across the picture, of the coarsest pilot


_ALL_HALVINGS = (
    f"the cube is halved {_FINEST} times at most; allowed is a smaller domain.edge_m, or a larger "
    "transport.accuracy_K"
)


def too_many(cell_m: float) -> str:
    """Why cells are not finer, and what is allowed, where memory is too small.

    Args:
        cell_m: of cells that it does not hold.
    """
    return (
        f"memory does not hold cells of {1e3 * cell_m:.3g} mm; allowed is a machine of more "
        "memory, or a larger transport.accuracy_K"
    )


def too_fine(spacing_m: float) -> str:
    """Why lattice and cells are not finer, and what is allowed, where a cone takes none.

    Args:
        spacing_m: of the finest lattice that it takes.
    """
    return (
        f"the cone takes no lattice finer than {1e3 * spacing_m:.3g} mm; allowed is a larger "
        "transport.accuracy_K"
    )


@dataclass(frozen=True)
class Refined:
    """What two coarser pictures say of the error that is left.

    order: p. step: error of the finest, with its map. sizes: of the three pictures' cells over that
    of the finest. most_K: where the steps fall faster than second order allows, so that no order is
    known, what the larger of both says by first order; else None.
    """

    order: float
    step: Step
    sizes: tuple[float, float, float] = (1.0, 2.0, 4.0)
    most_K: float | None = None

    @classmethod
    def of(cls, before: Step, last: Step, *, once: float = 2.0, twice: float = 4.0) -> Refined:
        """From two differences of pictures on cells of h, `once` h and `twice` h.

        With an error of C h^p, `before` is C h^p (twice^p - once^p), `last` C h^p (once^p - 1).

        Args:
            before: of `twice` h against `once` h.
            last: of `once` h against h.
            once, twice: above 1, and above `once`.
        """
        order, most_K = _ORDERS[0], None
        if before.error_K and last.error_K:
            ratio = before.error_K / last.error_K

            def above(p: float) -> float:
                return float((twice**p - once**p) / (once**p - 1.0)) - ratio

            low, high = _ORDERS
            if above(high) < -1e-6 * ratio:
                most_K = max(last.error_K / (once - 1.0), before.error_K / (twice - once))
            elif above(high) <= 0.0:
                order = high
            elif above(low) < 0.0:
                order = float(brentq(above, low, high, xtol=1e-6))
        step = last.times(1.0 / (once**order - 1.0))
        return cls(order, step, (1.0, once, twice), most_K)


@dataclass(frozen=True)
class Cells:
    """The chosen cells.

    depth: how often the cube is halved. limited: why it is not halved more often, where the wanted
    error needs it; else empty. error_K: found, or foretold; None: it cannot be said. less:
    edge of the chosen cells over that of `depth`, where any edge is possible.
    """

    depth: int
    error_K: float | None
    limited: str = ""
    less: float = 1.0


def error_at(pilot: Pilot, depth: int) -> Refined | None:
    """Error of the cells of a cube; None: it cannot be said.

    Args:
        pilot: traces.
        depth: how often the cube is halved.
    """
    if depth < 2:
        return None
    fine = pilot.level(depth)
    try:
        (once, coarser), (twice, coarsest) = pilot.coarser(depth)
    except (SprayError, TransportError):  # no cone has the lattice, or cells reach behind a patch
        return None
    before, last = pilot.step(coarser, coarsest), pilot.step(fine, coarser)
    return None if last.error_K is None else Refined.of(before, last, once=once, twice=twice)


def coarse_depths(pilot: Pilot) -> range:
    """How often the cube is halved for coarse pilots: the first is the coarsest to try.

    Args:
        pilot: traces.
    """
    across = pilot.scene.camera.field_m
    depth = max(3, math.ceil(math.log2(_ACROSS * pilot.probed.frame.edge_m / max(across))))
    return range(min(depth, _FINEST - 3), _FINEST - 2)


def foretold_cells(pilot: Pilot, depth: int) -> Cells:
    """Cells that the scene fixes, with the error that coarser ones foretell.

    Args:
        pilot: traces.
        depth: of the fixed cells.
    """
    return Cells(depth, foretold_error(pilot, depth)[0])


def foretold_error(pilot: Pilot, depth: int) -> tuple[float | None, bool]:
    """The error of cells that coarser ones foretell, and whether it is an upper bound.

    Args:
        pilot: traces.
        depth: of the cells.

    Returns:
        The error in K, None where it cannot be said; and whether the steps tell no order.
    """
    found = error_at(pilot, depth - 1)
    if found is None or found.step.error_K is None:
        return None, False
    return found.step.error_K / 2**found.order, found.most_K is not None


def choose_cells(
    pilot: Pilot, allowed_K: Callable[[Picture], float], say: Callable[[str], None]
) -> Cells | None:
    """The largest cells whose error is as allowed; None: no pixel says which.

    Goes on until the error that is foretold for the next finer cells is small enough, so that these
    are traced once, for the picture.

    Args:
        pilot: traces.
        allowed_K: error that the cells may have, by what their picture tells of other causes.
        say: told of each trace.

    Raises:
        SprayError: the cone takes none of the coarse lattices.
        TransportError: cells reach behind a patch, however small.
        MediumError: not even coarse cells fit the memory.
    """
    frame = pilot.probed.frame
    coarse = coarse_depths(pilot)
    depth, traced = coarse[0], 0
    while traced < 2:
        say(f"pilot: cells of {1e3 * frame.edge_m / 2**depth:.3g} mm")
        try:
            pilot.level(depth)
            traced += 1
        except (SprayError, TransportError):  # as in `error_at`
            if depth >= coarse[-1]:
                raise
            traced = 0
        depth += 1
    while True:
        cell_mm = 1e3 * frame.edge_m / 2**depth
        say(f"pilot: cells of {cell_mm:.3g} mm")
        try:
            found = error_at(pilot, depth)
        except MediumError:
            before = error_at(pilot, depth - 1)
            error_K = None if before is None else before.step.error_K
            return Cells(depth - 1, error_K, too_many(frame.edge_m / 2**depth))
        except SprayError:
            # The finest lattice that the cone takes lies between: the run finds it, step by step.
            return foretold_cells(pilot, depth)
        if found is None or found.step.error_K is None:
            return None
        wanted_K = allowed_K(pilot.level(depth))
        if found.most_K is not None and found.most_K > wanted_K and depth < _FINEST:
            depth += 1  # what the coarsest cells miss is none of what these do
            continue
        # Coarse cells foretell too high an order: what it may be for the next is bounded.
        less = (_SAFE * wanted_K / found.step.error_K) ** (1.0 / min(found.order, _FORETOLD))
        if pilot.probed.on_lattice and less >= _LEAST:
            return Cells(depth, _SAFE * wanted_K, less=min(less, 1.0))
        if found.step.error_K <= wanted_K:
            return Cells(depth, found.step.error_K)
        if depth == _FINEST:
            return Cells(depth, found.step.error_K, _ALL_HALVINGS)
        foretold_K = found.step.error_K / 2**found.order
        if foretold_K <= _CLOSE * wanted_K:
            return Cells(depth + 1, foretold_K)
        if depth + 1 == _FINEST:
            return Cells(depth + 1, foretold_K, _ALL_HALVINGS)
        depth += 1
